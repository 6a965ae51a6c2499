//! Sparse matrices in compressed rows.
//!
//! Row i has the columns and values at `starts[i] .. starts[i + 1]`, columns ascending, no entry twice. A product with a vector reads
//! every entry once, so that its time is that of reading the matrix from memory; with a block of several vectors the matrix is read
//! once for all of them.
//!
//! ```
//! use geom_core::algebra::SparseMatrix;
//! // −u″ on four points: 2 on the diagonal, −1 beside it.
//! let entries: Vec<(u32, u32, f64)> = (0..4)
//!     .flat_map(|i| [(i, i, 2.0), (i, i + 1, -1.0), (i + 1, i, -1.0)])
//!     .filter(|&(i, j, _)| i < 4 && j < 4)
//!     .collect();
//! let matrix = SparseMatrix::from_triplets(4, 4, &entries)?;
//! let second = matrix.multiply(&[0.0, 1.0, 4.0, 9.0], 1);
//! assert_eq!(second[1..3], [-2.0, -2.0]);
//! # Ok::<(), geom_core::algebra::Error>(())
//! ```

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Mul, Neg, Range, Sub, SubAssign};

use crate::compute::parallel;
use nalgebra::Complex;
use rayon::prelude::*;

use super::Error;

/// Rows per task of a product.
const ROWS: usize = 2048;
/// Triplets that are sorted into blocks of rows at a time.
const TRIPLETS: usize = 1 << 17;

mod sealed {
    use super::super::cholesky::Sweep;
    use super::super::{Error, Symbolic, cholesky};
    use super::{Complex, SparseMatrix};
    use crate::compute::lanes;

