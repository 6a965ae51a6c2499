//! 03 — From a field to tetrahedra, inside, outside or both.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{self, Common, HasCommon, MeshArgs, Region};
use biogeom_examples::source::SourceArgs;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use dual_contour::{Material, Outer, Shape, volume};
use geom_core::Vector3;
use serde::Serialize;

/// From atoms or a grid to tetrahedra inside and outside of its surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    /// What to mesh
    #[arg(long, value_enum, default_value_t)]
    region: Region,
    /// Where the exterior ends: grid, box:SCALE or sphere:SCALE
    #[arg(long, value_name = "grid|box:S|sphere:S", default_value = "grid", value_parser = args::outer)]
    outer: Outer,
    /// A material between two planes, e.g. a membrane z:-15:15; may be repeated
    #[arg(long, value_name = "AXIS:LOW:HIGH", value_parser = args::slab)]
    slab: Vec<Shape>,
    /// A material in a cylinder between two points; may be repeated
    #[arg(long, value_name = "X,Y,Z:X,Y,Z:R", value_parser = args::cylinder)]
    cylinder: Vec<Shape>,
    /// A material in a ball; may be repeated
    #[arg(long, value_name = "X,Y,Z:R", value_parser = args::ball)]
    ball: Vec<Shape>,
    /// A material in an axis-aligned box between two corners; may be repeated
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = args::cuboid)]
    cuboid: Vec<Shape>,
    /// Take the membrane's planes from the structure file (dummy atoms as in the OPM database)
    #[arg(long)]
    membrane: bool,
    /// Give each separate part of the exterior a region number of its own
    #[arg(long)]
    separate_exterior: bool,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  03_tets 1ajj.pdb --out out
  03_tets 1ajj.pdb --region both --outer sphere:2 --method lattice --out both
  03_tets 2nwl_opm.pdb --membrane --region both --out membrane
  03_tets potential.dx --isovalue 0.5 --region exterior --outer box:1.5 --out map

Materials get the region numbers 2, 3, … in the order cylinders, balls, boxes, slabs; where they overlap
the first one counts, and the molecule (1) before all. Outputs: volume.vtu (regions and quality per
tetrahedron), volume.msh (named groups), volume.png (a cut), surface.ply/.glb/.png, report.json.";

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
    let field = source.field()?;
    let mut shapes = [&args.cylinder[..], &args.ball, &args.cuboid, &args.slab].concat();
    if args.membrane {
        let planes = source
            .membrane
            .ok_or("the file has no dummy atoms that mark a membrane; give --slab")?;
        shapes.push(Shape::Slab {
            normal: Vector3::z(),
            low: planes.lower,
            high: planes.upper,
        });
    }
    let options = dual_contour::Options {
        region: args.region.into(),
        outer: args.outer,
        separate_exterior: args.separate_exterior,
        materials: (2..)
            .zip(shapes)
            .map(|(region, shape)| Material { region, shape })
            .collect(),
        ..args.mesh.options(&source, session)?
    };
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
    products::note_surface(session, &made.surface)?;
    session.files(6, || {
        products::side_by_side(
            || products::save_surface(session, "surface", &made.surface, source.structure()),
            || products::save_volume(session, "volume", &made.mesh, (&made.mesh).into()),
        )
    })
}
