//! The smoothest angles for given period jumps: a graph Laplacian over the triangles.
//!
//! One factorization serves all choices of the period jumps, since they stand on the right-hand side only. What a change of
//! the jumps on some edges is worth comes in two parts: with the angles held, which is a sum over these edges, and what the angles
//! win back by following, which is half a substitution with a sparse right-hand side.

use geom_core::algebra::{Cholesky, SparseMatrix};
use geom_core::compute::sets::DisjointSets;

use super::field::Guide;
use super::frames::{Frames, QUARTER, modulo_quarter};
use crate::Error;

/// No row: the angle of the triangle is given. As an index it is beyond any array, so that `get` leaves these out.
const FIXED: u32 = u32::MAX;

/// `min_θ Σ w (θ_j − θ_i − κ − (π/2) p)² + Σ λ̄ (θ − γ)²` with the period jumps p given (Eq. 4.9). The matrix does
/// not depend on p: it is factored once.
pub(super) struct Parallel<'a> {
    pub(super) frames: &'a Frames,
    /// The unknown that each triangle's angle is, or [`FIXED`].
    row: Vec<u32>,
    /// Number of unknowns.
    rows: usize,
    /// The factor of W, the Laplacian of the dual graph plus λ̄ on the diagonal, without the rows and columns of given
    /// angles.
    factor: Cholesky,
    /// γ and λ̄ of the softly guided triangles.
    soft: Vec<(usize, f64, f64)>,
    /// The angles of the given triangles.
    fixed: Vec<(usize, f64)>,
}

/// A change of period jumps: half-edges and what is added to theirs.
/// On a path all half-edges run from its start to its end, and each has the same sign.
pub(super) type Change = Vec<(usize, i32)>;

impl<'a> Parallel<'a> {
    /// Factors the matrix. In a component without any guide, the lowest triangle keeps its angle.
    ///
    /// Guides of weight 0 must have been left out: a component that they alone hold would count as held, and its matrix
    /// would be singular. The factor of a surface of n triangles has about n log n entries.
    pub(super) fn new(frames: &'a Frames, guides: &[Guide]) -> Result<Self, Error> {
        let faces = frames.faces();
        let mut sets = DisjointSets::new(faces);
        for (h, t) in frames.interior() {
            sets.join((h / 3) as u32, (t / 3) as u32);
        }
        let part = sets.into_roots();
        let mut anchored = vec![false; faces];
        let (mut soft, mut fixed) = (Vec::new(), Vec::new());
        for guide in guides {
            let face = guide.face as usize;
            anchored[part[face] as usize] = true;
            let angle = guide.angle(frames);
            if guide.is_hard() {
                fixed.push((face, angle));
            } else {
                soft.push((face, angle, guide.weight));
            }
        }
        // What hard guides hold has no row; nor has one triangle of each part that no guide holds, or its crosses could
        // all turn together at no cost, and the matrix would be singular.
        let mut row = vec![0; faces];
        for &(face, _) in &fixed {
            row[face] = FIXED;
        }
        for face in 0..faces {
            if part[face] as usize == face && !anchored[face] {
                row[face] = FIXED;
            }
        }
        let mut rows = 0;
        for r in &mut row {
            if *r != FIXED {
                *r = rows;
                rows += 1;
            }
        }
        // The connection's Laplace operator on triangles; columns of what is held go to the right-hand side.
        let mut entries = Vec::new();
        for (h, t) in frames.interior() {
            let (i, j, w) = (row[h / 3], row[t / 3], frames.weight(h));
            if i != FIXED {
                entries.push((i, i, w));
            }
            if j != FIXED {
                entries.push((j, j, w));
            }
            if i != FIXED && j != FIXED {
                entries.extend([(i, j, -w), (j, i, -w)]);
            }
        }
        for &(face, _, weight) in &soft {
            if row[face] != FIXED {
                entries.push((row[face], row[face], weight));
            }
        }
        let rows = rows as usize;
        let matrix = SparseMatrix::from_triplets(rows, rows, &entries)?;
        let factor = Cholesky::of(&matrix)?;
        Ok(Self {
            frames,
            row,
            rows,
            factor,
            soft,
            fixed,
        })
    }

