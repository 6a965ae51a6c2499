#![doc = include_str!("../README.md")]

pub use geom_core;

mod backend;
mod complex;
mod contour;
mod cpu;
mod dual;
mod error;
mod kernel;
mod octree;
mod options;
#[cfg(test)]
mod specification;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use backend::{
    BLOCK_CELLS, BLOCK_POINTS, BLOCK_SIDE, CROSSINGS, ContourBackend, DUAL_VERTICES, MIN_MAX,
};
pub use contour::{Report, Surface, Volume, surface, volume};
pub use error::Error;
pub use octree::FieldSamples;
pub use options::{
    AtBox, ErrorNorm, Extent, Material, Method, Options, Outer, Placement, Resolution, Shape, Zone,
};
