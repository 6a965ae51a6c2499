//! Areas, volumes, normals, Euler characteristic.
//!
//! Sums run over fixed chunks in a fixed order, so that the bits do not depend on threads. Nothing here asks whether a
//! mesh is closed or oriented: numbers that mean something only then say so.

use rayon::prelude::*;

use super::{EDGES, FACES, QuadMesh, Region, TetMesh, TriMesh};
use crate::compute::parallel;
use crate::{Aabb, Point3, Vector3};

/// Six times the signed volume of a tetrahedron: positive if `(b − a, c − a, d − a)` is right-handed; Å³. Rounding
/// decides the sign of what is nearly flat: it is no exact predicate.
#[inline]
pub fn six_volume([a, b, c, d]: [Point3; 4]) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a))
}

impl TriMesh {
    /// Twice the area of a triangle times its unit normal. Å²: the cross product of two sides, zero for a triangle
    /// without area.
    pub fn doubled_area_normal(&self, triangle: usize) -> Vector3 {
        doubled_area_normal(self.corners(triangle))
    }

    /// Area, Å².
    pub fn area(&self) -> f64 {
        area(self.positions(), self.triangles())
    }

    /// Enclosed volume, Å³; meaningful for closed oriented surfaces only.
    ///
    /// Negative if the surface is inside out; walls of cavities take their part away. With a boundary it is the volume
    /// of the cone over the surface from the middle of [`TriMesh::bounds`].
    pub fn volume(&self) -> f64 {
        enclosed_volume(self.positions(), self.triangles())
    }

    /// Bounding box of all vertices. Unused ones count; [`Aabb::EMPTY`] for a mesh without any.
    pub fn bounds(&self) -> Aabb {
        Aabb::of_points(self.positions())
    }

    /// Unit normal per vertex, weighted by the corner angles; zero at vertices without a proper
    /// triangle.
    ///
    /// Angles as weights make the normal a property of the surface and not of how it is cut: halving a triangle changes
    /// nothing (Thürmer and Wüthrich, *Computing vertex normals from polygonal facets*, J. Graphics Tools 3, 1998).
    pub fn vertex_normals(&self) -> Vec<Vector3> {
        vertex_normals(self.positions(), self.triangles())
    }

    /// Used vertices − edges + triangles. Of a closed oriented manifold it is 2 per component less 2 per handle. Edges
    /// are sorted for it.
    pub fn euler_characteristic(&self) -> i64 {
        euler(self.triangles())
    }
}

impl QuadMesh {
    /// The four corner positions of a quad.
    pub fn corners(&self, quad: usize) -> [Point3; 4] {
        self.quads()[quad].map(|v| self.positions()[v as usize])
    }

    /// Area, Å²: that of the triangles left and right of each quad's diagonal from its first corner.
    pub fn area(&self) -> f64 {
        area(self.positions(), self.quads())
    }

    /// Volume enclosed by the same triangles, Å³; meaningful for closed oriented surfaces only.
    pub fn volume(&self) -> f64 {
        enclosed_volume(self.positions(), self.quads())
    }

    /// Unit normal per vertex, weighted by the corner angles; zero at vertices without a proper quad. The normal of a
    /// bent quad is that of its vector area, which does not depend on the diagonal.
    pub fn vertex_normals(&self) -> Vec<Vector3> {
        vertex_normals(self.positions(), self.quads())
    }

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
    /// Six times the signed volume of a tetrahedron, Å³. Negative where it is inverted.
    pub fn six_volume(&self, tet: usize) -> f64 {
        six_volume(self.corners(tet))
    }
    /// Sum of the signed volumes, Å³.
    pub fn volume(&self) -> f64 {
        parallel::sum(self.tets().len(), |t| self.six_volume(t) / 6.0)
    }
    /// Sum of the signed volumes of a region's tetrahedra, Å³.
    pub fn region_volume(&self, region: Region) -> f64 {
        parallel::sum(self.tets().len(), |t| {
            if self.regions()[t] == region {
                self.six_volume(t) / 6.0
            } else {
                0.0
            }
        })
    }
    /// Used vertices − edges + faces − tetrahedra: components − tunnels + cavities. 1 for a ball, 2 for a shell around
    /// a cavity, 0 for a solid torus.
    pub fn euler_characteristic(&self) -> i64 {
        let tets = self.tets();
        let faces = count(tets.iter().flat_map(|t| {
            FACES.map(|f| {
                let mut face = f.map(|k| t[k]);
                face.sort_unstable();
                face
            })
        }));
        let edges = count(
            tets.iter()
                .flat_map(|t| EDGES.map(|[a, b]| undirected(t[a], t[b]))),
        );
        let vertices = count(tets.iter().flatten().copied());
        vertices - edges + faces - tets.len() as i64
    }
    /// Bounding box of all vertices.
    pub fn bounds(&self) -> Aabb {
        Aabb::of_points(self.positions())
    }
}

fn doubled_area_normal([a, b, c]: [Point3; 3]) -> Vector3 {
    (b - a).cross(&(c - a))
}

/// The triangles of a face, from its first corner. The area and volume of a quad follow from it, so that they are those
/// of [`QuadMesh::into_triangles`].
fn fan<const N: usize>(positions: &[Point3], face: [u32; N]) -> impl Iterator<Item = [Point3; 3]> {
    let p = face.map(|v| positions[v as usize]);
    (1..N - 1).map(move |k| [p[0], p[k], p[k + 1]])
}

fn area<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> f64 {
    parallel::sum(faces.len(), |f| {
        let triangles = fan(positions, faces[f]);
        triangles.map(|t| 0.5 * doubled_area_normal(t).norm()).sum()
    })
}

/// The sum of the cones of all faces over one point, which is the same for every point if the faces close.
fn enclosed_volume<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> f64 {
    // Relative to the middle of the box, so that far-away meshes lose no digits.
    let o = Aabb::of_points(positions).center();
    parallel::sum(faces.len(), |f| {
        fan(positions, faces[f])
            .map(|[a, b, c]| (a - o).cross(&(b - o)).dot(&(c - o)) / 6.0)
            .sum()
    })
}

/// On one thread, in the order of the faces: a vertex sums what its faces bring as they come.
fn vertex_normals<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> Vec<Vector3> {
    let mut normals = vec![Vector3::zeros(); positions.len()];
    for corners in faces {
        let p = corners.map(|v| positions[v as usize]);
        let sum: Vector3 = fan(positions, *corners).map(doubled_area_normal).sum();
        let Some(n) = sum.try_normalize(0.0) else {
            continue;
        };
        for k in 0..N {
            let (u, v) = (p[(k + 1) % N] - p[k], p[(k + N - 1) % N] - p[k]);
            normals[corners[k] as usize] += n * u.angle(&v);
        }
    }
    for n in &mut normals {
        *n = n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    }
    normals
}

fn undirected(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Different elements.
fn count<T: Ord + Send>(elements: impl Iterator<Item = T>) -> i64 {
    let mut elements: Vec<T> = elements.collect();
    elements.par_sort_unstable();
    elements.dedup();
    elements.len() as i64
}

fn euler<const N: usize>(faces: &[[u32; N]]) -> i64 {
    let edges = faces
        .iter()
        .flat_map(|f| (0..N).map(|k| undirected(f[k], f[(k + 1) % N])));
    count(faces.iter().flatten().copied()) - count(edges) + faces.len() as i64
}
