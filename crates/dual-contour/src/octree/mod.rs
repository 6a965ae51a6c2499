//! Where values, labels and sizes live: the lattice of the finest cells, what stands at its points, and the
//! octree over it.

mod domain;
mod field;
pub(crate) mod points;
pub(crate) mod samples;
pub(crate) mod sizing;
mod source;
pub(crate) mod tree;

pub(crate) use domain::{Domain, Labels, exact, local};
pub use field::FieldSamples;
pub(crate) use points::{PointMarks, PointSet};
pub(crate) use samples::Samples;
pub(crate) use sizing::splits;
pub(crate) use source::Source;
#[cfg(feature = "testing")]
pub(crate) use tree::BLOCK_LOG;
pub(crate) use tree::{BLOCK, Leaf, NONE, Octree, Splits, TooManyLeaves, block_index, corner_of};
