//! The field gives way to the map between steep and flat (Eqs. 4.11–4.12).

use geom_core::TriMesh;

use super::Adaptation;
use crate::Error;
use crate::backend::On;
use crate::field::CrossField;
use crate::field::frames::{Frames, QUARTER};
use crate::map::{MapOptions, Relaxation, relaxation};

/// Crosses that turn by less, radians, stand still.
const STILL: f64 = 1e-4;
/// Indices, in quarters, of vertices where three, five or six quads meet: others fold quads.
const INDICES: std::ops::RangeInclusive<i32> = -2..=1;

/// The field of the fewest folded triangles, then of the best map, among those that come about as the crosses of `free`
/// triangles turn towards the gradients of their map; and after how many rounds.
///
/// Of the two arms the one that is farther from its gradient turns by a part of the way, and takes the other along. Period jumps
/// follow the angles, so that singularities may come and go in pairs; their sum stays.
///
/// `map` says what the map of a field should be like, since spacings follow the crosses. Fields with a vertex of two
/// quads, or of seven and more, are passed over. The field that was given is the first candidate, and round 0.
pub(crate) fn adapted(
    mesh: &TriMesh,
    frames: &Frames,
    field: CrossField,
    free: &[usize],
    map: impl Fn(&CrossField) -> MapOptions,
    options: &Adaptation,
    run: On<'_>,
) -> Result<(CrossField, u32), Error> {
    let rounds = u64::from(options.rounds);
    let mut now = field.clone();
    let mut best = (None, field, 0);
    for round in 0..=options.rounds {
        run.progress("adaptation", u64::from(round), rounds + 1)?;
        let relaxed = relaxation(mesh, frames, &now, &map(&now), run)?;
        let rank = (relaxed.faults, relaxed.energy);
        let sound = now.index.iter().all(|i| INDICES.contains(i));
        let better = best.0.is_none_or(|b| sound && rank < b);
        if better {
            best = (Some(rank), now.clone(), round);
        }
        if round == options.rounds || !turn(frames, &mut now, free, &relaxed, options.rate) {
            break;
        }
    }
    Ok((best.1, best.2))
}

/// Turns the crosses of these triangles towards the gradients of a map; whether any moved.
///
/// All turn at once by the same map; indices, energy and counts of the field are measured anew.
pub(crate) fn turn(
    frames: &Frames,
    field: &mut CrossField,
    free: &[usize],
    relaxed: &Relaxation,
    rate: f64,
) -> bool {
    let before = field.theta.clone();
    let mut moved = false;
    for &f in free {
        let by = turned_by(&relaxed.jacobians[f], rate);
        field.theta[f] += by;
        moved |= by.abs() > STILL;
    }
    // A jump changes where the nearest arm of the neighbour is another one now, and only there.
    let nearest = |theta: &[f64], h: usize, t: usize| {
        ((theta[t / 3] - theta[h / 3] - frames.transport(h)) / QUARTER).round() as i32
    };
    for (h, t) in frames.interior() {
        let change = nearest(&field.theta, h, t) - nearest(&before, h, t);
        field.jump[h] += change;
        field.jump[t] -= change;
    }
    let (theta, jump) = (
        std::mem::take(&mut field.theta),
        std::mem::take(&mut field.jump),
    );
    *field = CrossField::measured(frames, theta, jump, field.report.clone());
    moved
}

/// The angle by which a cross turns, from the gradients of u and v in the basis of its arms (Eqs. 4.11–4.12, the result made a
/// unit vector again).
///
/// An arm counts as far from its gradient by the size of their cosine; a gradient of length 0 leaves its arm alone.
pub(crate) fn turned_by([of_u, of_v]: &[[f64; 2]; 2], rate: f64) -> f64 {
    let towards = |along: f64, aside: f64| {
        let length = along.hypot(aside);
        if length > 0.0 {
            [along / length, aside / length]
        } else {
            [1.0, 0.0]
        }
    };
    let u = towards(of_u[0], of_u[1]);
    let v = towards(of_v[1], -of_v[0]);
    let worse = if u[0].abs() < v[0].abs() { u } else { v };
    (rate * worse[1]).atan2(1.0 + rate * (worse[0] - 1.0))
}
