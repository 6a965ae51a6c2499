//! A factor at half of its memory, for those who solve with it again and again and need no more than an inverse close to the
//! right one: what a substitution takes is reading the factor.

use super::substitution::{Direction, Solved, Supernodal, Task};
use super::{Cholesky, Plan, ROWS, Symbolic};
use crate::algebra::Error;
use crate::compute::{lanes, parallel};

/// Rows of a rectangle that are handled together, and terms of a sum.
const TILE: usize = 16;

/// The factor of a [`Cholesky`] rounded to f32, from [`Symbolic::factor_single`]: `(L̃ L̃ᵀ)⁻¹` with L̃ close to L. Arithmetic is in
/// f64, so that this is one symmetric positive definite operator whatever it is applied to, which preconditioners have to be.
#[derive(Clone, Debug)]
pub struct SingleFactor(pub(super) Values);

#[derive(Clone, Debug)]
pub(super) enum Values {
    /// With supernodes.
    Rounded {
        symbolic: Symbolic,
        values: Vec<f32>,
    },
    /// What rounding would gain nothing for, or what does not fit f32.
    Whole(Cholesky),
}

impl SingleFactor {
    /// `(L̃ L̃ᵀ)⁻¹ b`.
    ///
    /// ```
    /// use geom_core::algebra::{SparseMatrix, Symbolic};
    /// // Springs between neighbours on a square, and to the ground: a factor with supernodes.
    /// let n = 40u32;
    /// let at = |i: u32, j: u32| i * n + j;
    /// let mut entries = Vec::new();
    /// for (i, j) in (0..n * n).map(|k| (k / n, k % n)) {
    ///     entries.push((at(i, j), at(i, j), 4.1));
    ///     for (a, b) in [(i + 1, j), (i, j + 1)] {
    ///         if a < n && b < n {
    ///             entries.push((at(i, j), at(a, b), -1.0));
    ///             entries.push((at(a, b), at(i, j), -1.0));
    ///         }
    ///     }
    /// }
    /// let rows = (n * n) as usize;
    /// let matrix = SparseMatrix::from_triplets(rows, rows, &entries)?;
    /// let symbolic = Symbolic::of(&matrix)?;
    /// let b: Vec<f64> = (0..rows).map(|k| (k as f64).sin()).collect();
    /// let exact = symbolic.factor(&matrix)?.solve(&b)?;
    /// let close = symbolic.factor_single(&matrix)?.solve(&b)?;
    /// let off = exact.iter().zip(&close).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    /// assert!(off < 1e-6);
    /// # Ok::<(), geom_core::algebra::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::RightHandSide`] for another number of values.
    pub fn solve(&self, b: &[f64]) -> Result<Vec<f64>, Error> {
        let (symbolic, values) = match &self.0 {
            Values::Rounded { symbolic, values } => (symbolic, values),
            Values::Whole(factor) => return factor.solve(b),
        };
        let (found, expected) = (b.len(), symbolic.rows());
        if found != expected {
            return Err(Error::RightHandSide { found, expected });
        }
        let mut x = vec![0.0; expected];
        let Some(Plan { schedule, .. }) = &symbolic.inner.plan else {
            return Ok(x);
        };
        parallel::inside(|| {
            let solved: Solved<f64, 1> = schedule.solve_by(b, 1, 0..1, |task, x, direction| {
                lanes::vectorized(Sweep {
                    task: &schedule.tasks[task],
                    values,
                    x: x.as_flattened_mut(),
                    direction,
                });
            });
            parallel::for_chunks(&mut x, ROWS, |chunk, x| {
                for (row, x) in (chunk * ROWS..).zip(x) {
                    *x = schedule.row(&solved, row)[0];
                }
            });
        });
        Ok(x)
    }

    /// Rows of the matrix.
    pub fn rows(&self) -> usize {
        match &self.0 {
            Values::Rounded { symbolic, .. } => symbolic.rows(),
            Values::Whole(factor) => factor.rows(),
        }
    }

    /// `Bᵀ (L̃ L̃ᵀ)⁻¹ B`: [`Cholesky::inverse_gram`] with this factor.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a row that the matrix has not, [`Error::OutOfMemory`].
    pub fn inverse_gram(&self, columns: &[Vec<(usize, f64)>]) -> Result<Vec<f64>, Error> {
        match &self.0 {
            Values::Rounded { symbolic, values } => symbolic.inverse_gram(values, columns),
            Values::Whole(factor) => factor.inverse_gram(columns),
        }
    }
}

/// One sweep over the supernodes of a task.
struct Sweep<'a> {
    task: &'a Task,
    values: &'a [f32],
    x: &'a mut [f64],
    direction: Direction,
}

