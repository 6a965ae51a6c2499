//! Smoothing: geometric flows by an operator, and the filters of normals beside them.

mod bilateral;
mod filter;
mod guard;
mod sheet;
mod steps;
mod tangential;
mod variation;
mod volume;

pub use filter::{filter_normals, filter_quad_normals};
pub use steps::{FlowReport, Smoothed, smooth, smooth_quads};
