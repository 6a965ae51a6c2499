//! Integers for the seams: greedy rounding with exact re-optimization, then descent.
//!
//! With the reals eliminated, the energy is a quadratic function `½ zᵀ S z − sᵀ z` of the integers z alone, S the Schur complement.
//! Its least value over ℤⁿ is the closest vector of a lattice, which nobody computes for hundreds of unknowns. Greedy rounding
//! takes the variable that is nearest to an integer anyway, fixes it, and moves the rest to its new optimum by one rank-one
//! update; that costs O(n²) per variable. Moves by ±1 of single variables and of coupled pairs then lower what is left.

use std::cell::OnceCell;

use geom_core::Cancelled;
use geom_core::compute::parallel;
use geom_core::nalgebra::{DMatrix, DVector};

use super::dense::{Free, factor, inverse_of};
use super::upright::{AtLeast, Guard, Pair, Short, Upright, Weighed};
use crate::backend::On;
use crate::map::unfold::Effort;

/// Moves lower the energy when they do so by this much.
const FALLS: f64 = 1e-9;
/// Denser grids that rounding is tried on.
const DENSEST: i32 = 4;
/// How many times denser each is.
const RATIO: f64 = 1.25;
/// What bounds the moves looked at per integer: mending stops after a fifth of it, a descent after about twenty times as
/// many.
const MOST_TRIED: usize = 20_000;
/// How often triangles are given more weight.
const BREAKOUTS: usize = 60;
/// How often triangles that have turned around vertices are turned back.
const TURNS: usize = 4;

/// What would keep upright triangles from turning too far around vertices; nothing where none do, `None` if that is not known.
pub(crate) type Turned<'a> = &'a dyn Fn(&[f64]) -> Option<Vec<AtLeast>>;

/// What a search for integers may use: a move that is looked at costs as much as the energy of a triangle.
#[derive(Clone, Copy)]
pub(crate) struct Means<'a> {
    pub(crate) effort: &'a Effort,
    pub(crate) run: On<'a>,
}

/// The energy as a function of the integers: `½ zᵀ S z − sᵀ z`.
pub(crate) struct Quadratic {
    /// S, dense.
    matrix: DMatrix<f64>,
    /// s.
    right: DVector<f64>,
    /// S⁻¹.
    inverse: DMatrix<f64>,
    /// The real minimum.
    relaxed: DVector<f64>,
    /// What [`greedy`] makes of it, which is asked for with and without a decimated map.
    nearest: OnceCell<Vec<f64>>,
}

impl Quadratic {
    /// From S⁻¹, row after row and symmetric, and the real minimum `S⁻¹ s`; `None` if S⁻¹ is not positive definite.
    pub(crate) fn new(inverse: Vec<f64>, relaxed: &[f64]) -> Option<Self> {
        let n = relaxed.len();
        let inverse = DMatrix::from_vec(n, n, inverse);
        let matrix = inverse_of(&factor(&inverse)?);
        let relaxed = DVector::from_column_slice(relaxed);
        Some(Self {
            right: &matrix * &relaxed,
            matrix,
            inverse,
            relaxed,
            nearest: OnceCell::new(),
        })
    }

    /// How much more energy than the real minimum has.
    #[cfg(feature = "testing")]
    pub(crate) fn above(&self, z: &[f64]) -> f64 {
        let off = DVector::from_column_slice(z) - &self.relaxed;
        0.5 * off.dot(&(&self.matrix * &off))
    }

    /// Rounds the variable that is nearest to an integer, lets the others follow to their exact optimum, and so on
    /// (Bommes, Zimmer and Kobbelt, *Mixed-integer quadrangulation*, 2009, with the real unknowns eliminated); then moves single
    /// integers and pairs of them by one while the energy falls.
    pub(crate) fn rounded(&self, run: On<'_>) -> Result<Vec<f64>, Cancelled> {
        let mut z = self.nearest().to_vec();
        self.descend_on(&mut z, &self.right, None, run)?;
        Ok(z)
    }

