//! The smoothest angles for given period jumps: a graph Laplacian over the triangles.
//!
//! One factorization serves all choices of the period jumps, since they stand on the right-hand side only. What a change of
//! the jumps on some edges is worth comes in two parts: with the angles held, which is a sum over these edges, and what the angles
//! win back by following, which is a solve. The second is estimated from the triangles nearby.

use geom_core::algebra::{Cholesky, SparseMatrix};
use geom_core::compute::sets::DisjointSets;
use rayon::prelude::*;

use super::field::Guide;
use super::frames::{Frames, QUARTER, modulo_quarter};
use crate::Error;

/// No row: the angle of the triangle is given.
/// The same number stands for *not among the triangles nearby* where a few of them have a numbering of their own. As an
/// index it is beyond any array, so that `get` leaves these out.
const FIXED: u32 = u32::MAX;

/// Right-hand sides per pass.
const COLUMNS: usize = 16;
/// Angles follow a change for so many triangles around it at least.
const RINGS: usize = 10;

/// `min_θ Σ w (θ_j − θ_i − κ − (π/2) p)² + Σ λ̄ (θ − γ)²` with the period jumps p given (Eq. 4.9). The matrix does
/// not depend on p: it is factored once.
pub(super) struct Parallel<'a> {
    pub(super) frames: &'a Frames,
    /// The unknown that each triangle's angle is, or [`FIXED`].
    row: Vec<u32>,
    /// Number of unknowns.
    rows: usize,
    /// λ̄ of each triangle that a soft guide holds, 0 of others.
    softness: Vec<f64>,
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
        let mut softness = vec![0.0; faces];
        for &(face, _, weight) in &soft {
            softness[face] += weight;
        }
        let rows = rows as usize;
        let matrix = SparseMatrix::from_triplets(rows, rows, &entries)?;
        let factor = Cholesky::of(&matrix)?;
        Ok(Self {
            frames,
            row,
            rows,
            softness,
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
    /// `b = Σ w d (e_j − e_i)`. Only angles near the change follow, so that it is never more than the energy falls by, and
    /// hardly less: what a change does fades with the square of the distance.
    pub(super) fn compliances(&self, changes: &[Change]) -> Vec<f64> {
        changes
            .par_iter()
            .map_init(
                || vec![FIXED; self.frames.faces()],
                |place, change| self.compliance(change, place),
            )
            .collect()
    }

    /// By conjugate gradients on the triangles within twice as many steps as the change is long, and [`RINGS`] at least.
    /// `place` holds [`FIXED`] throughout, before and after.
    ///
    /// Outside of them the angles are held, as by hard guides: a minimum over fewer unknowns, hence never below the
    /// true one. The time is that of the triangles nearby and does not depend on the size of the surface.
    fn compliance(&self, change: &[(usize, i32)], place: &mut [u32]) -> f64 {
        let rings = RINGS.max(2 * change.len());
        let mut near: Vec<u32> = Vec::new();
        let reach = |face: usize, near: &mut Vec<u32>, place: &mut [u32]| {
            if self.row[face] != FIXED && place[face] == FIXED {
                place[face] = near.len() as u32;
                near.push(face as u32);
            }
        };
        for &(h, _) in change {
            let twin = self.frames.twin(h).expect("an interior edge");
            reach(h / 3, &mut near, place);
            reach(twin / 3, &mut near, place);
        }
        let mut first = 0;
        for _ in 0..rings {
            let end = near.len();
            for k in first..end {
                let face = near[k] as usize;
                for h in 3 * face..3 * face + 3 {
                    if let Some(twin) = self.frames.twin(h) {
                        reach(twin / 3, &mut near, place);
                    }
                }
            }
            first = end;
        }
        let mut right = vec![0.0; near.len()];
        for &(h, quarters) in change {
            let twin = self.frames.twin(h).expect("an interior edge");
            let value = self.frames.weight(h) * QUARTER * f64::from(quarters);
            for (face, value) in [(twin / 3, value), (h / 3, -value)] {
                if let Some(right) = right.get_mut(place[face] as usize) {
                    *right += value;
                }
            }
        }
        // Up to three neighbours, and what a row has on its diagonal.
        let rows: Vec<(f64, [(u32, f64); 3])> = near
            .iter()
            .map(|&face| {
                let mut row = (self.softness[face as usize], [(FIXED, 0.0); 3]);
                for k in 0..3 {
                    let h = 3 * face as usize + k;
                    if let Some(twin) = self.frames.twin(h) {
                        let w = self.frames.weight(h);
                        row.0 += w;
                        row.1[k] = (place[twin / 3], w);
                    }
                }
                row
            })
            .collect();
        for &face in &near {
            place[face as usize] = FIXED;
        }
        gained(&rows, &right)
    }

    /// The same with all angles following.
    ///
    /// A forward and a backward substitution on the whole surface for each change, [`COLUMNS`] of them in one pass over
    /// the factor, which is bound by memory and not by arithmetic.
    pub(super) fn exact_compliances(&self, changes: &[Change]) -> Result<Vec<f64>, Error> {
        let mut out = Vec::with_capacity(changes.len());
        for part in changes.chunks(COLUMNS) {
            let columns = part.len();
            let mut block = vec![0.0; self.rows * columns];
            for (c, change) in part.iter().enumerate() {
                self.load(change, |row, value| block[row * columns + c] += value);
            }
            let right = block.clone();
            self.factor.solve_in_place(&mut block, columns)?;
            out.extend((0..columns).map(|c| {
                (0..self.rows)
                    .map(|r| right[r * columns + c] * block[r * columns + c])
                    .sum::<f64>()
            }));
        }
        Ok(out)
    }

    /// Lets the angles follow a change of period jumps.
    /// By linearity `W⁻¹ b` is added to the best angles before; what hard guides hold stays.
    pub(super) fn follow(&self, change: &[(usize, i32)], theta: &mut [f64]) -> Result<(), Error> {
        let mut b = vec![0.0; self.rows];
        self.load(change, |row, value| b[row] += value);
        let x = self.factor.solve(&b)?;
        for (face, &row) in self.row.iter().enumerate() {
            if row != FIXED {
                theta[face] += x[row as usize];
            }
        }
        Ok(())
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

/// `bᵀ A⁻¹ b` by conjugate gradients with the diagonal as preconditioner. Spelled out for rows of three neighbours: those of
/// the core start from a factor, and here are thousands of systems of some hundred triangles, each solved once.
///
/// `rows` are the diagonal and up to three neighbours with the weights of their edges; neighbours numbered [`FIXED`] do
/// not move. The residual, measured in the preconditioner, falls to 1e-8 of what it was at the start.
fn gained(rows: &[(f64, [(u32, f64); 3])], right: &[f64]) -> f64 {
    const STEPS: usize = 200;
    const SMALL: f64 = 1e-8;
    let n = right.len();
    let (mut x, mut rest) = (vec![0.0; n], right.to_vec());
    let mut way: Vec<f64> = rest.iter().zip(rows).map(|(r, row)| r / row.0).collect();
    let mut along = vec![0.0; n];
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut energy = dot(&rest, &way);
    let small = SMALL * energy;
    for _ in 0..STEPS {
        if energy <= small {
            break;
        }
        for (out, (k, (diagonal, others))) in along.iter_mut().zip(rows.iter().enumerate()) {
            *out = diagonal * way[k];
            for &(j, w) in others {
                if let Some(there) = way.get(j as usize) {
                    *out -= w * there;
                }
            }
        }
        let step = energy / dot(&way, &along);
        for k in 0..n {
            x[k] += step * way[k];
            rest[k] -= step * along[k];
        }
        let after: f64 = rest.iter().zip(rows).map(|(r, row)| r * r / row.0).sum();
        let turn = after / energy;
        for k in 0..n {
            way[k] = rest[k] / rows[k].0 + turn * way[k];
        }
        energy = after;
    }
    dot(right, &x)
}

/// `angle` plus the multiple of a quarter turn that brings it nearest to `to`.
pub(super) fn nearest_branch(angle: f64, to: f64) -> f64 {
    to - modulo_quarter(to - angle)
}
