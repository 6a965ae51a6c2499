// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]
//!
//! # The map, in the order of the data
//!
//! - [`shape`]: lattice points inside a body: graph, boundary, skeleton, diameters, modes.
//! - [`fit`]: how far a map is from rigid in each neighbourhood, and fits that lower it.
//! - [`start`]: where the search may start.
//! - [`correspond`](mod@correspond): the search, its verdict, the joint modes.
//! - [`morph`]: shapes between two shapes.
//! - [`compare`](mod@compare): where, and how much, matched shapes differ.
//! - [`truth`]: the true map of a protein in two poses, from its atoms.
//!
//! Beside them [`backend`] (the kernels, and what another backend owes), [`options`] and [`Error`].

pub use geom_core;

pub mod backend;
pub mod compare;
pub mod correspond;
mod cpu;
mod error;
pub mod fit;
pub mod morph;
mod near;
pub mod options;
pub mod shape;
#[cfg(feature = "testing")]
pub mod specification;
pub mod start;
pub mod truth;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use backend::CorrespBackend;
pub use compare::{CompareReport, Comparison, compare};
pub use correspond::{Correspondence, JointModes, Verdict, correspond};
pub use error::Error;
pub use morph::{Frame, Morph};
pub use options::{
    CompareOptions, Components, Directions, MatchOptions, MorphOptions, Refine, ShapeOptions, Start,
};
pub use shape::{Map, VoxelShape};
pub use truth::{Truth, TruthReport};
