//! One step of Catmull–Clark subdivision.

use geom_core::mesh::Halfedges;
use geom_core::{FaceId, MeshError, Point3, QuadMesh, Vector3, VertexId, id::Id};

/// One step of subdivision (Catmull and Clark, 1978): old vertices keep their numbers, then come the
/// points of the edges, then those of the faces. Child k of quad q is quad `4 q + k` and begins with
/// corner k of it. Boundary edges are those of a cubic B-spline; a corner of one quad stays.
///
/// # Errors
/// A mesh that is not manifold or not oriented.
///
/// ```
/// use secondfund_ops::{catmull::subdivide, geom_core::mesh::shapes};
/// let coarse = shapes::quad_sphere(1.0, 2);
/// let fine = subdivide(&coarse)?;
/// assert_eq!(fine.quads().len(), 4 * coarse.quads().len());
/// // Each step takes means, so that the limit lies inside of the net.
/// assert!(fine.into_triangles().volume() < coarse.into_triangles().volume());
/// # Ok::<(), secondfund_ops::geom_core::MeshError>(())
/// ```
pub fn subdivide(mesh: &QuadMesh) -> Result<QuadMesh, MeshError> {
    let edges = Halfedges::<4>::of_quads(mesh)?;
    let old = mesh.positions();
    let at = |v: VertexId| old[v.index()].coords;
    let faces: Vec<Vector3> = mesh
        .quads()
        .iter()
        .map(|q| q.iter().map(|&v| old[v as usize].coords).sum::<Vector3>() / 4.0)
        .collect();
    let mut positions: Vec<Point3> = (0..old.len())
        .map(|v| vertex_point(&edges, VertexId(v as u32), &at, &faces))
        .collect();

    let mut edge_number = vec![0u32; edges.len()];
    for h in edges.edges() {
        let number = positions.len() as u32;
        edge_number[h.index()] = number;
        let ends = at(edges.from(h)) + at(edges.to(h));
        positions.push(Point3::from(match edges.twin(h) {
            Some(twin) => {
                edge_number[twin.index()] = number;
                let sides = [h, twin].map(|h| faces[edges.face(h).index()]);
                (ends + sides[0] + sides[1]) / 4.0
            }
            None => ends / 2.0,
        }));
    }
    let first_face = positions.len() as u32;
    positions.extend(faces.iter().map(|&f| Point3::from(f)));
    let children = mesh.quads().iter().enumerate().flat_map(|(f, q)| {
        let side = |k: usize| edge_number[edges.of_face(FaceId(f as u32), k).index()];
        [0, 1, 2, 3].map(|k| [q[k], side(k), first_face + f as u32, side((k + 3) % 4)])
    });
    QuadMesh::new(positions, children.collect())
}

/// `(F̄ + 2 R̄ + (n − 3) V) / n` inside, `(l + 6 V + r) / 8` on a boundary, V at a corner of one quad and
/// at a vertex of none.
fn vertex_point(
    edges: &Halfedges<4>,
    v: VertexId,
    at: &impl Fn(VertexId) -> Vector3,
    faces: &[Vector3],
) -> Point3 {
    let here = at(v);
    let around: Vec<_> = edges.around(v).collect();
    let n = around.len() as f64;
    if around.is_empty() {
        return Point3::from(here);
    }
    if edges.on_boundary(v) {
        if around.len() == 1 {
            return Point3::from(here);
        }
        let right = at(edges.to(around[0]));
        let left = at(edges.from(edges.previous(around[around.len() - 1])));
        return Point3::from((left + here * 6.0 + right) / 8.0);
    }
    let face_mean = around
        .iter()
        .map(|&h| faces[edges.face(h).index()])
        .sum::<Vector3>()
        / n;
    let middles = around.iter().map(|&h| (here + at(edges.to(h))) / 2.0);
    let edge_mean = middles.sum::<Vector3>() / n;
    Point3::from((face_mean + edge_mean * 2.0 + here * (n - 3.0)) / n)
}
