//! 06 — Eigenfunctions of a surface's Laplace operator, and its shape-DNA.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::input::surface;
use biogeom_examples::steps::modes;
use biogeom_examples::{Failure, Session};
use clap::Parser;
use serde::Serialize;

/// The first eigenfunctions of a surface: of a mesh, or of a structure's or grid's surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// How many eigenpairs, 300 at most
    #[arg(long, short = 'k', value_name = "K", default_value_t = modes::Settings::default().count, value_parser = clap::value_parser!(u32).range(1..=300))]
    count: u32,
    /// Largest relative residual
    #[arg(long, value_name = "R", default_value_t = modes::Settings::default().tolerance)]
    tolerance: f64,
    /// Consistent instead of lumped mass
    #[arg(long)]
    consistent: bool,
    /// Keep all components of the surface, cavities too, each of which has a constant mode of its own;
    /// else the one of the largest area
    #[arg(long)]
    all_components: bool,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  06_modes spot.ply --count 20 --out out
  06_modes 1ajj.pdb --spacing 1 --out protein
  06_modes 1ajj.pdb --spacing 1 --all-components --out everything

Meshes are PLY, OFF, OBJ, STL, GLB, VTU or MSH. Outputs: modes.png (contact sheet), mode_01.glb … (coloured),
modes.vtu (all modes as point fields), spectrum.png, shape_dna.json (eigenvalues as they are, and made
free of scale by the area), report.json with `eigenvalues`. Here mode 1 is the constant; --guide modes: and --field mode:
of other programs count from the first that is not: their 1 is mode_02.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("06_modes", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let whole = surface::read(&args.source, session)?;
    let mut components = whole.components();
    session.note("components", components.len())?;
    let mesh = if args.all_components || components.is_empty() {
        whole
    } else {
        components.swap_remove(0)
    };
    let settings = modes::Settings {
        count: args.count,
        tolerance: args.tolerance,
        consistent: args.consistent,
    };
    modes::run(session, &mesh, &settings)
}
