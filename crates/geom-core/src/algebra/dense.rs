//! Dense products of tall blocks and eigenvalues of small matrices, with the same bits for any
//! number of threads. The only file that knows faer's dense interface.
//!
//! The blocks of the eigensolvers have as many rows as the mesh has vertices and some dozens of columns. `Vᵀ W` of two of them is a sum
//! over all rows, which threads would add up in whatever order they finish. Here rows are cut into pieces of a fixed length whose
//! sums are added in their order.

use super::tall;
pub(crate) use super::tall::Tall;
use crate::compute::parallel;
use faer::{MatMut, MatRef, Par};
use rayon::prelude::*;

/// Rows per task. Part of the result: another number, other last bits.
const ROWS: usize = 2048;
/// Rows of a basis that stay in the second cache while two blocks are multiplied with them. Part of the result, too.
const STRIP: usize = 256;
/// Rows that are taken apart at a time.
const TILE: usize = 128;

fn width(blocks: &[Tall<'_>]) -> usize {
    blocks.iter().map(|a| a.columns).sum()
}

/// `Aᵀ B`, row after row, where A stands in blocks side by side. The blocks of A follow each other in the rows of the
/// result. `O(n · columns of A · columns of B)`, the parts added in order.
pub(crate) fn gram(a: &[Tall<'_>], b: Tall<'_>) -> Vec<f64> {
    let length = width(a) * b.columns;
    if length == 0 {
        return Vec::new();
    }
    sum_over_rows(b.rows(), length, |part, from, rows| {
        gram_part(part, a, b.part(from, rows), from);
    })
}

/// A sum over `n` rows: what `add` adds for some of them, given the first and how many, in their order.
fn sum_over_rows(
    n: usize,
    length: usize,
    add: impl Fn(&mut [f64], usize, usize) + Sync,
) -> Vec<f64> {
    let parts: Vec<Vec<f64>> = parallel::map(n.div_ceil(ROWS), |k| {
        let mut part = vec![0.0; length];
        add(&mut part, k * ROWS, ROWS.min(n - k * ROWS));
        part
    });
    add_all(parts, length)
}

/// The same for some rows of B, which are those of A from `from` on, added to `out`.
fn gram_part(out: &mut [f64], a: &[Tall<'_>], b: Tall<'_>, from: usize) {
    tall::add_gram(out, &parts(a, from, b.rows()), b);
}

/// Some rows of each block.
fn parts<'a>(a: &[Tall<'a>], from: usize, rows: usize) -> Vec<Tall<'a>> {
    a.iter().map(|a| a.part(from, rows)).collect()
}

/// `Aᵀ B` for two B of as many columns each, while A is read once.
pub(crate) fn gram_of_two(a: &[Tall<'_>], b: [Tall<'_>; 2]) -> [Vec<f64>; 2] {
    let length = width(a) * b[0].columns;
    let mut first = sum_over_rows(b[0].rows(), 2 * length, |part, from, rows| {
        let end = from + rows;
        for at in (from..end).step_by(STRIP) {
            let count = STRIP.min(end - at);
            let a = parts(a, at, count);
            for (out, b) in part.chunks_mut(length.max(1)).zip(b) {
                tall::add_gram(out, &a, b.part(at, count));
            }
        }
    });
    let second = first.split_off(length);
    [first, second]
}

