//! Dense products of tall blocks and eigenvalues of small matrices, with the same bits for any
//! number of threads. The only file that knows faer's dense interface.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use crate::parallel::fold_chunks;

/// Rows per task.
const ROWS: usize = 4096;

/// Some of the columns of a tall block: rows of `width` values, of which `columns` count from `first`
/// on.
#[derive(Clone, Copy)]
pub(crate) struct Tall<'a> {
    pub(crate) values: &'a [f64],
    pub(crate) width: usize,
    pub(crate) first: usize,
    pub(crate) columns: usize,
}

impl<'a> Tall<'a> {
    /// A whole block.
    pub(crate) fn of(values: &'a [f64], columns: usize) -> Self {
        Self {
            values,
            width: columns,
            first: 0,
            columns,
        }
    }

    fn rows(&self) -> usize {
        self.values.len() / self.width.max(1)
    }

    fn part(&self, from: usize, to: usize) -> MatRef<'a, f64> {
        let values = &self.values[from * self.width..to * self.width];
        MatRef::from_row_major_slice(values, to - from, self.width)
            .subcols(self.first, self.columns)
    }
}

/// `Aᵀ B`, row after row: `a.columns × b.columns`.
pub(crate) fn gram(a: Tall<'_>, b: Tall<'_>) -> Vec<f64> {
    let mut total = vec![0.0; a.columns * b.columns];
    if total.is_empty() {
        return total;
    }
    let parts = fold_chunks(a.rows(), |range| {
        let mut part = vec![0.0; a.columns * b.columns];
        matmul(
            MatMut::from_row_major_slice_mut(&mut part, a.columns, b.columns),
            Accum::Replace,
            a.part(range.start, range.end).transpose(),
            b.part(range.start, range.end),
            1.0,
            Par::Seq,
        );
        part
    });
    for part in parts {
        for (t, p) in total.iter_mut().zip(part) {
            *t += p;
        }
    }
    total
}

/// `out ← out + scale · A C`, where `out` has `columns` columns and C is `a.columns × columns`, row
/// after row.
pub(crate) fn add_product(out: &mut [f64], columns: usize, a: Tall<'_>, c: &[f64], scale: f64) {
    if columns == 0 || a.columns == 0 {
        return;
    }
    let c = MatRef::from_row_major_slice(c, a.columns, columns);
    out.par_chunks_mut(ROWS * columns)
        .enumerate()
        .for_each(|(k, out)| {
            let (from, rows) = (k * ROWS, out.len() / columns);
            matmul(
                MatMut::from_row_major_slice_mut(out, rows, columns),
                Accum::Add,
                a.part(from, from + rows),
                c,
                scale,
                Par::Seq,
            );
        });
}

/// `A C` as a new block of `columns` columns.
pub(crate) fn product(a: Tall<'_>, c: &[f64], columns: usize) -> Vec<f64> {
    let mut out = vec![0.0; a.rows() * columns];
    add_product(&mut out, columns, a, c, 1.0);
    out
}

/// Eigenvalues, ascending, and eigenvectors (column `j` of the row-major result) of a symmetric
/// matrix of `n` rows, of which the lower half is read. `None` when the iteration does not converge
/// (NaN).
pub(crate) fn symmetric_eigen(matrix: &[f64], n: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    use faer::diag::DiagMut;
    use faer::dyn_stack::{MemBuffer, MemStack};
    use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
    if matrix.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let (mut values, mut vectors) = (vec![0.0; n], vec![0.0; n * n]);
    let scratch =
        self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Default::default());
    // Column-major on both sides: symmetric input, and transposed afterwards.
    self_adjoint_evd(
        MatRef::from_row_major_slice(matrix, n, n),
        DiagMut::from_slice_mut(&mut values),
        Some(MatMut::from_column_major_slice_mut(&mut vectors, n, n)),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .ok()?;
    let mut rows = vec![0.0; n * n];
    for j in 0..n {
        for i in 0..n {
            rows[i * n + j] = vectors[j * n + i];
        }
    }
    Some((values, rows))
}

/// The upper factor R of a small positive semi-definite matrix G = Rᵀ R, row after row, and the
/// columns whose pivot is below `floor` of their diagonal: they depend on the columns before, and
/// their row of R is zero.
pub(crate) fn upper_cholesky(gram: &[f64], n: usize, floor: f64) -> (Vec<f64>, Vec<usize>) {
    let mut r = vec![0.0; n * n];
    let mut dead = Vec::new();
    for j in 0..n {
        let mut pivot = gram[j * n + j];
        for i in 0..j {
            if r[i * n + i] == 0.0 {
                continue;
            }
            let mut s = gram[i * n + j];
            for k in 0..i {
                s -= r[k * n + i] * r[k * n + j];
            }
            r[i * n + j] = s / r[i * n + i];
            pivot -= r[i * n + j] * r[i * n + j];
        }
        if pivot > floor * gram[j * n + j] && pivot > 0.0 {
            r[j * n + j] = pivot.sqrt();
        } else {
            dead.push(j);
        }
    }
    (r, dead)
}

/// The inverse of an upper triangular matrix, row after row; a zero on the diagonal counts as one.
pub(crate) fn upper_inverse(r: &[f64], n: usize) -> Vec<f64> {
    let pivot = |i: usize| {
        if r[i * n + i] == 0.0 {
            1.0
        } else {
            r[i * n + i]
        }
    };
    let mut inverse = vec![0.0; n * n];
    for j in 0..n {
        inverse[j * n + j] = 1.0 / pivot(j);
        for i in (0..j).rev() {
            let s: f64 = (i + 1..=j).map(|k| r[i * n + k] * inverse[k * n + j]).sum();
            inverse[i * n + j] = -s / pivot(i);
        }
    }
    inverse
}
