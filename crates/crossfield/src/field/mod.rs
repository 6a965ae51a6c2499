//! Cross fields: four directions per triangle, smooth but for a few singular vertices.

mod descend;
mod diffuse;
#[expect(clippy::module_inception, reason = "the field of the folder's name")]
mod field;
pub mod frames;
mod near;
mod parallel;
pub mod singularity;
pub(crate) mod smooth;
pub(crate) mod solve;

#[cfg(feature = "testing")]
pub(crate) use descend::{NEAR, price};
pub use field::{CrossField, FieldReport, Guide, Toward};
pub use frames::Frames;
pub use solve::cross_field;