    /// Integers that leave all triangles of a decimated map upright: those rounded, on a grid so many times denser that moves
    /// by one mend them, brought back step by step to the wanted spacing by descent that keeps them so. `None` if even the
    /// densest grid is of no use.
    ///
    /// On a grid r times denser the whole map is r times as large: S stays the same and s is multiplied by r. There
    /// singular vertices have more points between them, so that rounding makes fewer mistakes. It is tried 1, 1.25, …
    /// up to 1.25⁴ times as dense, as long as the effort lasts, and on the way back the energy is that of each coarser grid in turn, under the
    /// condition that no triangle that is upright turns over.
    pub(crate) fn rounded_within(
        &self,
        upright: &mut Upright,
        turned: Turned<'_>,
        means: Means<'_>,
    ) -> Result<Option<Vec<f64>>, Cancelled> {
        for first in 0..=DENSEST {
            let mut z = match first {
                0 => self.nearest().to_vec(),
                _ if !means.effort.spend(cube(self.relaxed.len())) => return Ok(None),
                _ => greedy(&self.inverse, &(&self.relaxed * RATIO.powi(first))),
            };
            if !self.mend(&mut z, &self.denser(first), upright, means)? {
                continue;
            }
            for step in (0..=first).rev() {
                self.descend_on(&mut z, &self.denser(step), Some(upright), means.run)?;
            }
            if self.unturn(&mut z, upright, turned, means)? {
                return Ok(Some(z));
            }
        }
        Ok(None)
    }

    /// Integers near these that leave all upright; `None` if none are found.
    pub(crate) fn mended(
        &self,
        z: &[f64],
        upright: &mut Upright,
        turned: Turned<'_>,
        means: Means<'_>,
    ) -> Result<Option<Vec<f64>>, Cancelled> {
        let mut z = z.to_vec();
        let is_right =
            self.settle(&mut z, upright, means)? && self.unturn(&mut z, upright, turned, means)?;
        Ok(is_right.then_some(z))
    }

    /// Mends on the wanted grid, then descends; false if triangles stay folded.
    fn settle(
        &self,
        z: &mut [f64],
        upright: &Upright,
        means: Means<'_>,
    ) -> Result<bool, Cancelled> {
        let is_mended = self.mend(z, &self.right, upright, means)?;
        if is_mended {
            self.descend_on(z, &self.right, Some(upright), means.run)?;
        }
        Ok(is_mended)
    }

    /// Turns back what moves have turned around vertices, with conditions that stay; false if that leads nowhere.
    fn unturn(
        &self,
        z: &mut [f64],
        upright: &mut Upright,
        turned: Turned<'_>,
        means: Means<'_>,
    ) -> Result<bool, Cancelled> {
        for _ in 0..=TURNS {
            let Some(conditions) = turned(z) else {
                return Ok(false);
            };
            if conditions.is_empty() {
                return Ok(true);
            }
            upright.add(&conditions);
            if !self.settle(z, upright, means)? {
                return Ok(false);
            }
        }
        Ok(false)
    }

    /// The right-hand side on a grid so many steps denser.
    fn denser(&self, step: i32) -> DVector<f64> {
        &self.right * RATIO.powi(step)
    }

    /// Rounded on the wanted grid, n³ operations, once.
    fn nearest(&self) -> &[f64] {
        self.nearest
            .get_or_init(|| greedy(&self.inverse, &self.relaxed))
    }

    /// Moves single integers and pairs by one while that brings triangles nearer to upright; of the moves that do so most,
    /// those of least energy. Where none does, triangles that are not upright weigh more from then on (Morris, *The breakout
    /// method for escaping from local minima*, 1993). Returns whether all are.
    ///
    /// `z` changes, and is what was reached even if that is not enough. It gives up after 4 n + 50 steps, after
    /// [`BREAKOUTS`] times of more weight, or when it has looked at too many moves or at as many as the effort was for.
    fn mend(
        &self,
        z: &mut [f64],
        right: &DVector<f64>,
        upright: &Upright,
        means: Means<'_>,
    ) -> Result<bool, Cancelled> {
        let n = z.len();
        let coupled = self.coupled(|_| 0);
        let mut sides = upright.sides(z);
        let mut weights = vec![1; sides.len()];
        let mut gradient = &self.matrix * DVector::from_column_slice(z) - right;
        let most = 4 * n + 50;
        let (mut tried, mut breakouts) = (0, 0);
        for step in 0..most {
            let before = tried;
            let short = upright.short(&sides);
            if short.integers.is_empty() {
                return Ok(true);
            }
            means.run.progress("integers", step as u64, most as u64)?;
            // Other integers change no triangle that has to change.
            let integers = &short.integers;
            tried += 2 * integers.len();
            let single = integers
                .iter()
                .flat_map(|&i| [-1.0, 1.0].map(|d| [(i, d), (i, 0.0)]));
            let weighed = Weighed {
                upright,
                sides: &sides,
                weights: &weights,
            };
            // Pairs are many times as many, and asked for only where no single one helps. The bound counts them before, so that what is
            // given up does not depend on how fast they are judged.
            let best = self.best_mend(single, weighed, &short, &gradient);
            if best.is_none() {
                tried += integers
                    .iter()
                    .map(|&i| 4 * coupled[i].len())
                    .sum::<usize>();
            }
            if tried > MOST_TRIED / 5 * n || !means.effort.spend(tried - before) {
                return Ok(false);
            }
            let best = best.or_else(|| {
                let signs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
                let pairs = integers
                    .iter()
                    .flat_map(|&i| coupled[i].iter().map(move |&(j, _)| (i, j)))
                    .flat_map(|(i, j)| signs.map(|(d, e)| [(i, d), (j, e)]));
                self.best_mend(pairs, weighed, &short, &gradient)
            });
            // A local minimum of the weighted shortages: raise it until one of its neighbours is lower.
            let Some(moves) = best else {
                breakouts += 1;
                if breakouts > BREAKOUTS {
                    return Ok(false);
                }
                upright.weigh_short(&sides, &mut weights);
                continue;
            };
            // All that is judged by follows the move: sides exactly, the gradient by its column.
            for (k, d) in moves {
                z[k] += d;
                upright.shift(&mut sides, k, d);
                gradient.axpy(d, &self.matrix.column(k), 1.0);
            }
        }
        Ok(false)
    }

