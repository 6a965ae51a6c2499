//! Segmentation: from modes to one label per face.
//!
//! The rows `(φ₁/√λ₁, …, φ_K/√λ_K)` of the vertices are grouped around medoids; the groups become
//! connected patches with smooth borders.

pub(crate) mod clean;
mod cluster;
mod consensus;
mod embed;
mod faces;
pub mod metrics;
mod parts;
pub mod rivals;
mod run;

pub use cluster::{Medoids, davies_bouldin, medoids};
pub use consensus::consensus;
pub use faces::Faces;
pub use parts::{Parts, parts};
pub use run::{GroupChoice, Segments, segment};
