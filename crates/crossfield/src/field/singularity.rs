//! Where a field turns: the index of each vertex, in quarters.

use super::frames::{Frames, QUARTER, modulo_quarter};

/// Four times the index of every vertex: +1 for a vertex where three quads meet, −1 where five meet. On a
/// boundary, where the field is parallel to it, +1 is a convex corner.
///
/// Interior vertices count in integers, `4 I = 4 round((K − Σκ) / 2π) − Σp` over the half-edges that lead to the
/// vertex (Ray et al., *N-symmetry direction field design*, 2008), so the sum over a component is four
/// times its Euler characteristic, exactly.
pub fn indices(frames: &Frames, theta: &[f64], jump: &[i32]) -> Vec<i32> {
    (0..frames.edges().vertices())
        .map(|v| {
            if frames.edges().out(geom_core::VertexId(v as u32)).is_none() {
                0
            } else if frames.on_boundary(v) {
                boundary_index(frames, theta, jump, v)
            } else {
                interior_index(frames, jump, v)
            }
        })
        .collect()
}

/// The index of an interior vertex depends on the period jumps alone.
pub(crate) fn interior_index(frames: &Frames, jump: &[i32], v: usize) -> i32 {
    let (mut turn, mut jumps) = (0.0, 0);
    for out in frames.around(v) {
        let h = frames.twin(out).expect("an interior vertex");
        turn += frames.transport(h);
        jumps += jump[h];
    }
    4 * ((frames.defect(v) - turn) / std::f64::consts::TAU).round() as i32 - jumps
}

/// `4 I = (2/π) (K + Σδ + o(out) − o(in))`: o is the angle from the boundary to the nearest arm.
fn boundary_index(frames: &Frames, theta: &[f64], jump: &[i32], v: usize) -> i32 {
    let mut total = frames.defect(v);
    let mut last = 0;
    for (i, out) in frames.around(v).enumerate() {
        if i == 0 {
            total += off_side(frames, theta, out);
        } else {
            total += difference(
                frames,
                theta,
                jump,
                frames.twin(out).expect("inside of the fan"),
            );
        }
        last = out;
    }
    let incoming = super::frames::previous(last);
    total -= off_side(frames, theta, incoming);
    (total / QUARTER).round() as i32
}

/// δ = θ_j − θ_i − κ − (π/2) p: how far the field is from parallel across a half-edge.
pub(crate) fn difference(frames: &Frames, theta: &[f64], jump: &[i32], h: usize) -> f64 {
    let twin = frames.twin(h).expect("an interior edge");
    theta[twin / 3] - theta[h / 3] - frames.transport(h) - QUARTER * f64::from(jump[h])
}

/// The angle from a half-edge to the nearest arm of its triangle's cross.
fn off_side(frames: &Frames, theta: &[f64], h: usize) -> f64 {
    modulo_quarter(theta[h / 3] - frames.side_angle(h))
}