    /// Of moves that bring triangles nearer to upright, the one that does so most and costs least energy.
    ///
    /// `gradient` is that of the energy before the move, `S z − s`. Exact shortages come first, energies only break
    /// ties: an energy that is a sum of many numbers must not decide what is valid.
    fn best_mend(
        &self,
        moves: impl Iterator<Item = Pair>,
        weighed: Weighed<'_>,
        short: &Short,
        gradient: &DVector<f64>,
    ) -> Option<Pair> {
        let mut best: Option<(i128, f64, Pair)> = None;
        for pair in moves {
            // Nearly all moves gain less than the best: most triangles of theirs need not be looked at.
            let least = weighed.least_change(&pair, short);
            if least >= 0 || best.is_some_and(|b| b.0 < least) {
                continue;
            }
            let change = weighed.change(&pair);
            if change >= 0 || best.is_some_and(|b| b.0 < change) {
                continue;
            }
            let [(i, d), (j, e)] = pair;
            let energy = d * gradient[i]
                + e * gradient[j]
                + 0.5 * (d * d * self.matrix[(i, i)] + e * e * self.matrix[(j, j)])
                + d * e * self.matrix[(i, j)];
            if best.is_none_or(|b| (change, energy) < (b.0, b.1)) {
                best = Some((change, energy, pair));
            }
        }
        best.map(|b| b.2)
    }

    /// Changes one integer or two that are coupled by one, whatever lowers the energy most, as long as that turns no triangle
    /// over.
    ///
    /// `right` says on which grid. After a change the gradient is brought up to date in n operations, and all moves are
    /// judged anew from it. All triangles are upright before, and after each move.
    fn descend_on(
        &self,
        z: &mut [f64],
        right: &DVector<f64>,
        upright: Option<&Upright>,
        run: On<'_>,
    ) -> Result<(), Cancelled> {
        let n = z.len();
        let coupled = self.coupled(|i| i + 1);
        let mut gradient = &self.matrix * DVector::from_column_slice(z) - right;
        let diagonal = self.matrix.diagonal();
        let single =
            |gradient: &DVector<f64>, k: usize, d: f64| d * gradient[k] + 0.5 * diagonal[k];
        // Moves have numbers, in the order in which they are considered.
        let pairs: usize = coupled.iter().map(|c| 2 + 4 * c.len()).sum();
        let mut guard = upright.map(|upright| Guard::new(upright, z, pairs));
        let mut moves: Vec<Move> = Vec::new();
        let most = (20 * n + 20).min(20 * MOST_TRIED * n / pairs.max(1) + 200);
        for step in 0..most {
            run.progress("integers", step as u64, most as u64)?;
            // What each change does to the energy follows from its gradient.
            moves.clear();
            let mut number = 0;
            let mut consider = |energy: f64, pair: Pair| {
                if energy < -FALLS && guard.as_ref().is_none_or(|g| !g.knows(number, &pair)) {
                    moves.push((energy, number, pair));
                }
                number += 1;
            };
            for (i, coupled) in coupled.iter().enumerate() {
                for d in [-1.0, 1.0] {
                    let own = single(&gradient, i, d);
                    consider(own, [(i, d), (i, 0.0)]);
                    for &(j, s) in coupled {
                        for e in [-1.0, 1.0] {
                            let both = own + single(&gradient, j, e) + d * e * s;
                            consider(both, [(i, d), (j, e)]);
                        }
                    }
                }
            }
            let accepted = best_allowed(&mut moves, |number, pair| {
                guard.as_mut().is_none_or(|g| !g.forbids(number, pair))
            });
            let Some(pair) = accepted else {
                return Ok(());
            };
            for (k, d) in pair {
                z[k] += d;
                gradient.axpy(d, &self.matrix.column(k), 1.0);
            }
            if let Some(guard) = &mut guard {
                guard.make(&pair);
            }
        }
        Ok(())
    }

