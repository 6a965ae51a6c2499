//! 08 — Quads of a surface, by its cross field.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::crosses::{self, Guide, Mode};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::input::surface;
use biogeom_examples::steps::quads;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use crossfield::{Ladder, Options, Size};
use serde::Serialize;

/// A mesh of quads: of a mesh's surface, or of a structure's or grid's
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// How many quads [default: a third of the triangles]
    #[arg(long, value_name = "N", conflicts_with = "side", value_parser = clap::value_parser!(u32).range(1..))]
    quads: Option<u32>,
    /// Side of a quad, Å, instead
    #[arg(long, value_name = "H")]
    side: Option<f64>,
    /// What the field follows: none, curvature, modes:1,2, modes:auto, characteristic:1,2
    #[arg(long, value_name = "GUIDE", default_value = "none", value_parser = crosses::guide)]
    guide: Guide,
    /// How strictly
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// Keep edges whose triangles' normals differ by more than this, degrees
    #[arg(long, value_name = "DEGREES")]
    crease: Option<f64>,
    /// Bumps smaller than this many sides of a quad get no irregular vertices of their own
    #[arg(long, value_name = "SIDES", default_value_t = Options::default().smoothing)]
    smoothing: f64,
    /// What removing a pair of irregular vertices may cost, rad²
    #[arg(long, value_name = "MU", default_value_t = Options::default().singularity_penalty)]
    singularity_penalty: f64,
    /// Stop at the first failure instead of trying other fields and sizes
    #[arg(long)]
    no_fallback: bool,
    /// Leave the vertices where the map puts them
    #[arg(long)]
    raw: bool,
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
        size: match (args.quads, args.side) {
            (Some(n), _) => Size::Quads(n as usize),
            (None, Some(h)) => Size::Spacing(h),
            (None, None) => Size::Triangles,
        },
        guidance: args.guide.guidance(args.mode),
        crease: args.crease,
        smoothing: args.smoothing,
        singularity_penalty: args.singularity_penalty,
        ladder: if args.no_fallback {
            Ladder::Off
        } else {
            Ladder::Full
        },
        improve: !args.raw,
        ..Options::default()
    };
    options.check()?;
    quads::run(session, &mesh, &options)
}
