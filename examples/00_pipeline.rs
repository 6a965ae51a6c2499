//! 00 — From atoms to an improved tetrahedral mesh: the main job.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon, MeshArgs, Region, VolumeArgs};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::labels::LabelArgs;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use serde::Serialize;

/// From atoms or a grid to a quality tetrahedral mesh, inside and outside of the molecule's surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    volume: VolumeArgs,
    /// Let no walls of gaps that are not meshed cross, for programs that take the surface further; takes
    /// up to three times as long
    #[arg(long)]
    keep_apart: bool,
    #[command(flatten)]
    labels: LabelArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  00_pipeline 1ajj.pdb --out out
  00_pipeline 2buk.pdb --assembly 1 --out capsid
  00_pipeline 1ajj.pdb --method dual-contour --out thesis
  00_pipeline 1ajj.pdb --keep-apart --out for-tetgen
  00_pipeline 1su4.pdb --region both --spacing 0.8 --residue-power 0.25 --out both
  00_pipeline 2nwl_opm.pdb --membrane --region both --outer box:1.5 --out membrane
  00_pipeline 1ajj.pdb --region both --spacing 0.5 --max-cell 2 --out study

Materials get the region numbers 2, 3, … in the order cylinders, balls, boxes, slabs; where they overlap
the first one counts, and the molecule (1) before all.

Outputs: surface.ply, surface.glb (coloured by --color) and surface.png; of structures view.cxc and view.pml
(ChimeraX and PyMOL open the surface around the atoms); volume.vtu (regions and quality
per tetrahedron), volume.msh (named groups, for solvers) and volume.png (a cut); quality.png;
report.json with counts, quality before and after, seconds per stage and peak memory.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("00_pipeline", pipeline)
}

fn pipeline(args: &Args, session: &Session) -> Result<(), Failure> {
    if matches!(args.volume.region, Region::Both) {
        session.refuse(&["keep_apart"], "is for --region interior and exterior")?;
    }
    let source = args.source.read(session)?;
    let field = source.field()?;
    let options = args.volume.options(&args.mesh, &source, session)?;
    let volume = session.stage("tetrahedra", || {
        dual_contour::volume(
            &source.values,
            Some(&field),
            &options,
            session.on(session.device.contour()),
        )
    })?;
    session.note("contour", &volume.report)?;

    let quality = tet_quality::Options {
        level: source.level,
        spacing: Some(volume.report.spacing),
        keep_apart: args.keep_apart,
        ..Default::default()
    };
    let improved = session.stage("improvement", || {
        tet_quality::improve(
            volume.mesh,
            Some(&field),
            &quality,
            session.on(session.device.quality()),
        )
    })?;
    let (mesh, report) = (improved.mesh, improved.report);
    session.note("quality", &report)?;

    let surface = products::molecule_surface(&mesh);
    products::note_volume(session, &mesh)?;
    products::note_surface(session, &surface)?;
    session.files(9, || {
        products::side_by_side(
            || {
                products::save_surface(
                    session,
                    "surface",
                    &surface,
                    args.labels.around(&source, &args.source.input),
                )
            },
            || products::save_volume(session, "volume", &mesh, (&mesh).into(), source.structure()),
        )?;
        products::picture_of_quality(session, "quality", &report.before.all, &report.after.all)
    })
}
