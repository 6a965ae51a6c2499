//! The hot kernels, and what each backend owes to the specification.
//!
//! A backend may come from outside of this crate; this one counts its calls:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//! use secondfund_ops::backend::{OperatorBackend, PatchMatrices, PatchTask, TriangleTask};
//! use secondfund_ops::forms::TriangleMatrix;
//! use secondfund_ops::geom_core::{Backend, Cpu, Run, Vector3, mesh::shapes};
//! use secondfund_ops::{Element, Error, Normals, SpectrumOptions, spectrum};
//!
//! #[derive(Default)]
//! struct Counting(AtomicUsize);
//!
//! impl Backend for Counting {
//!     fn name(&self) -> String {
//!         "counting".to_owned()
//!     }
//! }
//!
//! impl OperatorBackend for Counting {
//!     fn triangle_matrices(&self, task: &TriangleTask<'_>, out: &mut Vec<TriangleMatrix>) -> Result<(), Error> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.triangle_matrices(task, out)
//!     }
//!     fn patch_matrices(&self, task: &PatchTask<'_>, out: &mut PatchMatrices) -> Result<(), Error> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.patch_matrices(task, out)
//!     }
//!     fn patch_forces(&self, task: &PatchTask<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.patch_forces(task, out)
//!     }
//!     fn distances(&self, rows: &[f32], width: usize, out: &mut Vec<f32>) -> Result<(), Error> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.distances(rows, width, out)
//!     }
//! }
//!
//! let (sphere, normals, counting) = (shapes::icosphere(1.0, 2), Normals::default(), Counting::default());
//! let element = Element::Triangles(&sphere, &normals);
//! spectrum(&element, &SpectrumOptions::default(), Run::on(&counting))?;
//! assert_eq!(counting.0.into_inner(), 1);
//! # Ok::<(), Error>(())
//! ```

use geom_core::{Agreement, Backend, Point3, Vector3};
use rayon::prelude::*;

use crate::Error;
use crate::forms::{Conductor, TriangleMatrix};

/// The hot kernels of this crate. [`Cpu`](geom_core::Cpu) and [`Wgpu`](geom_core::Wgpu) have them; what they compute
/// stands in `specification` (feature `testing`) as the equations read.
pub trait OperatorBackend: Backend + OperatorObject {
    /// The matrices of every triangle of a task, in place of what was in `out`.
    /// One entry per triangle, in order. A triangle without area has zeros; one on which the operator is infinite has
    /// values that are not finite, and the caller names it in its error.
    fn triangle_matrices(
        &self,
        task: &TriangleTask<'_>,
        out: &mut Vec<TriangleMatrix>,
    ) -> Result<(), Error>;

    /// The matrices of every patch of a task, in place of what was in `out`.
    /// Points whose area element is not above [`PatchTask::least`] are left out and counted.
    fn patch_matrices(&self, task: &PatchTask<'_>, out: &mut PatchMatrices) -> Result<(), Error>;

    /// `∫ Nᵢ_a A^{ab} x_b dA` for every function of every patch of a task, patch after patch: the stiffness applied to the
    /// surface itself, in place of what was in `out`.
    /// In unit scale, one vector per entry of [`PatchTask::points`].
    fn patch_forces(&self, task: &PatchTask<'_>, out: &mut Vec<Vector3>) -> Result<(), Error>;

    /// The distances between all pairs of `rows` (of `width` numbers each), row after row: the
    /// dissimilarities of the medoids, in place of what was in `out`.
    /// `n²` of them for n rows: row i holds the distances from row i, its own zero included.
    fn distances(&self, rows: &[f32], width: usize, out: &mut Vec<f32>) -> Result<(), Error>;
}

geom_core::backend_object!(OperatorObject, as_operators -> OperatorBackend);

/// A run on any of them.
pub(crate) type On<'a> = geom_core::Run<'a, dyn OperatorBackend + 'a>;

/// Triangles whose matrices are wanted, in unit scale.
#[derive(Clone, Debug)]
pub struct TriangleTask<'a> {
    /// Positions of the vertices.
    pub positions: &'a [Point3],
    /// Unit normals of the vertices.
    pub normals: &'a [Vector3],
    /// Corners per triangle, in range.
    pub triangles: &'a [[u32; 3]],
    /// The value of the weight's fields per vertex; empty for 1 everywhere.
    /// A triangle takes the mean of its corners.
    pub factors: &'a [f64],
    /// The operator.
    pub conductor: Conductor,
}

/// Patches of a surface that share a basis, in unit scale. A patch is a sum of `functions` functions over a piece of the
/// parameters, integrated at `weights.len()` points.
#[derive(Clone, Copy, Debug)]
pub struct PatchTask<'a> {
    /// The functions of a patch.
    pub functions: usize,
    /// The weight of each point of the quadrature.
    pub weights: &'a [f64],
    /// Per point six rows of a number per function: value, derivatives u, v, uu, uv, vv.
    pub basis: &'a [f64],
    /// The coefficients of the functions, patch after patch.
    /// A multiple of `functions`; a vertex in several patches stands here once for each.
    pub points: &'a [Point3],
    /// The value of the weight's fields for each of `points`; empty for 1 everywhere.
    pub factors: &'a [f64],
    /// The operator.
    pub conductor: Conductor,
    /// Area elements of this and below count as none, and their points as left out.
    pub least: f64,
    /// Are the mass matrices wanted?
    pub mass: bool,
}

