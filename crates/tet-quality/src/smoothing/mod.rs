//! What moves vertices.

pub(crate) mod flow;
pub(crate) mod search;
pub(crate) mod smooth;
pub(crate) mod star;
