//! The turns of a map around vertices: are they those of the field?

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use crate::field::CrossField;
use crate::field::frames::Frames;

/// What the angles around a vertex of index I shall add up to in a map: `4 − 4 I` quarters, on a boundary `2 − 4 I`.
pub(super) fn wanted_angle(frames: &Frames, field: &CrossField, v: usize) -> f64 {
    let quarters = if frames.on_boundary(v) { 2 } else { 4 } - field.index[v];
    f64::from(quarters) * FRAC_PI_2
}

/// Do the angles around a vertex add up to something else than what the field says?
///
/// Angles of triangles that are turned over count as negative, and the sum is a multiple of a quarter turn where the
/// map continues over its seams: an eighth of a turn is a safe threshold for rounding errors. Vertices without
/// triangles have no wrong angle. `corners` are those of each triangle.
pub(super) fn has_wrong_angle(
    frames: &Frames,
    field: &CrossField,
    corners: impl Fn(usize) -> [[f64; 2]; 3],
    v: usize,
) -> bool {
    if frames.around(v).next().is_none() {
        return false;
    }
    let angles = frames
        .around(v)
        .map(|h| corner_angle(&corners(h / 3), h % 3));
    let wanted = wanted_angle(frames, field, v);
    (angles.sum::<f64>() - wanted).abs() > FRAC_PI_4
}

/// The angle from the side to the next corner to that to the previous one, within ±π.
fn corner_angle(uv: &[[f64; 2]; 3], k: usize) -> f64 {
    let side = |l: usize| [uv[l][0] - uv[k][0], uv[l][1] - uv[k][1]];
    let (a, b) = (side((k + 1) % 3), side((k + 2) % 3));
    (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1])
}
