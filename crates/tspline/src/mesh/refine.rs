//! Quads cut into four, again and again.

use geom_core::mesh::Halfedges;
use geom_core::{HalfedgeId, MeshError, Point3, QuadMesh, VertexId};

use crate::Error;

/// A quad mesh whose quads are cut into `4^times`: vertices first, then middles of edges and of quads, where a flat quad
/// would have them; the parts of a quad follow each other. Extraordinary vertices lie `2^times` quads apart then, as T-meshes
/// of so many levels need it.
///
/// # Errors
/// [`Error::Mesh`] if the quads are no oriented manifold, or too many for an index.
///
/// ```
/// use tspline::{geom_core::mesh::shapes, mesh::refined};
/// let fine = refined(&shapes::quad_sphere(1.0, 3), 2)?;
/// assert_eq!((fine.quads().len(), fine.positions().len()), (16 * 54, 16 * 54 + 2));
/// # Ok::<(), tspline::Error>(())
/// ```
pub fn refined(mesh: &QuadMesh, times: u8) -> Result<QuadMesh, Error> {
    let quads = mesh.quads().len().max(1) as u128;
    let count = 4u128
        .checked_pow(times.into())
        .and_then(|n| n.checked_mul(quads));
    if count.is_none_or(|n| n > u128::from(u32::MAX / 8)) {
        let count = count.and_then(|n| usize::try_from(n).ok());
        let count = count.unwrap_or(usize::MAX);
        return Err(MeshError::TooMany { count }.into());
    }
    let mut mesh = mesh.clone();
    for _ in 0..times {
        mesh = once(&mesh)?;
    }
    Ok(mesh)
}

fn once(mesh: &QuadMesh) -> Result<QuadMesh, Error> {
    let edges = Halfedges::of_quads(mesh)?;
    let mut positions = mesh.positions().to_vec();
    let mut middle = vec![0; edges.len()];
    for h in edges.edges() {
        let at = |v: VertexId| mesh.positions()[v.0 as usize];
        let number = positions.len() as u32;
        middle[h.0 as usize] = number;
        if let Some(twin) = edges.twin(h) {
            middle[twin.0 as usize] = number;
        }
        positions.push(geom_core::nalgebra::center(
            &at(edges.from(h)),
            &at(edges.to(h)),
        ));
    }
    let mut quads = Vec::with_capacity(4 * mesh.quads().len());
    for (q, quad) in (0u32..).zip(mesh.quads()) {
        let centre = positions.len() as u32;
        let sum = quad.iter().map(|&v| mesh.positions()[v as usize].coords);
        positions.push(Point3::from(sum.sum::<geom_core::Vector3>() / 4.0));
        let m = [0, 1, 2, 3].map(|k| middle[HalfedgeId(4 * q + k).0 as usize]);
        let [a, b, c, d] = *quad;
        quads.extend([
            [a, m[0], centre, m[3]],
            [m[0], b, m[1], centre],
            [centre, m[1], c, m[2]],
            [m[3], centre, m[2], d],
        ]);
    }
    Ok(QuadMesh::new(positions, quads)?)
}
