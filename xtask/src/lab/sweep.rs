//! `cargo xtask sweep`: every structure of a folder through the whole chain, with both meshers and all
//! regions, and every mesh audited.

#[cfg(feature = "lab")]
mod case;
#[cfg(any(test, feature = "lab"))]
mod labels;
#[cfg(feature = "lab")]
mod run;

use std::path::PathBuf;

use clap::ValueEnum;

#[cfg(feature = "lab")]
pub(crate) use run::run;

/// What is swept, and where the results go.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder of structure files [default: ../shared/data/pdb]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Lattice spacings, Å [default: for about --tets tetrahedra inside, and for 2.5 times as many]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    spacing: Vec<f64>,
    /// About how many tetrahedra inside a molecule, at the coarser spacing
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1000..))]
    tets: u64,
    /// Meshers
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["lattice", "dual-contour"])]
    method: Vec<Mesher>,
    /// Regions
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["interior", "exterior", "both"])]
    region: Vec<Region>,
    /// Only structures whose file name contains this
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// Every seventh case also goes through this independent checker, a Python script that prints its
    /// measurements of a mesh file as JSON
    #[arg(long, value_name = "SCRIPT")]
    meshcheck: Option<PathBuf>,
    /// The interpreter for it, with what it imports
    #[arg(long, value_name = "PYTHON", default_value = "python3")]
    python: String,
    /// A line of JSON per case; cases that it holds already are not run again
    #[arg(long, value_name = "FILE", default_value = "target/sweep.jsonl")]
    out: PathBuf,
}

/// Mesher of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Mesher {
    DualContour,
    Lattice,
}

/// Region of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Region {
    Interior,
    Exterior,
    Both,
}