    /// The heavy functions, compiled here once for each of the two types and not in every program that calls them.
    pub trait Sealed: faer::traits::ComplexField {
        fn factor(symbolic: &Symbolic, matrix: &SparseMatrix<Self>) -> Result<Vec<Self>, Error>;
        fn substitute(
            symbolic: &Symbolic,
            factor: &[Self],
            block: &mut [Self],
            columns: usize,
        ) -> Result<(), Error>;
        fn substitute_into(
            symbolic: &Symbolic,
            factor: &[Self],
            block: &[Self],
            out: &mut [Self],
            columns: usize,
        );
        fn sweep<const C: usize>(sweep: Sweep<'_, Self, C>);
        fn multiply(matrix: &SparseMatrix<Self>, block: &[Self], columns: usize, out: &mut [Self]);
    }
    macro_rules! sealed {
        ($scalar:ty, $factor:path, $sweep:expr) => {
            impl Sealed for $scalar {
                fn factor(
                    symbolic: &Symbolic,
                    matrix: &SparseMatrix<Self>,
                ) -> Result<Vec<Self>, Error> {
                    $factor(symbolic, matrix)
                }
                fn substitute(
                    symbolic: &Symbolic,
                    factor: &[Self],
                    block: &mut [Self],
                    columns: usize,
                ) -> Result<(), Error> {
                    cholesky::substitute(symbolic, factor, block, columns)
                }
                fn substitute_into(
                    symbolic: &Symbolic,
                    factor: &[Self],
                    block: &[Self],
                    out: &mut [Self],
                    columns: usize,
                ) {
                    cholesky::substitute_into(symbolic, factor, block, out, columns);
                }
                fn sweep<const C: usize>(sweep: Sweep<'_, Self, C>) {
                    lanes::vectorized($sweep(sweep));
                }
                fn multiply(
                    matrix: &SparseMatrix<Self>,
                    block: &[Self],
                    columns: usize,
                    out: &mut [Self],
                ) {
                    super::multiply(matrix, block, columns, out);
                }
            }
        };
    }
    sealed!(f64, cholesky::factor_real, cholesky::Real);
    sealed!(Complex<f64>, cholesky::factor, std::convert::identity);
}

/// What a sparse matrix holds: f64 or complex f64. Sealed. Complex matrices are those of fields of directions on
/// surfaces, [`connection()`](crate::surface::laplace::connection()).
pub trait Scalar:
    sealed::Sealed
    + Copy
    + Debug
    + Default
    + PartialEq
    + Send
    + Sync
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + SubAssign
    + Mul<Output = Self>
    + Mul<f64, Output = Self>
    + Neg<Output = Self>
    + From<f64>
{
    /// The complex conjugate.
    #[must_use]
    fn conjugate(self) -> Self;
    /// |x|².
    fn norm_squared(self) -> f64;
    /// The real part.
    fn real_part(self) -> f64;
    /// Neither NaN nor infinite.
    fn finite(self) -> bool;
    /// `self · factor + summand`, rounded once where that is real. A product of two complex numbers is four fused ones.
    fn fused(self, factor: Self, summand: Self) -> Self;
}

impl Scalar for f64 {
    #[inline(always)]
    fn conjugate(self) -> Self {
        self
    }
    #[inline(always)]
    fn norm_squared(self) -> f64 {
        self * self
    }
    #[inline(always)]
    fn real_part(self) -> f64 {
        self
    }
    #[inline(always)]
    fn finite(self) -> bool {
        self.is_finite()
    }
    #[inline(always)]
    fn fused(self, factor: Self, summand: Self) -> Self {
        self.mul_add(factor, summand)
    }
}

impl Scalar for Complex<f64> {
    #[inline(always)]
    fn conjugate(self) -> Self {
        self.conj()
    }
    #[inline(always)]
    fn norm_squared(self) -> f64 {
        self.norm_sqr()
    }
    #[inline(always)]
    fn real_part(self) -> f64 {
        self.re
    }
    #[inline(always)]
    fn finite(self) -> bool {
        self.re.is_finite() && self.im.is_finite()
    }
    #[inline(always)]
    fn fused(self, factor: Self, summand: Self) -> Self {
        let part = |a: f64, b: f64, c: f64| self.re.mul_add(a, self.im.mul_add(b, c));
        Self::new(
            part(factor.re, -factor.im, summand.re),
            part(factor.im, factor.re, summand.im),
        )
    }
}

/// [`SparseMatrix::multiply_into`] for a block of the right size that is not empty. A block is taken 16 columns at a
/// time, then 8, 4, 2, 1: the sums of a row stay in registers, and the matrix is read once per slice.
fn multiply<T: Scalar>(matrix: &SparseMatrix<T>, block: &[T], columns: usize, out: &mut [T]) {
    parallel::for_chunks(out, ROWS * columns, |part, out| {
        let mut at = 0;
        while at < columns {
            let width = match columns - at {
                1 => matrix.rows_times::<1>(part * ROWS, block, out, columns, at),
                2 => matrix.rows_times::<2>(part * ROWS, block, out, columns, at),
                // Coordinates.
                3 => matrix.rows_times::<3>(part * ROWS, block, out, columns, at),
                4..8 => matrix.rows_times::<4>(part * ROWS, block, out, columns, at),
                8..16 => matrix.rows_times::<8>(part * ROWS, block, out, columns, at),
                _ => matrix.rows_times::<16>(part * ROWS, block, out, columns, at),
            };
            at += width;
        }
    });
}

/// A sparse matrix in compressed rows; columns ascend within a row, each at most once. A symmetric
/// matrix holds both halves.
///
/// 12 bytes per entry of f64 and 8 per row; at most 2³² − 2 rows, columns and entries. Zeros that are stored count as
/// entries: they belong to the pattern, which a [`Symbolic`](super::Symbolic) analysis is made of. The pattern does not
/// change after it is made, [`map`](Self::map) changes values only.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseMatrix<T = f64> {
    columns: usize,
    starts: Vec<usize>,
    indices: Vec<u32>,
    values: Vec<T>,
}

