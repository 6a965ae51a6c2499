//! Tetrahedra.

use geom_core::mesh::{OUTSIDE, VertexKind};
use geom_core::{ImplicitField, LatticeValues, Run, TetMesh, TriMesh};

use crate::backend::ContourBackend;
use crate::build::{self, Contour, Purpose};
use crate::emit::compact;
use crate::surface::surface_mesh;
use crate::{Error, Options, Report};

/// Tetrahedra, the surface of the molecule, and how they came about.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Positive, conforming tetrahedra with a region each.
    pub mesh: TetMesh,
    /// The boundary of the molecule, with vertices of its own.
    pub surface: TriMesh,
    /// Counts.
    pub report: Report,
}

/// Tetrahedra inside or outside of the molecule, or both, conforming across all interfaces.
pub fn volume<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Volume, Error> {
    let Contour {
        mut raw,
        domain,
        report,
    } = build::contour(values, field, options, Purpose::Volume(options.region), run)?;
    let surface = surface_mesh(&raw.positions, std::mem::take(&mut raw.triangles), &domain);
    let kept = compact(raw.positions.len(), &mut raw.tets);
    let kinds: Vec<VertexKind> = kept.iter().map(|&v| raw.kinds[v as usize]).collect();
    let positions = kept
        .iter()
        .map(|&v| domain.world(&raw.positions[v as usize]))
        .collect();
    let mesh = TetMesh::with_kinds(positions, raw.tets, raw.regions, kinds)
        .expect("emitted tetrahedra name emitted vertices");
    Ok(Volume {
        mesh: with_interface_kinds(mesh),
        surface,
        report,
    })
}

/// Kinds from what lies around each vertex: on an interface, on the box, at a junction.
fn with_interface_kinds(mesh: TetMesh) -> TetMesh {
    let faces = mesh.interfaces();
    let (positions, tets, regions, mut kinds) = mesh.into_parts();
    // The pair of regions of the first interface seen at a vertex.
    let mut pair = vec![None; positions.len()];
    for face in &faces {
        let on_box = face.triangle.iter().all(|&v| {
            matches!(
                kinds[v as usize],
                VertexKind::BoxFace { .. } | VertexKind::BoxEdge { .. } | VertexKind::Fixed
            )
        });
        if face.outside == OUTSIDE && on_box {
            continue;
        }
        for v in face.triangle.map(|v| v as usize) {
            let here = (face.inside, face.outside);
            match pair[v] {
                None => pair[v] = Some((here, false)),
                Some((other, false)) if other != here => pair[v] = Some((other, true)),
                _ => {}
            }
        }
    }
    for (kind, pair) in kinds.iter_mut().zip(&pair) {
        *kind = match (*kind, pair) {
            (VertexKind::Interior | VertexKind::Surface, None) => VertexKind::Interior,
            (VertexKind::Interior | VertexKind::Surface, Some((_, false))) => VertexKind::Surface,
            (_, Some(_)) => VertexKind::Fixed,
            (boxed, None) => boxed,
        };
    }
    TetMesh::with_kinds(positions, tets, regions, kinds).expect("only kinds have changed")
}
