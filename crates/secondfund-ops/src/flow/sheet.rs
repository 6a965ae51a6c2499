//! Faces as filters of their normals see them.

use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, Vector3};

use crate::Error;
use crate::forms::{area_normal, centroid, sorted_sides};

/// Directions count as free up to this share of the largest eigenvalue: faces that meet at up to 25 degrees are one.
const FREE: f64 = 0.05;

/// The part of a vector along the eigenvectors of small eigenvalues, less the larger they are.
fn free_part(tensor: &Matrix3<f64>, way: &Vector3) -> Vector3 {
    let eigen = tensor.symmetric_eigen();
    let bound = FREE * eigen.eigenvalues.max();
    let along = |k: usize| {
        let axis = eigen.eigenvectors.column(k).into_owned();
        let share = (1.0 - eigen.eigenvalues[k] / bound).clamp(0.0, 1.0);
        axis * (axis.dot(way) * share)
    };
    if bound > 0.0 {
        along(0) + along(1) + along(2)
    } else {
        Vector3::zeros()
    }
}

/// An edge of two faces.
pub(super) struct Hinge {
    pub(super) faces: [u32; 2],
    /// In mean edges.
    pub(super) length: f64,
}

/// The faces of a mesh as a filter sees them.
pub(super) struct Sheet {
    pub(super) centers: Vec<Point3>,
    /// Unit normals, zero for a face without area.
    pub(super) normals: Vec<Vector3>,
    /// In squared mean edges.
    pub(super) areas: Vec<f64>,
    pub(super) hinges: Vec<Hinge>,
    /// Which vertices lie on boundaries.
    rims: Vec<bool>,
    starts: Vec<usize>,
    faces: Vec<u32>,
}

impl Sheet {
    pub(super) fn of<const N: usize>(
        positions: &[Point3],
        faces: &[[u32; N]],
    ) -> Result<Self, Error> {
        let sides = sorted_sides(faces);
        let length = |[a, b]: [u32; 2]| (positions[b as usize] - positions[a as usize]).norm();
        let all: f64 = sides.iter().map(|side| length(side.0)).sum();
        let edge = all / sides.len() as f64;
        // Not a number for a mesh without faces.
        if edge.is_nan() || edge <= 0.0 {
            return Err(Error::NoExtent);
        }
        let mut rims = vec![false; positions.len()];
        let mut hinges = Vec::with_capacity(sides.len() / 2);
        for around in sides.chunk_by(|a, b| a.0 == b.0) {
            match around {
                [(ends, _)] => ends.iter().for_each(|&v| rims[v as usize] = true),
                [(ends, f), (_, g)] => hinges.push(Hinge {
                    faces: [*f, *g],
                    length: length(*ends) / edge,
                }),
                // More than two sheets have no common normal.
                _ => {}
            }
        }
        let scaled: Vec<Vector3> = faces.iter().map(|f| area_normal(positions, f)).collect();
        let unit = |n: &Vector3| n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let mut counts = vec![0u32; positions.len()];
        for &v in faces.as_flattened() {
            counts[v as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut members = vec![0; faces.as_flattened().len()];
        for (corner, &v) in faces.as_flattened().iter().enumerate() {
            members[next[v as usize]] = (corner / N) as u32;
            next[v as usize] += 1;
        }
        Ok(Self {
            centers: faces.iter().map(|f| centroid(positions, f)).collect(),
            normals: scaled.iter().map(unit).collect(),
            areas: scaled.iter().map(|n| n.norm() / (edge * edge)).collect(),
            hinges,
            rims,
            starts,
            faces: members,
        })
    }

    /// The faces of a vertex.
    pub(super) fn around(&self, v: usize) -> &[u32] {
        &self.faces[self.starts[v]..self.starts[v + 1]]
    }

    /// Each vertex goes the mean of its ways to the planes through the middles of its faces; and this share of the way to
    /// the mean of the middles, by area, in the directions in which none of the normals around it pulls: in the plane of a
    /// flat place, along an edge, nowhere at a corner (null-space smoothing: Jiao, *Face offsetting: a unified approach for
    /// explicit moving interfaces*, 2007).
    pub(super) fn steps<const N: usize>(
        &self,
        positions: &[Point3],
        corners: &[[u32; N]],
        normals: &[Vector3],
        tangential: f64,
    ) -> Vec<Vector3> {
        let step = |v: usize| {
            let faces = self.around(v);
            let (mut to_planes, mut to_middles) = (Vector3::zeros(), Vector3::zeros());
            let (mut tensor, mut total) = (Matrix3::zeros(), 0.0);
            for &f in faces {
                let (n, face) = (normals[f as usize], &corners[f as usize]);
                let way = centroid(positions, face) - positions[v];
                let area = area_normal(positions, face).norm();
                to_planes += n * n.dot(&way);
                to_middles += way * area;
                tensor += n * n.transpose() * area;
                total += area;
            }
            let along = match tangential > 0.0 && total > 0.0 {
                true => free_part(&tensor, &(to_middles / total)) * tangential,
                false => Vector3::zeros(),
            };
            to_planes / faces.len().max(1) as f64 + along
        };
        parallel::map(positions.len(), step)
    }

    /// Vertices on boundaries do not move.
    pub(super) fn hold_rims(&self, moves: &mut [Vector3]) {
        for (m, _) in moves.iter_mut().zip(&self.rims).filter(|(_, rim)| **rim) {
            *m = Vector3::zeros();
        }
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;

    pub fn what_is_free_lies_in_a_plane_along_an_edge_and_nowhere_at_a_corner() {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        let way = Vector3::new(0.3, 0.5, 0.7);
        let free = |normals: &[Vector3]| {
            let tensor = normals.iter().map(|n| n * n.transpose()).sum();
            free_part(&tensor, &way)
        };
        assert!((free(&[z, z]) - Vector3::new(0.3, 0.5, 0.0)).norm() < 1e-12);
        assert!((free(&[y, z]) - Vector3::new(0.3, 0.0, 0.0)).norm() < 1e-12);
        assert!(free(&[x, y, z]).norm() < 1e-12);
        assert_eq!(free(&[]), Vector3::zeros());
    }
}