/// Some rows of a matrix while it is made.
#[derive(Default)]
struct Rows<T> {
    lengths: Vec<u32>,
    indices: Vec<u32>,
    values: Vec<T>,
}

impl<T: Scalar> Rows<T> {
    /// The next row, of columns and values in any order; those of one column are added in the order they have.
    fn push(&mut self, entries: &mut [(u32, T)]) {
        entries.sort_by_key(|e| e.0);
        let before = self.indices.len();
        for &(column, value) in &*entries {
            match self.values.last_mut() {
                Some(last) if self.indices[before..].last() == Some(&column) => *last += value,
                _ => {
                    self.indices.push(column);
                    self.values.push(value);
                }
            }
        }
        self.lengths.push((self.indices.len() - before) as u32);
    }
}

/// Triplets sorted into blocks of [`ROWS`] rows, in their order within each.
struct Triplets<T> {
    starts: Vec<usize>,
    entries: Vec<(u32, u32, T)>,
}

impl<T: Scalar> Triplets<T> {
    /// Checks and sorts them.
    fn of(entries: &[(u32, u32, T)], [rows, columns]: [usize; 2]) -> Result<Self, Error> {
        let mut counts = vec![0u32; rows.div_ceil(ROWS)];
        for &(row, column, value) in entries {
            let (row, column) = (row as usize, column as usize);
            if row >= rows || column >= columns {
                return Err(Error::OutOfRange {
                    row,
                    column,
                    rows,
                    columns,
                });
            }
            if !value.finite() {
                return Err(Error::NotFinite { row, column });
            }
            counts[row / ROWS] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut sorted = vec![(0, 0, T::default()); entries.len()];
        for &entry in entries {
            let next = &mut next[entry.0 as usize / ROWS];
            sorted[*next] = entry;
            *next += 1;
        }
        Ok(Self {
            starts,
            entries: sorted,
        })
    }

    fn of_block(&self, block: usize) -> &[(u32, u32, T)] {
        &self.entries[self.starts[block]..self.starts[block + 1]]
    }
}

impl<T: Scalar> SparseMatrix<T> {
    /// The sum of entries `(row, column, value)`; entries of one place are added in the given order. Sums that vanish
    /// stay as zeros.
    ///
    /// # Errors
    /// [`Error::TooLarge`]; then, of the first entry at fault, [`Error::OutOfRange`] or [`Error::NotFinite`]. A sum
    /// that overflows is not seen here.
    pub fn from_triplets(
        rows: usize,
        columns: usize,
        entries: &[(u32, u32, T)],
    ) -> Result<Self, Error> {
        check_size(rows.max(columns), entries.len())?;
        let pieces: Vec<&[(u32, u32, T)]> = entries.chunks(TRIPLETS).collect();
        let sorted = parallel::map_each(&pieces, |piece| Triplets::of(piece, [rows, columns]));
        let sorted = sorted.into_iter().collect::<Result<Vec<_>, _>>()?;
        Self::from_blocks(rows, columns, |block, own, out| {
            let all = || sorted.iter().flat_map(|piece| piece.of_block(block));
            let mut starts = vec![0u32; own.len() + 1];
            for &(row, ..) in all() {
                starts[row as usize - own.start + 1] += 1;
            }
            for row in 0..own.len() {
                starts[row + 1] += starts[row];
            }
            let mut next = starts.clone();
            let mut entries = vec![(0u32, T::default()); starts[own.len()] as usize];
            for &(row, column, value) in all() {
                let next = &mut next[row as usize - own.start];
                entries[*next as usize] = (column, value);
                *next += 1;
            }
            for row in starts.windows(2) {
                out.push(&mut entries[row[0] as usize..row[1] as usize]);
            }
        })
    }

