//! What replaces some tetrahedra by others.

pub(crate) mod contract;
pub(crate) mod insert;
pub(crate) mod operate;
pub(crate) mod patch;
pub(crate) mod swap;
pub(crate) mod untangle;
