//! 02 — From a field to its surface.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon, MeshArgs};
use biogeom_examples::batch::{Batch, BatchArgs};
use biogeom_examples::input::labels::LabelArgs;
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use dual_contour::surface;
use serde::Serialize;

/// From atoms or a grid to a closed triangle surface
#[derive(Clone, Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    labels: LabelArgs,
    #[command(flatten)]
    #[serde(skip)]
    batch: BatchArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  02_surface 1ajj.pdb --out out
  02_surface 1su4.pdb --spacing 0.5 --tolerance 0.2 --out adaptive
  02_surface emd_1234.map.gz --isovalue 0.03 --out map

Outputs: surface.ply, surface.glb (coloured by --color), surface.png, of structures view.cxc and view.pml
(ChimeraX and PyMOL open the surface around the atoms), report.json with the audit (closed,
manifold, parts, Euler characteristic), area and volume.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

impl Batch for Args {
    fn batch(&self) -> &BatchArgs {
        &self.batch
    }
    fn parts_mut(&mut self) -> (&mut PathBuf, &mut Common) {
        (&mut self.source.input, &mut self.common)
    }
}

fn main() -> ExitCode {
    biogeom_examples::run_each("02_surface", contour)
}

fn contour(args: &Args, session: &Session) -> Result<(), Failure> {
    let source = args.source.read(session)?;
    let field = source.field(session)?;
    let options = args.mesh.options(&source, session)?;
    let made = session.stage("surface", || {
        surface(
            &source.values,
            Some(&field),
            &options,
            session.on(session.device.contour()),
        )
    })?;
    session.note("contour", &made.report)?;
    products::note_surface(session, &made.mesh)?;
    session.files(5, || {
        products::save_surface(
            session,
            "surface",
            &made.mesh,
            args.labels.around(&source, &args.source.input),
        )
    })
}
