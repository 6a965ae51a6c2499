//! Algebraic multigrid by smoothed aggregation: an approximate inverse of a graph Laplacian, in f32.
//!
//! Neighbouring nodes form aggregates, functions constant on them are smoothed by one step of Jacobi,
//! and the operator is carried over to that space, level after level (Vaněk, Mandel and Brezina,
//! 1996). A V-cycle with Chebyshev smoothing is a symmetric approximation of the inverse, and its cost
//! per node does not grow. It only proposes directions: the solver accepts in f64.

use crate::compute::parallel;
use rayon::prelude::*;

use super::{Error, Operator};
use crate::algebra::graph::VoxelGraph;
use crate::algebra::{SparseMatrix, dense};
use crate::compute::random::SplitMix64;

/// Rows up to which the coarsest level is inverted densely.
const COARSEST: usize = 400;
/// Rows of a coarsest level that does not shrink, beyond which it is only smoothed.
const LARGEST_DENSE: usize = 1500;
/// Neighbours whose entry is below this share of the diagonals do not share an aggregate.
const STRONG: f64 = 0.02;
/// Steps of Chebyshev smoothing before and after the coarse correction.
const STEPS: usize = 2;
/// Share of the spectrum of a level that smoothing damps.
const DAMPED: f64 = 0.15;
/// Rows per task. Not part of the result.
const ROWS: usize = 2048;

/// A sparse matrix of f32 in compressed rows.
#[derive(Clone, Debug)]
pub struct CompressedRows {
    /// Where the entries of each row start, and their number at the end.
    pub starts: Vec<u32>,
    /// The column of each entry.
    pub indices: Vec<u32>,
    /// The entries.
    pub values: Vec<f32>,
}

impl CompressedRows {
    fn of(matrix: &SparseMatrix) -> Self {
        Self {
            // A sparse matrix has fewer than 2³² entries.
            starts: matrix.starts().iter().map(|&s| s as u32).collect(),
            indices: matrix.indices().to_vec(),
            values: matrix.values().iter().map(|&v| v as f32).collect(),
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// `out ← out + scale · A X`. The widths that the solver uses have loops of their own, in which the sums stay in
    /// registers.
    fn add_product(&self, scale: f32, block: &[f32], columns: usize, out: &mut [f32]) {
        match columns {
            0 => {}
            4 => self.add::<4>(scale, block, out),
            8 => self.add::<8>(scale, block, out),
            16 => self.add::<16>(scale, block, out),
            _ => parallel::for_chunks(out, ROWS * columns, |part, out| {
                for (i, y) in out.chunks_exact_mut(columns).enumerate() {
                    for (j, a) in self.row(part * ROWS + i) {
                        let a = scale * a;
                        for (y, &x) in y.iter_mut().zip(&block[j * columns..]) {
                            *y += a * x;
                        }
                    }
                }
            }),
        }
    }

    /// Columns and entries of a row.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        self.indices[range.clone()]
            .iter()
            .map(|&j| j as usize)
            .zip(self.values[range].iter().copied())
    }

    fn add<const C: usize>(&self, scale: f32, block: &[f32], out: &mut [f32]) {
        let (rows, _) = block.as_chunks::<C>();
        let (out, _) = out.as_chunks_mut::<C>();
        parallel::for_chunks(out, ROWS, |part, out| {
            for (i, y) in out.iter_mut().enumerate() {
                let mut sum = [0.0; C];
                for (j, a) in self.row(part * ROWS + i) {
                    let x = &rows[j];
                    for c in 0..C {
                        sum[c] += a * x[c];
                    }
                }
                for c in 0..C {
                    y[c] += scale * sum[c];
                }
            }
        });
    }
}

/// An operator with its entries rounded to f32.
#[derive(Clone, Debug)]
pub struct RoundedOperator<'a> {
    /// The matrix; of a graph Laplacian what its stencils leave.
    pub matrix: CompressedRows,
    /// The weights of these graphs, one graph after the other along the diagonal, are subtracted.
    pub graphs: &'a [VoxelGraph],
}

impl<'a> RoundedOperator<'a> {
    fn of(operator: Operator<'a>) -> Self {
        Self {
            matrix: CompressedRows::of(operator.matrix()),
            graphs: operator.graphs(),
        }
    }

    fn rows(&self) -> usize {
        self.matrix.rows()
    }

