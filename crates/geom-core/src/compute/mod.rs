//! How things are computed: on which backend, watched by whom, with the same bits on any number of threads.
//!
//! - [`backend`]: a place where kernels run, what it owes to the specification, and how it fails
//! - [`gpu`]: device, queue and pipelines of a GPU (feature `wgpu`); [`usage`]: what it was asked to do
//! - [`run`]: a computation's backend, its progress, its cancellation
//! - [`parallel`]: loops and sums over fixed chunks, combined in order
//! - [`lanes`]: the processor's vector instructions
//! - [`coloring`], [`sets`]: colours such that neighbours differ; disjoint sets (union–find)
//! - [`lists`]: lists of different lengths in one piece of memory
//! - [`random`]: a seeded generator

pub mod backend;
pub mod coloring;
pub mod lanes;
pub mod lists;
pub mod parallel;
pub mod random;
pub mod run;
pub mod sets;
pub mod usage;

#[cfg(feature = "wgpu")]
pub mod gpu;

pub use backend::BackendError;
