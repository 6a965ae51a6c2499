//! Integers that leave the triangles of a decimated map upright: those rounded, moved until they do.
//!
//! How much triangles fall short of upright decides, in exact integers; what moves cost of the energy breaks ties. The energy may be
//! known in full ([`Quadratic`](super::Quadratic)) or not ([`Regions`](super::Regions)), which is what [`Energy`] is for.

use geom_core::Cancelled;

use super::joint::best_joint;
use super::upright::{AtLeast, Pair, Short, Sides, Upright, Weighed};
use crate::backend::On;
use crate::map::unfold::Effort;

/// Denser grids that rounding is tried on.
const DENSEST: i32 = 4;
/// How many times denser each is.
pub(super) const RATIO: f64 = 1.25;
/// What bounds the moves looked at per integer: mending stops after a fifth of it, a descent after about twenty times as
/// many.
pub(super) const MOST_TRIED: usize = 20_000;
/// How often triangles are given more weight before all integers of one may move at once, and how often from then on.
const BREAKOUTS: usize = 60;
/// How often triangles that have turned around vertices are turned back.
const TURNS: usize = 4;

/// What would keep upright triangles from turning too far around vertices; nothing where none do.
pub(crate) type Turned<'a> = &'a dyn Fn(&[f64]) -> Vec<AtLeast>;

/// What a search for integers may use: a move that is looked at costs as much as the energy of a triangle.
#[derive(Clone, Copy)]
pub(crate) struct Means<'a> {
    pub(crate) effort: &'a Effort,
    pub(crate) run: On<'a>,
}

/// The energy over the integers of a map, as far as it is known.
pub(crate) trait Energy {
    /// Rounded one by one, the others following to their optimum.
    fn nearest(&self) -> &[f64];

