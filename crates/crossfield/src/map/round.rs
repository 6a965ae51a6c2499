//! Integers for the seams: greedy rounding with exact re-optimization, then descent.

use geom_core::nalgebra::{DMatrix, DVector};

/// Moves lower the energy when they do so by this much.
const FALLS: f64 = 1e-9;
/// More integers than this are rounded in batches between solves.
const LARGEST: usize = 2000;

/// The energy as a function of the integers: `½ zᵀ S z − sᵀ z`.
pub(crate) struct Quadratic {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

impl Quadratic {
    pub(crate) fn new(matrix: &[f64], right: &[f64]) -> Self {
        let n = right.len();
        let mut matrix = DMatrix::from_row_slice(n, n, matrix);
        // Symmetric but for the last digits.
        matrix = (&matrix + matrix.transpose()) * 0.5;
        Self {
            matrix,
            right: DVector::from_column_slice(right),
        }
    }

    /// The real minimum; `None` if the matrix is not positive definite.
    pub(crate) fn relaxed(&self) -> Option<Vec<f64>> {
        let factor = self.matrix.clone().cholesky()?;
        Some(factor.solve(&self.right).as_slice().to_vec())
    }

    /// Rounds the variable that is nearest to an integer, lets the others follow to their exact optimum, and so on
    /// (Bommes, Zimmer and Kobbelt, *Mixed-integer quadrangulation*, 2009, with the real unknowns eliminated); then moves single
    /// integers and pairs of them by one while the energy falls.
    pub(crate) fn rounded(&self) -> Option<Vec<f64>> {
        let mut z = self.greedy()?;
        self.descend(&mut z, |_| true);
        Some(z)
    }

    /// Integers that are `allowed`: rounded on a grid so many times denser that they are, then brought back step by step to
    /// the wanted spacing by descent within what is allowed. `None` if even the densest grid is of no use.
    pub(crate) fn rounded_within(&self, allowed: impl Fn(&[f64]) -> bool) -> Option<Vec<f64>> {
        const STEPS: i32 = 16;
        const RATIO: f64 = 1.2;
        let denser = |step: i32| Self {
            matrix: self.matrix.clone(),
            right: &self.right * RATIO.powi(step),
        };
        let (first, mut z) = (1..=STEPS).find_map(|step| {
            let z = denser(step).rounded()?;
            allowed(&z).then_some((step, z))
        })?;
        for step in (0..first).rev() {
            denser(step).descend(&mut z, &allowed);
        }
        Some(z)
    }

    fn greedy(&self) -> Option<Vec<f64>> {
        let n = self.right.len();
        let mut inverse = self.matrix.clone().cholesky()?.inverse();
        let mut z: Vec<f64> = (&inverse * &self.right).as_slice().to_vec();
        let mut free: Vec<usize> = (0..n).collect();
        let batch = if n > LARGEST { n / LARGEST + 1 } else { 1 };
        while !free.is_empty() {
            let away = |k: usize, z: &[f64]| (z[k] - z[k].round()).abs();
            free.sort_by(|&a, &b| away(a, &z).total_cmp(&away(b, &z)).then(a.cmp(&b)));
            for k in free.drain(..batch.min(free.len())).collect::<Vec<_>>() {
                let to = z[k].round();
                let column = inverse.column(k).clone_owned();
                let pivot = column[k];
                if pivot > 0.0 {
                    let step = (to - z[k]) / pivot;
                    for &j in &free {
                        z[j] += column[j] * step;
                    }
                    inverse.ger(-1.0 / pivot, &column, &column, 1.0);
                }
                z[k] = to;
            }
        }
        Some(z)
    }

    /// Moves by ±1, and pairs of them, while the energy falls and `allowed` agrees.
    pub(crate) fn descend(&self, z: &mut [f64], mut allowed: impl FnMut(&[f64]) -> bool) {
        let n = z.len();
        let mut gradient = &self.matrix * DVector::from_column_slice(z) - &self.right;
        let mut shift = |z: &mut [f64], gradient: &mut DVector<f64>, moves: &[(usize, f64)]| {
            for &(k, d) in moves {
                z[k] += d;
            }
            if !allowed(z) {
                for &(k, d) in moves {
                    z[k] -= d;
                }
                return false;
            }
            for &(k, d) in moves {
                gradient.axpy(d, &self.matrix.column(k), 1.0);
            }
            true
        };
        let single =
            |gradient: &DVector<f64>, k: usize, d: f64| d * gradient[k] + 0.5 * self.matrix[(k, k)];
        for _ in 0..20 * n + 20 {
            let mut moves: Vec<(f64, Vec<(usize, f64)>)> = Vec::new();
            for i in 0..n {
                for d in [-1.0, 1.0] {
                    let own = single(&gradient, i, d);
                    if own < -FALLS {
                        moves.push((own, vec![(i, d)]));
                    }
                    for j in i + 1..n {
                        for e in [-1.0, 1.0] {
                            let both = own + single(&gradient, j, e) + d * e * self.matrix[(i, j)];
                            if both < -FALLS {
                                moves.push((both, vec![(i, d), (j, e)]));
                            }
                        }
                    }
                }
            }
            moves.sort_by(|a, b| a.0.total_cmp(&b.0));
            let done = moves
                .iter()
                .any(|(_, moves)| shift(z, &mut gradient, moves));
            if !done {
                return;
            }
        }
    }
}
