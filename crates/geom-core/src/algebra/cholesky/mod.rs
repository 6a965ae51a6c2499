//! Sparse Cholesky factors: analyse once, factor often, solve for many right-hand sides. The only
//! file that knows faer's sparse interface.
//!
//! A symmetric positive definite A is `L Lᴴ` with a lower triangle L, and `A x = b` two substitutions. Where entries of L become
//! different from zero follows from the pattern of A alone: an order of the unknowns that keeps them few, and the columns of L that
//! share a pattern (supernodes, which are dense blocks), are the *symbolic* part, which serves every matrix of that pattern. A mesh
//! of n vertices on a surface needs about n log n entries and n^1.5 operations.
//!
//! Analysis runs on one thread. Real factors and substitutions run on all (`multifrontal.rs`, `substitution.rs`; `signed.rs` where
//! pivots may be negative) over the tasks of `tree.rs`; complex factors and those without supernodes are faer's, on one. In a body of n
//! vertices, with neighbours on all sides, a factor has about n^4/3 entries and takes n² operations: for these
//! [`eigen`](super::eigen) has a method without one.

mod gram;
mod multifrontal;
mod real;
mod signed;
mod single;
#[cfg(not(feature = "testing"))]
mod substitution;
#[cfg(feature = "testing")]
#[doc(hidden)]
pub mod substitution;
mod tree;

use std::sync::Arc;

use crate::compute::parallel;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

use self::multifrontal::{Failure, Fronts, Kept};
pub(super) use self::real::Real;
pub use self::signed::SignedFactor;
pub use self::single::SingleFactor;
pub(super) use self::substitution::Sweep;
use self::substitution::{Direction, Schedule, Solved, run};
use self::tree::{Forest, Supernode};
use super::{Error, Scalar, SparseMatrix};

/// Right-hand sides per pass over the factor. Part of the result: another number, other last bits. Eight of them fill
/// vector registers, and the factor, which is larger than the caches, is read once for them.
const COLUMNS: usize = 8;
/// Rows of a result that are put together at once.
const ROWS: usize = 2048;

/// Share of faer's own bound on operations per entry from which on a factor has supernodes: those of meshes of a thousand
/// vertices are still faster with them here.
const SUPERNODAL: f64 = 0.25;

/// The analysis of a pattern: ordering and shape of the factor, for every matrix of that pattern. Cloning shares it.
/// Keep it where matrices of one mesh are factored again and again, as for other times of a diffusion or other shifts.
#[derive(Clone)]
pub struct Symbolic {
    inner: Arc<Analysis>,
}

struct Analysis {
    symbolic: SymbolicCholesky<u32>,
    /// `None` for a small or nearly diagonal factor, which has no supernodes.
    plan: Option<Plan>,
    /// The upper half of the matrix row by row, which is the lower half column by column.
    starts: Vec<u32>,
    indices: Vec<u32>,
}

/// How a factor with supernodes is computed and solved with.
struct Plan {
    forest: Forest,
    fronts: Fronts,
    schedule: Schedule,
}

impl std::fmt::Debug for Symbolic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Symbolic")
            .field("rows", &self.rows())
            .field("factor_entries", &self.factor_entries())
            .finish()
    }
}

impl Symbolic {
    /// Analyses the pattern of a symmetric matrix: a minimum-degree ordering and the shape of the
    /// factor. Values are read for being finite only.
    ///
    /// # Errors
    /// [`Error::Shape`] if it is not square, [`Error::NotFinite`], [`Error::TooLarge`] if it or its factor is beyond
    /// 32-bit indices, and [`Error::OutOfMemory`].
    pub fn of<T: Scalar>(matrix: &SparseMatrix<T>) -> Result<Self, Error> {
        let (starts, indices, _) = upper_half(matrix)?;
        Self::analysed(matrix.rows(), matrix.entries(), starts, indices)
    }

