//! 09 — Quads that are narrower along the gradient of a field.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::crosses::Mode;
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::steps::anisotropy;
use biogeom_examples::steps::quads::{self, QuadArgs};
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use crossfield::anisotropy::{Adaptation, Function};
use crossfield::{Anisotropy, Options};
use serde::Serialize;

/// Quads of a surface (its largest part) that are narrow where a field on it is steep: of a mesh, or of a structure's or grid's
/// surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// The field along whose gradient quads are narrow: mode:1 (an eigenfunction, the constant not counted), curvature (the
    /// mean one), distance:X,Y,Z or distance:SELECTOR (along the surface, from a point or from selected atoms), or the name of a
    /// point field of a mesh
    #[arg(long, value_name = "FIELD", default_value = "mode:1", value_parser = anisotropy::source)]
    field: anisotropy::Source,
    /// How far from --field distance:… quads are narrow: to 1/e, Å [default: a tenth of the surface's diagonal]
    #[arg(long, value_name = "LENGTH")]
    reach: Option<f64>,
    /// Side of a quad along the gradient over that across, where the field is steepest
    #[arg(long, value_name = "R", default_value_t = 0.2)]
    ratio: f64,
    /// Shares of the largest gradient at which quads begin to be narrow, and from which on they have the ratio
    #[arg(long, value_name = "LOW,HIGH", default_value = "0.3,0.9", value_parser = anisotropy::ramp)]
    ramp: [f64; 2],
    /// How strictly quads follow the gradient where it is above half its largest
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// Let directions between steep and flat give way to the map (Eqs. 4.11–4.12)
    #[arg(long)]
    adapt: bool,
    #[command(flatten)]
    #[serde(flatten)]
    size: QuadArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  09_anisotropy spot.ply --quads 2000 --out out
  09_anisotropy 1hvr.pdb --spacing 1 --field distance:name:XK2 --reach 8 --out site
  09_anisotropy bunny.vtu --field charge --ratio 0.4 --ramp 0.5,0.5 --adapt --out charge

Outputs: field.ply, field.glb and field.png (the field, and strokes along its gradient, as long as that is steep), quads.obj,
quads.vtu (scaled Jacobian, aspect ratio and the length along the gradient over that across per quad), quads.glb, quads.png,
report.json with `anisotropy`: `aspect_ratio` (longer over shorter side), `along_over_across` in steps of |gradient|,
`misalignment` of the directions where the field is steep, degrees, and `adapted`; and all that 08_quads has.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("09_anisotropy", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let input = anisotropy::Input::read(&args.source, session)?;
    products::note_surface(session, &input.mesh)?;
    let field = session.stage("field", || input.values(&args.field, args.reach, session))?;
    let anisotropy = Anisotropy {
        ratio: args.ratio,
        ramp: args.ramp,
        weight: match args.mode {
            Mode::Hard => f64::INFINITY,
            Mode::Soft => 1.0,
        },
        adaptation: args.adapt.then(Adaptation::default),
        ..Anisotropy::of(Function::Values(field.clone()))
    };
    let options = Options {
        anisotropy: Some(anisotropy),
        ..args.size.options()
    };
    options.check()?;
    let made = quads::make(session, &input.mesh, &options)?;
    let steep = anisotropy::Steep::of(&input.mesh, &field, &made)?;
    steep.note(session, &made)?;
    session.files(7, || {
        anisotropy::save_field(session, &input.mesh, &field, &args.field.to_string())?;
        quads::save(session, &made, &[("along_over_across", &steep.ratios)])
    })
}
