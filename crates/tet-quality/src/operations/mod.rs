//! What replaces some tetrahedra by others.

pub(crate) mod contract;
pub(crate) mod insert;
pub(crate) mod operate;
pub(crate) mod patch;
pub(crate) mod swap;
#[cfg(test)]
mod tests;
pub(crate) mod untangle;
