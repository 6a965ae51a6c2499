//! The orientation energy (Eq. 4.10) over independent unknowns.
//!
//! Let x be the coordinates of all copies, u and v of each. As if no conditions held, Eq. 4.10 is `½ xᵀ K x − kᵀ x`
//! with K the stiffness matrix of linear elements, anisotropic where the spacing is ([`Chart`]). The conditions are
//! `x = P y` with the sparse integer matrix P of [`Seams`], so that the energy over the independent unknowns has the
//! matrix `A = Pᵀ K P` and the right-hand side `b = Pᵀ k`. No multipliers and no penalties: whatever y is, the
//! conditions hold.
//!
//! The few integers are what is chosen, the many reals follow. With `A = [A_RR A_RI; A_IR A_II]` and A_RR factored
//! once, all that is asked of the energy as the integers change is in the Schur complement
//! `S = A_II − A_IR A_RR⁻¹ A_RI`, a small dense matrix: each greedy step of rounding is then an exact optimum over
//! everything that is still free, where solvers of the original method stop early.

use geom_core::algebra::{Cholesky, SparseMatrix, Symbolic};

use super::cut::Cut;
use super::spacing::Chart;
use super::transition::Seams;
use crate::Error;

/// Solves a system in place.
/// Handed to [`Weighted::inverse`] by those who have a factor of the Schur complement; this file has none.
pub(crate) type Solver<'a> = &'a dyn Fn(&mut [f64]);

/// `½ yᵀ A y − bᵀ y`, with the real unknowns R apart from the integer ones I.
pub(crate) struct System<'a> {
    /// Which copy each corner is.
    pub(crate) cut: &'a Cut,
    /// The rows of P.
    pub(crate) seams: &'a Seams,
    /// What each triangle contributes to K.
    pub(crate) charts: &'a [Chart],
    /// The wanted Jacobians: at first the field's, the identity.
    pub(crate) wanted: Vec<[[f64; 2]; 2]>,
    /// The pattern of A_RR and the order of its elimination, which weights do not change: analysed with the first
    /// weights, kept for all others.
    symbolic: Option<Symbolic>,
}

/// The system for one choice of weights, A_RR factored.
pub(crate) struct Weighted {
    /// Of A_RR; `None` if there are no reals.
    factor: Option<Cholesky>,
    /// A_RI, column by column.
    mixed: Vec<Vec<(usize, f64)>>,
    /// A_II, row after row.
    pub(crate) integer: Vec<f64>,
    /// Reals first.
    pub(crate) right: Vec<f64>,
    /// Number of real unknowns.
    reals: usize,
}

impl<'a> System<'a> {
    /// With the identity wanted in every triangle.
    pub(crate) fn new(cut: &'a Cut, seams: &'a Seams, charts: &'a [Chart]) -> Self {
        Self {
            cut,
            seams,
            charts,
            wanted: vec![[[1.0, 0.0], [0.0, 1.0]]; charts.len()],
            symbolic: None,
        }
    }

