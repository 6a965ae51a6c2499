#![doc = include_str!("../README.md")]

pub use geom_core;

mod backend;
mod build;
mod complex;
mod cpu;
mod cut;
mod dual;
mod emit;
mod error;
mod field;
mod lanes;
mod lattice;
mod octree;
mod options;
mod quality;
mod report;
mod samples;
mod sizing;
mod surface;
mod uniform;
mod volume;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use backend::{
    BLOCK_CELLS, BLOCK_POINTS, BLOCK_SIDE, CROSSINGS, ContourBackend, DUAL_VERTICES, MIN_MAX,
};
pub use error::Error;
pub use field::FieldSamples;
pub use options::{
    AtBox, ErrorNorm, Extent, Material, Method, Options, Outer, Placement, Resolution, Shape, Zone,
};
pub use report::Report;
pub use surface::{Surface, surface};
pub use volume::{Volume, volume};