    /// `A X`.
    fn multiply(&self, block: &[f32], columns: usize) -> Vec<f32> {
        let mut out = vec![0.0; self.rows() * columns];
        self.matrix.add_product(1.0, block, columns, &mut out);
        let mut first = 0;
        for graph in self.graphs {
            let range = first * columns..(first + graph.nodes()) * columns;
            graph.subtract_product(&block[range.clone()], columns, &mut out[range]);
            first += graph.nodes();
        }
        out
    }
}

/// One level above the coarsest.
///
/// The cycle smooths `x` from zero, adds `prolong · cycle(restrict · (b − A x))` of the next level, and smooths
/// again.
#[derive(Clone, Debug)]
pub struct Level<'a> {
    /// A.
    pub operator: RoundedOperator<'a>,
    /// D⁻¹: the inverse of the diagonal of A.
    pub inverse_diagonal: Vec<f32>,
    /// The smoother, from `d = 0`: step `[first, second]` is `d ← first · d + second · D⁻¹ (b − A x)`,
    /// `x ← x + d`.
    pub steps: [[f32; 2]; STEPS],
    /// From the next level to this one.
    pub prolong: CompressedRows,
    /// From this level to the next one: the transpose of [`Level::prolong`].
    pub restrict: CompressedRows,
}

/// A hierarchy of ever smaller operators: see the module.
///
/// The null space of constants is kept on every level: where rows sum to zero, prolongation maps constants to
/// constants. A level has at most seven tenths of the rows of the one above it, mostly far fewer; the coarsest has at
/// most 400 and a dense inverse. If aggregation gets stuck before, a dense inverse serves up to 1500 rows, and beyond
/// that only the diagonal.
#[derive(Clone, Debug)]
pub struct Multigrid<'a> {
    levels: Vec<Level<'a>>,
    coarsest: CompressedRows,
    rows: usize,
}

impl<'a> Multigrid<'a> {
    /// The hierarchy of a positive semi-definite operator of one connected part, whose null space, if
    /// it has one, is the constants.
    ///
    /// # Errors
    /// [`algebra::Error::NotPositiveDefinite`](crate::algebra::Error::NotPositiveDefinite) names the first row whose
    /// diagonal is not positive, on any level; else what products of sparse matrices refuse.
    pub fn of(operator: Operator<'a>) -> Result<Self, Error> {
        let rows = operator.rows();
        let mut levels = Vec::new();
        let mut coarse: Option<SparseMatrix> = None;
        loop {
            let current = coarse.as_ref().map_or(operator, Operator::from);
            let n = current.rows();
            if n <= COARSEST {
                break;
            }
            let diagonal = current.diagonal();
            if let Some(row) = diagonal.iter().position(|&d| d <= 0.0 || !d.is_finite()) {
                return Err(crate::algebra::Error::NotPositiveDefinite { row }.into());
            }
            let (aggregate, count) = aggregates(current, &diagonal);
            if 10 * count > 7 * n {
                break;
            }
            let radius = spectral_radius(current, &diagonal);
            let prolong = SparseMatrix::written(n, count, |i, out| {
                out.push((aggregate[i], 1.0));
                let omega = 4.0 / 3.0 / radius / diagonal[i];
                out.extend(current.row(i).map(|(j, a)| (aggregate[j], -omega * a)));
            })?;
            let restrict = prolong.transposed();
            let image = SparseMatrix::written(n, count, |i, out| {
                for (j, a) in current.row(i) {
                    out.extend(prolong.row(j).map(|(c, p)| (c as u32, a * p)));
                }
            })?;
            let next = SparseMatrix::written(count, count, |c, out| {
                for (i, p) in restrict.row(c) {
                    out.extend(image.row(i).map(|(d, a)| (d as u32, p * a)));
                }
            })?;
            let rounded = match coarse {
                None => RoundedOperator::of(operator),
                Some(ref matrix) => RoundedOperator {
                    matrix: CompressedRows::of(matrix),
                    graphs: &[],
                },
            };
            levels.push(Level {
                operator: rounded,
                inverse_diagonal: diagonal.iter().map(|d| (1.0 / d) as f32).collect(),
                steps: chebyshev(DAMPED * radius, 1.05 * radius),
                prolong: CompressedRows::of(&prolong),
                restrict: CompressedRows::of(&restrict),
            });
            coarse = Some(next);
        }
        let last = coarse.as_ref().map_or(operator, Operator::from);
        Ok(Self {
            levels,
            coarsest: inverse(last)?,
            rows,
        })
    }