    /// Assembles and factors, triangle f counting `weights[f]` times.
    ///
    /// `Pᵀ K P` is not formed as a product of matrices: each row of K is expanded over the reals and the integers of its
    /// coordinates. A coordinate hangs on few reals and often on many integers, so that the sums over integers are
    /// gathered once per row of K.
    ///
    /// # Errors
    /// [`Error::Matrix`] if A_RR is not positive definite: the map could be shifted or a part of it hangs on nothing.
    pub(crate) fn weighted(&mut self, weights: &[f64]) -> Result<Weighted, Error> {
        let (reals, integers) = (self.seams.reals, self.seams.integers);
        let (stiffness, pulls) = self.of_copies(weights)?;
        let mut right = vec![0.0; reals + integers];
        let mut real = Vec::with_capacity(stiffness.entries());
        let mut mixed = vec![Vec::new(); integers];
        let mut integer = vec![0.0; integers * integers];
        let row = |k: usize| self.seams.row((k / 2) as u32, k % 2);
        let integers_of: Vec<Vec<(usize, f64)>> = (0..pulls.len())
            .map(|k| {
                let terms = row(k).filter(|t| t.0 >= reals);
                terms.map(|(z, q)| (z - reals, f64::from(q))).collect()
            })
            .collect();
        // What a coordinate's row of the matrix is over the integers.
        let (mut sum, mut touched) = (vec![0.0; integers], Vec::new());
        // Terms may cancel exactly on the way: a sum of zero does not say that it is new.
        let mut is_touched = vec![false; integers];
        for (k, &pull) in pulls.iter().enumerate() {
            for (other, value) in stiffness.row(k) {
                for &(z, q) in &integers_of[other] {
                    if !std::mem::replace(&mut is_touched[z], true) {
                        touched.push(z);
                    }
                    sum[z] += value * q;
                }
            }
            for (y, p) in row(k) {
                let p = f64::from(p);
                right[y] += p * pull;
                // Reals with reals, reals with integers, integers with integers.
                if y < reals {
                    for (other, value) in stiffness.row(k) {
                        let reals_of = row(other).filter(|t| t.0 < reals);
                        real.extend(
                            reals_of.map(|(z, q)| (y as u32, z as u32, value * p * f64::from(q))),
                        );
                    }
                    for &z in &touched {
                        mixed[z].push((y, p * sum[z]));
                    }
                } else {
                    for &z in &touched {
                        integer[(y - reals) * integers + z] += p * sum[z];
                    }
                }
            }
            for z in touched.drain(..) {
                (sum[z], is_touched[z]) = (0.0, false);
            }
        }
        // The same place may have been met from several copies.
        for column in &mut mixed {
            *column = summed(std::mem::take(column));
        }
        let matrix = SparseMatrix::from_triplets(reals, reals, &real)?;
        drop(real);
        let factor = self.factored(&matrix)?;
        Ok(Weighted {
            factor,
            mixed,
            integer,
            right,
            reals,
        })
    }

    /// The matrix and right-hand side over the coordinates of all copies, as if no conditions held.
    ///
    /// In a triangle u and v do not know of each other: 9 entries for each. Seams alone mix them, through P.
    fn of_copies(&self, weights: &[f64]) -> Result<(SparseMatrix, Vec<f64>), Error> {
        let coordinates = 2 * self.seams.copies();
        let mut entries = Vec::with_capacity(18 * self.charts.len());
        let mut pulls = vec![0.0; coordinates];
        for (f, chart) in self.charts.iter().enumerate() {
            let weight = weights[f] * chart.area;
            let hats = [&chart.along_u, &chart.along_v];
            for (component, stiffness) in chart.stiffness().iter().enumerate() {
                let wanted = self.wanted[f][component];
                let places = [0, 1, 2].map(|k| 2 * self.cut.copy[3 * f + k] + component as u32);
                for k in 0..3 {
                    let hat = hats[component][k];
                    pulls[places[k] as usize] += weight * (hat[0] * wanted[0] + hat[1] * wanted[1]);
                    entries
                        .extend((0..3).map(|l| (places[k], places[l], weight * stiffness[k][l])));
                }
            }
        }
        let matrix = SparseMatrix::from_triplets(coordinates, coordinates, &entries)?;
        Ok((matrix, pulls))
    }

    /// With the pattern analysed if this is the first matrix.
    fn factored(&mut self, matrix: &SparseMatrix) -> Result<Option<Cholesky>, Error> {
        if matrix.rows() == 0 {
            return Ok(None);
        }
        let symbolic = match &self.symbolic {
            Some(symbolic) => symbolic,
            None => self.symbolic.insert(Symbolic::of(matrix)?),
        };
        Ok(Some(symbolic.factor(matrix)?))
    }

    /// The coordinates of the corners of all triangles.
    /// In units of lines, from the values of the unknowns, reals first.
    pub(crate) fn corners(&self, y: &[f64]) -> Vec<[[f64; 2]; 3]> {
        let copies: Vec<[f64; 2]> = (0..self.seams.copies() as u32)
            .map(|copy| self.copy(y, copy))
            .collect();
        self.cut
            .copy
            .chunks_exact(3)
            .map(|c| [0, 1, 2].map(|k| copies[c[k] as usize]))
            .collect()
    }

    /// The coordinates of a copy of a vertex.
    pub(crate) fn copy(&self, y: &[f64], copy: u32) -> [f64; 2] {
        [0, 1].map(|component| {
            let terms = self.seams.row(copy, component);
            terms.map(|(k, c)| f64::from(c) * y[k]).sum()
        })
    }

