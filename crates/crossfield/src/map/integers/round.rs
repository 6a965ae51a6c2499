//! Integers for the seams: greedy rounding with exact re-optimization, then descent.
//!
//! With the reals eliminated, the energy is a quadratic function `½ zᵀ S z − sᵀ z` of the integers z alone, S the Schur complement.
//! Its least value over ℤⁿ is the closest vector of a lattice, which nobody computes for hundreds of unknowns. Greedy rounding
//! takes the variable that is nearest to an integer anyway, fixes it, and moves the rest to its new optimum by one rank-one
//! update; that costs O(n²) per variable. Moves by ±1 of single variables and of coupled pairs then lower what is left.

use geom_core::Cancelled;
use geom_core::compute::parallel;
use geom_core::nalgebra::{DMatrix, DVector};

use super::dense::{Free, factor, inverse_of};
use super::mend::{Cost, Energy, MOST_TRIED, Means, RATIO, strongest};
use super::upright::{Guard, Pair, Sides, Upright};
use crate::backend::On;

/// So many integers have dense matrices of 180 MB together. Rounded region by region they are a tenth to a quarter worse in energy.
pub(crate) const MOST_DENSE: usize = 3000;
/// Moves lower the energy when they do so by this much.
const FALLS: f64 = 1e-9;

/// The energy as a function of the integers: `½ zᵀ S z − sᵀ z`.
pub(crate) struct Quadratic {
    /// S, dense.
    matrix: DMatrix<f64>,
    /// s.
    right: DVector<f64>,
    /// The real minimum.
    relaxed: DVector<f64>,
    /// It rounded.
    nearest: Vec<f64>,
}

impl Quadratic {
    /// From S⁻¹, row after row and symmetric, and the real minimum `S⁻¹ s`; `None` if S⁻¹ is not positive definite. No more than
    /// two and a half matrices of this size are in memory at a time.
    pub(crate) fn new(inverse: Vec<f64>, relaxed: &[f64]) -> Option<Self> {
        let n = relaxed.len();
        let inverse = DMatrix::from_vec(n, n, inverse);
        let factor = factor(&inverse)?;
        let relaxed = DVector::from_column_slice(relaxed);
        let nearest = greedy(inverse, &relaxed);
        let matrix = inverse_of(factor);
        Some(Self {
            right: &matrix * &relaxed,
            matrix,
            relaxed,
            nearest,
        })
    }

    /// How much more energy than the real minimum has.
    #[cfg(feature = "testing")]
    pub(crate) fn above(&self, z: &[f64]) -> f64 {
        let off = DVector::from_column_slice(z) - &self.relaxed;
        0.5 * off.dot(&(&self.matrix * &off))
    }

    /// The right-hand side on a grid so many steps denser.
    fn right_of(&self, step: i32) -> DVector<f64> {
        &self.right * RATIO.powi(step)
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
    fn coupled(&self, first: impl Fn(usize) -> usize + Sync) -> Vec<Vec<(usize, f64)>> {
        const FEW: usize = 256;
        let (matrix, n) = (&self.matrix, self.right.len());
        parallel::map(n, |i| {
            let column = matrix.column(i);
            let others = (first(i)..n).filter(|&j| j != i);
            let others: Vec<(usize, f64)> = others.map(|j| (j, column[j])).collect();
            match n > FEW {
                true => strongest(others),
                false => others,
            }
        })
    }
}

impl Energy for Quadratic {
    fn nearest(&self) -> &[f64] {
        &self.nearest
    }

    /// The inverse is made anew, n³ operations: few maps ask for it.
    fn denser(&self, step: i32, means: Means<'_>) -> Option<Vec<f64>> {
        if !means.effort.spend(cube(self.relaxed.len())) {
            return None;
        }
        let inverse = inverse_of(factor(&self.matrix)?);
        Some(greedy(inverse, &(&self.relaxed * RATIO.powi(step))))
    }

    fn descend(
        &self,
        z: &mut [f64],
        step: i32,
        upright: Option<&Upright>,
        run: On<'_>,
    ) -> Result<(), Cancelled> {
        self.descend_on(z, &self.right_of(step), upright, run)
    }

    fn cost<'a>(&'a self, z: &[f64], step: i32, _: &'a Upright) -> Box<dyn Cost + 'a> {
        let others = |others: Vec<(usize, f64)>| others.into_iter().map(|other| other.0).collect();
        Box::new(Gradient {
            matrix: &self.matrix,
            gradient: &self.matrix * DVector::from_column_slice(z) - self.right_of(step),
            coupled: self.coupled(|_| 0).into_iter().map(others).collect(),
        })
    }
}

/// What moves cost, by the gradient of the energy.
struct Gradient<'a> {
    matrix: &'a DMatrix<f64>,
    /// `S z − s`.
    gradient: DVector<f64>,
    coupled: Vec<Vec<usize>>,
}

impl Cost for Gradient<'_> {
    fn of(&self, &[(i, d), (j, e)]: &Pair, _: &[Sides]) -> f64 {
        d * self.gradient[i]
            + e * self.gradient[j]
            + 0.5 * (d * d * self.matrix[(i, i)] + e * e * self.matrix[(j, j)])
            + d * e * self.matrix[(i, j)]
    }

    fn follow(&mut self, k: usize, by: f64) {
        self.gradient.axpy(by, &self.matrix.column(k), 1.0);
    }

    fn coupled(&self, k: usize) -> &[usize] {
        &self.coupled[k]
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
    Some(inverse_of(factor).as_slice().to_vec())
}

/// [`greedy`] for tests, from a positive definite matrix.
#[cfg(feature = "testing")]
pub(crate) fn rounded(matrix: &[f64], right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    let inverse = inverse_of(factor(&DMatrix::from_row_slice(n, n, matrix))?);
    let relaxed = &inverse * DVector::from_column_slice(right);
    Some(greedy(inverse, &relaxed))
}

/// Rounds the variable that is nearest to an integer, lets the others follow to their exact optimum, and so on
/// (Bommes, Zimmer and Kobbelt, *Mixed-integer quadrangulation*, 2009, with the real unknowns eliminated).
///
/// From the real minimum, with the inverse of the matrix of those that are free.
/// Putting variable k at an integer moves all others by `column k of the inverse × step / pivot`, which is their exact
/// optimum. n³ operations in all, in parallel, the same digits for any number of threads.
pub(super) fn greedy(inverse: DMatrix<f64>, relaxed: &DVector<f64>) -> Vec<f64> {
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
