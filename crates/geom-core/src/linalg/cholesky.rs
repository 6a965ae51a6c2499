//! Sparse Cholesky factors: analyse once, factor often, solve for many right-hand sides. The only
//! file that knows faer's sparse interface.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::linalg::cholesky::llt::factor::LltError;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use rayon::prelude::*;

use super::{Error, Scalar, SparseMatrix};

/// Right-hand sides per task. Part of the result: another number, other last bits.
const COLUMNS: usize = 8;

/// The analysis of a pattern: ordering and shape of the factor, for every matrix of that pattern.
#[derive(Clone)]
pub struct Symbolic {
    inner: Arc<Analysis>,
}

struct Analysis {
    symbolic: SymbolicCholesky<u32>,
    /// The upper half of the matrix row by row, which is the lower half column by column.
    starts: Vec<u32>,
    indices: Vec<u32>,
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
    /// factor.
    pub fn of<T: Scalar>(matrix: &SparseMatrix<T>) -> Result<Self, Error> {
        let (starts, indices, _) = upper_half(matrix)?;
        let n = matrix.rows();
        let too_large = Error::TooLarge {
            rows: n,
            entries: matrix.entries() as u128,
        };
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &indices);
        let symbolic = factorize_symbolic_cholesky(
            pattern,
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .map_err(|e| match e {
            faer::sparse::FaerError::OutOfMemory => Error::OutOfMemory { entries: 0 },
            _ => too_large,
        })?;
        let inner = Arc::new(Analysis {
            symbolic,
            starts,
            indices,
        });
        Ok(Self { inner })
    }

    /// Rows of the matrix.
    pub fn rows(&self) -> usize {
        self.inner.symbolic.nrows()
    }

    /// Entries of the factor.
    pub fn factor_entries(&self) -> usize {
        self.inner.symbolic.len_val()
    }

    /// Factors a positive definite matrix of the analysed pattern as L Lᴴ.
    pub fn factor<T: Scalar>(&self, matrix: &SparseMatrix<T>) -> Result<Cholesky<T>, Error> {
        let upper = self.values_of(matrix)?;
        let symbolic = &self.inner.symbolic;
        let (mut values, mut memory) = self.memory::<T>(
            symbolic.factorize_numeric_llt_scratch::<T>(Par::Seq, Default::default()),
        )?;
        symbolic
            .factorize_numeric_llt::<T>(
                &mut values,
                self.lower(&upper),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .map_err(
                |LltError::NonPositivePivot { index }| Error::NotPositiveDefinite {
                    row: self.original(index),
                },
            )?;
        Ok(Cholesky {
            symbolic: self.clone(),
            values,
        })
    }

    /// How many eigenvalues of a matrix of this pattern are negative: the signs of the pivots of
    /// L D Lᵀ (Sylvester's law of inertia). `None` when a pivot vanishes, which says that zero is an
    /// eigenvalue, or nearly so.
    pub fn negative_eigenvalues(&self, matrix: &SparseMatrix<f64>) -> Result<Option<usize>, Error> {
        let upper = self.values_of(matrix)?;
        let symbolic = &self.inner.symbolic;
        let (mut values, mut memory) = self.memory::<f64>(
            symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default()),
        )?;
        let factored = symbolic.factorize_numeric_ldlt::<f64>(
            &mut values,
            self.lower(&upper),
            Side::Lower,
            LdltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        if factored.is_err() {
            return Ok(None);
        }
        let pivots = self.pivots(&values);
        if pivots.iter().any(|&d| d == 0.0 || !d.is_finite()) {
            return Ok(None);
        }
        Ok(Some(pivots.iter().filter(|&&d| d < 0.0).count()))
    }

    /// The diagonal of a factor.
    fn pivots(&self, values: &[f64]) -> Vec<f64> {
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

    fn memory<T: Scalar>(
        &self,
        scratch: faer::dyn_stack::StackReq,
    ) -> Result<(Vec<T>, MemBuffer), Error> {
        let entries = self.factor_entries();
        let mut values = Vec::new();
        values
            .try_reserve_exact(entries)
            .map_err(|_| Error::OutOfMemory { entries })?;
        values.resize(entries, T::default());
        let memory = MemBuffer::try_new(scratch).map_err(|_| Error::OutOfMemory { entries })?;
        Ok((values, memory))
    }

    fn values_of<T: Scalar>(&self, matrix: &SparseMatrix<T>) -> Result<Vec<T>, Error> {
        let (starts, indices, values) = upper_half(matrix)?;
        if starts != self.inner.starts || indices != self.inner.indices {
            return Err(Error::OtherPattern);
        }
        Ok(values)
    }

    fn lower<'a, T: Scalar>(&'a self, upper: &'a [T]) -> SparseColMatRef<'a, u32, T> {
        let (a, n) = (&*self.inner, self.rows());
        SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(n, n, &a.starts, None, &a.indices),
            upper,
        )
    }

    /// The row of the matrix that the ordering puts at `index`.
    fn original(&self, index: usize) -> usize {
        match self.inner.symbolic.perm() {
            Some(order) => order.arrays().0[index] as usize,
            None => index,
        }
    }
}

/// Starts, indices and conjugated values: a row of the upper half, conjugated, is a column of the
/// lower half.
type Half<T> = (Vec<u32>, Vec<u32>, Vec<T>);

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
    let (mut starts, mut indices, mut values) = (vec![0u32], Vec::new(), Vec::new());
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

/// The factor L Lᴴ of a positive definite matrix.
#[derive(Clone, Debug)]
pub struct Cholesky<T = f64> {
    symbolic: Symbolic,
    values: Vec<T>,
}

impl<T: Scalar> Cholesky<T> {
    /// Analyses and factors a positive definite matrix. Only the upper half is read.
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

