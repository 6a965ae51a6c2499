//! Faces as filters of their normals see them.

use geom_core::compute::parallel;
use geom_core::{Point3, Vector3};
use rayon::prelude::*;

use crate::Error;
use crate::forms::{area_normal, centroid, sorted_sides};

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

    /// Each vertex goes the mean of its ways to the planes through the middles of its faces.
    pub(super) fn steps<const N: usize>(
        &self,
        positions: &[Point3],
        corners: &[[u32; N]],
        normals: &[Vector3],
    ) -> Vec<Vector3> {
        (0..positions.len())
            .into_par_iter()
            .map(|v| {
                let faces = self.around(v);
                let to_planes = faces.iter().map(|&f| {
                    let center = centroid(positions, &corners[f as usize]);
                    let n = normals[f as usize];
                    n * n.dot(&(center - positions[v]))
                });
                to_planes.sum::<Vector3>() / faces.len().max(1) as f64
            })
            .collect()
    }

    pub(super) fn hold_rims(&self, moves: &mut [Vector3]) {
        for (m, _) in moves.iter_mut().zip(&self.rims).filter(|(_, rim)| **rim) {
            *m = Vector3::zeros();
        }
    }
}