    /// The analysis of the upper half of a matrix of `n` rows and so many entries: not generic, so that it is compiled
    /// here and not in every program.
    fn analysed(
        n: usize,
        entries: usize,
        starts: Vec<u32>,
        indices: Vec<u32>,
    ) -> Result<Self, Error> {
        let too_large = Error::TooLarge {
            rows: n,
            entries: entries as u128,
        };
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &indices);
        let symbolic = factorize_symbolic_cholesky(
            pattern,
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: SupernodalThreshold(SUPERNODAL),
                ..CholeskySymbolicParams::default()
            },
        )
        .map_err(|e| match e {
            faer::sparse::FaerError::OutOfMemory => Error::OutOfMemory { entries: 0 },
            _ => too_large,
        })?;
        let plan = match symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(shape) => {
                let order = symbolic.perm().map(|p| p.arrays());
                let original = |i: usize| order.map_or(i, |(rows, _)| rows[i] as usize);
                let unordered: Vec<u32>;
                let place = match order {
                    Some((_, place)) => place,
                    None => {
                        unordered = (0..n as u32).collect();
                        &unordered
                    }
                };
                let supernodes = supernodes(shape);
                let forest = Forest::of(&supernodes);
                let (fronts, schedule) = rayon::join(
                    || Fronts::of(&supernodes, &forest, (&starts, &indices), place),
                    || Schedule::of(&supernodes, &forest, original),
                );
                Some(Plan {
                    fronts,
                    schedule,
                    forest,
                })
            }
            SymbolicCholeskyRaw::Simplicial(_) => None,
        };
        let inner = Arc::new(Analysis {
            symbolic,
            plan,
            starts,
            indices,
        });
        Ok(Self { inner })
    }

    /// Rows of the matrix.
    pub fn rows(&self) -> usize {
        self.inner.symbolic.nrows()
    }

    /// Entries of the factor. Known before anything is factored: eight bytes each, sixteen of complex ones.
    pub fn factor_entries(&self) -> usize {
        self.inner.symbolic.len_val()
    }

    /// Factors a positive definite matrix of the analysed pattern as L Lᴴ.
    ///
    /// # Errors
    /// [`Error::OtherPattern`], [`Error::NotFinite`], [`Error::OutOfMemory`]; [`Error::NotPositiveDefinite`] names the
    /// row of the first pivot that is not positive.
    pub fn factor<T: Scalar>(&self, matrix: &SparseMatrix<T>) -> Result<Cholesky<T>, Error> {
        Ok(Cholesky {
            symbolic: self.clone(),
            values: T::factor(self, matrix)?,
        })
    }

    /// The same at half of the memory, rounded to f32; as it is where it is so small that nothing is gained by it, or does not fit f32.
    ///
    /// # Errors
    /// Those of [`factor`](Self::factor).
    pub fn factor_single(&self, matrix: &SparseMatrix<f64>) -> Result<SingleFactor, Error> {
        if let Some(plan) = &self.inner.plan {
            // A pivot that vanishes or is beyond f32 makes it no factor, and rounding may bring one to that.
            let holds = |&d: &f32| d >= f32::MIN_POSITIVE && d.is_finite();
            match factor_into::<f32, false>(self, plan, matrix) {
                Ok(values) if self.pivots(&values).iter().all(holds) => {
                    let symbolic = self.clone();
                    return Ok(SingleFactor(single::Values::Rounded { symbolic, values }));
                }
                Ok(_) | Err(Error::NotPositiveDefinite { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(SingleFactor(single::Values::Whole(self.factor(matrix)?)))
    }

    /// Factors a symmetric matrix of the analysed pattern that need not be definite as L S Lᵀ, with signs S. Pivots are not
    /// exchanged, so that the pattern serves for it, too: `None` when one vanishes, which says that zero is an eigenvalue of a
    /// leading part, or nearly so, and the factor is as good as pivots keep clear of that.
    ///
    /// # Errors
    /// [`Error::OtherPattern`], [`Error::NotFinite`] and [`Error::OutOfMemory`].
    pub fn factor_signed(&self, matrix: &SparseMatrix<f64>) -> Result<Option<SignedFactor>, Error> {
        signed::factor(self, matrix)
    }

    /// How many eigenvalues of a matrix of this pattern are negative: the signs of the pivots of [its
    /// factor](Self::factor_signed) (Sylvester's law of inertia). `None` when a pivot vanishes. The answer is for shifts that keep
    /// clear of eigenvalues; it takes as long as a factor.
    ///
    /// # Errors
    /// [`Error::OtherPattern`], [`Error::NotFinite`] and [`Error::OutOfMemory`].
    pub fn negative_eigenvalues(&self, matrix: &SparseMatrix<f64>) -> Result<Option<usize>, Error> {
        Ok(self.factor_signed(matrix)?.map(|factor| factor.negative()))
    }

    /// The diagonal of a factor.
    fn pivots<T: Copy>(&self, values: &[T]) -> Vec<T> {
        match self.inner.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(s) => s.col_ptr()[..s.ncols()]
                .iter()
                .map(|&at| values[at as usize])
                .collect(),
            SymbolicCholeskyRaw::Supernodal(s) => (0..s.n_supernodes())
                .flat_map(|k| {
                    let columns = (s.supernode_end()[k] - s.supernode_begin()[k]) as usize;
                    let start = s.col_ptr_for_val()[k] as usize;
                    let height = (s.col_ptr_for_val()[k + 1] as usize - start) / columns;
                    (0..columns).map(move |j| start + j * height + j)
                })
                .map(|at| values[at])
                .collect(),
        }
    }

    /// [`Cholesky::inverse_gram`] with the values of a factor that has supernodes, as they are kept.
    fn inverse_gram<V: Kept>(
        &self,
        values: &[V],
        columns: &[Vec<(usize, f64)>],
    ) -> Result<Vec<f64>, Error> {
        let mut gram = self.room_for(columns)?;
        let Some(Plan { schedule, .. }) = &self.inner.plan else {
            return Ok(gram);
        };
        gram.resize(columns.len() * columns.len(), 0.0);
        Ok(gram::inverse_gram(schedule, values, columns, gram))
    }

    /// For a number per pair of columns, which are columns of the matrix.
    fn room_for(&self, columns: &[Vec<(usize, f64)>]) -> Result<Vec<f64>, Error> {
        self.check_rows(columns)?;
        let entries = columns.len().saturating_mul(columns.len());
        let mut room = Vec::new();
        room.try_reserve_exact(entries)
            .map_err(|_| Error::OutOfMemory { entries })?;
        Ok(room)
    }

    fn check_rows(&self, vectors: &[Vec<(usize, f64)>]) -> Result<(), Error> {
        let n = self.rows();
        match vectors.iter().flatten().find(|entry| entry.0 >= n) {
            None => Ok(()),
            Some(&(row, _)) => Err(Error::OutOfRange {
                row,
                column: row,
                rows: n,
                columns: n,
            }),
        }
    }

    /// Refused rather than fatal: a factor may be the largest thing in a program.
    fn zeros<T: Clone + Default>(&self) -> Result<Vec<T>, Error> {
        let entries = self.factor_entries();
        let mut values = Vec::new();
        values
            .try_reserve_exact(entries)
            .map_err(|_| Error::OutOfMemory { entries })?;
        values.resize(entries, T::default());
        Ok(values)
    }

    fn memory<T: Scalar>(
        &self,
        scratch: faer::dyn_stack::StackReq,
    ) -> Result<(Vec<T>, MemBuffer), Error> {
        let entries = self.factor_entries();
        let memory = MemBuffer::try_new(scratch).map_err(|_| Error::OutOfMemory { entries })?;
        Ok((self.zeros()?, memory))
    }

    fn values_of<T: Scalar>(&self, matrix: &SparseMatrix<T>) -> Result<Vec<T>, Error> {
        let (starts, indices, values) = upper_half(matrix)?;
        if starts != self.inner.starts || indices != self.inner.indices {
            return Err(Error::OtherPattern);
        }
        Ok(values)
    }

    /// The rows of the upper half are handed to faer as the columns of the lower one: nothing is transposed.
    fn lower<'a, T: Scalar>(&'a self, upper: &'a [T]) -> SparseColMatRef<'a, u32, T> {
        let (a, n) = (&*self.inner, self.rows());
        SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(n, n, &a.starts, None, &a.indices),
            upper,
        )
    }

    /// The row of the matrix whose pivot faer says is not positive: it counts pivots from 1 in factors without
    /// supernodes, from 0 in others.
    fn row_of_pivot(&self, index: usize) -> usize {
        let index = match self.inner.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(_) => index.saturating_sub(1),
            SymbolicCholeskyRaw::Supernodal(_) => index,
        };
        match self.inner.symbolic.perm() {
            Some(order) => order.arrays().0[index] as usize,
            None => index,
        }
    }
}

