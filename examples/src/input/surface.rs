//! The triangle surface that a program works on: of a mesh, a structure or a grid.

use geom_core::{Structure, TriMesh, io};

use crate::input::source::{OF_STRUCTURES, SourceArgs, extension};
use crate::{Failure, Session};

/// Reads a mesh, or makes the surface of a structure or grid.
pub fn read(source: &SourceArgs, session: &Session) -> Result<TriMesh, Failure> {
    let path = &source.input;
    let mesh = match extension(path).as_str() {
        "ply" | "off" | "obj" | "stl" | "vtu" | "msh" | "glb" => {
            session.refuse(&OF_STRUCTURES, "is for structures, and the input is a mesh")?;
            let of_grids = ["isovalue", "enclosed_volume"];
            session.refuse(&of_grids, "is for grids, and the input is a mesh")?;
            let read = session.stage("reading", || io::mesh::read_up_to(path, session.memory()))?;
            read.mesh.into_triangles()
        }
        _ => with_structure(source, session)?.0,
    };
    Ok(mesh)
}

/// Makes the surface of a structure or grid; the structure, too.
pub fn with_structure(
    source: &SourceArgs,
    session: &Session,
) -> Result<(TriMesh, Option<Structure>), Failure> {
    let source = source.read(session)?;
    let options = dual_contour::Options {
        level: source.level,
        max_memory: session.memory(),
        ..Default::default()
    };
    let field = source.field(session)?;
    let made = session.stage("surface", || {
        let on = session.on(session.device.contour());
        dual_contour::surface(&source.values, Some(&field), &options, on)
    })?;
    Ok((made.mesh, source.structure().cloned()))
}
