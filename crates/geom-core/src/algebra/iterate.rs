//! Solutions better than a factor alone gives them, or without one: iterative refinement, and conjugate gradients
//! with the factor of another, similar matrix or with the diagonal.
//!
//! Use [`refine`] with the factor of the very matrix, [`conjugate_gradients`] with anything else that resembles its
//! inverse. Both take a block of right-hand sides: conjugate gradients look at each column by itself, refinement goes
//! on until the worst is done.

use super::{Cholesky, Error, Scalar, SingleFactor, SparseMatrix};
use crate::compute::parallel;
use crate::options::require;

/// Rows per task.
const ROWS: usize = parallel::CHUNK;

/// Up to so many rows an iteration takes less time than waking the threads for each of its loops.
const FEW: usize = 2 * ROWS;

/// When to stop.
///
/// Near 10⁻¹⁶ times the condition number a residual stops falling, whatever is asked: a solution is then returned with
/// [`Solution::converged`] false.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Relative residual `‖b − A x‖ / ‖b‖` at which a column is done.
    pub tolerance: f64,
    /// Most corrections of the first solution: of that by the factor alone in [`refine`], of zero in
    /// [`conjugate_gradients`].
    pub max_iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            tolerance: 1e-12,
            max_iterations: 200,
        }
    }
}

impl Options {
    /// Refuses values that make no sense, naming the field.
    pub fn check(&self) -> Result<(), Error> {
        let holds = self.tolerance >= 0.0 && self.tolerance < 1.0;
        require(
            holds,
            "tolerance",
            self.tolerance,
            "be at least 0 and below 1",
        )?;
        Ok(())
    }
}

/// What [`conjugate_gradients`] multiplies with: symmetric (Hermitian) and positive definite. A matrix, or a part of one that is not
/// made for it.
pub trait LinearMap<T: Scalar>: Sync {
    /// Rows and columns.
    fn shape(&self) -> [usize; 2];

    /// Its product with a block of `columns` vectors.
    fn multiply(&self, block: &[T], columns: usize) -> Vec<T>;
}

impl<T: Scalar> LinearMap<T> for SparseMatrix<T> {
    fn shape(&self) -> [usize; 2] {
        [self.rows(), self.columns()]
    }

    fn multiply(&self, block: &[T], columns: usize) -> Vec<T> {
        SparseMatrix::multiply(self, block, columns)
    }
}

/// What [`conjugate_gradients`] applies to a residual in place of the inverse of the matrix: positive definite, and easy to
/// apply. It must be the same linear map each time, and symmetric (Hermitian): a cycle of multigrid is, most sweeps
/// from first to last row are not.
pub trait Preconditioner<T: Scalar>: Sync {
    /// The rows of its matrix.
    fn rows(&self) -> usize;

    /// Applies it to a block of `columns` vectors in place.
    ///
    /// # Errors
    /// What cannot be solved with.
    fn apply(&self, block: &mut [T], columns: usize) -> Result<(), Error>;
}

impl<T: Scalar> Preconditioner<T> for Cholesky<T> {
    fn rows(&self) -> usize {
        Cholesky::rows(self)
    }

    fn apply(&self, block: &mut [T], columns: usize) -> Result<(), Error> {
        self.solve_in_place(block, columns)
    }
}

impl Preconditioner<f64> for SingleFactor {
    fn rows(&self) -> usize {
        SingleFactor::rows(self)
    }

    fn apply(&self, block: &mut [f64], columns: usize) -> Result<(), Error> {
        for j in 0..columns {
            let b: Vec<f64> = block.iter().skip(j).step_by(columns).copied().collect();
            let places = block.iter_mut().skip(j).step_by(columns);
            places.zip(self.solve(&b)?).for_each(|(x, y)| *x = y);
        }
        Ok(())
    }
}

/// The inverse of the diagonal of a matrix (Jacobi): a preconditioner that costs nothing, for matrices whose diagonal
/// weighs much, as the mass does in a short step of a diffusion.
#[derive(Clone, Debug, PartialEq)]
pub struct Jacobi(Vec<f64>);

