//! Segmentation: from modes to one label per face.
//!
//! The rows `(φ₁/√λ₁, …, φ_K/√λ_K)` of the vertices are grouped around medoids; the groups become
//! connected patches with smooth borders.

mod clean;
mod cluster;
mod embed;
mod faces;
pub mod metrics;
mod run;

pub use cluster::{Medoids, davies_bouldin, medoids};
pub use faces::Faces;
pub use run::{GroupChoice, Segments, segment};
