#![doc = include_str!("../README.md")]

pub use geom_core;

// What goes in: atoms, the tree above them with a power per node, decays.
mod model;

// What is asked, and why it cannot be done.
mod error;
mod options;

// Fewer atoms for the same surface.
#[rustfmt::skip]
mod atoms {
    // Removes atoms while every sample keeps its share of the density (Algorithm 1).
    pub(crate) mod eliminate;
    // Moves what remains towards the original density (Eqs. 3.11–3.14).
    pub(crate) mod refit;
    // The points near the surface where both look, in cells that share their atoms.
    pub(crate) mod samples;
}

// From the model to values: on a lattice, near the surface, anywhere.
#[rustfmt::skip]
mod sample {
    // The way to the blocks of bricks that some atom can reach, batch after batch.
    pub(crate) mod blocks;
    // Every lattice point.
    pub(crate) mod dense;
    // Bricks near the surface.
    pub(crate) mod band;
    // Any point, with derivatives.
    pub(crate) mod point;
    // One surface beside another (Eq. 3.10).
    pub(crate) mod compare;
    // The shape without its short waves (§5.2.1).
    pub(crate) mod low_pass;
}

// The three hot kernels: what they are handed and owe, and where they run.
pub mod backend;
mod cpu;
#[cfg(feature = "wgpu")]
mod wgpu;

// What the kernels are made of, the lowest first.
#[rustfmt::skip]
mod kernel {
    // Exponentials, logarithms and powers as vector instructions.
    pub(crate) mod math;
    // Boxes of lattice points, bricks and blocks.
    pub(crate) mod boxes;
    // How far an atom can matter after the powers.
    pub(crate) mod reach;
    // The model made ready: levels that matter, parents, clusters of atoms.
    pub(crate) mod prepared;
    // f64, one point: with second derivatives and shares of atoms.
    pub(crate) mod plain;
    // f64, one point, many exponentials at a time.
    pub(crate) mod point;
    // The atoms that matter in a box, with their tree.
    pub(crate) mod cull;
    // f32, a brick, relative to a reference atom per node: for small powers that reach far.
    pub(crate) mod relative;
    // f32, a block, straight from the kernels: for moderate powers.
    pub(crate) mod direct;
    // f64, the points of a sample cell side by side: "without this atom", and derivatives.
    pub(crate) mod cells;
}

// What must hold, and what the thesis did otherwise.
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
pub use model::{Level, Levels, Model};
pub use options::{Cutoff, Options};
pub use sample::band::sample_band;
pub use sample::blocks::{Report, Sampled};
pub use sample::compare::{Comparison, compare};
pub use sample::dense::sample;
pub use sample::low_pass::{LowPass, Shape, low_pass};
pub use sample::point::{AtomGradient, PointSampler};
