//! The hot kernels, and what each backend owes to the specification.
//!
//! A backend from outside, which counts calls and leaves the work to the CPU:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//!
//! use crossfield::backend::{ChartDistortion, CrossfieldBackend};
//! use crossfield::geom_core::compute::BackendError;
//! use crossfield::geom_core::surface::flow::{Corner, CornerBackend, CornerDistortion};
//! use crossfield::geom_core::{Backend, Cpu, Run, mesh::shapes};
//! use crossfield::map::Chart;
//! use crossfield::{Error, Options, quadrangulate};
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
//! impl CrossfieldBackend for Counting {
//!     fn chart_distortion(
//!         &self,
//!         charts: &[Chart],
//!         corners: &[[[f64; 2]; 3]],
//!         epsilon: f64,
//!         out: &mut Vec<ChartDistortion>,
//!     ) -> Result<(), Error> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.chart_distortion(charts, corners, epsilon, out)
//!     }
//! }
//!
//! let backend = Counting::default();
//! let sphere = shapes::icosphere(1.0, 2);
//! let made = quadrangulate(&sphere, &Options::default(), Run::on(&backend))?;
//! assert_eq!(made.report.backend, "counting");
//! assert!(backend.0.load(Ordering::Relaxed) > 0);
//! # Ok::<(), Error>(())
//! ```

use geom_core::Agreement;
use geom_core::surface::flow::CornerBackend;

use crate::Error;
use crate::map::Chart;

/// The hot kernels of this crate: that of corners, and its own.
pub trait CrossfieldBackend: CornerBackend + CrossfieldObject {
    /// The distortion of each triangle of a map and its derivatives, in place of what was in `out`, whose memory is used again;
    /// ε as in [`ChartDistortion`].
    fn chart_distortion(
        &self,
        charts: &[Chart],
        corners: &[[[f64; 2]; 3]],
        epsilon: f64,
        out: &mut Vec<ChartDistortion>,
    ) -> Result<(), Error>;
}

geom_core::backend_object!(CrossfieldObject, as_crossfield -> CrossfieldBackend);

/// A run on any of them.
pub(crate) type On<'a> = geom_core::Run<'a, dyn CrossfieldBackend + 'a>;

/// How far the map of a triangle is from what is wanted: `A ((|J|² + det² + 1) / 2χ + |J − 1|²)`,
/// `χ = (det + √(ε² + det²)) / 2`: finite for inverted triangles while ε > 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChartDistortion {
    /// The distortion.
    pub energy: f64,
    /// Its derivatives with respect to the coordinates of the corners.
    pub gradient: [[f64; 2]; 3],
}

/// What a backend owes to [`CrossfieldBackend::chart_distortion`], for energies and derivatives over the energy: f32 with
/// coordinates relative to the first corner. The determinant of a nearly flat triangle loses digits, which ε bounds:
/// for ε ≥ 0.01.
pub const CHART_DISTORTION: Agreement = Agreement::Bounded {
    relative: 1e-3,
    absolute: 1e-3,
};
