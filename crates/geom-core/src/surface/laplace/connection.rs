//! The connection between the frames of neighbouring triangles, and the Hermitian form that says how
//! far a field of n-fold directions is from parallel.
//!
//! A direction in a triangle is an angle in a frame of that triangle, and frames of neighbours have nothing to do with each other.
//! Laid flat at their common edge, two triangles have one angle κ between their frames; a direction of angle θ here is *parallel* to one of
//! θ + κ there. For n-fold directions (n = 4: crosses) angles count up to 2π/n, which `z = e^{inθ}` forgets: parallel is
//! `z_j = e^{inκ} z_i`. The sum of `w |z_j − e^{inκ} z_i|²` over the edges is the form, Hermitian and positive semi-definite; its
//! smallest eigenvector is the smoothest field of all.

use nalgebra::Complex;

use super::{Connection, EdgeWeights, Error};
use crate::algebra::SparseMatrix;
use crate::mesh::Halfedges;
use crate::{HalfedgeId, TriMesh, Vector3};

/// Inner edges in the order of their lower half-edge: the turn κ is the difference of the edge's angles in the two
/// frames, by half a turn, since the triangles run it opposite ways. Four entries of the form per edge, and one zero
/// per triangle.
pub(super) fn connection(
    mesh: &TriMesh,
    order: u32,
    weights: EdgeWeights,
) -> Result<Connection, Error> {
    super::check_shapes(mesh)?;
    let edges = Halfedges::of(mesh)?;
    let faces = mesh.triangles().len();
    let areas = super::areas(mesh);
    let mut transports = Vec::new();
    for h in 0..3 * faces as u32 {
        let Some(twin) = edges.twin(HalfedgeId(h)).filter(|t| t.0 > h) else {
            continue;
        };
        let (f, g) = (h / 3, twin.0 / 3);
        let turn = angle_in_frame(mesh, twin.0) + std::f64::consts::PI - angle_in_frame(mesh, h);
        let weight = match weights {
            EdgeWeights::One => 1.0,
            EdgeWeights::Shape => {
                let squared = side(mesh, h).norm_squared();
                1.5 * squared / (areas[f as usize] + areas[g as usize])
            }
        };
        transports.push(super::Transport {
            faces: [f, g],
            angle: wrapped(turn),
            weight,
        });
    }
    let mut triplets = Vec::with_capacity(4 * transports.len());
    // Every triangle has a row, even where it has no neighbour.
    triplets.extend((0..faces as u32).map(|f| (f, f, Complex::from(0.0))));
    for t in &transports {
        let [f, g] = t.faces;
        let w = Complex::from(t.weight);
        let turned = Complex::from_polar(t.weight, f64::from(order) * t.angle);
        triplets.extend([
            (f, f, w),
            (g, g, w),
            (g, f, -turned),
            (f, g, -turned.conj()),
        ]);
    }
    let matrix = SparseMatrix::from_triplets(faces, faces, &triplets)?;
    Ok(Connection {
        transports,
        matrix,
        areas,
    })
}

/// The side that a half-edge runs along. It is not normalized: only directions and the squared length are read.
fn side(mesh: &TriMesh, halfedge: u32) -> Vector3 {
    let corners = mesh.corners(halfedge as usize / 3);
    let k = halfedge as usize % 3;
    corners[(k + 1) % 3] - corners[k]
}

/// The angle of a half-edge in the frame of its triangle, whose first axis is the first side. Counter-clockwise seen
/// from outside, −π…π.
fn angle_in_frame(mesh: &TriMesh, halfedge: u32) -> f64 {
    let first = side(mesh, halfedge / 3 * 3);
    let own = side(mesh, halfedge);
    let normal = mesh.doubled_area_normal(halfedge as usize / 3).normalize();
    normal.dot(&first.cross(&own)).atan2(first.dot(&own))
}

/// In −π…π.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let inside = (angle + PI).rem_euclid(TAU) - PI;
    if inside == -PI { PI } else { inside }
}