impl PatchTask<'_> {
    /// The number of patches.
    pub fn patches(&self) -> usize {
        self.points.len().checked_div(self.functions).unwrap_or(0)
    }
}

/// What patches add to the matrices of a surface, patch after patch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PatchMatrices {
    /// Packed upper halves of `∫ Nᵢ_a A^{ab} Nⱼ_b dA`, row after row.
    pub stiffness: Vec<f64>,
    /// Packed upper halves of `∫ Nᵢ Nⱼ dA`; empty where a task does not want them.
    pub mass: Vec<f64>,
    /// Per function `∫ Nᵢ dA`, `∫ Nᵢ H dA`, `∫ Nᵢ K dA`.
    pub sums: Vec<[f64; 3]>,
    /// Per patch the points without an area.
    pub skipped: Vec<u32>,
}

/// Places of the numbers of a patch.
pub(crate) struct Slots<'a> {
    pub(crate) stiffness: &'a mut [f64],
    /// Empty where no mass is wanted.
    pub(crate) mass: &'a mut [f64],
    pub(crate) sums: &'a mut [[f64; 3]],
    pub(crate) skipped: &'a mut u32,
}

impl PatchMatrices {
    /// Zeros for the patches of a task.
    /// Memory is used again, so that a caller may keep one for many tasks.
    pub fn reset(&mut self, task: &PatchTask<'_>) {
        let (n, patches) = (task.functions, task.patches());
        let entries = patches * n * (n + 1) / 2;
        fn refill<T: Clone>(values: &mut Vec<T>, count: usize, zero: T) {
            if values.capacity() < count {
                // Pages that nobody has touched: those who fill them share that.
                *values = vec![zero; count];
            } else {
                values.clear();
                values.resize(count, zero);
            }
        }
        refill(&mut self.stiffness, entries, 0.0);
        refill(&mut self.mass, if task.mass { entries } else { 0 }, 0.0);
        refill(&mut self.sums, patches * n, [0.0; 3]);
        refill(&mut self.skipped, patches, 0);
    }

    /// Where the numbers of each patch of a task belong.
    pub(crate) fn slots<'a>(
        &'a mut self,
        task: &PatchTask<'_>,
    ) -> impl IndexedParallelIterator<Item = Slots<'a>> {
        let n = task.functions;
        let size = n * (n + 1) / 2;
        let masses: Vec<&mut [f64]> = match task.mass {
            true => self.mass.chunks_mut(size).collect(),
            false => (0..task.patches()).map(|_| Default::default()).collect(),
        };
        (self.stiffness.par_chunks_mut(size))
            .zip(masses)
            .zip(self.sums.par_chunks_mut(n))
            .zip(&mut self.skipped)
            .map(|(((stiffness, mass), sums), skipped)| Slots {
                stiffness,
                mass,
                sums,
                skipped,
            })
    }

    /// Appends the patches of another.
    /// Patches keep their order: those of `other` come last.
    pub(crate) fn append(&mut self, mut other: Self) {
        if self.skipped.is_empty() {
            *self = other;
            return;
        }
        self.stiffness.append(&mut other.stiffness);
        self.mass.append(&mut other.mass);
        self.sums.append(&mut other.sums);
        self.skipped.append(&mut other.skipped);
    }
}

/// What a backend owes to [`OperatorBackend::triangle_matrices`], for the values of a triangle over its
/// own largest one: f32 from the differences of positions and normals on.
pub const TRIANGLE_MATRICES: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 2e-4,
};

/// What a backend owes to [`OperatorBackend::patch_matrices`] and [`OperatorBackend::patch_forces`], for the values of a
/// patch over its own largest one of their kind: f32 from the differences to the middle of a patch's points on.
pub const PATCH_MATRICES: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 2e-4,
};

/// What a backend owes to [`OperatorBackend::distances`], for rows of numbers up to 1: the square root
/// of a sum of at most 32 squares in f32.
pub const DISTANCES: Agreement = Agreement::Bounded {
    relative: 1e-5,
    absolute: 1e-6,
};
