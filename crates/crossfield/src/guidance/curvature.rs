//! Guidance by principal curvature: the thesis's comparison.
//!
//! Quads that follow the principal directions are the flattest; but on a molecular surface curvature is that of atoms, and
//! so a field has a singularity for every few of them. Chapter 4 of the thesis compares with it.

use geom_core::TriMesh;
use geom_core::nalgebra::Complex;
use geom_core::surface::curvature;

use crate::field::Frames;
use crate::field::{Guide, Toward};

/// Rings of neighbours to which the quadric is fitted.
const RINGS: usize = 2;
/// Curvatures below this over the diagonal of the bounding box are none.
const FLAT: f64 = 1e-3;

/// Triangles whose corners' principal curvatures differ, along the mean of the directions there, taken as fourth powers.
///
/// A direction is a fourth root: as `e^{4iφ}` the two principal directions and their opposites are one number, and
/// numbers can be added up with their weights. The value that is compared with the threshold is the mean over the
/// corners, in 0…1: 1 for cylinders, 0 for spheres, planes and minimal surfaces.
pub(super) fn guides(mesh: &TriMesh, frames: &Frames, threshold: f64, weight: f64) -> Vec<Guide> {
    let principal = curvature::principal(mesh, RINGS);
    let flat = FLAT / mesh.bounds().diagonal();
    let difference = |v: usize| {
        let p = &principal[v];
        (p.max.abs() - p.min.abs()).abs() / (p.max.abs() + p.min.abs() + flat)
    };
    (0..frames.faces())
        .filter_map(|face| {
            let corners = mesh.triangles()[face].map(|v| v as usize);
            let mean = corners.iter().map(|&v| difference(v)).sum::<f64>() / 3.0;
            if mean <= threshold {
                return None;
            }
            let sum: Complex<f64> = corners
                .iter()
                .filter(|&&v| principal[v].confidence > 0.0)
                .map(|&v| {
                    let angle = frames.angle(face, &principal[v].max_direction);
                    Complex::from_polar(difference(v), 4.0 * angle)
                })
                .sum();
            (sum.norm() > 1e-6).then(|| Guide {
                face: face as u32,
                toward: Toward::Angle(sum.arg() / 4.0),
                weight,
            })
        })
        .collect()
}