impl Jacobi {
    /// That of a matrix.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] names the first entry that is not above zero.
    pub fn of<T: Scalar>(matrix: &SparseMatrix<T>) -> Result<Self, Error> {
        let diagonal: Vec<f64> = matrix.diagonal().iter().map(|d| d.real_part()).collect();
        // NaN, too.
        match diagonal.iter().position(|d| d.is_nan() || *d <= 0.0) {
            Some(row) => Err(Error::NotPositiveDefinite { row }),
            None => Ok(Self(diagonal.iter().map(|d| 1.0 / d).collect())),
        }
    }
}

impl<T: Scalar> Preconditioner<T> for Jacobi {
    fn rows(&self) -> usize {
        self.0.len()
    }

    fn apply(&self, block: &mut [T], columns: usize) -> Result<(), Error> {
        for (row, &scale) in block.chunks_mut(columns.max(1)).zip(&self.0) {
            row.iter_mut().for_each(|x| *x = *x * scale);
        }
        Ok(())
    }
}

/// Solutions for a block of right-hand sides. It is returned also where the tolerance was not reached: look at
/// [`Solution::converged`].
#[derive(Clone, Debug, PartialEq)]
pub struct Solution<T = f64> {
    /// The block of solutions.
    pub values: Vec<T>,
    /// Relative residual of each column; 0 where the right-hand side is zero, or its squares are. Computed anew from
    /// `B − A X` at the end, not carried along.
    pub residuals: Vec<f64>,
    /// Iterations of the column that took most.
    pub iterations: usize,
    /// Whether every column reached the tolerance.
    pub converged: bool,
}

/// Solves `A X = B` with a factor of A, or nearly of A, and repeats with what is missing until the
/// residual no longer falls. Good for a factor that is exact but for rounding; where it belongs to
/// another matrix, [`conjugate_gradients`] needs fewer steps.
///
/// ```
/// use geom_core::algebra::iterate::{Options, refine};
/// use geom_core::algebra::{Cholesky, SparseMatrix};
/// let matrix = SparseMatrix::diagonal_of(&[4.0, 3.0]);
/// let factor = Cholesky::of(&matrix)?;
/// let found = refine(&matrix, &factor, &[2.0, 6.0], 1, &Options::default())?;
/// assert!((found.values[0] - 0.5).abs() < 1e-14 && (found.values[1] - 2.0).abs() < 1e-14);
/// # Ok::<(), geom_core::algebra::Error>(())
/// ```
///
/// # Errors
/// [`Error::Option`], [`Error::Shape`], [`Error::RightHandSide`], [`Error::RightHandSideTooLarge`],
/// [`Error::NotFinite`] for a right-hand side, and what the factor cannot solve. Not to converge is no error.
pub fn refine<T: Scalar>(
    matrix: &SparseMatrix<T>,
    factor: &Cholesky<T>,
    block: &[T],
    columns: usize,
    options: &Options,
) -> Result<Solution<T>, Error> {
    let sizes = start(matrix, factor, block, columns, options)?;
    let mut x = vec![T::default(); block.len()];
    let mut rest = block.to_vec();
    let mut solution = Solution {
        values: Vec::new(),
        residuals: sizes.iter().map(|&s| f64::from(s > 0.0)).collect(),
        iterations: 0,
        converged: false,
    };
    let mut worst = f64::INFINITY;
    for iteration in 0..=options.max_iterations {
        let mut step = rest.clone();
        factor.solve_in_place(&mut step, columns)?;
        let next: Vec<T> = x.iter().zip(&step).map(|(&x, &d)| x + d).collect();
        let (after, residuals) = missing(matrix, &next, block, &sizes);
        let largest = residuals.iter().copied().fold(0.0, f64::max);
        // Rounding has the last word: keep the better one.
        if largest >= worst || largest.is_nan() {
            break;
        }
        (x, rest) = (next, after);
        solution.residuals = residuals;
        solution.iterations = iteration;
        let slow = largest > 0.5 * worst;
        worst = largest;
        if largest <= options.tolerance || slow {
            break;
        }
    }
    solution.values = x;
    solution.converged = worst <= options.tolerance;
    Ok(solution)
}

