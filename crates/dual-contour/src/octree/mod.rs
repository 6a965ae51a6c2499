//! Where values, labels and sizes live: the lattice of the finest cells, what stands at its points, and the
//! octree over it.
//!
//! In the order of the work: a [`Source`] says what value stands at a point of the mesh lattice, [`Samples`] keeps the
//! values where labels change, [`splits`] says from these which cells are too large, and [`Octree`] makes the coarsest
//! balanced tree in which they are split.

pub(crate) mod domain;
mod field;
pub(crate) mod points;
pub(crate) mod samples;
pub(crate) mod sizing;
mod source;
pub(crate) mod tree;

pub(crate) use domain::{Domain, Labels, along, exact, local};
pub use field::FieldSamples;
pub(crate) use points::{PointMarks, PointSet};
pub(crate) use samples::Samples;
pub(crate) use sizing::splits;
pub(crate) use source::Source;
#[cfg(feature = "testing")]
pub(crate) use tree::BLOCK_LOG;
pub(crate) use tree::{BLOCK, Leaf, NONE, Octree, Splits, TooManyLeaves, block_index, corner_of};