    /// A matrix whose rows are written by `row(i, &mut entries)`: pairs of column and value in any
    /// order; entries of one column are added in the written order. Rows are written in parallel, piece by piece: what a list of
    /// [triplets](Self::from_triplets) takes in memory is saved.
    ///
    /// ```
    /// use geom_core::algebra::SparseMatrix;
    /// let differences = SparseMatrix::from_rows(3, 3, |i, row| {
    ///     row.push((i as u32, 1.0));
    ///     if i > 0 {
    ///         row.push((i as u32 - 1, -1.0));
    ///     }
    /// })?;
    /// assert_eq!(differences.multiply(&[1.0, 2.0, 4.0], 1), [1.0, 1.0, 2.0]);
    /// # Ok::<(), geom_core::algebra::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::TooLarge`]; then, of the lowest row at fault, [`Error::OutOfRange`] or [`Error::NotFinite`], of a sum too.
    pub fn from_rows(
        rows: usize,
        columns: usize,
        row: impl Fn(usize, &mut Vec<(u32, T)>) + Sync,
    ) -> Result<Self, Error> {
        check_size(rows.max(columns), 0)?;
        let matrix = Self::written(rows, columns, row)?;
        let fault = |row: usize| {
            matrix.row(row).find_map(|(column, value)| {
                if column >= columns {
                    return Some(Error::OutOfRange {
                        row,
                        column,
                        rows,
                        columns,
                    });
                }
                (!value.finite()).then_some(Error::NotFinite { row, column })
            })
        };
        match parallel::first(rows, |row| fault(row).is_some()).and_then(fault) {
            Some(error) => Err(error),
            None => Ok(matrix),
        }
    }

    /// The same, columns and values not looked at.
    pub(super) fn written(
        rows: usize,
        columns: usize,
        row: impl Fn(usize, &mut Vec<(u32, T)>) + Sync,
    ) -> Result<Self, Error> {
        Self::from_blocks(rows, columns, |_, own, out| {
            let mut entries: Vec<(u32, T)> = Vec::new();
            for i in own {
                entries.clear();
                row(i, &mut entries);
                out.push(&mut entries);
            }
        })
    }

    /// The same, written by `block(number, rows, &mut out)`, [`ROWS`] rows at a time.
    fn from_blocks(
        rows: usize,
        columns: usize,
        block: impl Fn(usize, Range<usize>, &mut Rows<T>) + Sync,
    ) -> Result<Self, Error> {
        let parts: Vec<Rows<T>> = parallel::map(rows.div_ceil(ROWS), |number| {
            let mut out = Rows::default();
            let first = number * ROWS;
            block(number, first..(first + ROWS).min(rows), &mut out);
            out
        });
        let lengths: Vec<u32> = parts.iter().flat_map(|p| &p.lengths).copied().collect();
        let starts = parallel::starts_of(&lengths);
        check_size(rows, starts[rows])?;
        let mut indices = Vec::with_capacity(starts[rows]);
        let mut values = Vec::with_capacity(starts[rows]);
        for part in parts {
            indices.extend_from_slice(&part.indices);
            values.extend_from_slice(&part.values);
        }
        Ok(Self {
            columns,
            starts,
            indices,
            values,
        })
    }

