#![doc = include_str!("../README.md")]

pub use geom_core;

pub mod backend;
mod block;
mod contract;
mod cpu;
mod error;
pub mod exceptions;
mod flow;
mod gaps;
mod improve;
mod input;
mod insert;
pub mod metrics;
mod operate;
mod options;
mod own_surface;
mod patch;
mod proposal;
pub mod report;
mod ring;
mod search;
mod smooth;
mod surface_field;
mod swap;
#[cfg(feature = "testing")]
pub mod testing;
#[cfg(test)]
mod tests;
mod untangle;
mod walls;
#[cfg(feature = "wgpu")]
mod wgpu;
mod work;

pub use backend::{QualityBackend, Relaxation};
pub use error::Error;
pub use exceptions::{Cause, Exceptions, SurfaceFit};
pub use improve::{Improved, Pass, Report, improve};
pub use metrics::{Measures, aspect_ratio, measures, radius_ratio};
pub use options::{Goals, Operations, Options, SurfaceMotion};
pub use report::{QualityReport, Summary, quality_report};
