//! Unfolding of a map.
//!
//! The energy of Eq. 4.10 does not know that a triangle is upside down: its determinant may change sign at a finite cost.
//! Here the distortion of a triangle with Jacobian J is `(|J|² + λ (det² + 1)) / 2 det`, which is infinite where det J = 0, so that
//! no step leads from upright to folded. To get *into* the upright region from outside, det is replaced by
//! `χ = (det + √(ε² + det²)) / 2`, which is positive everywhere, close to det above ε and close to 0 below −ε. With ε large a
//! folded triangle costs little; as ε falls, unfolding it is what pays (Garanzha et al., 2021).

use geom_core::compute::parallel;

use super::effort::Effort;
use super::energy::{Energy, LEAST, Wish};
use super::lbfgs::{Bend, STEPS, minimize};
use super::scope::Scope;
use crate::Error;
use crate::backend::On;
use crate::map::system::System;

/// Regularizations.
const ROUNDS: usize = 60;
/// A folded map stays so when its worst triangle is not better after so many.
const STALLED: usize = 20;
/// Fewer triangles are worked on by one thread: a step of theirs takes less time than others to wake.
const FEW: usize = 2000;
/// Below this ε upright triangles do not fold again: the mean determinant is 1.
const FIRM: f64 = 1.0;
/// An upright map is settled when a round lowers its energy by less, relatively.
const SETTLED: f64 = 1e-2;

/// Says something of a map by all its unknowns.
pub(crate) type Judge<'a> = &'a dyn Fn(&[f64]) -> bool;

/// How it moves.
pub(crate) struct Moves<'a> {
    /// What moves.
    pub(crate) scope: &'a Scope,
    /// The inverse of the quadratic energy, which bends the steps (Kovalsky, Galun and Lipman, *Accelerated quadratic proxy for
    /// geometric optimization*, 2016): a mesh of any fineness takes about as many.
    pub(crate) bend: Bend<'a>,
    /// Triangles that are upright, and stay so; ascending.
    pub(crate) held: Vec<usize>,
    /// What unfolding may cost.
    pub(crate) effort: &'a Effort,
    /// Is this a map from which none with the right angles is reached once ε is small?
    pub(crate) is_lost: Judge<'a>,
    /// May what is upright fold on the way? A map that only settles then takes long to come back, if it does.
    pub(crate) may_fold: bool,
}

/// Minimizes the regularized distortion `Σ A ((|J|² + λ (det² + 1)) / 2χ + |J − 1|²)`, `χ = (det + √(ε² + det²)) / 2`
/// (Garanzha et al., *Foldover-free maps in 50 lines of code*, 2021), by L-BFGS. ε falls as theirs does, by what a round has
/// gained and by the worst determinant, and to twice that at once. A map that cannot be unfolded comes out folded.
///
/// `w` are all values; the unknowns of the scope move, and sums with the integers. With ε above 0 the energy is finite
/// everywhere, so that any map may be the start. A round is a minimization for one ε, of at most [`STEPS`] steps, and there are at most [`ROUNDS`] of them. A map that is still folded is given up
/// when the effort is spent, when its worst determinant has not risen for [`STALLED`] rounds, or when it is lost. Of an
/// upright one ε falls on until a round gains less than [`SETTLED`], so that what comes out is also smooth; the rounds of a start
/// that is upright end with the steps that gain as little.
pub(crate) fn untangle(
    system: &System<'_>,
    w: &mut [f64],
    moves: &Moves<'_>,
    run: On<'_>,
) -> Result<(), Error> {
    minimized(system, w, moves, run, |energy, x| {
        rounds(energy, x, moves, run)
    })
}

/// Moves the values of a scope by rounds of minimization, on one thread if it is about few triangles.
pub(super) fn minimized(
    system: &System<'_>,
    w: &mut [f64],
    moves: &Moves<'_>,
    run: On<'_>,
    rounds: impl FnOnce(&mut Energy<'_>, &mut Vec<f64>) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut x = moves.scope.of(w);
    let mut energy = Energy::new(system, moves.scope, &moves.held, w, run);
    if energy.triangles() < FEW {
        parallel::alone(|| rounds(&mut energy, &mut x))?;
    } else {
        rounds(&mut energy, &mut x)?;
    }
    energy.all(&x);
    Ok(())
}

/// The minimizations, each with its ε.
fn rounds(
    energy: &mut Energy<'_>,
    x: &mut Vec<f64>,
    moves: &Moves<'_>,
    run: On<'_>,
) -> Result<(), Error> {
    let worst = energy.worst(x);
    let mut epsilon = match moves.may_fold {
        true => first_epsilon(worst),
        false => LEAST,
    };
    // What is upright only settles: steps that would not make a round worth another are not worth taking.
    let enough = match worst > 0.0 {
        true => SETTLED / STEPS as f64,
        false => 0.0,
    };
    let (mut best, mut stalled) = (worst, 0);
    for round in 0..ROUNDS {
        // A step of a large map takes a good part of a second, a round half a minute.
        let watch = |step: usize| {
            let done = round * STEPS + step;
            run.progress("untangle", done as u64, (ROUNDS * STEPS) as u64)
        };
        energy.wish = Wish::Upright(epsilon);
        let (before, after) = minimize(energy, moves.bend, moves.effort, x, enough, &watch)?;
        let worst = energy.worst(x);
        let positive = worst > 0.0;
        // Folds that hold each other do not open however long they are pushed.
        if worst > best + 1e-2 * best.abs() {
            (best, stalled) = (worst, 0);
        } else {
            stalled += 1;
        }
        if !positive && (stalled >= STALLED || moves.effort.is_spent()) {
            break;
        }
        if epsilon < FIRM && (moves.is_lost)(energy.all(x)) {
            break;
        }
        let gained = 1.0 - after / before;
        if positive && gained < SETTLED {
            break;
        }
        // ε follows what was gained: too fast a fall freezes the folds, too slow a one takes forever.
        let share = gained.max(0.5);
        let root = worst.hypot(epsilon);
        let falls = if positive {
            share
        } else {
            share * root / (worst.abs() + root)
        };
        // Far above the worst determinant ε only takes time.
        let most = (2.0 * worst.abs()).max(0.4);
        epsilon = (epsilon * (1.0 - falls)).clamp(LEAST, most);
    }
    Ok(())
}

/// The ε that a map with this worst determinant begins with: the smallest where nothing is folded, and nothing shall be, but for
/// triangles so flat that no step could be long for them.
fn first_epsilon(worst: f64) -> f64 {
    const FLAT: f64 = 0.01;
    if worst > FLAT {
        LEAST
    } else {
        (0.5 * worst.abs()).max(0.1)
    }
}
