//! The triangle surface that a program works on: of a mesh, a structure or a grid.

use geom_core::io::{self, AnyMesh, view::Field};
use geom_core::{Structure, TriMesh};

use crate::input::source::{Kind, SourceArgs};
use crate::{Failure, Session};

/// A surface and what its input says of it.
pub struct Known {
    /// The surface.
    pub mesh: TriMesh,
    /// The fields of a mesh's points, if these are those of the surface.
    pub fields: Vec<Field<'static>>,
    /// If the input is a structure.
    pub structure: Option<Structure>,
}

/// Reads a mesh, or makes the surface of a structure or grid.
pub fn read(source: &SourceArgs, session: &Session) -> Result<TriMesh, Failure> {
    Ok(read_all(source, session)?.mesh)
}

/// The same, and what else is there.
pub fn read_all(source: &SourceArgs, session: &Session) -> Result<Known, Failure> {
    let path = &source.input;
    match Kind::of(path) {
        Kind::Mesh => {
            SourceArgs::refuse_beside_mesh(session)?;
            let read = session.stage("reading", || io::mesh::read_up_to(path, session.memory()))?;
            let fields = match &read.mesh {
                AnyMesh::Tet(_) => Vec::new(),
                _ => read.point_fields,
            };
            Ok(Known {
                mesh: read.mesh.into_triangles(),
                fields,
                structure: None,
            })
        }
        _ => {
            let (mesh, structure) = with_structure(source, session)?;
            Ok(Known {
                mesh,
                fields: Vec::new(),
                structure,
            })
        }
    }
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