impl lanes::WithSimd for Sweep<'_> {
    type Output = ();

    /// Compiled for the registers that the machine has: the loops are over arrays of fixed length.
    #[inline(always)]
    fn with_simd<S: lanes::Simd>(self, _: S) {
        match lanes::fuses::<S>() {
            true => self.run::<true>(),
            false => self.run::<false>(),
        }
    }
}

impl Sweep<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let supernodes = self.task.supernodes();
        if self.direction == Direction::Down {
            for s in supernodes {
                let (head, below) = self.x.split_at_mut(s.columns.end);
                forward::<FUSED>(&s, self.values, &mut head[s.columns.clone()], below);
            }
            return;
        }
        let mut reached = Vec::new();
        for s in supernodes.rev() {
            let (head, below) = self.x.split_at_mut(s.columns.end);
            reached.clear();
            let rows = s.rows.iter();
            reached.extend(rows.map(|&row| below[row as usize - s.columns.end]));
            backward::<FUSED>(&s, self.values, &mut head[s.columns.clone()], &reached);
        }
    }
}

/// `sum + l · x`.
#[inline(always)]
fn fused<const FUSED: bool>(l: f32, x: f64, sum: f64) -> f64 {
    if FUSED {
        f64::from(l).mul_add(x, sum)
    } else {
        sum + f64::from(l) * x
    }
}

/// Solves with the triangle, column by column, then takes the product of the rectangle off the rows below.
#[inline(always)]
fn forward<const FUSED: bool>(
    s: &Supernodal<'_>,
    values: &[f32],
    own: &mut [f64],
    below: &mut [f64],
) {
    let (width, height) = (own.len(), own.len() + s.rows.len());
    let values = &values[s.values.clone()];
    for c in 0..width {
        let column = &values[c * height..][..width];
        let x = own[c] / f64::from(column[c]);
        own[c] = x;
        for (own, &l) in own[c + 1..].iter_mut().zip(&column[c + 1..]) {
            *own = fused::<FUSED>(l, -x, *own);
        }
    }
    let (tiles, rest) = s.rows.as_chunks::<TILE>();
    for (tile, rows) in tiles.iter().enumerate() {
        let at = width + tile * TILE;
        let mut sums = [0.0; TILE];
        for (&x, column) in own.iter().zip(values.chunks_exact(height)) {
            let l: &[f32; TILE] = column[at..].first_chunk().expect("a tile of rows");
            for k in 0..TILE {
                sums[k] = fused::<FUSED>(l[k], x, sums[k]);
            }
        }
        for (&row, sum) in rows.iter().zip(sums) {
            below[row as usize - s.columns.end] -= sum;
        }
    }
    let mut sums = [0.0; TILE];
    for (&x, column) in own.iter().zip(values.chunks_exact(height)) {
        for (sum, &l) in sums.iter_mut().zip(&column[height - rest.len()..]) {
            *sum = fused::<FUSED>(l, x, *sum);
        }
    }
    for (&row, sum) in rest.iter().zip(sums) {
        below[row as usize - s.columns.end] -= sum;
    }
}

/// The mirror image, from the last column up; `reached` are the unknowns of the rectangle's rows.
#[inline(always)]
fn backward<const FUSED: bool>(
    s: &Supernodal<'_>,
    values: &[f32],
    own: &mut [f64],
    reached: &[f64],
) {
    let (width, height) = (own.len(), own.len() + reached.len());
    let values = &values[s.values.clone()];
    for c in (0..width).rev() {
        let column = &values[c * height..][..height];
        let (head, after) = own[c..].split_first_mut().expect("a column");
        let sum =
            dot::<FUSED>(&column[width..], reached) + dot::<FUSED>(&column[c + 1..width], after);
        *head = (*head - sum) / f64::from(column[c]);
    }
}

/// With as many sums as a tile has places.
#[inline(always)]
fn dot<const FUSED: bool>(l: &[f32], x: &[f64]) -> f64 {
    let ((l, l_rest), (x, x_rest)) = (l.as_chunks::<TILE>(), x.as_chunks::<TILE>());
    let mut sums = [0.0; TILE];
    for (l, x) in l.iter().zip(x) {
        for k in 0..TILE {
            sums[k] = fused::<FUSED>(l[k], x[k], sums[k]);
        }
    }
    let rest = l_rest.iter().zip(x_rest);
    let rest = rest.fold(0.0, |sum, (&l, &x)| fused::<FUSED>(l, x, sum));
    sums.iter().sum::<f64>() + rest
}
