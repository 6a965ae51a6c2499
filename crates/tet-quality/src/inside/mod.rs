//! Laws of what is not public, for the tests: `tests/inside.rs` runs those that take nothing.

mod boundary;
mod links;
mod measures;
mod operations;
mod walls;

pub use boundary::*;
pub use links::*;
pub use measures::*;
pub use operations::*;
pub use walls::*;

use geom_core::Point3;

/// The factor that makes the Joe–Liu measure of a regular tetrahedron 1.
pub const JOE_LIU: f64 = crate::measure::metrics::JOE_LIU;

/// The sine of the smallest dihedral angle, with the sign of the volume.
pub fn quality(corners: [Point3; 4]) -> f64 {
    crate::measure::metrics::quality(corners)
}
