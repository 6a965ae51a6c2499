//! 03 — From a field to tetrahedra, inside, outside or both.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon, MeshArgs, VolumeArgs};
use biogeom_examples::input::labels::LabelArgs;
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use dual_contour::volume;
use serde::Serialize;

/// From atoms or a grid to tetrahedra inside and outside of its surface, as the mesher makes them; 00_pipeline
/// takes the same options and improves them
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    volume: VolumeArgs,
    #[command(flatten)]
    labels: LabelArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  03_tets 1ajj.pdb --out out
  03_tets 1ajj.pdb --region both --outer sphere:2 --out both
  03_tets 2nwl_opm.pdb --membrane --region both --out membrane
  03_tets potential.dx --isovalue 0.5 --region exterior --outer box:1.5 --out map

Materials get the region numbers 2, 3, … in the order cylinders, balls, boxes, slabs; where they overlap
the first one counts, and the molecule (1) before all. Outputs: volume.vtu (regions and quality per
tetrahedron), volume.msh (named groups), volume.png (a cut), surface.ply/.glb/.png,
of structures view.cxc and view.pml (ChimeraX and PyMOL open the surface around the atoms), report.json.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("03_tets", tets)
}

fn tets(args: &Args, session: &Session) -> Result<(), Failure> {
    let source = args.source.read(session)?;
    let field = source.field(session)?;
    let options = args.volume.options(&args.mesh, &source, session)?;
    let made = session.stage("tetrahedra", || {
        volume(
            &source.values,
            Some(&field),
            &options,
            session.on(session.device.contour()),
        )
    })?;
    session.note("contour", &made.report)?;
    session.note("quality", tet_quality::quality_report(&made.mesh))?;
    products::note_volume(session, &made.mesh)?;
    products::warn_of_missing(session, &made.mesh, &options.materials)?;
    products::note_surface(session, &made.surface)?;
    session.files(8, || {
        products::side_by_side(
            || {
                products::save_surface(
                    session,
                    "surface",
                    &made.surface,
                    args.labels.around(&source, &args.source.input),
                )
            },
            || {
                products::save_volume(
                    session,
                    "volume",
                    &made.mesh,
                    (&made.mesh).into(),
                    source.structure(),
                )
            },
        )
    })
}