    /// Replaces a block of `columns` right-hand sides by the solutions.
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
        match self.symbolic.inner.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(shape) => {
                // One buffer of up to eight columns per task.
                let parts: Vec<(usize, Vec<T>)> = (0..columns.div_ceil(COLUMNS))
                    .into_par_iter()
                    .map(|part| {
                        let range = part * COLUMNS..((part + 1) * COLUMNS).min(columns);
                        let width = range.len();
                        let x = match width {
                            1 => self.solve_columns::<1>(shape, block, columns, range),
                            2 => self.solve_columns::<2>(shape, block, columns, range),
                            3 | 4 => self.solve_columns::<4>(shape, block, columns, range),
                            _ => self.solve_columns::<8>(shape, block, columns, range),
                        };
                        (width, x)
                    })
                    .collect();
                block
                    .par_chunks_mut(columns)
                    .enumerate()
                    .with_min_len(4096)
                    .for_each(|(i, row)| {
                        for (part, out) in parts.iter().zip(row.chunks_mut(COLUMNS)) {
                            let stride = part.1.len() / n;
                            out.copy_from_slice(&part.1[i * stride..i * stride + part.0]);
                        }
                    });
            }
            // Small or nearly diagonal: not worth a kernel.
            SymbolicCholeskyRaw::Simplicial(_) => {
                let symbolic = &self.symbolic.inner.symbolic;
                let scratch = symbolic.solve_in_place_scratch::<T>(columns, Par::Seq);
                let mut memory =
                    MemBuffer::try_new(scratch).map_err(|_| Error::OutOfMemory { entries: 0 })?;
                LltRef::new(symbolic, &self.values).solve_in_place_with_conj(
                    Conj::No,
                    MatMut::from_row_major_slice_mut(block, n, columns),
                    Par::Seq,
                    MemStack::new(&mut memory),
                );
            }
        }
        Ok(())
    }

    /// The solutions for some columns of a block, `C` of them row after row (the last ones zero).
    fn solve_columns<const C: usize>(
        &self,
        shape: &SymbolicSupernodalCholesky<u32>,
        block: &[T],
        columns: usize,
        range: std::ops::Range<usize>,
    ) -> Vec<T> {
        let order = self.symbolic.inner.symbolic.perm();
        let row_of = |i: usize| order.map_or(i, |p| p.arrays().0[i] as usize);
        let mut x = vec![[T::default(); C]; self.rows()];
        for (i, x) in x.iter_mut().enumerate() {
            let row = &block[row_of(i) * columns..][range.clone()];
            x[..row.len()].copy_from_slice(row);
        }
        // Compiled for the vector registers that the machine has.
        pulp::Arch::new().dispatch(Substitution {
            shape,
            values: &self.values,
            x: &mut x,
        });
        let mut out = vec![[T::default(); C]; self.rows()];
        for (i, x) in x.iter().enumerate() {
            out[row_of(i)] = *x;
        }
        out.into_flattened()
    }

    /// Solves for one right-hand side.
    pub fn solve(&self, b: &[T]) -> Result<Vec<T>, Error> {
        let mut x = b.to_vec();
        self.solve_in_place(&mut x, 1)?;
        Ok(x)
    }
}

/// `x ← L⁻ᴴ L⁻¹ x` for `C` columns at once, over the supernodes: dense trapezoids of the factor,
/// column after column. faer's own solve calls a product per supernode, which costs more than the
/// arithmetic where supernodes are as small as those of a surface.
struct Substitution<'a, T, const C: usize> {
    shape: &'a SymbolicSupernodalCholesky<u32>,
    values: &'a [T],
    x: &'a mut [[T; C]],
}

impl<T: Scalar, const C: usize> pulp::WithSimd for Substitution<'_, T, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        for s in 0..self.shape.n_supernodes() {
            forward(self.shape, self.values, s, self.x);
        }
        for s in (0..self.shape.n_supernodes()).rev() {
            backward(self.shape, self.values, s, self.x);
        }
    }
}

