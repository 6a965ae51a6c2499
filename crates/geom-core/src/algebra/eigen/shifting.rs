//! The inverse for a shift, and where it is put: [`Shifting::below`] all eigenvalues, or [`Shifting::among`] them.

use rayon::prelude::*;

use super::basis::Basis;
use super::{Error, Pencil};
use crate::algebra::dense::{self, Tall};
use crate::algebra::{Cholesky, Mass, SignedFactor, SparseMatrix, Symbolic};
use crate::compute::parallel;

/// The shift below all eigenvalues, in what Weyl's law tells of the smallest.
const NEAR_ZERO: f64 = 0.05;
/// Where the shift is put among `k` wanted eigenvalues, in `k` times that: what Weyl's law has for a mesh of equilateral
/// triangles, 4π over the diagonal 2√3, and a part of it.
const MIDDLE: f64 = 0.45 * 3.63;
/// No more of them may be below it.
const MOST: f64 = 0.75;
/// Another shift not far away.
const NEARBY: f64 = 0.93;
/// Of fewer none is far from the others: there is nothing to gain.
const FEW: usize = 16;
/// How far below zero an eigenvalue is taken for zero, in the shift.
const ZERO: f64 = 1e-6;

/// The factor of `K − σM`.
enum Factor {
    /// σ below all eigenvalues.
    Definite(Cholesky),
    /// Among them, with what was factored.
    Signed(SignedFactor, SparseMatrix),
}

/// `K − σM`, for one σ after the other; with a lumped mass `M^(−½) (K − σM) M^(−½)`, whose diagonal is more even.
pub(super) struct Shifting<'p, 'a> {
    pencil: &'p Pencil<'a>,
    /// The shift below all eigenvalues.
    pub(super) usual: f64,
    /// Roots of a lumped mass.
    roots: Option<Vec<f64>>,
    /// Of the pattern, which all have in common.
    symbolic: Option<Symbolic>,
}

impl<'p, 'a> Shifting<'p, 'a> {
    pub(super) fn of(pencil: &'p Pencil<'a>) -> Self {
        let roots = match pencil.mass {
            Mass::Lumped(masses) => Some(masses.iter().map(|m| m.sqrt()).collect()),
            Mass::Consistent(_) => None,
        };
        Self {
            pencil,
            usual: default_shift(pencil),
            roots,
            symbolic: None,
        }
    }

    fn matrix(&self, shift: f64) -> Result<SparseMatrix, Error> {
        let shifted = self.pencil.shifted(shift)?;
        Ok(match &self.roots {
            Some(roots) => shifted.map(|i, j, a| a / (roots[i] * roots[j])),
            None => shifted,
        })
    }

    fn symbolic(&mut self, matrix: &SparseMatrix) -> Result<&Symbolic, Error> {
        let symbolic = match self.symbolic.take() {
            Some(symbolic) => symbolic,
            None => Symbolic::of(matrix)?,
        };
        Ok(self.symbolic.insert(symbolic))
    }

    /// With a shift below all eigenvalues.
    pub(super) fn below(&mut self, shift: f64) -> Result<Inverse<'a>, Error> {
        let matrix = self.matrix(shift)?;
        let factor = self.symbolic(&matrix)?.factor(&matrix)?;
        Ok(self.inverse(shift, Factor::Definite(factor), 0))
    }

    /// Where about half of the `k` smallest eigenvalues of a surface are below; `None` where that is not known, or of no use.
    pub(super) fn middle(&self, k: usize) -> Option<f64> {
        let may_be_surface = self.pencil.stiffness.graphs().is_empty();
        (k >= FEW && may_be_surface).then(|| MIDDLE * k as f64 * self.usual / -NEAR_ZERO)
    }

    /// With a shift among the `k` smallest; `None` where none or too many of them are below it, or a pivot vanishes. And another
    /// shift, should this one be of no use.
    pub(super) fn among(
        &mut self,
        k: usize,
        shift: f64,
    ) -> Result<(Option<Inverse<'a>>, f64), Error> {
        let matrix = self.matrix(shift)?;
        let Some(factor) = self.symbolic(&matrix)?.factor_signed(&matrix)? else {
            return Ok((None, NEARBY * shift));
        };
        let below = factor.negative();
        if below == 0 {
            return Ok((None, 2.0 * shift));
        }
        if below as f64 > MOST * k as f64 {
            return Ok((None, 0.5 * shift * k as f64 / below as f64));
        }
        let factor = Factor::Signed(factor, matrix);
        Ok((Some(self.inverse(shift, factor, below)), NEARBY * shift))
    }

    fn inverse(&self, shift: f64, factor: Factor, below: usize) -> Inverse<'a> {
        Inverse {
            shift,
            below,
            factor,
            roots: self.roots.clone(),
            mass: match self.pencil.mass {
                Mass::Lumped(_) => None,
                mass @ Mass::Consistent(_) => Some(mass),
            },
        }
    }
}

/// The operator whose largest eigenvalues are sought. With a lumped mass it is
/// `M^½ (K − σM)⁻¹ M^½`, symmetric as it stands, whose basis is orthonormal in the plain product, which is cheaper than that of M;
/// else `(K − σM)⁻¹ M`, symmetric in the product of M. Either way one application is one solve, and for a consistent mass one
/// product more.
pub(super) struct Inverse<'a> {
    pub(super) shift: f64,
    /// How many eigenvalues are below the shift.
    pub(super) below: usize,
    factor: Factor,
    /// Roots of the lumped mass.
    roots: Option<Vec<f64>>,
    pub(super) mass: Option<&'a Mass>,
}

