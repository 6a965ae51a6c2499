//! The hot kernels, and what each backend owes to the specification.
//!
//! A backend may come from outside of this crate; this one counts its calls:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//! use secondfund_ops::backend::{OperatorBackend, TriangleTask};
//! use secondfund_ops::forms::TriangleMatrix;
//! use secondfund_ops::geom_core::{Backend, Cpu, Run, mesh::shapes};
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

use crate::Error;
use crate::forms::{Conductor, TriangleMatrix};

/// The hot kernels of this crate. [`Cpu`](geom_core::Cpu) is the specification.
pub trait OperatorBackend: Backend + OperatorObject {
    /// The matrices of every triangle of a task, in place of what was in `out`.
    fn triangle_matrices(
        &self,
        task: &TriangleTask<'_>,
        out: &mut Vec<TriangleMatrix>,
    ) -> Result<(), Error>;

    /// The distances between all pairs of `rows` (of `width` numbers each), row after row: the
    /// dissimilarities of the medoids, in place of what was in `out`.
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
    pub factors: &'a [f64],
    /// The operator.
    pub conductor: Conductor,
}

/// What a backend owes to [`OperatorBackend::triangle_matrices`], for the values of a triangle over its
/// own largest one: f32 from the differences of positions and normals on.
pub const TRIANGLE_MATRICES: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 2e-4,
};

/// What a backend owes to [`OperatorBackend::distances`], for rows of numbers up to 1: the square root
/// of a sum of at most 32 squares in f32.
pub const DISTANCES: Agreement = Agreement::Bounded {
    relative: 1e-5,
    absolute: 1e-6,
};
