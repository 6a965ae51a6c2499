//! Smoothing: geometric flows by an operator, and the filters of normals beside them.

mod bilateral;
mod filter;
pub(crate) mod guard;
pub(crate) mod sheet;
pub(crate) mod steps;
mod tangential;
mod variation;
mod volume;

pub use filter::{filter_normals, filter_quad_normals};
pub use steps::{FlowReport, Smoothed, smooth, smooth_quads};
