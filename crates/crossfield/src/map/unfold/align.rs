//! Unfolding by a convex problem: see [`monotone`](super::monotone).

use super::energy::{Energy, Wish};
use super::lbfgs::{STEPS, minimize};
use super::monotone::least_eigenvalue;
use super::untangle::{Moves, on_threads_for};
use crate::Error;
use crate::backend::On;
use crate::map::system::System;

/// Minimizations at most.
const ROUNDS: usize = 8;
/// After a round that leaves more than this share of the triangles, the rest is for its places.
const ENOUGH: f64 = 0.5;

/// Moves a map towards those whose triangles are monotone.
///
/// # Errors
/// If the watcher asks to stop.
pub(crate) fn align(
    system: &System<'_>,
    w: &mut [f64],
    moves: &Moves<'_>,
    run: On<'_>,
) -> Result<(), Error> {
    let energy = Energy::new(system, moves.scope, &[], w, run);
    on_threads_for(energy.triangles(), || rounds(energy, w, moves, run))
}

fn rounds(
    mut energy: Energy<'_>,
    w: &mut [f64],
    moves: &Moves<'_>,
    run: On<'_>,
) -> Result<(), Error> {
    let mut x: Vec<f64> = moves.scope.unknowns.iter().map(|&k| w[k]).collect();
    energy.wish = Wish::Monotone;
    let mut left = energy.count(&x, |chart, uv| least_eigenvalue(chart, uv) <= 0.0);
    for round in 0..ROUNDS {
        if left == 0 || moves.effort.is_spent() {
            break;
        }
        let watch = |step: usize| {
            let done = round * STEPS + step;
            run.progress("monotone", done as u64, (ROUNDS * STEPS) as u64)
        };
        minimize(&mut energy, moves.bend, moves.effort, &mut x, &watch)?;
        let last = left;
        left = energy.count(&x, |chart, uv| least_eigenvalue(chart, uv) <= 0.0);
        if left as f64 > ENOUGH * last as f64 {
            break;
        }
    }
    w.copy_from_slice(energy.all(&x));
    Ok(())
}
