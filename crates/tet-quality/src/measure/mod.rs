//! What a mesh is like: measures of its tetrahedra, statistics, and what falls short of the goals.

pub(crate) mod block;
pub mod metrics;
pub mod report;
pub mod unmet;
