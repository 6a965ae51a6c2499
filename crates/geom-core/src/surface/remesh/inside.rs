//! The working mesh, for tests.

use super::mesh::Mesh;
use crate::{MeshError, TriMesh};

/// A surface and its labels after changes, each done only if it is allowed: 0 flips an edge, 1 contracts it, 2 splits it.
/// Which edge is chosen by the number of those there are; edges between two vertices for which `crease` holds are creases.
/// Panics where twins, fans and kinds do not fit together. The law that is held to it: whatever order changes come in,
/// the mesh stays a manifold of the same topology.
pub fn changed(
    start: &TriMesh,
    labels: Vec<u32>,
    crease: impl Fn(u32) -> bool,
    steps: impl Iterator<Item = (u8, impl Fn(usize) -> usize)>,
) -> Result<(TriMesh, Vec<u32>), MeshError> {
    let mut mesh = Mesh::new(start, labels)?;
    let edges = mesh.edges();
    let creases: Vec<u32> = edges
        .filter(|&h| crease(mesh.to(h)) && crease(mesh.from(h)))
        .collect();
    for h in creases {
        mesh.mark_crease(h);
    }
    for (what, pick) in steps {
        let edges: Vec<u32> = mesh.edges().collect();
        let h = edges[pick(edges.len())];
        match what {
            0 if mesh.may_flip(h) => mesh.flip(h),
            1 if mesh.may_contract(h) => {
                let vertex = mesh.vertices[mesh.to(h) as usize];
                mesh.contract(h, vertex);
            }
            2 => {
                let vertex = mesh.vertices[mesh.from(h) as usize];
                mesh.split(h, vertex);
            }
            _ => {}
        }
        mesh.validate();
    }
    Ok((mesh.surface(), mesh.living_labels()))
}
