//! 00 — From atoms to an improved tetrahedral mesh: the main job.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, DensityArgs, HasCommon, Method, ReaderArgs, Region};
use biogeom_examples::source::Field;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use dual_contour::Extent;
use gauss_density::Model;
use serde::Serialize;

/// From atoms to a quality tetrahedral mesh, inside and outside of the molecule's surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure: PDB, mmCIF or PQR, each also gzip-compressed
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// What to mesh
    #[arg(long, value_enum, default_value_t)]
    region: Region,
    /// How to mesh
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// Let no walls of gaps that are not meshed cross, for programs that take the surface further; takes
    /// up to three times as long
    #[arg(long)]
    keep_apart: bool,
    #[command(flatten)]
    density: DensityArgs,
    #[command(flatten)]
    reader: ReaderArgs,
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

Outputs: surface.ply, surface.glb (coloured by chain) and surface.png; volume.vtu (regions and quality
per tetrahedron), volume.msh (named groups, for solvers) and volume.png (a cut); quality.png;
report.json with counts, quality before and after, seconds per stage and peak memory.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("00_pipeline", pipeline)
}

fn pipeline(args: &Args, session: &Session) -> Result<(), Failure> {
    if matches!(args.region, Region::Both) {
        session.refuse(&["keep_apart"], "is for --region interior and exterior")?;
    }
    let structure = args.reader.read(session, &args.input)?.structure;
    let model = Model::uniform(&structure, &args.density.model.levels())?;
    let density = args.density.options(&structure, session);
    let sampled = session.stage("density", || {
        gauss_density::sample_band(&model, &density, session.on(session.device.density()))
    })?;
    session.note("spacing", density.spacing)?;
    session.note("density", &sampled.report)?;

    let field = Field::of_atoms(&model, density.cutoff)?;
    let contour = dual_contour::Options {
        method: args.method.into(),
        region: Extent::from(args.region),
        max_memory: session.memory(),
        ..Default::default()
    };
    let volume = session.stage("tetrahedra", || {
        dual_contour::volume(
            &sampled.grid,
            Some(&field),
            &contour,
            session.on(session.device.contour()),
        )
    })?;
    session.note("contour", &volume.report)?;

    let quality = tet_quality::Options {
        spacing: Some(density.spacing),
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
    session.files(7, || {
        products::side_by_side(
            || products::save_surface(session, "surface", &surface, Some(&structure)),
            || products::save_volume(session, "volume", &mesh, (&mesh).into()),
        )?;
        products::picture_of_quality(session, "quality", &report.before.all, &report.after.all)
    })
}