impl Inverse<'_> {
    /// How far the image X of a block B is from a solution, as an error of K in the shift: what pivots that are too small bring.
    pub(super) fn error(&self, basis: &Basis<'_>, [b, x]: [&[f64]; 2], block: usize) -> f64 {
        let Factor::Signed(_, matrix) = &self.factor else {
            return 0.0;
        };
        let image = matrix.multiply(x, block);
        let (b, x) = (basis.image(b, block), basis.image(x, block));
        let off = image.iter().zip(b.iter()).map(|(a, b)| (a - b).powi(2));
        let size: f64 = x.iter().map(|x| x * x).sum();
        (off.sum::<f64>() / size).sqrt() / self.shift
    }

    /// A step of inverse iteration, `X ← X − P (K − σM)⁻¹ (K X − M X Λ)`, for some columns of a block of unit vectors, where P takes
    /// out what is of them. What errors of solutions leave in residuals is rough, and a solution of what is rough is small: it leaves
    /// `(λ − σ) M` times that.
    pub(super) fn step(
        &self,
        pencil: &Pencil<'_>,
        values: &[f64],
        some: &[usize],
        block: &mut [f64],
    ) -> Result<(), Error> {
        let (all, c) = (values.len(), some.len());
        let mut x = vec![0.0; pencil.rows() * c];
        parallel::for_chunks(&mut x, c, |i, x| {
            let row = &block[i * all..][..all];
            x.iter_mut().zip(some).for_each(|(x, &j)| *x = row[j]);
        });
        let mut r = pencil.stiffness.multiply(&x, c);
        let mx = pencil.mass_times(&x, c);
        parallel::for_chunks(&mut r, c, |i, r| {
            let mx = &mx[i * c..];
            (0..c).for_each(|l| r[l] -= values[some[l]] * mx[l]);
        });
        self.restore(&mut r, c);
        let mut off = self.apply(&r, c)?;
        self.restore(&mut off, c);
        let image = pencil.mass_times(&off, c);
        let inside = dense::gram(&[Tall::of(block, all)], Tall::of(&image, c));
        let inside = dense::product(&[Tall::of(block, all)], &inside, c);
        parallel::for_chunks(block, all, |i, row| {
            let of_row = i * c..(i + 1) * c;
            let off = off[of_row.clone()].iter().zip(&inside[of_row]);
            off.zip(some)
                .for_each(|((off, inside), &j)| row[j] -= off - inside);
        });
        Ok(())
    }

    /// No θ of an eigenvalue below the shift is larger: that of λ = 0, but for rounding.
    pub(super) fn lowest(&self) -> f64 {
        if self.below == 0 {
            f64::NEG_INFINITY
        } else {
            -(1.0 - ZERO) / self.shift
        }
    }

    pub(super) fn rows(&self) -> usize {
        match &self.factor {
            Factor::Definite(factor) => factor.rows(),
            Factor::Signed(factor, _) => factor.rows(),
        }
    }

    pub(super) fn factor_entries(&self) -> usize {
        match &self.factor {
            Factor::Definite(factor) => factor.factor_entries(),
            Factor::Signed(factor, _) => factor.factor_entries(),
        }
    }

    pub(super) fn apply(&self, block: &[f64], columns: usize) -> Result<Vec<f64>, Error> {
        Ok(match &self.factor {
            Factor::Definite(factor) => factor.solved(block, columns)?,
            Factor::Signed(factor, _) => factor.solve(block, columns)?,
        })
    }

    /// From vectors of the pencil to those of this operator.
    pub(super) fn adopt(&self, mut vector: Vec<f64>) -> Vec<f64> {
        if let Some(roots) = &self.roots {
            vector.iter_mut().zip(roots).for_each(|(x, r)| *x *= r);
        }
        vector
    }

    /// From vectors of this operator to those of the pencil.
    pub(super) fn restore(&self, block: &mut [f64], columns: usize) {
        if let Some(roots) = &self.roots {
            let rows = block.par_chunks_mut(columns).zip(roots);
            rows.with_min_len(4096)
                .for_each(|(row, root)| row.iter_mut().for_each(|x| *x /= root));
        }
    }
}

/// Slightly below zero: a small part of what the smallest eigenvalue of a surface is by Weyl's law, which is the middle
/// diagonal entry of K over the area. Too near to zero, `K − σM` is nearly singular along the constants; too far, the wanted
/// eigenvalues move together. The middle one, since weights of many orders (`e^K` of a curved surface) have a mean that is
/// their largest alone.
fn default_shift(pencil: &Pencil<'_>) -> f64 {
    let mut diagonal = pencil.stiffness.diagonal();
    let mean = diagonal.iter().sum::<f64>() / diagonal.len() as f64;
    let half = diagonal.len() / 2;
    let (_, &mut middle, _) = diagonal.select_nth_unstable_by(half, f64::total_cmp);
    let total: f64 = pencil.lumped.iter().sum();
    // Weights may also vanish on more than half of a surface, or on all of it.
    let size = [middle, mean].into_iter().find(|&x| x > 0.0);
    size.map_or(-1.0, |size| -NEAR_ZERO * size / total)
}
