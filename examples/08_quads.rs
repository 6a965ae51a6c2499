//! 08 — Quads of a surface, by its cross field.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::crosses::{self, Guide, Mode};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::input::surface;
use biogeom_examples::steps::quads::{self, QuadArgs};
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use crossfield::Options;
use serde::Serialize;

/// A mesh of quads: of a mesh's surface, or of a structure's or grid's
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    #[serde(flatten)]
    size: QuadArgs,
    /// What the field follows: none, curvature, modes:1,2, modes:auto, characteristic:1,2
    #[arg(long, value_name = "GUIDE", default_value = "none", value_parser = crosses::guide)]
    guide: Guide,
    /// How strictly
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// What removing a pair of irregular vertices may cost, rad²
    #[arg(long, value_name = "MU", default_value_t = Options::default().singularity_penalty)]
    singularity_penalty: f64,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  08_quads spot.ply --quads 2000 --out out
  08_quads 1ajj.pdb --spacing 1 --guide modes:1,2 --out protein

Outputs: quads.obj, quads.vtu (scaled Jacobian per quad), quads.glb, quads.png (sides, irregular vertices, scaled
Jacobian), report.json with `counts.quads`, `counts.irregular`, `scaled_jacobian`, `hausdorff` (from the quads to
the surface and back, Å) and `rung`, which says how the mesh was made.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("08_quads", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    crosses::refuse_mode_alone(&args.guide, session)?;
    let mesh = surface::read(&args.source, session)?;
    products::note_surface(session, &mesh)?;
    let options = Options {
        guidance: args.guide.guidance(args.mode),
        singularity_penalty: args.singularity_penalty,
        ..args.size.options()
    };
    options.check()?;
    quads::run(session, &mesh, &options)
}
