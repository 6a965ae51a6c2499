//! 04 — Better elements for a mesh of anybody.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use geom_core::io::{self, mesh::AnyMesh};
use serde::Serialize;
use tet_quality::{Goals, Options, improve};

/// Improves the tetrahedra of any mesh (VTU or MSH) and shows the quality before and after
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Mesh: VTU or MSH
    input: PathBuf,
    /// Smallest dihedral angle to reach, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = Goals::default().min_dihedral)]
    min_dihedral: f64,
    /// Largest dihedral angle to reach, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = Goals::default().max_dihedral)]
    max_dihedral: f64,
    /// Joe–Liu measure to reach
    #[arg(long, value_name = "Q", default_value_t = Goals::default().joe_liu)]
    joe_liu: f64,
    /// Longest over shortest edge to stay below
    #[arg(long, value_name = "RATIO", default_value_t = Goals::default().edge_ratio)]
    edge_ratio: f64,
    /// Most passes
    #[arg(long, value_name = "N", default_value_t = Options::default().passes)]
    passes: u32,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  04_improve volume.vtu --out out
  04_improve gmsh.msh --min-dihedral 30 --passes 30 --out better

Regions, their interfaces and the boundary stay; surface vertices slide only where that changes no
shape, since a mesh alone does not say what surface it stands for.
Outputs: improved.vtu, improved.msh, quality.png (histograms before and after), before.png and
after.png (cuts coloured by the smallest dihedral angle), report.json.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("04_improve", better)
}

fn better(args: &Args, session: &Session) -> Result<(), Failure> {
    let read = session.stage("reading", || io::mesh::read(&args.input))?;
    let AnyMesh::Tet(mesh) = read.mesh else {
        return Err(format!("{}: no tetrahedra, only faces", args.input.display()).into());
    };
    products::picture_of_volume(session, "before", &mesh)?;
    let options = Options {
        goals: Goals {
            min_dihedral: args.min_dihedral,
            max_dihedral: args.max_dihedral,
            joe_liu: args.joe_liu,
            edge_ratio: args.edge_ratio,
        },
        passes: args.passes,
        ..Options::default()
    };
    let improved = session.stage("improvement", || {
        improve(mesh, None, &options, session.on(session.device.quality()))
    })?;
    let (mesh, report) = (improved.mesh, improved.report);
    session.note("quality", &report)?;
    products::note_volume(session, &mesh)?;
    session.stage("files and pictures", || {
        products::save_volume(session, "improved", &mesh)?;
        products::picture_of_quality(session, "quality", &report.before.all, &report.after.all)
    })
}
