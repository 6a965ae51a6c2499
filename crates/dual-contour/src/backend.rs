//! The hot kernels: what a backend is handed, and what it owes.
//!
//! [`Cpu`](geom_core::Cpu) and `Wgpu` (feature `wgpu`) implement [`ContourBackend`]; so may a type from outside, here
//! one that lets the processor work and counts the blocks that it is handed:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
//!
//! use dual_contour::backend::{BLOCK_POINTS, ContourBackend};
//! use dual_contour::geom_core::{Aabb, Backend, Cpu, ImplicitField, Point3, Run, Vector3};
//! use dual_contour::{Error, FieldSamples, Options, surface};
//!
//! #[derive(Default)]
//! struct Counting {
//!     blocks: AtomicUsize,
//! }
//!
//! impl Backend for Counting {
//!     fn name(&self) -> String {
//!         "counting".to_owned()
//!     }
//! }
//!
//! impl ContourBackend for Counting {
//!     fn min_max(&self, blocks: &[f32], out: &mut Vec<[f32; 2]>) -> Result<(), Error> {
//!         self.blocks.fetch_add(blocks.len() / BLOCK_POINTS, Relaxed);
//!         Cpu.min_max(blocks, out)
//!     }
//!     fn crossings(&self, blocks: &[f32], level: f32, out: &mut Vec<u8>) -> Result<(), Error> {
//!         Cpu.crossings(blocks, level, out)
//!     }
//!     fn dual_vertices(
//!         &self,
//!         cells: &[[f32; 8]],
//!         steps: u32,
//!         out: &mut Vec<[f32; 3]>,
//!     ) -> Result<(), Error> {
//!         Cpu.dual_vertices(cells, steps, out)
//!     }
//! }
//!
//! /// Value 1 on a sphere of radius 3 Å.
//! struct Ball;
//! impl ImplicitField for Ball {
//!     fn value(&self, x: &Point3) -> f64 {
//!         4.0 - x.coords.norm()
//!     }
//!     fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
//!         (self.value(x), -x.coords.normalize())
//!     }
//! }
//!
//! # fn main() -> Result<(), Error> {
//! let bounds = Aabb::new(Point3::new(-4.0, -4.0, -4.0), Point3::new(4.0, 4.0, 4.0));
//! let values = FieldSamples::new(&Ball, &bounds, 0.5);
//! let counting = Counting::default();
//! let made = surface(&values, None, &Options::default(), Run::on(&counting))?;
//! assert_eq!(made.mesh.euler_characteristic(), 2);
//! assert_eq!(counting.blocks.into_inner(), 8, "16 cells along each axis");
//! # Ok(())
//! # }
//! ```

use geom_core::{Agreement, Backend};

use crate::Error;

/// Points per side of a block: 8 finest cells, closed.
pub const BLOCK_SIDE: usize = 9;
/// Values per block, x fastest.
pub const BLOCK_POINTS: usize = BLOCK_SIDE * BLOCK_SIDE * BLOCK_SIDE;
/// Finest cells per block, x fastest.
pub const BLOCK_CELLS: usize = 512;

/// Where the kernels of this crate run. A kernel replaces what is in `out` and uses its memory again. Calls come
/// from several threads.
pub trait ContourBackend: Backend + ContourObject {
    /// A capability, not a choice of results: how many blocks, or the cells with a surface of how many, the
    /// backend likes to get with one call where there are more; at least 1. By default as many as stay in the cache of a core;
    /// a device with a cost per call says more.
    fn blocks_per_call(&self) -> usize {
        64
    }

    /// The lowest and the highest of each block's [`BLOCK_POINTS`] values. Owes [`MIN_MAX`].
    fn min_max(&self, blocks: &[f32], out: &mut Vec<[f32; 2]>) -> Result<(), Error>;

    /// For each of the [`BLOCK_CELLS`] cells of each block: bit `x + 2y + 4z` is set if that corner's
    /// value is at least `level`. Owes [`CROSSINGS`].
    fn crossings(&self, blocks: &[f32], level: f32, out: &mut Vec<u8>) -> Result<(), Error>;

    /// The dual vertex of each cell from its corner values *minus the level* (corner `x + 2y + 4z`),
    /// in units of the cell: the mean of the crossings, then `steps` regularized Newton steps onto the
    /// level set of the trilinear interpolant. Owes [`DUAL_VERTICES`].
    ///
    /// Asked for finest cells by [`Placement::Newton`](crate::Placement) where no field is given; with a field,
    /// which only the processor can evaluate, all points are placed there.
    fn dual_vertices(
        &self,
        cells: &[[f32; 8]],
        steps: u32,
        out: &mut Vec<[f32; 3]>,
    ) -> Result<(), Error>;
}

geom_core::backend_object!(ContourObject, as_contour -> ContourBackend);

/// A run on any of them.
pub(crate) type On<'a> = geom_core::Run<'a, dyn ContourBackend + 'a>;

/// Comparisons alone: the same bits.
pub const MIN_MAX: Agreement = Agreement::Exact;
/// Comparisons alone: the same bits.
pub const CROSSINGS: Agreement = Agreement::Exact;
/// In cells. Confirmed on lavapipe with random corner values; four Newton steps amplify the rounding
/// of f32, most where the interpolant is nearly flat.
pub const DUAL_VERTICES: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 1e-4,
};
