//! The hot kernel: what a backend is handed, and what it owes.
//!
//! Only what computes is asked of a backend. What compares values, the range of a block and the signs at its corners,
//! is done where the values are: a device would get 2.9 KB of each block for a handful of comparisons. A field on a
//! device ([`ImplicitField::at_many`](geom_core::ImplicitField::at_many)) is asked by itself, for all cells and edges at a
//! time.
//!
//! [`Cpu`](geom_core::Cpu) and `Wgpu` (feature `wgpu`) implement [`ContourBackend`]; so may a type from outside, here
//! one that lets the processor work and counts the cells that it is handed:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
//!
//! use dual_contour::backend::ContourBackend;
//! use dual_contour::geom_core::{Aabb, Backend, Cpu, ImplicitField, Point3, Run, Vector3};
//! use dual_contour::{Error, FieldSamples, Options, surface};
//!
//! #[derive(Default)]
//! struct Counting {
//!     cells: AtomicUsize,
//! }
//!
//! impl Backend for Counting {
//!     fn name(&self) -> String {
//!         "counting".to_owned()
//!     }
//! }
//!
//! impl ContourBackend for Counting {
//!     fn dual_vertices(
//!         &self,
//!         cells: &[[f32; 8]],
//!         steps: u32,
//!         out: &mut Vec<[f32; 3]>,
//!     ) -> Result<(), Error> {
//!         self.cells.fetch_add(cells.len(), Relaxed);
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
//! assert!(counting.cells.into_inner() > made.report.surface_cells / 2, "the rest are cut");
//! # Ok(())
//! # }
//! ```

use geom_core::{Agreement, Backend};

use crate::Error;

/// Where the kernel of this crate runs. It replaces what is in `out` and uses its memory again. Calls come
/// from several threads.
pub trait ContourBackend: Backend + ContourObject {
    /// A capability, not a choice of results: the cells with a surface of how many blocks the backend likes to get
    /// with one call where there are more; at least 1. By default as many as stay in the cache of a core; a device with
    /// a cost per call says more.
    fn blocks_per_call(&self) -> usize {
        64
    }

    /// The dual vertex of each cell from its corner values *minus the level* (corner `x + 2y + 4z`),
    /// in units of the cell: the mean of the crossings, then `steps` regularized Newton steps onto the
    /// level set of the trilinear interpolant. Owes [`DUAL_VERTICES`].
    ///
    /// Asked for finest cells by [`Placement::Newton`](crate::Placement) where no field is given.
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

/// In cells. Confirmed on lavapipe with random corner values; four Newton steps amplify the rounding
/// of f32, most where the interpolant is nearly flat.
pub const DUAL_VERTICES: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 1e-4,
};
