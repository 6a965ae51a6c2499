//! What the example programs share, so that each shows only its crate's own calls: arguments,
//! a session (threads, backend, progress, outputs that appear together or not at all, `report.json`),
//! and pictures.

pub mod args;
pub mod picture;
pub mod session;

pub use session::{Failure, Session, run};
