//! What boundaries and interfaces allow.

mod curves;
mod fans;
pub(crate) mod field;
pub(crate) mod gaps;
pub(crate) mod guard;
pub(crate) mod input;
pub(crate) mod own;
pub(crate) mod plane;
pub(crate) mod walls;
