// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]

pub use geom_core;

// The verb, and what it takes and gives.
mod error;
mod improve;
mod options;
mod outcome;

// From the ground up: the folders in the order in which data passes through them.

/// What boundaries and interfaces allow: how vertices may move, and the guard of cavities and gaps.
mod boundary;
/// What tetrahedra are like, the statistics of a mesh, and what falls short of the goals.
pub mod measure;
/// The mesh while it is changed: what lies around a vertex, links, proposals.
mod mesh;
/// Replacements of tetrahedra, alone or with the smoothing that they need.
mod operations;
/// Moves of vertices: the star of one, the search for its best place, sweeps over many.
mod smoothing;

// The kernels: the trait, what it owes, and who has them.
pub mod backend;
mod cpu;
#[cfg(feature = "testing")]
pub mod specification;
#[cfg(feature = "wgpu")]
mod wgpu;

#[cfg(feature = "testing")]
#[doc(hidden)]
pub mod inside;
#[cfg(feature = "testing")]
pub mod testing;

pub use backend::QualityBackend;
pub use error::Error;
pub use improve::{improve, improve_part};
pub use measure::block::measures;
pub use measure::metrics::{Measures, aspect_ratio, radius_ratio};
pub use measure::report::{QualityReport, Summary, quality_report};
pub use measure::unmet::{Cause, SurfaceFit, Unmet};
pub use options::{Goals, Operations, Options, SurfaceMotion};
pub use outcome::{Crossings, Improved, Pass, Report};
