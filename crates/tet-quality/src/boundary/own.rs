//! The surfaces of a mesh itself, for vertices that slide along them where there is no field.
//!
//! What serves as a field here is a signed distance whose gradient is not the direction to the nearest point but a
//! normal that is interpolated over the triangle: with flat ones a vertex that slides from one triangle to the next
//! would see a jump. The zero set is the input's triangles themselves.

use geom_core::compute::parallel;
use geom_core::mesh::FACES;
use geom_core::search::bvh::TriangleTree;
use geom_core::{ImplicitField, Point3, TriMesh, Vector3};
use rayon::prelude::*;

use crate::mesh::editable::EditableMesh;

/// Triangles that turn by less than this are parts of one smooth surface: cos 40°.
pub(crate) const SMOOTH: f64 = 0.766_044_443_118_978;

/// The signed distance to all boundaries and interfaces of a mesh, with normals as of the smooth surface
/// that their triangles stand for.
/// Normals at a corner are means over the faces that turn by less than 40° from its own, weighted by angle: a sharp
/// edge has two.
pub(crate) struct OwnSurface {
    tree: TriangleTree,
    /// Unit normals per corner.
    normals: Vec<[Vector3; 3]>,
}

impl OwnSurface {
    /// `None` if all faces lie within one region.
    pub(crate) fn of(mesh: &EditableMesh) -> Option<Self> {
        let triangles: Vec<[u32; 3]> = parallel::flat_map(mesh.tets.len(), |t| {
            let living = Some(t as u32).filter(|&t| !mesh.is_empty_slot(t));
            living.into_iter().flat_map(|t| {
                (0..4).filter_map(move |k| {
                    // Each face once, from the side of the smaller region.
                    let once = mesh.regions[t as usize] < mesh.region_beyond(t, k);
                    once.then(|| FACES[k].map(|i| mesh.tets[t as usize][i]))
                })
            })
        });
        let flat: Vec<Vector3> = parallel::map_each(&triangles, |&[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|v| mesh.x[v as usize]);
            let normal = (b - a).cross(&(c - a)).try_normalize(0.0);
            normal.unwrap_or_default()
        });
        let mut corners: Vec<(u32, u32)> = (0..triangles.len() as u32)
            .flat_map(|f| triangles[f as usize].map(|v| (v, f)))
            .collect();
        corners.par_sort_unstable();
        let around = |v: u32| {
            let start = corners.partition_point(|c| c.0 < v);
            corners[start..].iter().take_while(move |c| c.0 == v)
        };
        let normals = parallel::map(triangles.len(), |f| {
            triangles[f].map(|v| {
                let alike = around(v).map(|&(_, g)| g as usize);
                let sum: Vector3 = alike
                    .filter(|&g| flat[f].dot(&flat[g]) >= SMOOTH)
                    .map(|g| flat[g] * angle(mesh, triangles[g], v))
                    .sum();
                sum.try_normalize(1e-9).unwrap_or(flat[f])
            })
        });
        let surface = TriMesh::new(mesh.x.clone(), triangles).ok()?;
        let tree = TriangleTree::new(&surface).ok()?;
        Some(Self { tree, normals })
    }
}

/// The angle of a triangle at its corner `v`.
fn angle(mesh: &EditableMesh, triangle: [u32; 3], v: u32) -> f64 {
    let x = mesh.x[v as usize];
    let others = triangle.map(|u| mesh.x[u as usize] - x);
    let mut sides = others.into_iter().zip(triangle).filter(|s| s.1 != v);
    match (sides.next(), sides.next()) {
        (Some((a, _)), Some((b, _))) => a.angle(&b),
        _ => 0.0,
    }
}

impl ImplicitField for OwnSurface {
    fn value(&self, x: &Point3) -> f64 {
        self.value_gradient(x).0
    }

    /// One search in a tree of boxes: logarithmic in the number of triangles, on average.
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let near = self.tree.closest(x);
        let corners = self.normals[near.triangle as usize];
        let weights = near.barycentric;
        let sum = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
        let normal = sum.try_normalize(0.0).unwrap_or_default();
        let side = (x - near.point).dot(&normal);
        (near.distance.copysign(side), normal)
    }
}