    /// The same on a grid so many steps denser; `None` where that is not known or not worth it any more.
    fn denser(&self, step: i32, means: Means<'_>) -> Option<Vec<f64>>;

    /// Moves that lower the energy on such a grid, as long as they turn no triangle over.
    ///
    /// # Errors
    /// If the watcher asks to stop.
    fn descend(
        &self,
        z: &mut [f64],
        step: i32,
        upright: Option<&Upright>,
        run: On<'_>,
    ) -> Result<(), Cancelled>;

    /// What moves from these integers cost there.
    fn cost<'a>(&'a self, z: &[f64], step: i32, upright: &'a Upright) -> Box<dyn Cost + 'a>;
}

/// What moves cost.
pub(in crate::map) trait Cost {
    /// What a move adds to the energy; `sides` are those of the triangles before it.
    fn of(&self, pair: &Pair, sides: &[Sides]) -> f64;
    /// One integer is another from now on.
    fn follow(&mut self, k: usize, by: f64);
    /// Those that an integer is coupled to most.
    fn coupled(&self, k: usize) -> &[usize];
}

impl dyn Energy + '_ {
    /// Rounded, then single integers and pairs of them moved by one while the energy falls.
    ///
    /// # Errors
    /// If the watcher asks to stop.
    pub(crate) fn rounded(&self, run: On<'_>) -> Result<Vec<f64>, Cancelled> {
        let mut z = self.nearest().to_vec();
        self.descend(&mut z, 0, None, run)?;
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
            let rounded = match first {
                0 => Some(self.nearest().to_vec()),
                _ => self.denser(first, means),
            };
            let Some(mut z) = rounded else {
                return Ok(None);
            };
            if !self.mend(&mut z, first, upright, means)? {
                continue;
            }
            for step in (0..=first).rev() {
                self.descend(&mut z, step, Some(upright), means.run)?;
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
        let is_mended = self.mend(z, 0, upright, means)?;
        if is_mended {
            self.descend(z, 0, Some(upright), means.run)?;
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
            let conditions = turned(z);
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

    /// Moves single integers and pairs by one, on a grid so many steps denser, while that brings triangles nearer to upright; of the
    /// moves that do so most, those of least energy. Where none does, triangles that are not upright weigh more from then on (Morris, *The breakout
    /// method for escaping from local minima*, 1993). Where that has not helped [`BREAKOUTS`] times, all integers of a triangle move at once
    /// ([`best_joint`]). Returns whether all are.
    ///
    /// `z` changes, and is what was reached even if that is not enough. It gives up after 4 n + 50 steps, after
    /// as many times more, or when it has looked at too many moves or at as many as the effort was for.
    fn mend(
        &self,
        z: &mut [f64],
        denser: i32,
        upright: &Upright,
        means: Means<'_>,
    ) -> Result<bool, Cancelled> {
        let n = z.len();
        let mut cost = self.cost(z, denser, upright);
        let mut sides = upright.sides(z);
        let mut weights = vec![1; sides.len()];
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
            let mut best = best_mends(single, weighed, &short, &*cost);
            if best.is_empty() {
                tried += integers
                    .iter()
                    .map(|&i| 4 * cost.coupled(i).len())
                    .sum::<usize>();
            }
            if tried > MOST_TRIED / 5 * n || !means.effort.spend(tried - before) {
                return Ok(false);
            }
            if best.is_empty() {
                let signs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
                let pairs = integers
                    .iter()
                    .flat_map(|&i| cost.coupled(i).iter().map(move |&j| (i, j)))
                    .flat_map(|(i, j)| signs.map(|(d, e)| [(i, d), (j, e)]));
                best = best_mends(pairs, weighed, &short, &*cost);
            }
            // A local minimum of the weighted shortages: raise it until one of its neighbours is lower.
            if best.is_empty() {
                breakouts += 1;
                upright.weigh_short(&sides, &mut weights);
                if breakouts <= BREAKOUTS {
                    continue;
                }
                // One with farther neighbours.
                let joint = best_joint(Weighed {
                    upright,
                    sides: &sides,
                    weights: &weights,
                });
                if breakouts > 2 * BREAKOUTS || !means.effort.spend(joint.tried) {
                    return Ok(false);
                }
                make(&joint.moves, z, &mut sides, upright, &mut *cost);
                continue;
            }
            // One after the other would do the same: a move that changes none of their triangles gains what it did.
            let mut moved = vec![false; sides.len()];
            for pair in best {
                if !upright.is_apart(&pair, &mut moved) {
                    continue;
                }
                make(&pair, z, &mut sides, upright, &mut *cost);
            }
        }
        Ok(false)
    }
}

/// Moves integers, and all that further moves are judged by.
fn make(
    moves: &[(usize, f64)],
    z: &mut [f64],
    sides: &mut [Sides],
    upright: &Upright,
    cost: &mut dyn Cost,
) {
    for &(k, by) in moves {
        z[k] += by;
        upright.shift(sides, k, by);
        cost.follow(k, by);
    }
}

/// Of the integers with these couplings, those that are coupled most: two of a small coupling do not change each other's optimum, and
/// moving both is no better than moving one after the other.
pub(super) fn strongest(mut others: Vec<(usize, f64)>) -> Vec<(usize, f64)> {
    const MOST: usize = 32;
    if others.len() > MOST {
        others.select_nth_unstable_by(MOST, |a, b| {
            b.1.abs().total_cmp(&a.1.abs()).then(a.0.cmp(&b.0))
        });
        others.truncate(MOST);
        // Lists of all integers, one for each of them, would be as large as two dense matrices.
        others.shrink_to_fit();
        others.sort_unstable_by_key(|other| other.0);
    }
    others
}

/// Of moves that bring triangles nearer to upright, those that do so most, of least energy first.
///
/// Exact shortages come first, energies only break ties: an energy that is a sum of many numbers must not decide what is
/// valid.
fn best_mends(
    moves: impl Iterator<Item = Pair>,
    weighed: Weighed<'_>,
    short: &Short,
    cost: &dyn Cost,
) -> Vec<Pair> {
    let (mut most, mut best) = (-1, Vec::new());
    for pair in moves {
        // Nearly all moves gain less than the best: most triangles of theirs need not be looked at.
        if weighed.least_change(&pair, short) > most {
            continue;
        }
        let change = weighed.change(&pair);
        if change > most {
            continue;
        }
        if change < most {
            best.clear();
            most = change;
        }
        best.push((cost.of(&pair, weighed.sides), pair));
    }
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    best.into_iter().map(|(_, pair)| pair).collect()
}
