//! `cargo xtask thesis 7`: segments of the Princeton benchmark, pockets of structures with known ligands, and smoothing,
//! each beside other methods in the same run.

mod pockets;
mod segments;
mod smoothing;

use std::path::{Path, PathBuf};

use super::text;
use crate::Outcome;

/// Prints the tables.
pub(crate) fn run() -> Outcome {
    smoothing()?;
    pockets()?;
    segments()
}

/// Prints the table of segments.
pub(crate) fn segments() -> Outcome {
    segments::run()
}

/// Prints the table of smoothing.
pub(crate) fn smoothing() -> Outcome {
    smoothing::run()
}

/// Prints the table of pockets.
pub(crate) fn pockets() -> Outcome {
    pockets::run()
}

/// The entries of a folder by name.
fn sorted(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let paths: Result<Vec<_>, _> = entries.map(|e| e.map(|e| e.path())).collect();
    let mut paths = paths.map_err(text)?;
    paths.sort();
    Ok(paths)
}
