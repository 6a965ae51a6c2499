//! The elements of a T-mesh.

use geom_core::io::{self, view};
use tspline::mesh::Record;

use crate::input::tmesh::{self, Made};
use crate::{Failure, Session, products};

/// Writes a T-mesh and its picture.
pub fn save(session: &Session, made: &Made) -> Result<(), Failure> {
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
