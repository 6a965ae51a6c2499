//! 10 — A T-mesh: quads that are coarse where they may be.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::tmesh::{self, Made, TMeshArgs};
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use geom_core::io::{self, view};
use serde::Serialize;
use tspline::mesh::Record;

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
        session.files(5, || save(session, &made))
    })
}

fn save(session: &Session, made: &Made) -> Result<(), Failure> {
    let mesh = &made.mesh;
    let record = Record::from(mesh);
    io::save(session.output("tmesh.json")?, |w| {
        serde_json::to_writer(w, &record).map_err(|e| io::ErrorKind::System(e.into()).into())
    })?;

    let (ends, corners) = mesh.polygons();
    let polygons = view::Cells::Polygons {
        ends: ends.into(),
        corners: corners.into(),
    };
    let elements = io::View {
        points: mesh.positions().into(),
        blocks: vec![polygons],
        ..io::View::default()
    };
    io::mesh::save(session.output("tmesh.obj")?, &elements)?;
    let levels: Vec<u8> = mesh.elements().iter().map(|e| e.level).collect();
    let mut fields = elements
        .cell_field("level", &levels)?
        .cell_field("scaled_jacobian", &made.jacobians)?;
    let carried = made.input.carried(mesh)?;
    for (name, values) in &carried {
        fields = fields.cell_field(name, values)?;
    }
    io::mesh::save(session.output("tmesh.vtu")?, &fields)?;

    let scale = tmesh::scale(mesh);
    let mut level = vec![0.0f64; mesh.fine().positions().len()];
    for (q, quad) in mesh.fine().quads().iter().enumerate() {
        let own = f64::from(mesh.elements()[mesh.element_of(q) as usize].level);
        for &v in quad {
            level[v as usize] = level[v as usize].max(own);
        }
    }
    let colored = io::View::from(mesh.fine()).colored(products::rgba(&scale.colors(&level)))?;
    io::mesh::save(session.output("tmesh.glb")?, &colored)?;
    session.picture("tmesh", || tmesh::picture(mesh, session))
}
