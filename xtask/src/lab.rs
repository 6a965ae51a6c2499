//! The chores that measure our own crates. They are compiled with the feature `lab` and in release
//! mode, which `cargo xtask` sees to by calling itself again, so that the plain chores build fast.

#[cfg(feature = "lab")]
mod bench;
#[cfg(feature = "lab")]
mod python;
#[cfg(feature = "lab")]
mod thesis;
#[cfg(feature = "lab")]
mod thesis35;

use clap::Subcommand;

use crate::Outcome;

#[derive(Subcommand)]
pub(crate) enum Chore {
    /// Density and surface beside programs of others, on the same input, in one run.
    Bench,
    /// A table of the thesis beside ours, on the structures at hand.
    Thesis {
        /// Its number: 3.1, 3.2, 3.3, 3.4, 3.5.
        table: String,
    },
}

#[cfg(feature = "lab")]
pub(crate) fn run(chore: &Chore) -> Outcome {
    match chore {
        Chore::Bench => bench::run(),
        Chore::Thesis { table } => thesis::run(table),
    }
}

/// The same command again, with the feature and optimized.
#[cfg(not(feature = "lab"))]
pub(crate) fn run(_: &Chore) -> Outcome {
    let own = "run --quiet --release --package xtask --features lab --";
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let all: Vec<&str> = own
        .split(' ')
        .chain(arguments.iter().map(String::as_str))
        .collect();
    crate::call("cargo", &all, &[])
}
