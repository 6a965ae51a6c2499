// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]

pub use geom_core;

// What goes in: atoms, the tree above them with a power per node, decays.
mod model;

// What is asked, and why it cannot be done.
mod error;
mod options;

// Fewer atoms for the same surface.
mod atoms;

// From the model to values: on a lattice, near the surface, anywhere.
mod sample;

// The three hot kernels: what they are handed and owe, and where they run.
pub mod backend;
mod cpu;
#[cfg(feature = "wgpu")]
mod wgpu;

// What the kernels are made of, the lowest first.
mod kernel;

// What must hold, and what the thesis did otherwise.
#[cfg(feature = "testing")]
#[doc(hidden)]
pub mod inside;
#[cfg(feature = "testing")]
pub mod specification;
#[cfg(feature = "testing")]
pub mod testing;
#[cfg(feature = "thesis")]
pub mod thesis;

pub use atoms::eliminate::{Eliminated, Elimination, EliminationReport, Interior, Stop, eliminate};
pub use atoms::refit::{Refit, RefitReport, Refitted, refit};
pub use backend::DensityBackend;
pub use error::Error;
pub use model::copies::Copies;
pub use model::{Level, Levels, Model};
pub use options::{Cutoff, Options};
pub use sample::band::sample_band;
pub use sample::blocks::{Report, Sampled};
pub use sample::compare::{Comparison, compare};
pub use sample::dense::sample;
pub use sample::low_pass::{LowPass, Shape, low_pass};
pub use sample::point::{AtomGradient, PointSampler};
pub use sample::root::RootDensity;
pub use sample::window::sample_window;
