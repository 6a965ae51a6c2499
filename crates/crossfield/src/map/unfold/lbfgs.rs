//! The minimizer: L-BFGS whose vectors meet once per step.
//!
//! The two loops of the textbook (Nocedal and Wright, *Numerical Optimization*, algorithm 7.4) read every vector of the memory
//! twice, one dot product after the other. All they need are products of these vectors with each other and with the gradient:
//! with those kept, the loops are over numbers, and a step reads the memory once to add the products of its own pair and once
//! to put the direction together (Chen, Wang and Zhou, *Large-scale L-BFGS using MapReduce*, 2014).

use std::ops::Range;

use geom_core::Cancelled;
use geom_core::compute::parallel;

use super::effort::Effort;
use super::energy::Energy;
use crate::Error;

/// Steps remembered.
const HISTORY: usize = 10;
/// Steps of a minimization.
pub(super) const STEPS: usize = 30;
/// Steps that must have gained enough together for more of them: single ones gain little between others that gain much.
const LAST: usize = 5;
/// Numbers of each vector that are worked on together: those of the whole memory stay in the second cache.
const BLOCK: usize = 512;

/// Solves with the matrix of a quadratic energy over the unknowns that move.
pub(super) type Bend<'a> = &'a dyn Fn(&[f64]) -> Result<Vec<f64>, Error>;

/// L-BFGS with backtracking; the energy before and after.
///
/// It ends after [`STEPS`], when a step gains less than 1e-8 of the energy or the [`LAST`] ones in the mean less than `enough` of it, when
/// no step along the direction lowers it, or when the effort is spent. A pair that shows no curvature is not remembered; a
/// direction that does not descend makes it forget all others.
pub(super) fn minimize(
    energy: &mut Energy<'_>,
    bend: Bend<'_>,
    effort: &Effort,
    x: &mut Vec<f64>,
    enough: f64,
    watch: &dyn Fn(usize) -> Result<(), Cancelled>,
) -> Result<(f64, f64), Error> {
    let (mut value, mut gradient) = energy.gradient(x)?;
    let first = value;
    let mut gains = [f64::INFINITY; LAST];
    // The only solve of a step: all else that P⁻¹ has to be known of is a sum of such.
    let mut bent = bend(&gradient)?;
    let mut memory = Memory::default();
    for step in 0..STEPS {
        watch(step)?;
        if !effort.spend(energy.triangles()) {
            break;
        }
        let (mut direction, mut slope) = memory.direction(&gradient, &bent);
        if slope >= 0.0 && !memory.pairs.is_empty() {
            memory.clear();
            (direction, slope) = memory.direction(&gradient, &bent);
        }
        if slope.is_nan() || slope >= -1e-14 * (1.0 + value.abs()) {
            break;
        }
        let Some(found) = searched(energy, x, &direction, value, slope)? else {
            break;
        };
        let next = bend(&found.gradient)?;
        memory.remember([x, &found.at], [&gradient, &found.gradient], [&bent, &next]);
        bent = next;
        let gain = value - found.value;
        (*x, value, gradient) = (found.at, found.value, found.gradient);
        gains[step % LAST] = gain / value.abs();
        if gain < 1e-8 * value.abs() || gains.iter().sum::<f64>() < LAST as f64 * enough {
            break;
        }
    }
    Ok((first, value))
}

/// Where a search along a line has ended, with energy and gradient there.
struct Found {
    at: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

/// The first of ever shorter steps that lowers the energy enough, with energy and gradient there.
///
/// Enough is 1e-4 of what the slope promises (Armijo's condition). Steps that meet a number that is not finite are too
/// long. `None` after thirty tries.
fn searched(
    energy: &mut Energy<'_>,
    x: &[f64],
    direction: &[f64],
    value: f64,
    slope: f64,
) -> Result<Option<Found>, Error> {
    let mut step = 1.0;
    for _ in 0..30 {
        let at: Vec<f64> = x.iter().zip(direction).map(|(x, d)| x + step * d).collect();
        let (there, gradient) = energy.gradient(&at)?;
        if there.is_finite() && there <= value + 1e-4 * step * slope {
            let value = there;
            return Ok(Some(Found {
                at,
                value,
                gradient,
            }));
        }
        step *= 0.5;
    }
    Ok(None)
}

/// A step and what it changed: of the unknowns, of the gradient, and `P⁻¹` times that, with P the matrix of the quadratic
/// energy. In blocks, the last one filled up with zeros.
type Pair = Vec<Block>;

#[derive(Clone)]
struct Block {
    moved: [f64; BLOCK],
    turned: [f64; BLOCK],
    bent: [f64; BLOCK],
    products: Products,
}

impl Block {
    const ZERO: Self = Self {
        moved: [0.0; BLOCK],
        turned: [0.0; BLOCK],
        bent: [0.0; BLOCK],
        products: Products::ZERO,
    };

