//! `cargo xtask sweep`: every structure of the data folders through the whole chain, with both meshers
//! and all regions, and every mesh audited; with `--quads`, quads of every mesh.

#[cfg(feature = "lab")]
mod case;
#[cfg(feature = "lab")]
mod check;
#[cfg(any(test, feature = "lab"))]
mod labels;
#[cfg(feature = "lab")]
mod quads;
#[cfg(feature = "lab")]
mod run;
#[cfg(feature = "lab")]
mod table;

use std::path::PathBuf;

/// Tetrahedra of structures, or quads of meshes.
#[cfg(feature = "lab")]
pub(crate) fn run(arguments: &Arguments) -> crate::Outcome {
    if arguments.quads {
        quads::run(arguments)
    } else {
        run::run(arguments)
    }
}

/// The meshers and regions that a case may have.
const METHODS: [&str; 2] = ["stuffing", "dual-contour"];
const REGIONS: [&str; 3] = ["interior", "exterior", "both"];

/// Results by the name of their case.
#[cfg(feature = "lab")]
type Rows = std::collections::BTreeMap<String, serde_json::Value>;

/// What is swept, and where the results go.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Quads of meshes in place of tetrahedra of structures
    #[arg(long, conflicts_with_all = ["spacing", "tets", "method", "region", "meshcheck", "python"])]
    quads: bool,
    /// Structure files, or folders of them [default: pdb and pockets of ../shared/data; with --quads files of
    /// meshes, too, and psb/off, meshes and pdb]
    #[arg(long, value_name = "PATH")]
    data: Vec<PathBuf>,
    /// Lattice spacings, Å [default: for about --tets tetrahedra inside, and for 2.5 times as many]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    spacing: Vec<f64>,
    /// About how many tetrahedra inside a molecule, at the coarser spacing
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1000..))]
    tets: u64,
    /// Meshers
    #[arg(long, value_delimiter = ',', default_values = METHODS, value_parser = METHODS)]
    method: Vec<String>,
    /// Regions
    #[arg(long, value_delimiter = ',', default_values = REGIONS, value_parser = REGIONS)]
    region: Vec<String>,
    /// Only structures whose file name contains this
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// About every seventh case also goes through this independent checker, a Python script that prints
    /// its measurements of a mesh file as JSON
    #[arg(long, value_name = "SCRIPT")]
    meshcheck: Option<PathBuf>,
    /// The interpreter for it, with what it imports
    #[arg(long, value_name = "PYTHON", default_value = "python3")]
    python: String,
    /// A line of JSON per case; cases that it holds already are not run again
    #[arg(long, value_name = "FILE", default_value = "target/sweep.jsonl")]
    out: PathBuf,
    /// When all cases have a result: write them as a table in Markdown
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// Run the cases in this process, whose death then ends the sweep; without this every structure has
    /// a process of its own, and the case in which it dies gets a result that says so
    #[arg(long)]
    in_process: bool,
}

/// The files asked for, by name: those of these kinds in the folders given, or in these of the larger data.
#[cfg(feature = "lab")]
fn files(
    arguments: &Arguments,
    folders: &[&str],
    extensions: &[&str],
) -> Result<Vec<PathBuf>, String> {
    let mut places = arguments.data.clone();
    if places.is_empty() {
        let shared = folders.iter().filter_map(|d| crate::fixtures::shared(d));
        places = shared.collect();
    }
    let mut files = Vec::new();
    for place in places {
        if place.is_file() {
            files.push(place);
            continue;
        }
        let failed = |e: std::io::Error| format!("{}: {e}", place.display());
        for entry in std::fs::read_dir(&place).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let name = name(&path);
            let bare = name.strip_suffix(".gz").unwrap_or(&name);
            if extensions.contains(&bare.rsplit('.').next().unwrap_or("")) {
                files.push(path);
            }
        }
    }
    let only = &arguments.only;
    files.retain(|p| only.is_empty() || only.iter().any(|o| name(p).contains(o.as_str())));
    files.sort_by_key(|p| name(p));
    if files.is_empty() {
        return Err("NOTHING SWEPT: no such file; give files or folders with --data".into());
    }
    Ok(files)
}

#[cfg(feature = "lab")]
fn name(path: &std::path::Path) -> String {
    let file = path.file_name().unwrap_or_default();
    file.to_string_lossy().into_owned()
}
