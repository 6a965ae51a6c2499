//! The connected parts of a pencil.
//!
//! A vertex set of several bodies has a block-diagonal pencil. Solved as one, its zero is as multiple as there are
//! bodies and equal bodies mix freely; solved part by part, each vector belongs to one body and each zero is simple.

use rayon::prelude::*;

use super::{Error, Operator};
use crate::algebra;
use crate::algebra::Mass;

/// Rows of each part, ascending; parts by their lowest row. Rows of no part are isolated: they have neither stiffness
/// nor mass.
pub(super) struct Split {
    pub(super) parts: Vec<Vec<u32>>,
    pub(super) isolated: usize,
}

/// Row sums of a positive mass; the diagonal where a row sum is not positive. What a row may lack is both: mass 0
/// beside a stiffness other than zero would be an infinite eigenvalue, and is refused.
pub(super) fn check_mass(stiffness: Operator<'_>, mass: &Mass) -> Result<Vec<f64>, Error> {
    let rows = stiffness.rows();
    let (found, lumped): (usize, Vec<f64>) = match mass {
        Mass::Lumped(values) => (values.len(), values.clone()),
        Mass::Consistent(matrix) => {
            matrix.check_hermitian()?;
            let sums = (0..matrix.rows()).map(|i| {
                let sum: f64 = matrix.row(i).map(|(_, m)| m).sum();
                let diagonal = matrix.get(i, i);
                if diagonal > 0.0 && sum <= 0.0 {
                    diagonal
                } else {
                    sum
                }
            });
            (matrix.rows(), sums.collect())
        }
    };
    if found != rows {
        return Err(Error::MassLength { found, rows });
    }
    for (row, &mass) in lumped.iter().enumerate() {
        if !mass.is_finite() {
            return Err(algebra::Error::NotFinite { row, column: row }.into());
        }
        let empty = mass == 0.0 && stiffness.row(row).all(|(_, a)| a == 0.0);
        if mass <= 0.0 && !empty {
            return Err(Error::Mass { row, mass });
        }
    }
    Ok(lumped)
}

/// The connected components of the entries that are not zero, of the stiffness and of a consistent mass, by a search
/// from the lowest row that is left. Linear in the entries.
pub(super) fn split(stiffness: Operator<'_>, mass: &Mass, lumped: &[f64]) -> Split {
    let n = stiffness.rows();
    let mut part = vec![u32::MAX; n];
    let mut parts: Vec<Vec<u32>> = Vec::new();
    let mut isolated = 0;
    let mut stack = Vec::new();
    for start in 0..n {
        if part[start] != u32::MAX {
            continue;
        }
        if lumped[start] == 0.0 {
            isolated += 1;
            continue;
        }
        let number = parts.len() as u32;
        let mut rows = Vec::new();
        part[start] = number;
        stack.push(start);
        while let Some(i) = stack.pop() {
            rows.push(i as u32);
            let mut visit = |j: usize, a: f64| {
                if a != 0.0 && part[j] == u32::MAX {
                    part[j] = number;
                    stack.push(j);
                }
            };
            stiffness.row(i).for_each(|(j, a)| visit(j, a));
            if let Mass::Consistent(mass) = mass {
                mass.row(i).for_each(|(j, m)| visit(j, m));
            }
        }
        rows.sort_unstable();
        parts.push(rows);
    }
    Split { parts, isolated }
}

/// The mass of some rows, which must ascend, and of the same columns.
pub(super) fn restrict(mass: &Mass, rows: &[u32]) -> Mass {
    match mass {
        Mass::Lumped(values) => Mass::Lumped(rows.iter().map(|&i| values[i as usize]).collect()),
        Mass::Consistent(matrix) => Mass::Consistent(matrix.principal(rows)),
    }
}

/// `M X`.
pub(super) fn mass_times(mass: &Mass, block: &[f64], columns: usize) -> Vec<f64> {
    match mass {
        Mass::Consistent(matrix) => matrix.multiply(block, columns),
        Mass::Lumped(values) => {
            let mut out = block.to_vec();
            out.par_chunks_mut(columns.max(1))
                .zip(values)
                .with_min_len(4096)
                .for_each(|(row, &m)| row.iter_mut().for_each(|x| *x *= m));
            out
        }
    }
}
