//! The chores that measure our own crates. They are compiled with the feature `lab` and in release
//! mode, which `cargo xtask` sees to by calling itself again, so that the plain chores build fast.

mod bench;
#[cfg(feature = "lab")]
mod crosscheck;
#[cfg(feature = "lab")]
mod fuzz;
#[cfg(feature = "lab")]
mod python;
#[cfg(feature = "lab")]
mod spectra;
mod sweep;
#[cfg(feature = "lab")]
mod thesis;

use clap::Subcommand;

use crate::Outcome;

#[derive(Subcommand)]
pub(crate) enum Chore {
    /// The programs by their defaults, stage by stage, and kernels beside programs of others, in one run, beside what was stored
    Bench(bench::Arguments),
    /// Eigenpairs of surfaces beside those of SciPy on the same matrices: differences and times.
    Spectra {
        /// Also what surfaces of 200 000 and 500 000 vertices and voxel graphs of 200 000 and 1 000 000
        /// nodes cost.
        #[arg(long)]
        large: bool,
    },
    /// Our files in other people's programs: surfaces, tetrahedra, grids, splines and pictures are measured and checked there,
    /// equations with known answers solved, structures read by others and distances found.
    Crosscheck {
        /// Only one of surfaces, volumes, grids, solver, foreign, tetgen, quads, splines, tiles, structures, distances, repair,
        /// glb, pages.
        part: Option<String>,
    },
    /// Faulty files and meshes for every reader and every verb that takes those of others: panics, endless work and
    /// memory are finds.
    Fuzz {
        /// For all targets together.
        #[arg(long, default_value_t = 10.0)]
        minutes: f64,
        /// Only this one.
        #[arg(long)]
        target: Option<String>,
        /// Only the input of this number, in this process.
        #[arg(long)]
        case: Option<u64>,
        /// Inputs from this number on, told to the calling process.
        #[arg(long, hide = true, requires = "target")]
        child: Option<u64>,
    },
    /// Every structure of a folder at two spacings, with both meshers, inside, outside and both: meshed,
    /// improved and audited. Fails if a mesh is broken; lists what is below the targets.
    Sweep(Box<sweep::Arguments>),
    /// A table of the thesis beside ours, on the structures at hand.
    Thesis {
        /// Its number: 3.1 to 3.5, 4.8 to 4.11 (figures), 5.1, 5.2, 6.1 to 6.4, 7.1 to 7.3; or a chapter: 4, cross fields and quads; 5,
        /// T-meshes and splines; 6, correspondences; 7, segments.
        table: String,
    },
}

#[cfg(feature = "lab")]
pub(crate) fn run(chore: &Chore) -> Outcome {
    match chore {
        Chore::Bench(arguments) => bench::run(arguments),
        Chore::Spectra { large } => spectra::run(*large),
        Chore::Crosscheck { part } => crosscheck::run(part.as_deref()),
        Chore::Fuzz {
            minutes,
            target,
            case,
            child,
        } => fuzz::run(*minutes, target.as_deref(), *case, *child),
        Chore::Sweep(arguments) => sweep::run(arguments),
        Chore::Thesis { table } => thesis::run(table),
    }
}

/// What a peer printed.
#[cfg(feature = "lab")]
fn answer(
    python: &std::path::Path,
    script: &std::path::Path,
    arguments: &[String],
) -> Result<serde_json::Value, String> {
    let mut all = vec![script.display().to_string()];
    all.extend_from_slice(arguments);
    let text = crate::capture(&python.display().to_string(), &all)?;
    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", script.display()))
}

#[cfg(feature = "lab")]
fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// The surface of a structure's density as the programs make it, by this decay and with lattice points this far apart, Å.
#[cfg(feature = "lab")]
fn density_surface(
    structure: &geom_core::Structure,
    decay: f64,
    spacing: f64,
) -> Result<geom_core::TriMesh, String> {
    use gauss_density::{Cutoff, Levels, Model, PointSampler, sample_band};
    let on = geom_core::Run::on(&geom_core::Cpu);
    let levels = Levels {
        decay,
        ..Levels::default()
    };
    let model = Model::uniform(structure, &levels).map_err(text)?;
    let options = gauss_density::Options {
        spacing,
        ..Default::default()
    };
    let grid = sample_band(&model, &options, on).map_err(text)?.grid;
    let field = PointSampler::new(&model, Cutoff::default()).map_err(text)?;
    let options = dual_contour::Options::default();
    let made = dual_contour::surface(&grid, Some(&field), &options, on);
    Ok(made.map_err(text)?.mesh)
}

#[cfg(feature = "lab")]
fn number(answer: &serde_json::Value, key: &str) -> Result<f64, String> {
    answer[key]
        .as_f64()
        .ok_or_else(|| format!("a peer printed no `{key}`"))
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