/// faer's shape of a factor as the schedule reads it.
fn supernodes(shape: &SymbolicSupernodalCholesky<u32>) -> Vec<Supernode<'_>> {
    let values = |s: usize| shape.col_ptr_for_val()[s] as usize;
    (0..shape.n_supernodes())
        .map(|s| {
            let first = shape.col_ptr_for_row_idx()[s] as usize;
            let count = shape.nnz_per_super()[s] as usize;
            Supernode {
                columns: shape.supernode_begin()[s] as usize..shape.supernode_end()[s] as usize,
                rows: &shape.row_idx()[first..first + count],
                values: values(s)..values(s + 1),
            }
        })
        .collect()
}

/// Starts, indices and conjugated values: a row of the upper half, conjugated, is a column of the
/// lower half.
type Half<T> = (Vec<u32>, Vec<u32>, Vec<T>);

/// Reads what lies on the diagonal or right of it, and refuses what is not finite there; the lower half is not looked
/// at.
fn upper_half<T: Scalar>(matrix: &SparseMatrix<T>) -> Result<Half<T>, Error> {
    let n = matrix.rows();
    if matrix.columns() != n {
        return Err(Error::Shape {
            what: "a matrix that should be square",
            found: n,
            expected: matrix.columns(),
        });
    }
    if matrix.entries() > i32::MAX as usize {
        return Err(Error::TooLarge {
            rows: n,
            entries: matrix.entries() as u128,
        });
    }
    // Half of the entries and of the diagonal.
    let count = (matrix.entries() + n) / 2;
    let mut starts = vec![0u32];
    let (mut indices, mut values) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for i in 0..n {
        for (j, a) in matrix.row(i).filter(|&(j, _)| j >= i) {
            if !a.finite() {
                return Err(Error::NotFinite { row: i, column: j });
            }
            indices.push(j as u32);
            values.push(a.conjugate());
        }
        starts.push(indices.len() as u32);
    }
    Ok((starts, indices, values))
}

