//! Unfolding by a convex problem: see [`monotone`](super::monotone).

use super::energy::{Energy, Wish};
use super::lbfgs::{STEPS, minimize};
use super::monotone::is_monotone;
use super::untangle::{Moves, minimized};
use crate::Error;
use crate::backend::On;
use crate::map::system::System;

/// Minimizations at most.
const ROUNDS: usize = 8;
/// After a round that leaves more than this share of the triangles, the rest is for its places.
const ENOUGH: f64 = 0.5;

/// Moves a map towards those whose triangles are monotone. Held triangles move with the others: monotone ones are upright.
///
/// # Errors
/// If the watcher asks to stop.
pub(super) fn align(
    system: &System<'_>,
    w: &mut [f64],
    moves: &Moves<'_>,
    run: On<'_>,
) -> Result<(), Error> {
    minimized(system, w, moves, run, |energy, x| {
        energy.wish = Wish::Monotone;
        rounds(energy, x, moves, run)
    })
}

/// Minimizations, as long as each leaves far fewer triangles than the last.
fn rounds(
    energy: &mut Energy<'_>,
    x: &mut Vec<f64>,
    moves: &Moves<'_>,
    run: On<'_>,
) -> Result<(), Error> {
    let mut left = energy.count_not(x, is_monotone);
    for round in 0..ROUNDS {
        if left == 0 || moves.effort.is_spent() {
            break;
        }
        let watch = |step: usize| {
            let done = round * STEPS + step;
            run.progress("monotone", done as u64, (ROUNDS * STEPS) as u64)
        };
        minimize(energy, moves.bend, moves.effort, x, 0.0, &watch)?;
        let last = left;
        left = energy.count_not(x, is_monotone);
        if left as f64 > ENOUGH * last as f64 {
            break;
        }
    }
    Ok(())
}
