// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]

pub use geom_core;

// In the order in which data flow: directions for some triangles; a cross in every triangle; the map whose lines follow
// the crosses, closer to each other along a function's gradient; quads between the lines.
pub mod anisotropy;
pub mod field;
pub mod guidance;
pub mod map;
pub mod quads;
// What to compute, where, and why not.
pub mod backend;
mod cpu;
mod error;
pub mod options;
#[cfg(feature = "testing")]
pub mod specification;
#[cfg(not(feature = "testing"))]
#[expect(unreachable_pub, reason = "public for tests only")]
mod specification;
#[cfg(feature = "testing")]
pub mod testing;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use anisotropy::Anisotropy;
pub use backend::CrossfieldBackend;
pub use error::Error;
pub use field::{CrossField, cross_field};
pub use guidance::Guidance;
pub use options::{FieldOptions, Ladder, Options, Size};
pub use quads::{Quadrangulation, Report, quadrangulate};
