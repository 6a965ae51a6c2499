//! 10 — A T-mesh: quads that are coarse where they may be.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::tmesh::TMeshArgs;
use biogeom_examples::steps::elements;
use clap::Parser;
use serde::Serialize;

/// A T-mesh of a surface: quads with T-junctions where their sizes change
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    mesh: TMeshArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  10_tmesh 1hvr.pdb --spacing 1 --levels chain:A=2,B=0 --out out
  10_tmesh spot.ply --quads 8000 --levels curvature --coarsest 2 --out spot

Outputs: tmesh.json (fine quads, levels, elements, half-edges with knot intervals), tmesh.obj and tmesh.vtu (elements as
polygons; level, scaled Jacobian and the input's labels or scalar fields per element), tmesh.glb and tmesh.png (a colour per level), report.json with
`counts.elements`, `counts.t_junctions`, `counts.extraordinary`, `counts.levels`, and `scaled_jacobian` (signed).";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.mesh.input()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("10_tmesh", |args: &Args, session| {
        let made = args.mesh.make(session)?;
        session.files(5, || elements::save(session, &made))
    })
}