/// Solves `A X = B` by conjugate gradients, with the factor of a similar matrix or [`Jacobi`] as preconditioner; every
/// column by itself.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] if A turns out not to be: `row` is then the row of the largest entry
/// of the direction that shows it.
///
/// ```
/// use geom_core::algebra::iterate::{Jacobi, Options, conjugate_gradients};
/// use geom_core::algebra::SparseMatrix;
/// let entries = [(0, 0, 4.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 3.0)];
/// let matrix = SparseMatrix::from_triplets(2, 2, &entries)?;
/// let diagonal = Jacobi::of(&matrix)?;
/// let found = conjugate_gradients(&matrix, &diagonal, &[2.0, 5.0], 1, &Options::default())?;
/// assert!(found.converged && (found.values[1] - 2.0).abs() < 1e-10);
/// # Ok::<(), geom_core::algebra::Error>(())
/// ```
///
/// One iteration is one product, one application of the preconditioner and some passes over the block, for all columns
/// at once; the number of iterations grows with the root of the condition number of the preconditioned matrix. Other
/// errors are those of [`refine`].
pub fn conjugate_gradients<T: Scalar>(
    matrix: &(impl LinearMap<T> + ?Sized),
    preconditioner: &(impl Preconditioner<T> + ?Sized),
    block: &[T],
    columns: usize,
    options: &Options,
) -> Result<Solution<T>, Error> {
    let sizes = start(matrix, preconditioner, block, columns, options)?;
    let descend = || descend(matrix, preconditioner, block, &sizes, options);
    // In the pool also where the loops here stay on one thread: the levels of a factor are handed out to all.
    parallel::inside(|| match matrix.shape()[0] {
        ..=FEW => parallel::alone(descend),
        _ => descend(),
    })
}

/// The iterations of [`conjugate_gradients`] for columns of these norms.
fn descend<T: Scalar>(
    matrix: &(impl LinearMap<T> + ?Sized),
    preconditioner: &(impl Preconditioner<T> + ?Sized),
    block: &[T],
    sizes: &[f64],
    options: &Options,
) -> Result<Solution<T>, Error> {
    let columns = sizes.len();
    // From zero, so that the residual is the right-hand side.
    let mut x = vec![T::default(); block.len()];
    let mut r = block.to_vec();
    let mut z = r.clone();
    preconditioner.apply(&mut z, columns)?;
    let mut p = z.clone();
    let mut rz = dots(&r, &z, columns);
    let mut open: Vec<bool> = sizes.iter().map(|&s| s > 0.0).collect();
    let mut iterations = 0;
    while iterations < options.max_iterations && open.contains(&true) {
        iterations += 1;
        let image = matrix.multiply(&p, columns);
        let curvature = dots(&p, &image, columns);
        // A direction along which the energy does not grow shows that the matrix is not definite.
        if let Some(j) =
            (0..columns).find(|&j| open[j] && (curvature[j] <= 0.0 || curvature[j].is_nan()))
        {
            let entry = |i: usize| p[i * columns + j].norm_squared();
            let row = parallel::argmax(matrix.shape()[0], entry).map_or(0, |m| m.0);
            return Err(Error::NotPositiveDefinite { row });
        }
        // Columns that are done stand still, while the others go on with one product for all.
        let step: Vec<f64> = (0..columns)
            .map(|j| if open[j] { rz[j] / curvature[j] } else { 0.0 })
            .collect();
        change(&mut x, &p, &step, |x, p, s| x + p * s);
        change(&mut r, &image, &step, |r, image, s| r - image * s);
        for (open, residual) in open.iter_mut().zip(relative(&norms(&r, columns), sizes)) {
            // One that is no number is not done.
            *open &= residual > options.tolerance || residual.is_nan();
        }
        z.copy_from_slice(&r);
        preconditioner.apply(&mut z, columns)?;
        let next = dots(&r, &z, columns);
        let turn: Vec<f64> = (0..columns)
            .map(|j| if open[j] { next[j] / rz[j] } else { 0.0 })
            .collect();
        change(&mut p, &z, &turn, |p, z, t| z + p * t);
        rz = next;
    }
    // The true residual, not the one that was carried along.
    let (_, residuals) = missing(matrix, &x, block, sizes);
    Ok(Solution {
        converged: !open.contains(&true) && !residuals.iter().any(|r| r.is_nan()),
        values: x,
        residuals,
        iterations,
    })
}

