#![doc = include_str!("../README.md")]

pub use geom_core;

mod backend;
mod error;
mod lanes;
mod model;
mod options;
mod sample {
    pub(crate) mod band;
    pub(crate) mod blocks;
    pub(crate) mod compare;
    pub(crate) mod dense;
    pub(crate) mod low_pass;
    pub(crate) mod point;
}
mod atoms {
    pub(crate) mod eliminate;
    pub(crate) mod refit;
    pub(crate) mod samples;
}
mod kernel {
    pub(crate) mod boxes;
    pub(crate) mod cells;
    pub(crate) mod cull;
    pub(crate) mod direct;
    pub(crate) mod math;
    pub(crate) mod plain;
    pub(crate) mod point;
    pub(crate) mod prepared;
    pub(crate) mod reach;
    pub(crate) mod relative;
}
mod cpu;
#[cfg(feature = "testing")]
pub mod testing;
mod thesis;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use atoms::eliminate::{Eliminated, Elimination, EliminationReport, Interior, Stop, eliminate};
pub use atoms::refit::{Refit, RefitReport, Refitted, refit};
pub use backend::{
    ATOM_ERRORS, BLOCK, BLOCK_POINTS, Block, BlockValues, DensityBackend, Job, REFIT_SUMS,
    RefitSums, SAMPLE_BLOCKS, SiteCell,
};
pub use error::Error;
pub use kernel::plain::nested_sum;
pub use kernel::prepared::Prepared;
pub use model::{Level, Levels, Model};
pub use options::{Cutoff, Options};
pub use sample::band::sample_band;
pub use sample::blocks::{Report, Sampled};
pub use sample::compare::{Comparison, compare};
pub use sample::dense::sample;
pub use sample::low_pass::{LowPass, Shape, low_pass};
pub use sample::point::{AtomGradient, PointSampler};
pub use thesis::Method;