    /// How far the map is from the field: Σ area · |J − 1|², over the number of triangles.
    /// The mean of the areas is 1, so that this is a mean over the surface; 0 if the map follows the field exactly.
    pub(crate) fn energy(&self, corners: &[[[f64; 2]; 3]]) -> f64 {
        let of = |(chart, uv): (&Chart, &[[f64; 2]; 3])| {
            let j = chart.jacobian(uv);
            let off = [j[0][0] - 1.0, j[0][1], j[1][0], j[1][1] - 1.0];
            chart.area * off.iter().map(|x| x * x).sum::<f64>()
        };
        let total: f64 = self.charts.iter().zip(corners).map(of).sum();
        total / self.charts.len().max(1) as f64
    }
}

impl Weighted {
    /// `A_RR⁻¹ x`, in place.
    fn solve(&self, x: &mut [f64]) -> Result<(), Error> {
        match &self.factor {
            Some(factor) => Ok(factor.solve_in_place(x, 1)?),
            None => Ok(()),
        }
    }

    /// `A⁻¹ (r, i)` by blocks, where `schur` solves with the Schur complement; with the integers held where it is `None`.
    ///
    /// Two substitutions with the factor of A_RR, or one where the integers are held; then the answer has the reals
    /// alone.
    pub(crate) fn inverse(
        &self,
        gradient: &[f64],
        schur: Option<Solver<'_>>,
    ) -> Result<Vec<f64>, Error> {
        let (real, integer) = gradient.split_at(self.reals);
        let mut x = real.to_vec();
        self.solve(&mut x)?;
        let Some(schur) = schur else {
            return Ok(x);
        };
        let mut z = integer.to_vec();
        self.take_reals(&mut z, &x);
        schur(&mut z);
        x.copy_from_slice(real);
        self.take_integers(&mut x, &z);
        self.solve(&mut x)?;
        x.extend(z);
        Ok(x)
    }

    /// The real unknowns for given integers.
    /// `A_RR⁻¹ (b_R − A_RI z)`: the minimum for these integers, which need not be integers.
    pub(crate) fn reals_for(&self, integers: &[f64]) -> Result<Vec<f64>, Error> {
        let mut x = self.right[..self.reals].to_vec();
        self.take_integers(&mut x, integers);
        self.solve(&mut x)?;
        Ok(x)
    }

    /// The Schur complement `S = A_II − A_IR A_RR⁻¹ A_RI`, row after row, and its right-hand side: what the energy
    /// is as a function of the integers alone, the reals following.
    ///
    /// A column of A_RI has entries along a chain of the cut, and eliminating them meets few of the reals: far less than a
    /// substitution per integer. `integers²` numbers in memory.
    pub(crate) fn schur(&self) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let (real, integer) = self.right.split_at(self.reals);
        let (mut s, mut right) = (self.integer.clone(), integer.to_vec());
        let Some(factor) = &self.factor else {
            return Ok((s, right));
        };
        for (s, gram) in s.iter_mut().zip(factor.inverse_gram(&self.mixed)?) {
            *s -= gram;
        }
        let mut x = real.to_vec();
        self.solve(&mut x)?;
        self.take_reals(&mut right, &x);
        Ok((s, right))
    }

    /// `z ← z − A_IR x`.
    fn take_reals(&self, z: &mut [f64], x: &[f64]) {
        for (z, column) in z.iter_mut().zip(&self.mixed) {
            *z -= column.iter().map(|&(row, a)| a * x[row]).sum::<f64>();
        }
    }

    /// `x ← x − A_RI z`.
    fn take_integers(&self, x: &mut [f64], z: &[f64]) {
        for (column, &z) in self.mixed.iter().zip(z) {
            for &(row, a) in column {
                x[row] -= a * z;
            }
        }
    }
}

/// Entries of one row added up.
fn summed(mut column: Vec<(usize, f64)>) -> Vec<(usize, f64)> {
    column.sort_by_key(|e| e.0);
    column.dedup_by(|later, kept| {
        let same = later.0 == kept.0;
        if same {
            kept.1 += later.1;
        }
        same
    });
    column
}