    /// The differences of numbers after and before.
    fn fill(&mut self, range: Range<usize>, numbers: [[&[f64]; 2]; 3]) {
        let own = [&mut self.moved, &mut self.turned, &mut self.bent];
        for (to, [before, after]) in own.into_iter().zip(numbers) {
            let pairs = after[range.clone()].iter().zip(&before[range.clone()]);
            for (to, (after, before)) in to.iter_mut().zip(pairs) {
                *to = after - before;
            }
        }
    }

    /// Its products with the blocks of older pairs, with itself, and with the gradient from `first` on.
    fn multiply<'b>(
        &mut self,
        old: impl Iterator<Item = &'b Self>,
        gradient: &[f64],
        bent: &[f64],
        first: usize,
    ) {
        let mut products = Products::ZERO;
        for (with, old) in products.with.iter_mut().zip(old) {
            *with = [
                dot(&old.moved, &self.turned),
                dot(&self.moved, &old.turned),
                dot(&self.turned, &old.bent),
            ];
        }
        products.own = [
            dot(&self.moved, &self.turned),
            dot(&self.turned, &self.bent),
            dot(&self.moved, &self.moved),
            dot(&self.turned, &self.turned),
        ];
        let end = gradient.len().min(first + BLOCK);
        products.gradient = [
            dot(&self.moved[..end - first], &gradient[first..end]),
            dot(&self.turned[..end - first], &bent[first..end]),
        ];
        self.products = products;
    }
}

/// The last steps, the oldest first, and the products of what they consist of.
#[derive(Default)]
struct Memory {
    pairs: Vec<Pair>,
    /// `[i][j]`: moved i · turned j.
    moved_turned: [[f64; HISTORY]; HISTORY],
    /// `[i][j]`: turned i · bent j, which is symmetric.
    turned_bent: [[f64; HISTORY]; HISTORY],
    /// With the gradient, and with `P⁻¹` times it.
    moved_gradient: [f64; HISTORY],
    turned_gradient: [f64; HISTORY],
    /// Of a pair that is forgotten, for the next.
    spare: Option<Pair>,
}

/// Products of a block of a new pair with those of the memory, and with themselves.
#[derive(Clone, Copy)]
struct Products {
    /// Per pair of the memory: its moved · turned, moved · its turned, its turned · bent.
    with: [[f64; 3]; HISTORY],
    /// moved · turned, turned · bent, |moved|², |turned|².
    own: [f64; 4],
    /// moved · gradient, turned · P⁻¹ gradient, after the step.
    gradient: [f64; 2],
}

impl Products {
    const ZERO: Self = Self {
        with: [[0.0; 3]; HISTORY],
        own: [0.0; 4],
        gradient: [0.0; 2],
    };

    fn add(&mut self, other: &Self) {
        let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
        add(self.with.as_flattened_mut(), other.with.as_flattened());
        add(&mut self.own, &other.own);
        add(&mut self.gradient, &other.gradient);
    }
}

impl Memory {
    fn clear(&mut self) {
        self.spare = self.pairs.pop();
        self.pairs.clear();
    }

