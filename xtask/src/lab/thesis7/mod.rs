//! `cargo xtask thesis 7`: segments of the Princeton benchmark, pockets of structures with known ligands, and smoothing,
//! each beside other methods in the same run.

mod pockets;
mod segments;
mod smoothing;

use super::text;
use crate::Outcome;

/// Prints the tables.
pub(crate) fn run() -> Outcome {
    smoothing::run()?;
    pockets::run()?;
    segments::run()
}
