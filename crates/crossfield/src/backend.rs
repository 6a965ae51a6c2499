//! The hot kernels, and what each backend owes to the specification.
//!
//! A backend from outside, which counts calls and leaves the work to the CPU:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//!
//! use crossfield::backend::{ChartDistortion, Corner, CornerDistortion, CrossfieldBackend};
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
//!     fn corner_distortion(
//!         &self,
//!         corners: &[Corner],
//!         epsilon: f64,
//!         out: &mut Vec<CornerDistortion>,
//!     ) -> Result<(), Error> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.corner_distortion(corners, epsilon, out)
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

pub use geom_core::mesh::quality::CornerDistortion;
use geom_core::{Agreement, Backend, Vector3};

use crate::Error;
use crate::map::Chart;

/// The hot kernels of this crate. Each replaces what was in `out`, whose memory is used again.
pub trait CrossfieldBackend: Backend + CrossfieldObject {
    /// The distortion of each triangle of a map and its derivatives; ε as in [`ChartDistortion`].
    fn chart_distortion(
        &self,
        charts: &[Chart],
        corners: &[[[f64; 2]; 3]],
        epsilon: f64,
        out: &mut Vec<ChartDistortion>,
    ) -> Result<(), Error>;

    /// The distortion of each corner of a quad mesh and its derivatives; ε as in [`CornerDistortion::of`].
    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
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

/// A corner of a quad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Its sides to the next corner and to the previous one, divided by their wanted lengths.
    pub sides: [Vector3; 2],
    /// Unit normal of the surface.
    pub normal: Vector3,
}

/// What a backend owes to [`CrossfieldBackend::chart_distortion`], for energies and derivatives over the energy: f32 with
/// coordinates relative to the first corner. The determinant of a nearly flat triangle loses digits, which ε bounds:
/// for ε ≥ 0.01.
pub const CHART_DISTORTION: Agreement = Agreement::Bounded {
    relative: 1e-3,
    absolute: 1e-3,
};

/// What a backend owes to [`CrossfieldBackend::corner_distortion`], as above.
pub const CORNER_DISTORTION: Agreement = Agreement::Bounded {
    relative: 1e-3,
    absolute: 1e-3,
};
