//! The kernels as their equations read, in f64 and one value at a time: what every backend is compared with.
//!
//! Nothing here is fast, and nothing is shared with the code that is: sums run in the order of the equation, on one
//! thread, and every intermediate is f64, also where the kernels and their inputs are f32. Under the features `testing`
//! and `algebra`.

use crate::algebra::eigen::backend::{CompressedRows, Level, Multigrid, RoundedOperator};

/// Kernel `product`: `A X` for a sparse matrix and a block of `columns` vectors, row after row. Row `i` of a block
/// starts at `i · columns`.
pub fn product(matrix: &CompressedRows, block: &[f64], columns: usize) -> Vec<f64> {
    let mut out = vec![0.0; matrix.rows() * columns];
    for i in 0..matrix.rows() {
        for (j, a) in matrix.row(i) {
            for c in 0..columns {
                out[i * columns + c] += f64::from(a) * block[j * columns + c];
            }
        }
    }
    out
}

/// Kernels `product` and `stencil`: `A X` for a matrix from which the weights of graphs are subtracted. The graphs lie
/// one after the other along the diagonal, so that the rows of a graph begin where those before it end.
pub fn operator_product(operator: &RoundedOperator<'_>, block: &[f64], columns: usize) -> Vec<f64> {
    let mut out = product(&operator.matrix, block, columns);
    let mut first = 0;
    for graph in operator.graphs {
        for i in 0..graph.nodes() {
            for (j, weight) in graph.around(i) {
                for c in 0..columns {
                    out[(first + i) * columns + c] -= weight * block[(first + j) * columns + c];
                }
            }
        }
        first += graph.nodes();
    }
    out
}

/// Kernel `smooth`: the steps of the Chebyshev smoother on `x`, from `d = 0`. `x` may start anywhere; `b` is the
/// right-hand side, of the same size.
pub fn smooth(level: &Level<'_>, x: &mut [f64], b: &[f64], columns: usize) {
    let mut d = vec![0.0; x.len()];
    for [first, second] in level.steps {
        let image = operator_product(&level.operator, x, columns);
        for (k, d) in d.iter_mut().enumerate() {
            let inverse = f64::from(level.inverse_diagonal[k / columns]);
            *d = f64::from(first) * *d + f64::from(second) * inverse * (b[k] - image[k]);
            x[k] += *d;
        }
    }
}

/// One V-cycle from zero: what a [`Cycle`](crate::algebra::eigen::backend::Cycle) gives. Restriction is the transpose
/// of prolongation and smoothing is the same before and after, so that the cycle is a symmetric operator on `block`,
/// but for rounding: what the solver relies on.
pub fn cycle(hierarchy: &Multigrid<'_>, block: &[f64], columns: usize) -> Vec<f64> {
    descend(hierarchy.levels(), hierarchy.coarsest(), block, columns)
}

fn descend(levels: &[Level<'_>], coarsest: &CompressedRows, b: &[f64], columns: usize) -> Vec<f64> {
    let Some((level, coarser)) = levels.split_first() else {
        return product(coarsest, b, columns);
    };
    let mut x = vec![0.0; b.len()];
    smooth(level, &mut x, b, columns);
    let image = operator_product(&level.operator, &x, columns);
    let residual: Vec<f64> = b.iter().zip(&image).map(|(b, a)| b - a).collect();
    let coarse = product(&level.restrict, &residual, columns);
    let correction = descend(coarser, coarsest, &coarse, columns);
    let correction = product(&level.prolong, &correction, columns);
    x.iter_mut().zip(&correction).for_each(|(x, c)| *x += c);
    smooth(level, &mut x, b, columns);
    x
}
