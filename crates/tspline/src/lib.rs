// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]

pub use geom_core;

// In the order in which data flow: how coarse each place may be; elements with T-junctions; better places for their
// corners.
pub mod levels;
pub mod mesh;
pub mod quality;
// Bézier patches and all that is done with them; what the functions are good for besides.
pub mod analysis;
pub mod files;
pub mod surface;
// What to compute, where, and why not.
pub mod backend;
mod cpu;
mod error;
pub mod options;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use backend::SplineBackend;
pub use error::Error;
pub use mesh::{Element, TMesh, VertexKind};
pub use options::{CleanOptions, Method, QualityOptions, TMeshOptions};
pub use quality::{Improved, improve};
pub use surface::{Basis, Extraction, Surface};