/// Refuses what does not fit together; the norms of the right-hand sides.
fn start<T: Scalar>(
    matrix: &(impl LinearMap<T> + ?Sized),
    preconditioner: &(impl Preconditioner<T> + ?Sized),
    block: &[T],
    columns: usize,
    options: &Options,
) -> Result<Vec<f64>, Error> {
    options.check()?;
    check_sizes(matrix, preconditioner.rows(), block, columns)?;
    let sizes = norms(block, columns);
    // Relative to an infinite norm nothing would be missing.
    match sizes.iter().position(|s| !s.is_finite()) {
        Some(column) => Err(Error::RightHandSideTooLarge { column }),
        None => Ok(sizes),
    }
}

/// `B − A X`, and the norm of each of its columns as a share of that of B.
fn missing<T: Scalar>(
    matrix: &(impl LinearMap<T> + ?Sized),
    x: &[T],
    block: &[T],
    sizes: &[f64],
) -> (Vec<T>, Vec<f64>) {
    let image = matrix.multiply(x, sizes.len());
    let rest: Vec<T> = block.iter().zip(&image).map(|(&b, &a)| b - a).collect();
    let residuals = relative(&norms(&rest, sizes.len()), sizes);
    (rest, residuals)
}

/// A square matrix of as many rows as the preconditioner, and a finite block of as many.
fn check_sizes<T: Scalar>(
    matrix: &(impl LinearMap<T> + ?Sized),
    rows: usize,
    block: &[T],
    columns: usize,
) -> Result<(), Error> {
    for found in matrix.shape() {
        if found != rows {
            return Err(Error::Shape {
                what: "the matrix that goes with a factor",
                found,
                expected: rows,
            });
        }
    }
    let (found, expected) = (block.len(), rows * columns);
    if found != expected {
        return Err(Error::RightHandSide { found, expected });
    }
    if let Some(at) = block.iter().position(|b| !b.finite()) {
        let (row, column) = (at / columns, at % columns);
        return Err(Error::NotFinite { row, column });
    }
    Ok(())
}

fn relative(norms: &[f64], sizes: &[f64]) -> Vec<f64> {
    let share = |(&n, &s)| if s > 0.0 { n / s } else { n };
    norms.iter().zip(sizes).map(share).collect()
}

fn norms<T: Scalar>(block: &[T], columns: usize) -> Vec<f64> {
    let squares = dots(block, block, columns);
    squares.into_iter().map(f64::sqrt).collect()
}

/// Real parts of the products of columns, `Re xᴴ y`. Summed by fixed chunks of rows: the same bits for any number of
/// threads.
fn dots<T: Scalar>(x: &[T], y: &[T], columns: usize) -> Vec<f64> {
    let mut total = vec![0.0; columns];
    let parts = parallel::fold_chunks(x.len() / columns.max(1), |rows| {
        let range = rows.start * columns..rows.end * columns;
        let mut sums = vec![0.0; columns];
        let mut column = 0;
        for (&x, &y) in x[range.clone()].iter().zip(&y[range]) {
            sums[column] += (x.conjugate() * y).real_part();
            column += 1;
            if column == columns {
                column = 0;
            }
        }
        sums
    });
    for part in parts {
        total.iter_mut().zip(part).for_each(|(t, p)| *t += p);
    }
    total
}

/// `x ← change(x, y, factor)` with a factor per column.
fn change<T: Scalar>(
    x: &mut [T],
    y: &[T],
    factors: &[f64],
    change: impl Fn(T, T, f64) -> T + Sync,
) {
    let size = ROWS * factors.len().max(1);
    parallel::for_chunks(x, size, |chunk, x| {
        let mut column = 0;
        for (x, &y) in x.iter_mut().zip(&y[chunk * size..]) {
            *x = change(*x, y, factors[column]);
            column += 1;
            if column == factors.len() {
                column = 0;
            }
        }
    });
}