    /// Minus the gradient, bent by the curvature met so far, and the slope along that.
    ///
    /// In place of a multiple of the identity, as in the textbook, the inverse of the quadratic energy stands in the
    /// middle, scaled to the curvature of the last step. `bent` is that inverse times the gradient.
    fn direction(&self, gradient: &[f64], bent: &[f64]) -> (Vec<f64>, f64) {
        let n = self.pairs.len();
        let curvature = |i: usize| self.moved_turned[i][i];
        // q = −gradient − Σ alpha turned
        let mut alpha = [0.0; HISTORY];
        for i in (0..n).rev() {
            let later = (i + 1..n).map(|j| alpha[j] * self.moved_turned[i][j]);
            alpha[i] = -(self.moved_gradient[i] + later.sum::<f64>()) / curvature(i);
        }
        let scale = match n {
            0 => 1.0,
            _ => curvature(n - 1) / self.turned_bent[n - 1][n - 1],
        };
        // direction = −scale (bent + Σ alpha bent of pairs) + Σ gamma moved
        let mut gamma = [0.0; HISTORY];
        for i in 0..n {
            let all = (0..n).map(|j| alpha[j] * self.turned_bent[i][j]);
            let middle = -scale * (self.turned_gradient[i] + all.sum::<f64>());
            let before = (0..i).map(|j| gamma[j] * self.moved_turned[j][i]);
            gamma[i] = alpha[i] - (middle + before.sum::<f64>()) / curvature(i);
        }
        let mut direction = vec![0.0; gradient.len()];
        parallel::for_chunks(&mut direction, BLOCK, |b, direction| {
            let bent = &bent[b * BLOCK..][..direction.len()];
            for (d, bent) in direction.iter_mut().zip(bent) {
                *d = -scale * bent;
            }
            for (k, pair) in self.pairs.iter().enumerate() {
                let (of_bent, of_moved) = (-scale * alpha[k], gamma[k]);
                let block = pair[b].bent.iter().zip(&pair[b].moved);
                for (d, (bent, moved)) in direction.iter_mut().zip(block) {
                    *d += of_bent * bent + of_moved * moved;
                }
            }
        });
        let slopes = parallel::fold_chunks(gradient.len(), |range| {
            dot(&direction[range.clone()], &gradient[range])
        });
        (direction, slopes.into_iter().sum())
    }

    /// Takes a step into the memory, if it shows a curvature, and the products with the new gradient in any case. Each of the
    /// three is given before and after.
    fn remember(&mut self, x: [&[f64]; 2], gradient: [&[f64]; 2], bent: [&[f64]; 2]) {
        let n = x[0].len();
        let made = self.spare.take();
        let mut pair = made.unwrap_or_else(|| vec![Block::ZERO; n.div_ceil(BLOCK)]);
        let pairs = &self.pairs;
        parallel::for_chunks(&mut pair, 1, |b, block| {
            block[0].fill(b * BLOCK..n.min((b + 1) * BLOCK), [x, gradient, bent]);
            let old = pairs.iter().map(|pair| &pair[b]);
            block[0].multiply(old, gradient[1], bent[1], b * BLOCK);
        });
        let mut sums = Products::ZERO;
        pair.iter().for_each(|block| sums.add(&block.products));
        let count = self.pairs.len();
        for k in 0..count {
            // P⁻¹ is symmetric.
            let [moved_turned, _, turned_bent] = sums.with[k];
            self.moved_gradient[k] += moved_turned;
            self.turned_gradient[k] += turned_bent;
        }
        let [curvature, bent, moved, turned] = sums.own;
        if curvature.is_nan() || curvature <= 1e-12 * (moved * turned).sqrt() {
            self.spare = Some(pair);
            return;
        }
        let mut with = sums.with;
        if count == HISTORY {
            self.forget();
            with.rotate_left(1);
        }
        let new = self.pairs.len();
        for (k, [forth, back, turned_bent]) in with.into_iter().take(new).enumerate() {
            (self.moved_turned[k][new], self.moved_turned[new][k]) = (forth, back);
            (self.turned_bent[k][new], self.turned_bent[new][k]) = (turned_bent, turned_bent);
        }
        (self.moved_turned[new][new], self.turned_bent[new][new]) = (curvature, bent);
        [self.moved_gradient[new], self.turned_gradient[new]] = sums.gradient;
        self.pairs.push(pair);
    }

    /// Lets the oldest pair go.
    fn forget(&mut self) {
        self.spare = Some(self.pairs.remove(0));
        for products in [&mut self.moved_turned, &mut self.turned_bent] {
            products.rotate_left(1);
            products.iter_mut().for_each(|row| row.rotate_left(1));
        }
        self.moved_gradient.rotate_left(1);
        self.turned_gradient.rotate_left(1);
    }
}

/// With eight sums, so that no product waits for the one before.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}