    /// A diagonal matrix.
    pub fn diagonal_of(values: &[T]) -> Self {
        Self {
            columns: values.len(),
            starts: (0..=values.len()).collect(),
            indices: (0..values.len() as u32).collect(),
            values: values.to_vec(),
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }
    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }
    /// Number of stored entries.
    pub fn entries(&self) -> usize {
        self.values.len()
    }
    /// Where each row starts in [`indices`](Self::indices) and [`values`](Self::values); `rows + 1`
    /// numbers.
    pub fn starts(&self) -> &[usize] {
        &self.starts
    }
    /// Column of each entry, row after row, ascending within a row.
    pub fn indices(&self) -> &[u32] {
        &self.indices
    }
    /// Value of each entry.
    pub fn values(&self) -> &[T] {
        &self.values
    }
    /// Columns and values of a row.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, T)> + '_ {
        let range = self.starts[row]..self.starts[row + 1];
        self.indices[range.clone()]
            .iter()
            .map(|&j| j as usize)
            .zip(self.values[range].iter().copied())
    }
    /// One entry; zero where none is stored. A binary search in the row.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn get(&self, row: usize, column: usize) -> T {
        let range = self.starts[row]..self.starts[row + 1];
        match self.indices[range.clone()].binary_search(&(column as u32)) {
            Ok(at) => self.values[range.start + at],
            Err(_) => T::default(),
        }
    }
    /// The diagonal. One value per row, 0 where none is stored; for square matrices.
    pub fn diagonal(&self) -> Vec<T> {
        (0..self.rows()).map(|i| self.get(i, i)).collect()
    }

    /// `A X` for a block of `columns` vectors. Parallel by rows, each summed in the order of its columns.
    ///
    /// # Panics
    /// If the block does not have `self.columns() · columns` values.
    pub fn multiply(&self, block: &[T], columns: usize) -> Vec<T> {
        let mut out = vec![T::default(); self.rows() * columns];
        self.multiply_into(block, columns, &mut out);
        out
    }

    /// Like [`multiply`](Self::multiply), into `out`.
    pub(crate) fn multiply_into(&self, block: &[T], columns: usize, out: &mut [T]) {
        assert_eq!(block.len(), self.columns * columns, "a block of other size");
        assert_eq!(out.len(), self.rows() * columns, "a block of other size");
        if columns == 0 {
            return;
        }
        T::multiply(self, block, columns, out);
    }

    /// Rows from `first` on and `C` columns from `at` on, with their number known to the compiler: the
    /// sums stay in registers.
    fn rows_times<const C: usize>(
        &self,
        first: usize,
        block: &[T],
        out: &mut [T],
        columns: usize,
        at: usize,
    ) -> usize {
        for (i, y) in out.chunks_exact_mut(columns).enumerate() {
            let mut sum = [T::default(); C];
            let range = self.starts[first + i]..self.starts[first + i + 1];
            for (&j, &a) in self.indices[range.clone()].iter().zip(&self.values[range]) {
                let start = j as usize * columns + at;
                let x = &block[start..start + C];
                for c in 0..C {
                    sum[c] += a * x[c];
                }
            }
            y[at..at + C].copy_from_slice(&sum);
        }
        C
    }

    /// The same pattern with other values: `value(row, column, old)`. Zeros among them stay entries. Parallel.
    pub fn map(&self, value: impl Fn(usize, usize, T) -> T + Sync) -> Self {
        let parts: Vec<Vec<T>> = parallel::map(self.rows().div_ceil(ROWS), |part| {
            let rows = part * ROWS..((part + 1) * ROWS).min(self.rows());
            let entries = rows.flat_map(|i| self.row(i).map(move |(j, a)| (i, j, a)));
            entries.map(|(i, j, a)| value(i, j, a)).collect()
        });
        Self {
            columns: self.columns,
            starts: self.starts.clone(),
            indices: self.indices.clone(),
            values: parts.concat(),
        }
    }

    /// Its first `n` rows and columns, or all where it has no more.
    ///
    /// ```
    /// use geom_core::algebra::SparseMatrix;
    /// let a = SparseMatrix::from_triplets(3, 3, &[(0, 0, 4.0), (0, 2, 1.0), (1, 0, 2.0), (2, 2, 3.0)])?;
    /// let leading = a.leading(2);
    /// assert_eq!((leading.rows(), leading.columns(), leading.entries()), (2, 2, 2));
    /// assert_eq!(leading.get(1, 0), 2.0);
    /// # Ok::<(), geom_core::algebra::Error>(())
    /// ```
    #[must_use]
    pub fn leading(&self, n: usize) -> Self {
        let (mut starts, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
        for row in 0..n.min(self.rows()) {
            // Columns ascend.
            for (column, value) in self.row(row).take_while(|entry| entry.0 < n) {
                indices.push(column as u32);
                values.push(value);
            }
            starts.push(indices.len());
        }
        Self {
            columns: n.min(self.columns),
            starts,
            indices,
            values,
        }
    }

    /// `A + s B`, with the union of both patterns.
    ///
    /// # Errors
    /// [`Error::Shape`] if the sizes differ, [`Error::TooLarge`] if the union has too many entries.
    pub fn plus(&self, s: f64, other: &Self) -> Result<Self, Error> {
        let sizes = [
            ("the second summand", other.rows(), self.rows()),
            (
                "the transpose of the second summand",
                other.columns,
                self.columns,
            ),
        ];
        if let Some(&(what, found, expected)) = sizes.iter().find(|s| s.1 != s.2) {
            return Err(Error::Shape {
                what,
                found,
                expected,
            });
        }
        Self::written(self.rows(), self.columns, |i, out| {
            out.extend(self.row(i).map(|(j, a)| (j as u32, a)));
            out.extend(other.row(i).map(|(j, b)| (j as u32, b * s)));
        })
    }

    /// The square matrix of some rows and the same columns, ascending; `rows` must ascend.
    pub(crate) fn principal(&self, rows: &[u32]) -> Self {
        let mut new = vec![u32::MAX; self.columns];
        for (i, &row) in rows.iter().enumerate() {
            new[row as usize] = i as u32;
        }
        Self::written(rows.len(), rows.len(), |i, out| {
            out.extend(
                self.row(rows[i] as usize)
                    .filter(|&(j, _)| new[j] != u32::MAX)
                    .map(|(j, a)| (new[j], a)),
            );
        })
        .expect("a part of a matrix is no larger than the matrix")
    }

    /// The transposed matrix. Complex values are not conjugated. Linear time, on one thread.
    #[must_use]
    pub fn transposed(&self) -> Self {
        let mut counts = vec![0u32; self.columns];
        for &j in &self.indices {
            counts[j as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut indices = vec![0; self.entries()];
        let mut values = vec![T::default(); self.entries()];
        for i in 0..self.rows() {
            for (j, a) in self.row(i) {
                indices[next[j]] = i as u32;
                values[next[j]] = a;
                next[j] += 1;
            }
        }
        Self {
            columns: self.rows(),
            starts,
            indices,
            values,
        }
    }

    /// Square, finite, and equal to its conjugate transpose up to `1e-12` of the larger of the two
    /// entries' rows.
    ///
    /// # Errors
    /// [`Error::Shape`]; then [`Error::NotFinite`] or [`Error::NotSymmetric`], for the first row at fault.
    pub fn check_hermitian(&self) -> Result<(), Error> {
        if self.rows() != self.columns {
            return Err(Error::Shape {
                what: "a matrix that should be square",
                found: self.rows(),
                expected: self.columns,
            });
        }
        let largest: Vec<f64> = parallel::map(self.rows(), |i| {
            self.row(i).fold(0.0, |m, (_, a)| a.norm_squared().max(m))
        });
        let check_row = |i: usize| {
            for (j, a) in self.row(i) {
                if !a.finite() {
                    return Err(Error::NotFinite { row: i, column: j });
                }
                let off = (a - self.get(j, i).conjugate()).norm_squared();
                if off > 1e-24 * largest[i].max(largest[j]) {
                    return Err(Error::NotSymmetric { row: i, column: j });
                }
            }
            Ok(())
        };
        // The first complaint in the order of rows.
        (0..self.rows())
            .into_par_iter()
            .with_min_len(ROWS)
            .map(check_row)
            .find_first(Result::is_err)
            .unwrap_or(Ok(()))
    }
}

fn check_size(rows: usize, entries: usize) -> Result<(), Error> {
    if rows > crate::id::MAX_ELEMENTS || entries > crate::id::MAX_ELEMENTS {
        let entries = entries as u128;
        return Err(Error::TooLarge { rows, entries });
    }
    Ok(())
}
