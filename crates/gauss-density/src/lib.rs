#![doc = include_str!("../README.md")]

pub use geom_core;

mod backend;
mod band;
mod compare;
mod cpu;
mod direct;
mod eliminate;
mod error;
mod fast;
mod field;
mod lanes;
mod low_pass;
mod members;
mod method;
mod model;
mod options;
mod plain;
mod point;
mod prepared;
mod reach;
mod refit;
mod sample;
mod sites;
mod terms;
#[cfg(feature = "testing")]
pub mod testing;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use backend::{
    ATOM_ERRORS, BLOCK, BLOCK_POINTS, Block, BlockValues, DensityBackend, Job, REFIT_SUMS,
    SAMPLE_BLOCKS,
};
pub use band::sample_band;
pub use compare::{Comparison, compare};
pub use eliminate::{Eliminated, Elimination, EliminationReport, Interior, Stop, eliminate};
pub use error::Error;
pub use low_pass::{LowPass, Shape, low_pass};
pub use method::Method;
pub use model::{Level, Levels, Model};
pub use options::{Cutoff, Options};
pub use plain::nested_sum;
pub use point::{AtomGradient, PointSampler};
pub use prepared::Prepared;
pub use refit::{Refit, RefitReport, Refitted, refit};
pub use sample::{Report, Sampled, sample};
pub use sites::SiteCell;
pub use terms::RefitSums;
