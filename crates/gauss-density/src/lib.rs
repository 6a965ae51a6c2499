#![doc = include_str!("../README.md")]

pub use geom_core;

mod backend;
mod band;
mod cpu;
mod error;
mod fast;
mod members;
mod model;
mod options;
mod plain;
mod point;
mod prepared;
mod reach;
mod sample;
#[cfg(feature = "testing")]
pub mod testing;

pub use backend::{BLOCK, BLOCK_POINTS, Block, BlockValues, DensityBackend, Job, SAMPLE_BLOCKS};
pub use band::sample_band;
pub use error::Error;
pub use model::{Level, Levels, Model};
pub use options::{Cutoff, Options};
pub use plain::nested_sum;
pub use point::PointSampler;
pub use prepared::Prepared;
pub use sample::{Report, Sampled, sample};