/// The values of the factor L Lᴴ: [`Symbolic::factor`].
pub(super) fn factor<T: Scalar>(
    symbolic: &Symbolic,
    matrix: &SparseMatrix<T>,
) -> Result<Vec<T>, Error> {
    let upper = symbolic.values_of(matrix)?;
    let inner = &symbolic.inner.symbolic;
    let (mut values, mut memory) = symbolic
        .memory::<T>(inner.factorize_numeric_llt_scratch::<T>(Par::Seq, Default::default()))?;
    inner
        .factorize_numeric_llt::<T>(
            &mut values,
            symbolic.lower(&upper),
            Side::Lower,
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .map_err(
            |LltError::NonPositivePivot { index }| Error::NotPositiveDefinite {
                row: symbolic.row_of_pivot(index),
            },
        )?;
    Ok(values)
}

/// The same for a real matrix: on all threads if there are supernodes.
pub(super) fn factor_real(
    symbolic: &Symbolic,
    matrix: &SparseMatrix<f64>,
) -> Result<Vec<f64>, Error> {
    match &symbolic.inner.plan {
        Some(plan) => factor_into::<f64, false>(symbolic, plan, matrix),
        None => factor(symbolic, matrix),
    }
}

fn factor_into<V: Kept, const SIGNED: bool>(
    symbolic: &Symbolic,
    plan: &Plan,
    matrix: &SparseMatrix<f64>,
) -> Result<Vec<V>, Error> {
    let upper = symbolic.values_of(matrix)?;
    let mut values = symbolic.zeros()?;
    let entries = values.len();
    let fronts = &plan.fronts;
    let made = parallel::inside(|| fronts.factor::<V, SIGNED>(&plan.forest, &upper, &mut values));
    made.map_err(|failure| match failure {
        Failure::Pivot(column) => Error::NotPositiveDefinite {
            row: symbolic.row_of_pivot(column),
        },
        Failure::Memory => Error::OutOfMemory { entries },
    })?;
    Ok(values)
}

/// The factor L Lᴴ of a positive definite matrix. It keeps the values of the factor and shares the analysis.
#[derive(Clone, Debug)]
pub struct Cholesky<T = f64> {
    symbolic: Symbolic,
    values: Vec<T>,
}

impl<T: Scalar> Cholesky<T> {
    /// Analyses and factors a positive definite matrix. Only the upper half is read. Whether the lower half agrees is
    /// not asked: [`SparseMatrix::check_hermitian`] does.
    ///
    /// # Errors
    /// Those of [`Symbolic::of`] and [`Symbolic::factor`].
    pub fn of(matrix: &SparseMatrix<T>) -> Result<Self, Error> {
        Symbolic::of(matrix)?.factor(matrix)
    }

    /// The analysis, for other matrices of the same pattern.
    pub fn symbolic(&self) -> &Symbolic {
        &self.symbolic
    }

    /// Rows of the matrix.
    pub fn rows(&self) -> usize {
        self.symbolic.rows()
    }

    /// Entries of the factor.
    pub fn factor_entries(&self) -> usize {
        self.values.len()
    }

    /// Replaces a block of `columns` right-hand sides by the solutions. Up to eight columns share one pass over the
    /// factor each way; such parts, and independent subtrees, are solved in parallel, with bits that do not depend on
    /// threads. What is not finite goes through as it is.
    ///
    /// # Errors
    /// [`Error::RightHandSide`] for a block of other size, [`Error::OutOfMemory`].
    pub fn solve_in_place(&self, block: &mut [T], columns: usize) -> Result<(), Error> {
        let n = self.rows();
        let expected = n * columns;
        if block.len() != expected {
            let found = block.len();
            return Err(Error::RightHandSide { found, expected });
        }
        if expected == 0 {
            return Ok(());
        }
        T::substitute(&self.symbolic, &self.values, block, columns)
    }

    /// The solutions for a block of right-hand sides of the right size.
    pub(super) fn solved(&self, block: &[T], columns: usize) -> Result<Vec<T>, Error> {
        if self.symbolic.inner.plan.is_none() || block.is_empty() {
            let mut x = block.to_vec();
            self.solve_in_place(&mut x, columns)?;
            return Ok(x);
        }
        let mut x = vec![T::default(); block.len()];
        T::substitute_into(&self.symbolic, &self.values, block, &mut x, columns);
        Ok(x)
    }

    /// Solves for one right-hand side.
    ///
    /// ```
    /// use geom_core::algebra::{Cholesky, SparseMatrix};
    /// let entries = [(0, 0, 4.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 3.0)];
    /// let matrix = SparseMatrix::from_triplets(2, 2, &entries)?;
    /// let x = Cholesky::of(&matrix)?.solve(&[2.0, 5.0])?;
    /// assert!((x[0] + 0.5).abs() < 1e-14 && (x[1] - 2.0).abs() < 1e-14);
    /// # Ok::<(), geom_core::algebra::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::RightHandSide`] for another number of values.
    pub fn solve(&self, b: &[T]) -> Result<Vec<T>, Error> {
        let mut x = b.to_vec();
        self.solve_in_place(&mut x, 1)?;
        Ok(x)
    }
}

impl Cholesky {
    /// `bᵀ A⁻¹ b` of sparse vectors b, each given by rows and values, which are summed where a row comes again: what each of
    /// many small changes is worth to a quadratic energy, for less than solving for it.
    ///
    /// It is the square of L⁻¹ b, which has entries on the way from those of b to the root of the elimination tree alone: on
    /// a surface of n vertices about n operations and less memory traffic, in place of n log n. Eight vectors share a
    /// pass, neighbours in the list if they are neighbours in the mesh; passes run in parallel, with bits that do not
    /// depend on threads.
    ///
    /// ```
    /// use geom_core::algebra::{Cholesky, SparseMatrix};
    /// let entries = [(0, 0, 4.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 3.0)];
    /// let matrix = SparseMatrix::from_triplets(2, 2, &entries)?;
    /// let energies = Cholesky::of(&matrix)?.inverse_energies(&[vec![(0, 1.0)], vec![(0, 2.0), (1, 5.0)]])?;
    /// // The inverse is [3, -2; -2, 4] / 8.
    /// assert!((energies[0] - 0.375).abs() < 1e-14 && (energies[1] - 9.0).abs() < 1e-13);
    /// # Ok::<(), geom_core::algebra::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a row that the matrix has not, [`Error::OutOfMemory`].
    pub fn inverse_energies(&self, vectors: &[Vec<(usize, f64)>]) -> Result<Vec<f64>, Error> {
        self.symbolic.check_rows(vectors)?;
        let Some(Plan { schedule, .. }) = &self.symbolic.inner.plan else {
            return vectors.iter().map(|b| self.inverse_energy(b)).collect();
        };
        let parts = vectors.chunks(COLUMNS);
        let norms: Vec<[f64; COLUMNS]> = parallel::map(parts.len(), |part| {
            let first = part * COLUMNS;
            let end = (first + COLUMNS).min(vectors.len());
            schedule.norms(&self.values, &vectors[first..end])
        });
        let norms = norms.as_flattened().iter().take(vectors.len());
        Ok(norms.copied().collect())
    }

    /// `Bᵀ A⁻¹ B`, row after row, of sparse columns given like those of [`inverse_energies`](Self::inverse_energies), which are its
    /// diagonal: what is left of `[A B; Bᵀ D]` when the unknowns of A are eliminated is D minus this, the Schur complement.
    ///
    /// On a surface of n vertices about n operations per column, and as many as each two columns have rows of L⁻¹ B in common;
    /// eight bytes per pair of columns. Bits do not depend on threads.
    ///
    /// ```
    /// use geom_core::algebra::{Cholesky, SparseMatrix};
    /// let entries = [(0, 0, 4.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 3.0)];
    /// let matrix = SparseMatrix::from_triplets(2, 2, &entries)?;
    /// let gram = Cholesky::of(&matrix)?.inverse_gram(&[vec![(0, 1.0)], vec![(1, 1.0)]])?;
    /// for (found, inverse) in gram.iter().zip([0.375, -0.25, -0.25, 0.5]) {
    ///     assert!((found - inverse).abs() < 1e-14);
    /// }
    /// # Ok::<(), geom_core::algebra::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a row that the matrix has not, [`Error::OutOfMemory`].
    pub fn inverse_gram(&self, columns: &[Vec<(usize, f64)>]) -> Result<Vec<f64>, Error> {
        if self.symbolic.inner.plan.is_some() {
            return self.symbolic.inverse_gram(&self.values, columns);
        }
        let mut gram = self.symbolic.room_for(columns)?;
        for b in columns {
            let x = self.solve_sparse(b)?;
            gram.extend(columns.iter().map(|c| dot(c, &x)));
        }
        Ok(gram)
    }

    /// By solving for it: without supernodes.
    fn inverse_energy(&self, vector: &[(usize, f64)]) -> Result<f64, Error> {
        Ok(dot(vector, &self.solve_sparse(vector)?))
    }

    fn solve_sparse(&self, vector: &[(usize, f64)]) -> Result<Vec<f64>, Error> {
        let mut x = vec![0.0; self.rows()];
        vector.iter().for_each(|&(row, value)| x[row] += value);
        self.solve_in_place(&mut x, 1)?;
        Ok(x)
    }
}

/// The product of a sparse vector with a full one.
fn dot(sparse: &[(usize, f64)], x: &[f64]) -> f64 {
    sparse.iter().map(|&(row, value)| value * x[row]).sum()
}

/// [`Cholesky::solve_in_place`] for a block of the right size that is not empty.
pub(super) fn substitute<T: Scalar>(
    symbolic: &Symbolic,
    factor: &[T],
    block: &mut [T],
    columns: usize,
) -> Result<(), Error> {
    let n = symbolic.rows();
    match &symbolic.inner.plan {
        Some(_) => {
            let mut x = vec![T::default(); block.len()];
            substitute_into(symbolic, factor, block, &mut x, columns);
            block.copy_from_slice(&x);
        }
        // Small or nearly diagonal: not worth a kernel.
        None => {
            let symbolic = &symbolic.inner.symbolic;
            let scratch = symbolic.solve_in_place_scratch::<T>(columns, Par::Seq);
            let mut memory =
                MemBuffer::try_new(scratch).map_err(|_| Error::OutOfMemory { entries: 0 })?;
            LltRef::new(symbolic, factor).solve_in_place_with_conj(
                Conj::No,
                MatMut::from_row_major_slice_mut(block, n, columns),
                Par::Seq,
                MemStack::new(&mut memory),
            );
        }
    }
    Ok(())
}

/// The solutions for a block that is not empty, with a factor that has supernodes.
pub(super) fn substitute_into<T: Scalar>(
    symbolic: &Symbolic,
    factor: &[T],
    block: &[T],
    out: &mut [T],
    columns: usize,
) {
    let Some(Plan { schedule, .. }) = &symbolic.inner.plan else {
        return;
    };
    let job = Job {
        schedule,
        factor,
        negative: &[],
        block,
        columns,
    };
    job.solve(out);
}

/// What is solved: schedule and factor, which of each task's columns have negative pivots if any may, and a block of so many
/// columns.
struct Job<'a, T> {
    schedule: &'a Schedule,
    factor: &'a [T],
    negative: &'a [Vec<u32>],
    block: &'a [T],
    columns: usize,
}