#[inline(always)]
fn forward<T: Scalar, const C: usize>(
    shape: &SymbolicSupernodalCholesky<u32>,
    values: &[T],
    s: usize,
    x: &mut [[T; C]],
) {
    let (begin, end) = bounds(shape, s);
    let (columns, rows) = trapezoid(shape, values, s);
    let (head, tail) = x.split_at_mut(end);
    let top = &mut head[begin..];
    let width = end - begin;
    let height = width + rows.len();
    for c in 0..width {
        let column = &columns[c * height..][..width];
        let mut xc = top[c];
        let scale = 1.0 / column[c].real_part();
        for v in &mut xc {
            *v = *v * scale;
        }
        top[c] = xc;
        for (x, &l) in top[c + 1..].iter_mut().zip(&column[c + 1..]) {
            subtract(x, l, &xc);
        }
    }
    let mut at = width;
    let (tiles, rest) = rows.as_chunks::<TILE>();
    for tile in tiles {
        let mut sums = [[T::default(); C]; TILE];
        for (xc, column) in top.iter().zip(columns.chunks_exact(height)) {
            let l = &column[at..at + TILE];
            for q in 0..TILE {
                add(&mut sums[q], l[q], xc);
            }
        }
        for q in 0..TILE {
            take(&mut tail[tile[q] as usize - end], &sums[q]);
        }
        at += TILE;
    }
    for &row in rest {
        let mut sum = [T::default(); C];
        for (xc, column) in top.iter().zip(columns.chunks_exact(height)) {
            add(&mut sum, column[at], xc);
        }
        take(&mut tail[row as usize - end], &sum);
        at += 1;
    }
}

#[inline(always)]
fn backward<T: Scalar, const C: usize>(
    shape: &SymbolicSupernodalCholesky<u32>,
    values: &[T],
    s: usize,
    x: &mut [[T; C]],
) {
    let (begin, end) = bounds(shape, s);
    let (columns, rows) = trapezoid(shape, values, s);
    let (head, tail) = x.split_at_mut(end);
    let top = &mut head[begin..];
    let width = end - begin;
    let height = width + rows.len();
    let (tiles, rest) = top.as_chunks_mut::<TILE>();
    let mut c = 0;
    for tile in tiles {
        let mut sums = [[T::default(); C]; TILE];
        let below = &columns[c * height..(c + TILE) * height];
        let (l0, below) = below.split_at(height);
        let (l1, below) = below.split_at(height);
        let (l2, l3) = below.split_at(height);
        let l = [&l0[width..], &l1[width..], &l2[width..], &l3[width..]];
        for (p, &row) in rows.iter().enumerate() {
            let x = &tail[row as usize - end];
            for q in 0..TILE {
                add(&mut sums[q], l[q][p].conjugate(), x);
            }
        }
        for q in 0..TILE {
            take(&mut tile[q], &sums[q]);
        }
        c += TILE;
    }
    for x in rest {
        let column = &columns[c * height + width..(c + 1) * height];
        let mut sum = [T::default(); C];
        for (&l, &row) in column.iter().zip(rows) {
            add(&mut sum, l.conjugate(), &tail[row as usize - end]);
        }
        take(x, &sum);
        c += 1;
    }
    for c in (0..width).rev() {
        let column = &columns[c * height..][..width];
        let mut sum = [T::default(); C];
        for (x, &l) in top[c + 1..].iter().zip(&column[c + 1..]) {
            add(&mut sum, l.conjugate(), x);
        }
        take(&mut top[c], &sum);
        let scale = 1.0 / column[c].real_part();
        for v in &mut top[c] {
            *v = *v * scale;
        }
    }
}

/// Rows (columns) of a trapezoid that are handled together.
const TILE: usize = 4;

#[inline(always)]
fn add<T: Scalar, const C: usize>(sum: &mut [T; C], l: T, x: &[T; C]) {
    for i in 0..C {
        sum[i] += l * x[i];
    }
}

#[inline(always)]
fn take<T: Scalar, const C: usize>(x: &mut [T; C], sum: &[T; C]) {
    for i in 0..C {
        x[i] -= sum[i];
    }
}

#[inline(always)]
fn subtract<T: Scalar, const C: usize>(sum: &mut [T; C], l: T, x: &[T; C]) {
    for i in 0..C {
        sum[i] -= l * x[i];
    }
}

#[inline(always)]
fn bounds(shape: &SymbolicSupernodalCholesky<u32>, s: usize) -> (usize, usize) {
    (
        shape.supernode_begin()[s] as usize,
        shape.supernode_end()[s] as usize,
    )
}

/// The columns of a supernode, one after the other, and the rows below its triangle.
#[inline(always)]
fn trapezoid<'a, T>(
    shape: &'a SymbolicSupernodalCholesky<u32>,
    values: &'a [T],
    s: usize,
) -> (&'a [T], &'a [u32]) {
    let at = |k: usize| shape.col_ptr_for_val()[k] as usize;
    let first = shape.col_ptr_for_row_idx()[s] as usize;
    let count = shape.nnz_per_super()[s] as usize;
    (
        &values[at(s)..at(s + 1)],
        &shape.row_idx()[first..first + count],
    )
}
