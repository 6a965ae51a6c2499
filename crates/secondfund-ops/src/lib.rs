// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]
//!
//! # The map, in the order of the data
//!
//! - [`catmull`]: quads to their limit surface: subdivision, limit positions, patches.
//! - [`forms`]: the fundamental forms at a point, weights, and what an operator makes of them.
//! - [`operators`]: matrices and modes, on limit surfaces, on triangles and on Bézier elements of splines.
//! - [`segment`](mod@segment): modes to segments, and how far two segmentations differ.
//! - [`pockets`]: where a ligand may bind, and which part of the surface that is.
//! - [`flow`]: smoothing that keeps creases, and filters of normals.
//!
//! Beside them [`backend`] (the kernels, and what another backend owes), [`options`] and [`Error`].

pub use geom_core;

pub mod backend;
pub mod catmull;
mod cpu;
mod error;
pub mod flow;
pub mod forms;
#[cfg(feature = "testing")]
#[doc(hidden)]
pub mod inside;
pub mod operators;
pub mod options;
pub mod pockets;
pub mod segment;
#[cfg(feature = "testing")]
pub mod specification;
#[cfg(feature = "testing")]
pub mod testing;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use backend::OperatorBackend;
pub use catmull::Surface;
pub use error::Error;
pub use flow::{smooth, smooth_quads};
pub use forms::{Normals, Operator, Weight};
pub use operators::{BezierElement, BezierSurface, Element, Spectrum, spectrum};
pub use options::{
    FilterOptions, FlowOperator, FlowOptions, Groups, Modes, NormalFilter, OutlineOptions,
    PartOptions, PocketOptions, SegmentOptions, SpectrumOptions,
};
pub use segment::{Faces, Segments, segment};