    /// Rows of the operator.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The levels above the coarsest, the finest first.
    pub fn levels(&self) -> &[Level<'a>] {
        &self.levels
    }

    /// The inverse of the coarsest operator, its null space left out, or of its diagonal.
    pub fn coarsest(&self) -> &CompressedRows {
        &self.coarsest
    }

    /// One V-cycle from zero, in f32; `x` is replaced.
    pub(super) fn cycle(&self, block: &[f32], columns: usize, x: &mut Vec<f32>) {
        self.descend(0, block, columns, x);
    }

    /// `x` is overwritten; its old contents do not matter.
    fn descend(&self, depth: usize, b: &[f32], columns: usize, x: &mut Vec<f32>) {
        x.clear();
        x.resize(b.len(), 0.0);
        if columns == 0 {
            return;
        }
        let Some(level) = self.levels.get(depth) else {
            self.coarsest.add_product(1.0, b, columns, x);
            return;
        };
        let mut r = b.to_vec();
        level.smooth(x, &mut r, b, columns);
        level.residual(&mut r, x, b, columns);
        let mut coarse = vec![0.0; level.restrict.rows() * columns];
        level.restrict.add_product(1.0, &r, columns, &mut coarse);
        let mut correction = Vec::new();
        self.descend(depth + 1, &coarse, columns, &mut correction);
        level.prolong.add_product(1.0, &correction, columns, x);
        level.residual(&mut r, x, b, columns);
        level.smooth(x, &mut r, b, columns);
    }
}

impl Level<'_> {
    /// Smooths x, with its residual in r, which is not up to date afterwards. Two steps of a polynomial cost two
    /// products, need no colours and no order of the rows, and are the same on every device.
    fn smooth(&self, x: &mut [f32], r: &mut [f32], b: &[f32], columns: usize) {
        let mut d = vec![0.0; x.len()];
        for (k, [first, second]) in self.steps.into_iter().enumerate() {
            if k > 0 {
                self.residual(r, x, b, columns);
            }
            x.par_chunks_mut(ROWS * columns)
                .zip(d.par_chunks_mut(ROWS * columns))
                .zip(r.par_chunks(ROWS * columns))
                .zip(self.inverse_diagonal.par_chunks(ROWS))
                .for_each(|(((x, d), r), inverse)| {
                    let rows = x.chunks_mut(columns).zip(d.chunks_mut(columns));
                    for (((x, d), r), &inverse) in rows.zip(r.chunks(columns)).zip(inverse) {
                        let scale = second * inverse;
                        for c in 0..columns {
                            d[c] = first * d[c] + scale * r[c];
                            x[c] += d[c];
                        }
                    }
                });
        }
    }

    /// `r ← b − A x`.
    fn residual(&self, r: &mut [f32], x: &[f32], b: &[f32], columns: usize) {
        let image = self.operator.multiply(x, columns);
        r.par_chunks_mut(ROWS * columns)
            .zip(b.par_chunks(ROWS * columns))
            .zip(image.par_chunks(ROWS * columns))
            .for_each(|((r, b), image)| {
                for ((r, &b), &a) in r.iter_mut().zip(b).zip(image) {
                    *r = b - a;
                }
            });
    }
}

/// The aggregate of each node, and their number: a node whose strong neighbours are all free founds
/// one with them; the others join the neighbour they are bound to most. Three passes: founding, joining, and what is
/// still free (neighbours of nodes that joined, or alone). The order of the rows decides, on one thread.
fn aggregates(operator: Operator<'_>, diagonal: &[f64]) -> (Vec<u32>, usize) {
    const FREE: u32 = u32::MAX;
    let n = diagonal.len();
    let strong =
        |i: usize, j: usize, a: f64| i != j && a * a > STRONG * STRONG * diagonal[i] * diagonal[j];
    let mut aggregate = vec![FREE; n];
    let mut count = 0u32;
    for i in 0..n {
        if aggregate[i] != FREE {
            continue;
        }
        let mut neighbours = operator.row(i).filter(|&(j, a)| strong(i, j, a)).peekable();
        if neighbours.peek().is_some() && neighbours.all(|(j, _)| aggregate[j] == FREE) {
            aggregate[i] = count;
            for (j, _) in operator.row(i).filter(|&(j, a)| strong(i, j, a)) {
                aggregate[j] = count;
            }
            count += 1;
        }
    }
    let first = aggregate.clone();
    for (i, own) in aggregate.iter_mut().enumerate() {
        if *own != FREE {
            continue;
        }
        let best = operator
            .row(i)
            .filter(|&(j, a)| j != i && a != 0.0 && first[j] != FREE)
            .fold(None, |best: Option<(usize, f64)>, (j, a)| match best {
                Some((k, b)) if a.abs() < b || (a.abs() == b && j > k) => best,
                _ => Some((j, a.abs())),
            });
        if let Some((j, _)) = best {
            *own = first[j];
        }
    }
    for i in 0..n {
        if aggregate[i] != FREE {
            continue;
        }
        aggregate[i] = count;
        for (j, _) in operator.row(i).filter(|&(j, a)| strong(i, j, a)) {
            if aggregate[j] == FREE {
                aggregate[j] = count;
            }
        }
        count += 1;
    }
    (aggregate, count as usize)
}

