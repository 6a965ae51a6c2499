//! Quad meshes: from an integer-grid map, exactly; improved; and the ladder that always ends with one.

pub(crate) mod extract;
pub(crate) mod improve;
mod ladder;
mod parts;
pub mod quality;
pub(crate) mod split;
mod trace;

pub use extract::SurfacePoint;
pub use ladder::{PartReport, Quadrangulation, Report, Rung, jacobians, quadrangulate};
