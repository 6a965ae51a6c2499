//! Factors and inverses of the energy over the integers: dense, symmetric, of up to some thousands of rows.
//!
//! Work goes through products of strips of columns, which stay in the caches, side by side on all threads with the same sums for
//! any number of them.

use geom_core::compute::parallel;
use geom_core::nalgebra::{DMatrix, DMatrixView, DMatrixViewMut};

/// Columns that are factored, or taken off a matrix, together.
const STRIP: usize = 64;
/// Rows of a strip that are one piece of work.
const ROWS: usize = 256;

/// The lower triangle L of `A = L Lᵀ`, zeros above it; `None` if A is not positive definite. Only its lower triangle is read.
///
/// Strip by strip from the left: what the strips before take off this one, its own triangle, then the rows below.
pub(super) fn factor(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let mut l = matrix.lower_triangle();
    for first in (0..n).step_by(STRIP) {
        let width = STRIP.min(n - first);
        let starts: Vec<usize> = (first..n).step_by(ROWS).collect();
        let done = l.view((0, 0), (n, first));
        let own = done.rows(first, width).transpose();
        let mut pieces: Vec<DMatrix<f64>> = parallel::map(starts.len(), |k| {
            let (row, rows) = (starts[k], ROWS.min(n - starts[k]));
            l.view((row, first), (rows, width)) - done.rows(row, rows) * &own
        });
        let triangle = pieces[0].view((0, 0), (width, width)).clone_owned();
        let triangle = triangle.cholesky()?.unpack();
        parallel::for_each(&mut pieces, |_, piece| divide(piece, &triangle));
        pieces[0]
            .view_mut((0, 0), (width, width))
            .copy_from(&triangle);
        for (&row, piece) in starts.iter().zip(&pieces) {
            l.view_mut((row, first), piece.shape()).copy_from(piece);
        }
    }
    Some(l)
}

/// `X ← X L⁻ᵀ`.
fn divide(x: &mut DMatrix<f64>, l: &DMatrix<f64>) {
    for c in 0..l.ncols() {
        let (mut own, mut after) = x.columns_range_pair_mut(c, c + 1..);
        own /= l[(c, c)];
        for (k, mut column) in after.column_iter_mut().enumerate() {
            column.axpy(-l[(c + 1 + k, c)], &own, 1.0);
        }
    }
}

/// The inverse of `L Lᵀ`; only the lower triangle of L is looked at, and L is gone before the inverse is put together.
///
/// Columns of the inverse are two substitutions each. Below the diagonal they need the part of L below the diagonal alone, and
/// the rest is its mirror image: a third of the work of whole columns. A strip of them goes side by side.
pub(super) fn inverse_of(factor: DMatrix<f64>) -> DMatrix<f64> {
    let n = factor.nrows();
    let starts: Vec<usize> = (0..n).step_by(STRIP).collect();
    let strips: Vec<DMatrix<f64>> = parallel::map(starts.len(), |s| {
        let first = starts[s];
        let width = STRIP.min(n - first);
        let mut x = DMatrix::zeros(n - first, width);
        x.fill_diagonal(1.0);
        let block = |row: usize| {
            let rows = STRIP.min(n - row);
            let below = row + rows;
            let triangle = factor.view((row, row), (rows, rows));
            (rows, triangle, factor.view((below, row), (n - below, rows)))
        };
        for &row in &starts[s..] {
            let (rows, triangle, under) = block(row);
            let (mut own, mut below) =
                x.rows_range_pair_mut(row - first..row - first + rows, row - first + rows..);
            triangle.solve_lower_triangular_mut(&mut own);
            below.gemm(-1.0, &under, &own, 1.0);
        }
        for &row in starts[s..].iter().rev() {
            let (rows, triangle, under) = block(row);
            let (mut own, below) =
                x.rows_range_pair_mut(row - first..row - first + rows, row - first + rows..);
            // As a product of its own: those of transposed matrices are not blocked.
            own.gemm(-1.0, &under.transpose(), &below, 1.0);
            triangle.tr_solve_lower_triangular_mut(&mut own);
        }
        x
    });
    drop(factor);
    DMatrix::from_fn(n, n, |i, j| {
        let (row, column) = (i.max(j), i.min(j));
        let first = column / STRIP * STRIP;
        strips[column / STRIP][(row - first, column - first)]
    })
}

/// The inverse of the part of a matrix whose variables are free, while one after the other is held.
///
/// Holding a variable takes a matrix of rank one from the inverse. They are taken together, [`STRIP`] at a time, as one product;
/// until then, a column that is asked for is worked out by itself.
pub(super) struct Free {
    /// Of those that were free when it was last put together.
    inverse: DMatrix<f64>,
    /// Their numbers, and which are free still.
    variables: Vec<usize>,
    is_free: Vec<bool>,
    count: usize,
    /// Columns of variables held since then, over the root of their pivots.
    held: DMatrix<f64>,
    waiting: usize,
}

impl Free {
    pub(super) fn of(inverse: DMatrix<f64>) -> Self {
        let n = inverse.nrows();
        Self {
            inverse,
            variables: (0..n).collect(),
            is_free: vec![true; n],
            count: n,
            held: DMatrix::zeros(n, STRIP),
            waiting: 0,
        }
    }

    /// Those that are free, with their places.
    pub(super) fn variables(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let all = self.variables.iter().enumerate();
        all.filter(|&(at, _)| self.is_free[at])
            .map(|(at, &k)| (at, k))
    }

    /// Holds the variable at a place: its entry of the inverse on the diagonal, and those of the variables that stay free. Places
    /// are others afterwards.
    pub(super) fn hold(&mut self, at: usize) -> (f64, Vec<(usize, f64)>) {
        let waiting = self.held.columns(0, self.waiting);
        let own = waiting.row(at).transpose();
        let column = self.inverse.column(at) - waiting * own;
        let pivot = column[at];
        self.is_free[at] = false;
        self.count -= 1;
        let others = self.variables();
        let others = others.map(|(place, k)| (k, column[place])).collect();
        if pivot > 0.0 {
            let scale = pivot.sqrt().recip();
            self.held
                .column_mut(self.waiting)
                .copy_from(&(&column * scale));
            self.waiting += 1;
        }
        if self.waiting == STRIP {
            self.take();
        }
        (pivot, others)
    }

    /// Takes off what was held. Once a quarter of all variables is held, their rows and columns go.
    fn take(&mut self) {
        let n = self.variables.len();
        let held = &self.held;
        parallel::for_chunks(self.inverse.as_mut_slice(), n * STRIP, |k, strip| {
            let columns = strip.len() / n;
            let own = held.rows(k * STRIP, columns).transpose();
            let mut strip = DMatrixViewMut::from_slice(strip, n, columns);
            strip.gemm(-1.0, held, &own, 1.0);
        });
        self.waiting = 0;
        if 4 * self.count > 3 * n {
            return;
        }
        let places: Vec<usize> = self.variables().map(|(at, _)| at).collect();
        let old = DMatrixView::from_slice(self.inverse.as_slice(), n, n);
        let columns = parallel::map(places.len(), |j| {
            let column = old.column(places[j]);
            places.iter().map(|&i| column[i]).collect::<Vec<f64>>()
        });
        self.inverse = DMatrix::from_vec(self.count, self.count, columns.concat());
        self.variables = places.iter().map(|&at| self.variables[at]).collect();
        self.is_free = vec![true; self.count];
        self.held = DMatrix::zeros(self.count, STRIP);
    }
}