    /// Per integer, the others from a first one on that it is coupled to most, and their entries in S: all while there are few.
    ///
    /// By the size of their entry in S. Two integers of a small entry do not change each other's optimum, and moving
    /// both is then no better than moving one after the other.
    fn coupled(&self, first: impl Fn(usize) -> usize + Sync) -> Vec<Vec<(usize, f64)>> {
        const FEW: usize = 256;
        const MOST: usize = 32;
        let (matrix, n) = (&self.matrix, self.right.len());
        parallel::map(n, |i| {
            let column = matrix.column(i);
            let others = (first(i)..n).filter(|&j| j != i);
            let mut others: Vec<(usize, f64)> = others.map(|j| (j, column[j])).collect();
            if n > FEW && others.len() > MOST {
                others.select_nth_unstable_by(MOST, |a, b| {
                    b.1.abs().total_cmp(&a.1.abs()).then(a.0.cmp(&b.0))
                });
                others.truncate(MOST);
                others.sort_unstable_by_key(|other| other.0);
            }
            others
        })
    }
}

/// What it changes of the energy, its number, and the integers by how much.
type Move = (f64, usize, Pair);

/// The best that is allowed, of equal ones the first; asked in this order. One of the best nearly always is, so that few have to be
/// put in order.
fn best_allowed(
    moves: &mut [Move],
    mut is_allowed: impl FnMut(usize, &Pair) -> bool,
) -> Option<Pair> {
    const TOGETHER: usize = 64;
    let by_energy = |a: &Move, b: &Move| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    let mut rest = moves;
    while !rest.is_empty() {
        let count = TOGETHER.min(rest.len());
        rest.select_nth_unstable_by(count - 1, by_energy);
        let (best, others) = rest.split_at_mut(count);
        best.sort_unstable_by(by_energy);
        let mut allowed = best.iter().filter(|m| is_allowed(m.1, &m.2));
        if let Some((_, _, pair)) = allowed.next() {
            return Some(*pair);
        }
        rest = others;
    }
    None
}

/// What the n³ operations of a dense matrix cost, in evaluations of a triangle.
pub(in crate::map) fn cube(n: usize) -> usize {
    const OPERATIONS: usize = 8000;
    n * n / OPERATIONS * n
}

/// [`inverse_of`] for tests: of a positive definite matrix, row after row.
#[cfg(feature = "testing")]
pub(crate) fn inverse(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    let factor = factor(&DMatrix::from_row_slice(n, n, matrix))?;
    Some(inverse_of(&factor).as_slice().to_vec())
}

/// [`greedy`] for tests, from a positive definite matrix.
#[cfg(feature = "testing")]
pub(crate) fn rounded(matrix: &[f64], right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    let inverse = inverse_of(&factor(&DMatrix::from_row_slice(n, n, matrix))?);
    let relaxed = &inverse * DVector::from_column_slice(right);
    Some(greedy(&inverse, &relaxed))
}

/// Variable by variable, from the real minimum, with the inverse of the matrix of those that are free.
///
/// Putting variable k at an integer moves all others by `column k of the inverse × step / pivot`, which is their exact
/// optimum. n³ operations in all, in parallel, the same digits for any number of threads.
fn greedy(inverse: &DMatrix<f64>, relaxed: &DVector<f64>) -> Vec<f64> {
    let mut z: Vec<f64> = relaxed.as_slice().to_vec();
    let mut free = Free::of(inverse);
    let away = |k: usize, z: &[f64]| (z[k] - z[k].round()).abs();
    let nearest = |free: &Free, z: &[f64]| {
        let all = free.variables();
        all.min_by(|&(_, a), &(_, b)| away(a, z).total_cmp(&away(b, z)).then(a.cmp(&b)))
    };
    while let Some((at, k)) = nearest(&free, &z) {
        let to = z[k].round();
        let (pivot, others) = free.hold(at);
        if pivot > 0.0 {
            let step = (to - z[k]) / pivot;
            for (j, entry) in others {
                z[j] += entry * step;
            }
        }
        z[k] = to;
    }
    z
}
