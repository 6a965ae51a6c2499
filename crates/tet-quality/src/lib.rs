#![doc = include_str!("../README.md")]

pub use geom_core;

pub mod backend;
mod boundary;
mod cpu;
mod error;
mod improve;
pub mod measure;
mod mesh;
mod operations;
mod options;
mod smoothing;
#[cfg(feature = "testing")]
pub mod testing;
#[cfg(feature = "wgpu")]
mod wgpu;

pub mod surface;

pub use backend::{QualityBackend, Relaxation};
pub use error::Error;
pub use improve::{Improved, Pass, Report, improve};
pub use measure::metrics::{self, Measures, aspect_ratio, measures, radius_ratio};
pub use measure::report::{QualityReport, Summary, quality_report};
pub use measure::unmet::{Cause, Exceptions, SurfaceFit};
pub use options::{Goals, Operations, Options, SurfaceMotion};
