//! Quad meshes: from an integer-grid map, exactly; improved; and the ladder that always ends with one.

mod extract;
mod improve;
mod ladder;
mod parts;
pub mod quality;
mod rungs;
mod smooth;
mod split;
mod trace;

pub use extract::{Extracted, SurfacePoint, extract};
#[cfg(feature = "testing")]
pub(crate) use improve::lengths;
pub use ladder::{Quadrangulation, Report, quadrangulate};
pub use rungs::{PartReport, Rung};
