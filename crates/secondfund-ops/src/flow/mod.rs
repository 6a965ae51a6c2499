//! Smoothing: geometric flows by an operator, and the bilateral normal filter beside them.

mod bilateral;
mod guard;
mod steps;
mod tangential;

pub use bilateral::{BilateralOptions, filter_normals};
pub use steps::{FlowReport, Smoothed, smooth, smooth_quads};
