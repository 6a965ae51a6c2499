//! Areas, volumes, normals, Euler characteristic.

use std::collections::HashSet;

use super::{QuadMesh, TetMesh, TriMesh};
use crate::{Aabb, Point3, Vector3, parallel};

/// Six times the signed volume of a tetrahedron: positive if `(b − a, c − a, d − a)` is right-handed.
pub fn six_volume([a, b, c, d]: [Point3; 4]) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a))
}

impl TriMesh {
    /// Twice the area of a triangle times its unit normal.
    pub fn doubled_area_normal(&self, triangle: usize) -> Vector3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }

    /// Area, Å².
    pub fn area(&self) -> f64 {
        parallel::sum(self.triangles().len(), |t| {
            0.5 * self.doubled_area_normal(t).norm()
        })
    }

    /// Enclosed volume, Å³; meaningful for closed oriented surfaces only.
    pub fn volume(&self) -> f64 {
        // Relative to the middle of the box, so that far-away meshes lose no digits.
        let o = self.bounds().center();
        parallel::sum(self.triangles().len(), |t| {
            let [a, b, c] = self.corners(t);
            (a - o).cross(&(b - o)).dot(&(c - o)) / 6.0
        })
    }

    /// Bounding box of all vertices.
    pub fn bounds(&self) -> Aabb {
        Aabb::of_points(self.positions())
    }

    /// Unit normal per vertex, weighted by the corner angles; zero at vertices without a proper
    /// triangle.
    pub fn vertex_normals(&self) -> Vec<Vector3> {
        let mut normals = vec![Vector3::zeros(); self.positions().len()];
        for (t, corners) in self.triangles().iter().enumerate() {
            let p = self.corners(t);
            let Some(n) = self.doubled_area_normal(t).try_normalize(0.0) else {
                continue;
            };
            for k in 0..3 {
                let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                normals[corners[k] as usize] += n * u.angle(&v);
            }
        }
        for n in &mut normals {
            *n = n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        }
        normals
    }

    /// Used vertices − edges + triangles.
    pub fn euler_characteristic(&self) -> i64 {
        euler(self.triangles())
    }
}

impl QuadMesh {
    /// Used vertices − edges + quads.
    pub fn euler_characteristic(&self) -> i64 {
        euler(self.quads())
    }
    /// Bounding box of all vertices.
    pub fn bounds(&self) -> Aabb {
        Aabb::of_points(self.positions())
    }
}

impl TetMesh {
    /// Six times the signed volume of a tetrahedron, Å³.
    pub fn six_volume(&self, tet: usize) -> f64 {
        six_volume(self.corners(tet))
    }
    /// Sum of the signed volumes, Å³.
    pub fn volume(&self) -> f64 {
        parallel::sum(self.tets().len(), |t| self.six_volume(t) / 6.0)
    }
    /// Bounding box of all vertices.
    pub fn bounds(&self) -> Aabb {
        Aabb::of_points(self.positions())
    }
}

fn euler<const N: usize>(faces: &[[u32; N]]) -> i64 {
    let mut edges: Vec<[u32; 2]> = faces
        .iter()
        .flat_map(|f| (0..N).map(|k| [f[k].min(f[(k + 1) % N]), f[k].max(f[(k + 1) % N])]))
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let vertices: HashSet<u32> = faces.iter().flatten().copied().collect();
    vertices.len() as i64 - edges.len() as i64 + faces.len() as i64
}
