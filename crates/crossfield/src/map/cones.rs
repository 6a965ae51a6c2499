//! The turns of a map around vertices: whether they are those of the field, and how vertices of five quads and more get theirs.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use super::system::System;
use crate::field::CrossField;
use crate::field::frames::{Frames, next, previous};

/// A star counts as upright when its triangles' determinants are above this.
const UPRIGHT: f64 = 1e-3;

/// Where the angle around a vertex of five or more quads is a full turn less than wanted, no energy that only keeps triangles
/// upright winds it up again. So its neighbours are laid as they lie on the surface, with angles that add up, before a map is
/// unfolded, whatever that does to the triangles around. Returns which triangles have to stay upright from then on: those of
/// all such vertices whose angle is right.
///
/// `y` are the unknowns of the system and change for the neighbours of the vertices laid. The vertices are taken one
/// after the other, so that of two that share a triangle the later one has it; what the first loses is not held.
pub(super) fn wound(
    system: &System<'_>,
    frames: &Frames,
    field: &CrossField,
    y: &mut [f64],
) -> Vec<usize> {
    let mut held = Vec::new();
    let mut corners = system.corners(y);
    for v in (0..field.index.len()).filter(|&v| field.index[v] < 0 && !frames.on_boundary(v)) {
        let fan: Vec<usize> = frames.around(v).collect();
        let is_right = |corners: &[[[f64; 2]; 3]]| {
            let mut all = fan.iter().map(|h| h / 3);
            !has_wrong_angle(frames, field, corners, v)
                && all.all(|f| system.charts[f].determinant(&corners[f]) > UPRIGHT)
        };
        if !is_right(&corners) {
            lay(system, field.index[v], &fan, &corners, y);
            corners = system.corners(y);
        }
        if is_right(&corners) {
            held.extend(fan.iter().map(|h| h / 3));
        }
    }
    held.sort_unstable();
    held.dedup();
    // What one vertex was given another may have taken.
    held.retain(|&f| system.charts[f].determinant(&corners[f]) > UPRIGHT);
    held
}

/// Lays the neighbours of a vertex around it: at their lengths, at angles stretched to add up, turned to fit the field best.
///
/// On the surface the angles around the vertex may add up to anything, in the map they must add up to `4 − 4 I`
/// quarters: all are multiplied by the same number. A neighbour stays where it is in a coordinate that is not free, as
/// on lines and boundaries.
fn lay(system: &System<'_>, index: i32, fan: &[usize], corners: &[[[f64; 2]; 3]], y: &mut [f64]) {
    let spokes: Vec<[[f64; 2]; 2]> = fan.iter().map(|&h| spokes(system, h)).collect();
    let angle = |p: [f64; 2]| p[1].atan2(p[0]);
    let opening = |[a, b]: [[f64; 2]; 2]| (angle(b) - angle(a)).rem_euclid(TAU);
    let total: f64 = spokes.iter().map(|&s| opening(s)).sum();
    let stretch = f64::from(4 - index) * FRAC_PI_2 / total;
    // The direction of each spoke in its own chart, if the first is at 0.
    let mut at = 0.0;
    let mut directions = Vec::with_capacity(fan.len());
    for (&h, &spokes) in fan.iter().zip(&spokes) {
        directions.push(at);
        at += stretch * opening(spokes) - FRAC_PI_2 * f64::from(system.cut.turn[previous(h)]);
    }
    let (mut sine, mut cosine) = (0.0, 0.0);
    for (spokes, direction) in spokes.iter().zip(&directions) {
        let off = angle(spokes[0]) - direction;
        (sine, cosine) = (sine + off.sin(), cosine + off.cos());
    }
    let first = sine.atan2(cosine);
    let reals = system.seams.reals;
    for ((&h, spokes), direction) in fan.iter().zip(&spokes).zip(directions) {
        let centre = corners[h / 3][h % 3];
        let length = spokes[0][0].hypot(spokes[0][1]);
        let (sine, cosine) = (first + direction).sin_cos();
        let wanted = [centre[0] + length * cosine, centre[1] + length * sine];
        for (component, wanted) in wanted.into_iter().enumerate() {
            let row = || system.seams.row(system.cut.copy[next(h)], component);
            let mut free = row().filter(|&(k, _)| k < reals);
            let (Some((k, c)), None) = (free.next(), free.next()) else {
                continue;
            };
            let rest: f64 = row()
                .filter(|&(l, _)| l != k)
                .map(|(l, c)| f64::from(c) * y[l])
                .sum();
            y[k] = (wanted - rest) / f64::from(c);
        }
    }
}

/// The two sides from a corner as the field would have them in the map.
///
/// They are `[du, dv]` in units of lines, to the next corner and to the previous one.
fn spokes(system: &System<'_>, h: usize) -> [[f64; 2]; 2] {
    let chart = &system.charts[h / 3];
    let (k, l) = (next(h) % 3, previous(h) % 3);
    // The gradients of the hats at the far ends, and the sides, are inverse matrices.
    let inverse = |hats: &[[f64; 2]; 3]| {
        let ([a, b], [c, d]) = (hats[k], hats[l]);
        let determinant = a * d - b * c;
        [[d, -b], [-c, a]].map(|row| row.map(|x| x / determinant))
    };
    let (u, v) = (inverse(&chart.along_u), inverse(&chart.along_v));
    [[u[0][0], v[1][0]], [u[0][1], v[1][1]]]
}

/// Do the angles around a vertex add up to something else than what the field says?
///
/// Angles of triangles that are turned over count as negative, and the sum is a multiple of a quarter turn where the
/// map continues over its seams: an eighth of a turn is a safe threshold for rounding errors. Vertices without
/// triangles have no wrong angle. On a boundary the wanted sum is `2 − 4 I` quarters.
pub(super) fn has_wrong_angle(
    frames: &Frames,
    field: &CrossField,
    corners: &[[[f64; 2]; 3]],
    v: usize,
) -> bool {
    if frames.around(v).next().is_none() {
        return false;
    }
    let angles = frames
        .around(v)
        .map(|h| corner_angle(&corners[h / 3], h % 3));
    let quarters = if frames.on_boundary(v) { 2 } else { 4 } - field.index[v];
    let wanted = f64::from(quarters) * FRAC_PI_2;
    (angles.sum::<f64>() - wanted).abs() > FRAC_PI_4
}

/// The angle from the side to the next corner to that to the previous one, within ±π.
fn corner_angle(uv: &[[f64; 2]; 3], k: usize) -> f64 {
    let side = |l: usize| [uv[l][0] - uv[k][0], uv[l][1] - uv[k][1]];
    let (a, b) = (side((k + 1) % 3), side((k + 2) % 3));
    (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1])
}