/// The largest eigenvalue of D⁻¹ A, from below by some steps of the power method, with a margin, and
/// not above the bound of Gershgorin. Too small a bound would let the smoother amplify the highest modes, hence the
/// margin of a tenth.
fn spectral_radius(operator: Operator<'_>, diagonal: &[f64]) -> f64 {
    let n = diagonal.len();
    let bound = parallel::argmax(n, |i| {
        operator.row(i).map(|(_, a)| a.abs()).sum::<f64>() / diagonal[i]
    })
    .map_or(1.0, |b| b.1);
    let mut random = SplitMix64::new(1);
    let mut x = super::basis::random_block(n, 1, &mut random);
    let mut radius = 0.0;
    for _ in 0..12 {
        let norm = parallel::sum(n, |i| diagonal[i] * x[i] * x[i]).sqrt();
        let y = operator.multiply(&x, 1);
        radius = parallel::sum(n, |i| x[i] * y[i]) / (norm * norm);
        x = parallel::map(n, |i| y[i] / diagonal[i] / norm);
    }
    (1.1 * radius).min(bound)
}

/// Chebyshev's polynomial for an interval, as steps of the smoother. The recurrence of Chebyshev iteration (Saad,
/// *Iterative Methods for Sparse Linear Systems*, 2003, ch. 12.3): least largest value over the interval among
/// polynomials of the degree that are 1 at zero.
fn chebyshev(low: f64, high: f64) -> [[f32; 2]; STEPS] {
    let (center, half) = (0.5 * (high + low), 0.5 * (high - low));
    let mut rho = half / center;
    let mut steps = [[0.0, (1.0 / center) as f32]; STEPS];
    for step in &mut steps[1..] {
        let next = 1.0 / (2.0 * center / half - rho);
        *step = [(next * rho) as f32, (2.0 * next / half) as f32];
        rho = next;
    }
    steps
}

/// The inverse on the coarsest level. Eigenvalues of rounding size are left out. Pseudo-inverse: the constants of a
/// singular operator are mapped to zero.
fn inverse(operator: Operator<'_>) -> Result<CompressedRows, Error> {
    let n = operator.rows();
    let matrix = operator.assembled()?;
    if n > LARGEST_DENSE {
        let inverse: Vec<f64> = matrix.diagonal().iter().map(|d| 1.0 / d).collect();
        return Ok(CompressedRows::of(&SparseMatrix::diagonal_of(&inverse)));
    }
    let mut full = vec![0.0; n * n];
    for i in 0..n {
        for (j, a) in matrix.row(i) {
            full[i * n + j] = a;
        }
    }
    let (values, vectors) = dense::symmetric_eigen(&full, n)
        .ok_or(crate::algebra::Error::NotFinite { row: 0, column: 0 })?;
    let floor = 1e-12 * values.last().copied().unwrap_or(0.0).abs();
    let mut scaled = vectors.clone();
    for row in scaled.chunks_mut(n.max(1)) {
        for (x, &value) in row.iter_mut().zip(&values) {
            *x = if value > floor { *x / value } else { 0.0 };
        }
    }
    let mut transposed = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            transposed[j * n + i] = vectors[i * n + j];
        }
    }
    let inverse = dense::product(&[dense::Tall::of(&scaled, n)], &transposed, n);
    let rows = SparseMatrix::written(n, n, |i, out| {
        out.extend((0..n).map(|j| (j as u32, inverse[i * n + j])));
    })?;
    Ok(CompressedRows::of(&rows))
}
