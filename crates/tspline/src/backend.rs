//! The hot kernels, and what each backend owes to the specification.
//!
//! A backend from outside, which counts calls and leaves the work to the CPU:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//!
//! use tspline::backend::{PointsTask, SamplesTask, SplineBackend};
//! use tspline::geom_core::compute::BackendError;
//! use tspline::geom_core::surface::flow::{Corner, CornerBackend, CornerDistortion};
//! use tspline::geom_core::{Backend, Cpu, Run, mesh::shapes};
//! use tspline::surface::{PatchPoints, Sample};
//! use tspline::{Error, QualityOptions, TMesh, TMeshOptions, improve};
//!
//! #[derive(Default)]
//! struct Counting(AtomicUsize);
//!
//! impl Backend for Counting {
//!     fn name(&self) -> String {
//!         "counting".into()
//!     }
//! }
//!
//! impl CornerBackend for Counting {
//!     fn corner_distortion(
//!         &self,
//!         corners: &[Corner],
//!         epsilon: f64,
//!         out: &mut Vec<CornerDistortion>,
//!     ) -> Result<(), BackendError> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.corner_distortion(corners, epsilon, out)
//!     }
//! }
//!
//! impl SplineBackend for Counting {
//!     fn bezier_points(&self, task: &PointsTask<'_>, out: &mut Vec<PatchPoints>) -> Result<(), Error> {
//!         Cpu.bezier_points(task, out)
//!     }
//!     fn bezier_samples(&self, task: &SamplesTask<'_>, out: &mut Vec<Sample>) -> Result<(), Error> {
//!         Cpu.bezier_samples(task, out)
//!     }
//! }
//!
//! let backend = Counting::default();
//! let (fine, sphere) = (shapes::quad_sphere(1.0, 4), shapes::icosphere(1.0, 3));
//! let mesh = TMesh::build(&fine, &[0; 96], &TMeshOptions::default())?;
//! let better = improve(mesh, &sphere, &QualityOptions::default(), Run::on(&backend))?;
//! assert_eq!(better.report.backend, "counting");
//! assert!(backend.0.load(Ordering::Relaxed) > 0);
//! # Ok::<(), Error>(())
//! ```

use geom_core::surface::flow::CornerBackend;
use geom_core::{Agreement, Point3};

use crate::Error;
use crate::surface::basis::Extraction;
use crate::surface::bezier::{PatchPoints, Sample};

/// The hot kernels of this crate: that of corners, and its own. Each replaces what was in `out`, whose memory is used again.
pub trait SplineBackend: CornerBackend + SplineObject {
    /// The Bézier points of every patch.
    fn bezier_points(&self, task: &PointsTask<'_>, out: &mut Vec<PatchPoints>)
    -> Result<(), Error>;

    /// Samples of every patch at all pairs of parameters, that along side 0 running fastest.
    fn bezier_samples(&self, task: &SamplesTask<'_>, out: &mut Vec<Sample>) -> Result<(), Error>;
}

geom_core::backend_object!(SplineObject, as_spline -> SplineBackend);

/// A run on any of them.
pub(crate) type On<'a> = geom_core::Run<'a, dyn SplineBackend + 'a>;

/// Control points of which Bézier points are wanted.
#[derive(Clone, Copy, Debug)]
pub struct PointsTask<'a> {
    /// The functions on the patches.
    pub extraction: &'a Extraction,
    /// One point per function, Å.
    pub controls: &'a [Point3],
}

/// Patches of which samples are wanted.
#[derive(Clone, Copy, Debug)]
pub struct SamplesTask<'a> {
    /// Their Bézier points.
    pub patches: &'a [PatchPoints],
    /// Parameters in 0…1.
    pub parameters: &'a [f64],
}

/// What a backend owes to [`SplineBackend::bezier_points`], for coordinates over the extent of all control points: sums of
/// some twenty f32.
pub const BEZIER_POINTS: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 1e-6,
};

/// What a backend owes to [`SplineBackend::bezier_samples`], for points and areas over the extent of their patch and its
/// square, and for normals of patches that are not degenerate: sums of sixteen f32 from differences taken before.
pub const BEZIER_SAMPLES: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 1e-5,
};
