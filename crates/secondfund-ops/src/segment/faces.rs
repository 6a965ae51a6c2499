//! Faces as a graph: areas, and which faces meet along which edges.
//!
//! All that happens to segments after the modes happens on this graph, so that triangles and quads are the same to it.

use geom_core::compute::parallel;
use geom_core::{Point3, QuadMesh, TriMesh, Vector3};

use crate::forms::{area_normal, centroid, sorted_sides};

/// Two faces with a common edge.
/// Lengths are in the unit of the mesh. `turn` is never negative: folds and creases count alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Link {
    /// The other face.
    pub(crate) face: u32,
    /// Length of the common edge.
    pub(crate) length: f64,
    /// Distance of the centroids.
    pub(crate) apart: f64,
    /// The angle between the faces over the distance of their centroids: curvature across the edge.
    pub(crate) turn: f64,
}

/// The faces of a mesh: their corners, areas and neighbours.
/// An edge of more than two faces links each pair of them. Quads count as plane: their area is that of their mean
/// plane.
#[derive(Clone, Debug)]
pub struct Faces {
    sides: usize,
    corners: Vec<u32>,
    areas: Vec<f64>,
    starts: Vec<usize>,
    links: Vec<Link>,
}

impl From<&TriMesh> for Faces {
    fn from(mesh: &TriMesh) -> Self {
        Self::of(mesh.positions(), mesh.triangles())
    }
}

impl From<&QuadMesh> for Faces {
    fn from(mesh: &QuadMesh) -> Self {
        Self::of(mesh.positions(), mesh.quads())
    }
}

impl Faces {
    fn of<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> Self {
        let normals: Vec<Vector3> = faces.iter().map(|f| area_normal(positions, f)).collect();
        let centers: Vec<Point3> = faces.iter().map(|f| centroid(positions, f)).collect();
        let sides = sorted_sides(faces);
        let mut links: Vec<(u32, Link)> = Vec::with_capacity(sides.len());
        for around in sides.chunk_by(|a, b| a.0 == b.0) {
            let [a, b] = around[0].0.map(|v| positions[v as usize]);
            for (i, &(_, f)) in around.iter().enumerate() {
                for &(_, g) in &around[i + 1..] {
                    let (n, m) = (normals[f as usize], normals[g as usize]);
                    let angle = n.cross(&m).norm().atan2(n.dot(&m));
                    let apart = (centers[f as usize] - centers[g as usize]).norm();
                    let length = (b - a).norm();
                    let turn = if apart > 0.0 { angle / apart } else { 0.0 };
                    let link = |face| Link {
                        face,
                        length,
                        apart,
                        turn,
                    };
                    links.extend([(f, link(g)), (g, link(f))]);
                }
            }
        }
        links.sort_by_key(|(f, link)| (*f, link.face));
        let mut counts = vec![0u32; faces.len()];
        for (f, _) in &links {
            counts[*f as usize] += 1;
        }
        Self {
            sides: N,
            corners: faces.as_flattened().to_vec(),
            areas: normals.iter().map(|n| n.norm()).collect(),
            starts: parallel::starts_of(&counts),
            links: links.into_iter().map(|(_, link)| link).collect(),
        }
    }

    /// The number of faces.
    pub fn len(&self) -> usize {
        self.areas.len()
    }

    /// Is there no face?
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty()
    }

    /// The corners of a face.
    pub fn corners(&self, face: usize) -> &[u32] {
        &self.corners[face * self.sides..(face + 1) * self.sides]
    }

    pub(crate) fn all_corners(&self) -> &[u32] {
        &self.corners
    }

    /// The area of each face.
    /// In the squared unit of the mesh.
    pub fn areas(&self) -> &[f64] {
        &self.areas
    }

    /// The neighbours of a face, in the order of their numbers.
    pub(crate) fn links(&self, face: usize) -> &[Link] {
        &self.links[self.starts[face]..self.starts[face + 1]]
    }
}
