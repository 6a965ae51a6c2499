// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]
//!
//! ## Map
//!
//! In the order of the data; each folder uses only those above it.
//!
//! | | |
//! |---|---|
//! | [`Options`], [`Error`] | what to compute, and why not |
//! | [`backend`], `cpu`, `wgpu` | the hot kernel: what a backend is handed and owes, and the two that are here |
//! | `kernel/` | the loops of the CPU over many cells at a time: ranges, signs, dual vertices, fans, volumes |
//! | `octree/` | the lattice of the finest cells, values and labels at its points, the octree and its sizes |
//! | `complex/` | the base complex over the leaves: cells, corners, rings of cells around edges; vertex numbers |
//! | `dual/` | dual contouring: where points belong, how far they may go, triangles and tetrahedra |
//! | `contour/` | the two verbs [`surface`] and [`volume`], their road from values to meshes, and the other meshers: `uniform/`, cells of one size without an octree, and `stuffing/` |
//! | `specification` | the kernels as the equations read (feature `testing`) |

pub use geom_core;

pub mod backend;
mod complex;
mod contour;
mod cpu;
mod dual;
mod error;
#[cfg(feature = "testing")]
#[doc(hidden)]
pub mod inside;
mod kernel;
mod octree;
mod options;
#[cfg(feature = "testing")]
pub mod specification;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use backend::ContourBackend;
pub use contour::{HALO, LARGEST, Report, Surface, Volume, surface, tile, volume};
pub use error::Error;
pub use octree::FieldSamples;
pub use options::{
    AtBox, ErrorNorm, Extent, Material, Method, Options, Outer, Placement, Resolution, Shape, Zone,
};