/// `out ← out + scale · A C`, where `out` has `columns` columns, A stands in blocks side by side, and
/// C is `width of A × columns`, row after row. Rows do not depend on each other, so pieces are handed out as they come.
pub(crate) fn add_product(out: &mut [f64], columns: usize, a: &[Tall<'_>], c: &[f64], scale: f64) {
    if columns == 0 || a.is_empty() {
        return;
    }
    parallel::for_chunks(out, ROWS * columns, |k, out| {
        add_product_part(out, columns, a, c, scale, k * ROWS)
    });
}

/// The same for some rows from `from` on.
fn add_product_part(
    out: &mut [f64],
    columns: usize,
    a: &[Tall<'_>],
    c: &[f64],
    scale: f64,
    from: usize,
) {
    let parts = parts(a, from, out.len() / columns);
    tall::add_product(out, columns, &parts, c, scale);
}

/// `W ← W − A C` for two W of as many columns each, while A is read once.
pub(crate) fn subtract_from_two(
    w: [&mut [f64]; 2],
    columns: usize,
    a: &[Tall<'_>],
    c: [&[f64]; 2],
) {
    let [first, second] = w.map(|w| w.par_chunks_mut(STRIP * columns));
    first
        .zip(second)
        .enumerate()
        .for_each(|(k, (first, second))| {
            let a = parts(a, k * STRIP, first.len() / columns);
            for (w, c) in [first, second].into_iter().zip(c) {
                tall::add_product(w, columns, &a, c, -1.0);
            }
        });
}

/// `A C` as a new block of `columns` columns.
pub(crate) fn product(a: &[Tall<'_>], c: &[f64], columns: usize) -> Vec<f64> {
    let rows = a.first().map_or(0, Tall::rows);
    let mut out = vec![0.0; rows * columns];
    if columns > 0 {
        parallel::for_chunks(&mut out, ROWS * columns, |k, out| {
            // Zeros from the system are pages that are mapped when they are touched. Read first, as sums are, they are
            // mapped once more when they are written, for which all threads are stopped: longer than the product took.
            out.fill(0.0);
            add_product_part(out, columns, a, c, 1.0, k * ROWS);
        });
    }
    out
}

/// `W ← W − A C`, and the new `Wᵀ W`. One pass over W in place of two: what orthogonalization does most.
pub(crate) fn subtract_product(
    w: &mut [f64],
    columns: usize,
    a: &[Tall<'_>],
    c: &[f64],
) -> Vec<f64> {
    let parts: Vec<Vec<f64>> = w
        .par_chunks_mut(ROWS * columns)
        .enumerate()
        .map(|(k, w)| {
            if !a.is_empty() {
                add_product_part(w, columns, a, c, -1.0, k * ROWS);
            }
            let mut part = vec![0.0; columns * columns];
            let w = Tall::of(w, columns);
            gram_part(&mut part, &[w], w, 0);
            part
        })
        .collect();
    add_all(parts, columns * columns)
}

/// `W ← W C` for a square C. With the inverse of a Cholesky factor it makes columns orthonormal.
pub(crate) fn turn(w: &mut [f64], columns: usize, c: &[f64]) {
    w.par_chunks_mut(ROWS * columns).for_each(|w| {
        let old = w.to_vec();
        w.fill(0.0);
        add_product_part(w, columns, &[Tall::of(&old, columns)], c, 1.0, 0);
    });
}

/// `Aᵀ W A` for a diagonal W. `W A` is made for some rows at a time: no second block as large.
pub(crate) fn weighted_gram(a: Tall<'_>, weights: &[f64]) -> Vec<f64> {
    let columns = a.columns;
    sum_over_rows(a.rows(), columns * columns, |part, from, rows| {
        let own = a.part(from, rows);
        let mut weighted = own.values.to_vec();
        let rows = weighted.chunks_exact_mut(columns).zip(&weights[from..]);
        rows.for_each(|(row, w)| row.iter_mut().for_each(|x| *x *= w));
        gram_part(part, &[own], Tall::of(&weighted, columns), 0);
    })
}

/// The columns of a block.
pub(crate) fn separate(block: &[f64], columns: usize) -> Vec<Vec<f64>> {
    // As many at once as lie in a line of the cache.
    let starts: Vec<usize> = (0..columns).step_by(8).collect();
    let parts = starts.into_par_iter().map(|first| {
        let mut out = vec![vec![0.0; block.len() / columns]; (columns - first).min(8)];
        // Some rows stay in the cache while each of the columns takes its own.
        for (tile, rows) in block.chunks(TILE * columns).enumerate() {
            for (j, out) in out.iter_mut().enumerate() {
                let own = out[tile * TILE..]
                    .iter_mut()
                    .zip(rows.chunks_exact(columns));
                own.for_each(|(x, row)| *x = row[first + j]);
            }
        }
        out
    });
    parts.flatten().collect()
}

/// The block of some columns, not none.
pub(crate) fn together(columns: &[impl AsRef<[f64]> + Sync]) -> Vec<f64> {
    let mut block = vec![0.0; columns[0].as_ref().len() * columns.len()];
    parallel::for_chunks(&mut block, columns.len(), |i, row| {
        for (x, column) in row.iter_mut().zip(columns) {
            *x = column.as_ref()[i];
        }
    });
    block
}

/// `Σ weight(i) x_i²` of each column.
pub(crate) fn squares(
    block: &[f64],
    columns: usize,
    weight: impl Fn(usize) -> f64 + Sync,
) -> Vec<f64> {
    let parts = parallel::fold_chunks(block.len() / columns, |range| {
        let mut sums = vec![0.0; columns];
        for i in range {
            let weight = weight(i);
            for (s, x) in sums.iter_mut().zip(&block[i * columns..]) {
                *s += weight * x * x;
            }
        }
        sums
    });
    add_all(parts, columns)
}

/// In the order of the parts, whichever thread was done first.
fn add_all(parts: Vec<Vec<f64>>, length: usize) -> Vec<f64> {
    let mut total = vec![0.0; length];
    for part in parts {
        for (t, p) in total.iter_mut().zip(part) {
            *t += p;
        }
    }
    total
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
/// their row of R is zero. The columns that depend on others are what a rank-deficient block of vectors has too many;
/// the caller replaces them.
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

/// The inverse of an upper triangular matrix, row after row; a zero on the diagonal counts as one. `O(n³)`, for factors
/// of some dozens of rows, or of a part that is solved densely.
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