    /// The smoothest angles for these period jumps; `theta` says which branch of each guide is meant.
    ///
    /// A hard guide fixes θ to γ plus the multiple of a quarter turn that is nearest to the present θ, and a soft one
    /// pulls towards that branch. Any other branch could be had with other period jumps around the triangle, so that
    /// nothing is lost by keeping this one, and the jumps keep their meaning.
    pub(super) fn angles(&self, jump: &[i32], theta: &mut [f64]) -> Result<(), Error> {
        for &(face, angle) in &self.fixed {
            theta[face] = nearest_branch(angle, theta[face]);
        }
        let mut b = vec![0.0; self.rows];
        for (h, t) in self.frames.interior() {
            let (i, j) = (h / 3, t / 3);
            let w = self.frames.weight(h);
            let turn = self.frames.transport(h) + QUARTER * f64::from(jump[h]);
            let known = |face: usize| {
                if self.row[face] == FIXED {
                    theta[face]
                } else {
                    0.0
                }
            };
            if let Some(b) = b.get_mut(self.row[j] as usize) {
                *b += w * (turn + known(i));
            }
            if let Some(b) = b.get_mut(self.row[i] as usize) {
                *b += w * (known(j) - turn);
            }
        }
        for &(face, angle, weight) in &self.soft {
            if let Some(b) = b.get_mut(self.row[face] as usize) {
                *b += weight * nearest_branch(angle, theta[face]);
            }
        }
        let x = self.factor.solve(&b)?;
        for (face, &row) in self.row.iter().enumerate() {
            if row != FIXED {
                theta[face] = x[row as usize];
            }
        }
        Ok(())
    }

    /// For each change of period jumps, what the energy falls by because the angles follow: `bᵀ W⁻¹ b` with
    /// `b = Σ w d (e_j − e_i)`.
    pub(super) fn compliances(&self, changes: &[Change]) -> Result<Vec<f64>, Error> {
        let sides = changes.iter().map(|change| {
            let mut entries = Vec::with_capacity(2 * change.len());
            self.load(change, |row, value| entries.push((row, value)));
            entries
        });
        let sides: Vec<Vec<(usize, f64)>> = sides.collect();
        Ok(self.factor.inverse_energies(&sides)?)
    }

    /// What a change of period jumps adds to the best angles, `x = W⁻¹ b`, and what the energy falls by because they follow, `bᵀ x`.
    pub(super) fn response(&self, change: &[(usize, i32)]) -> Result<(Vec<f64>, f64), Error> {
        let mut b = vec![0.0; self.rows];
        self.load(change, |row, value| b[row] += value);
        let x = self.factor.solve(&b)?;
        let mut gain = 0.0;
        self.load(change, |row, value| gain += value * x[row]);
        Ok((x, gain))
    }

    /// Adds a response to the angles; what hard guides hold stays.
    pub(super) fn follow(&self, response: &[f64], theta: &mut [f64]) {
        for (theta, &row) in theta.iter_mut().zip(&self.row) {
            if row != FIXED {
                *theta += response[row as usize];
            }
        }
    }

    /// Hands the entries of `b = Σ w d (e_j − e_i)` to `add`, each with its row; a row may come more than once.
    fn load(&self, change: &[(usize, i32)], mut add: impl FnMut(usize, f64)) {
        for &(h, quarters) in change {
            let twin = self.frames.twin(h).expect("an interior edge");
            let value = self.frames.weight(h) * QUARTER * f64::from(quarters);
            if self.row[twin / 3] != FIXED {
                add(self.row[twin / 3] as usize, value);
            }
            if self.row[h / 3] != FIXED {
                add(self.row[h / 3] as usize, -value);
            }
        }
    }
}

/// `angle` plus the multiple of a quarter turn that brings it nearest to `to`.
pub(super) fn nearest_branch(angle: f64, to: f64) -> f64 {
    to - modulo_quarter(to - angle)
}
