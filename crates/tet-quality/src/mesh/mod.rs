//! The mesh while it is changed, and what a change is.

pub(crate) mod editable;
pub(crate) mod incidence;
pub(crate) mod link;
pub(crate) mod proposal;
