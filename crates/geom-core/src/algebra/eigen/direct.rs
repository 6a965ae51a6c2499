//! All pairs of a small part, by a dense decomposition.

use super::{Error, Pair, Pencil, not_finite};
use crate::algebra;
use crate::algebra::Mass;
use crate::algebra::dense::{self, Tall};

/// `M = Rᵀ R`: of a lumped mass R is a diagonal.
enum Factor {
    Diagonal(Vec<f64>),
    /// R and its inverse, upper triangles row after row.
    Upper(Vec<f64>, Vec<f64>),
}

impl Factor {
    fn of(pencil: &Pencil<'_>) -> Result<Self, Error> {
        let n = pencil.rows();
        match pencil.mass {
            Mass::Lumped(masses) => Ok(Self::Diagonal(masses.iter().map(|m| m.sqrt()).collect())),
            Mass::Consistent(mass) => {
                let mut full = vec![0.0; n * n];
                for (i, row) in full.chunks_mut(n).enumerate() {
                    mass.row(i).for_each(|(j, m)| row[j] = m);
                }
                let (r, dead) = dense::upper_cholesky(&full, n, 0.0);
                if let Some(&row) = dead.first() {
                    return Err(algebra::Error::NotPositiveDefinite { row }.into());
                }
                let inverse = dense::upper_inverse(&r, n);
                Ok(Self::Upper(r, inverse))
            }
        }
    }

    /// `R⁻ᵀ K R⁻¹`, which has the eigenvalues of the pencil.
    fn reduced(&self, pencil: &Pencil<'_>) -> Vec<f64> {
        let n = pencil.rows();
        let mut k = vec![0.0; n * n];
        for (i, row) in k.chunks_mut(n).enumerate() {
            for (j, a) in pencil.stiffness.row(i) {
                row[j] += match self {
                    Self::Diagonal(roots) => a / (roots[i] * roots[j]),
                    Self::Upper(..) => a,
                };
            }
        }
        match self {
            Self::Diagonal(_) => k,
            Self::Upper(_, inverse) => {
                let right = dense::product(&[Tall::of(&k, n)], inverse, n);
                dense::gram(&[Tall::of(inverse, n)], Tall::of(&right, n))
            }
        }
    }

    /// `R 1`: what the constant becomes.
    fn constant(&self) -> Vec<f64> {
        match self {
            Self::Diagonal(roots) => roots.clone(),
            Self::Upper(r, inverse) => {
                let n = inverse.len().isqrt();
                r.chunks(n).map(|row| row.iter().sum()).collect()
            }
        }
    }

    /// `R⁻¹ X`.
    fn restore(&self, mut x: Vec<f64>) -> Vec<f64> {
        match self {
            Self::Diagonal(roots) => {
                for (row, root) in x.chunks_mut(roots.len()).zip(roots) {
                    row.iter_mut().for_each(|x| *x /= root);
                }
                x
            }
            Self::Upper(_, inverse) => {
                let n = inverse.len().isqrt();
                dense::product(&[Tall::of(inverse, n)], &x, n)
            }
        }
    }
}

/// The smallest `k` pairs of all. `O(n³)`. The constant, where it is known, is taken out before: its zero is then exact,
/// and the others are orthogonal to it.
pub(super) fn pairs(pencil: &Pencil<'_>, k: usize) -> Result<Vec<Pair>, Error> {
    let n = pencil.rows();
    let factor = Factor::of(pencil)?;
    let mut reduced = factor.reduced(pencil);
    let constants = pencil.constants_vanish();
    if constants {
        let mut u = factor.constant();
        let norm = u.iter().map(|x| x * x).sum::<f64>().sqrt();
        u.iter_mut().for_each(|x| *x /= norm);
        deflate(&mut reduced, &u, n);
    }
    let (values, vectors) = dense::symmetric_eigen(&reduced, n).ok_or_else(not_finite)?;
    let full = factor.restore(vectors);
    Ok((0..n.min(k))
        .map(|j| {
            let value = if constants && j == 0 { 0.0 } else { values[j] };
            (value, (0..n).map(|i| full[i * n + j]).collect())
        })
        .collect())
}

/// `P A P − s u uᵀ` with `P = 1 − u uᵀ`: u becomes the eigenvector of the smallest eigenvalue, −s.
fn deflate(a: &mut [f64], u: &[f64], n: usize) {
    let au: Vec<f64> = (0..n)
        .map(|i| (0..n).map(|j| a[i * n + j] * u[j]).sum())
        .collect();
    let uau: f64 = u.iter().zip(&au).map(|(x, y)| x * y).sum();
    let scale = (0..n).map(|i| a[i * n + i].abs()).fold(0.0, f64::max);
    for i in 0..n {
        for j in 0..n {
            a[i * n + j] += u[i] * u[j] * (uau - scale) - au[i] * u[j] - u[i] * au[j];
        }
    }
}