impl<T: Scalar> Job<'_, T> {
    /// Up to eight columns share a pass.
    fn solve(&self, out: &mut [T]) {
        let (wide, rest) = (self.columns / COLUMNS, self.columns % COLUMNS);
        let first = wide * COLUMNS;
        parallel::inside(|| {
            self.solve_parts::<COLUMNS>(0, wide, out);
            match rest {
                0 => {}
                1 => self.solve_parts::<1>(first, 1, out),
                _ => self.solve_parts::<COLUMNS>(first, 1, out),
            }
        });
    }

    /// Solves for `parts` times `C` columns of a block (the last ones may be missing) from the first one on. Each part has its
    /// own vectors and reads the whole factor; rows are put into the result at the end.
    fn solve_parts<const C: usize>(&self, first: usize, parts: usize, out: &mut [T]) {
        let Self {
            schedule,
            factor,
            negative,
            block,
            columns,
        } = *self;
        let range = |part: usize| first + part * C..(first + (part + 1) * C).min(columns);
        let solved: Vec<Solved<T, C>> = parallel::map(parts, |part| {
            schedule.solve_by(block, columns, range(part), |t, x, direction| {
                run(&schedule.tasks[t], factor, x, direction);
                if direction == Direction::Down
                    && let Some(negative) = negative.get(t)
                {
                    for &row in negative {
                        x[row as usize].iter_mut().for_each(|x| *x = -*x);
                    }
                }
            })
        });
        parallel::for_chunks(out, ROWS * columns, |k, out| {
            for (i, out) in out.chunks_exact_mut(columns).enumerate() {
                for (part, solved) in solved.iter().enumerate() {
                    let out = &mut out[range(part)];
                    out.copy_from_slice(&schedule.row(solved, k * ROWS + i)[..out.len()]);
                }
            }
        });
    }
}
