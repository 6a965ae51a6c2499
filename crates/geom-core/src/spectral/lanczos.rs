//! Block Lanczos with full orthogonalization and thick restarts on `(K − σM)⁻¹ M`.

use super::basis::{Basis, random_block};
use super::{Error, Options, Pair, Pencil, Report, SpectralBackend, not_finite, rayleigh_ritz};
use crate::Run;
use crate::linalg::Symbolic;
use crate::linalg::dense::{self, Tall};

/// The smallest `k + 1` pairs of one connected part, the first `k` of them converged.
pub(super) fn pairs<B: SpectralBackend + ?Sized>(
    pencil: &Pencil<'_>,
    k: usize,
    options: &Options,
    run: Run<'_, B>,
    report: &mut Report,
) -> Result<Vec<Pair>, Error> {
    let n = pencil.rows();
    run.progress("factor", 0, 1)?;
    let shift = options.shift.unwrap_or_else(|| default_shift(pencil));
    let shifted = pencil.shifted(shift)?;
    let symbolic = Symbolic::of(&shifted)?;
    let factor = symbolic.factor(&shifted)?;
    drop(shifted);
    report.factor_entries = report.factor_entries.max(factor.factor_entries());
    run.progress("factor", 1, 1)?;

    let block = options.block;
    // Enough room that a restart keeps a good part of the space.
    let keep = k + 1 + block;
    let room = (keep + (2 * k).max(8 * block)).next_multiple_of(block);
    let mut basis = Basis::new(pencil, room);
    let mut h = Projected::new(room + block);

    // A known null vector is not searched for.
    let locked = usize::from(pencil.constants_vanish());
    if locked == 1 {
        let total: f64 = pencil.mass_times(&vec![1.0; n], 1).iter().sum();
        basis.push(&vec![1.0 / total.sqrt(); n], 1);
        h.set(0, 0, -1.0 / shift);
    }
    let mut seed = options.seed;
    let mut next = random_block(n, block, &mut seed);
    let step = |block_values: &[f64], report: &mut Report| -> Result<Vec<f64>, Error> {
        let mut image = pencil.mass_times(block_values, block);
        factor.solve_in_place(&mut image, block)?;
        report.solves += block;
        Ok(image)
    };
    next = step(&next, report)?;
    basis.orthonormalize(&mut next, block, 0, &mut seed);
    let mut restarts = 0;
    let mut kept = 0;
    let mut ready = 0;
    let mut look_at = k + 1 + block;
    loop {
        // The block joins the basis; its image is what the basis lacks, and how it couples.
        let at = basis.columns();
        basis.push(&next, block);
        let mut image = step(&next, report)?;
        // Three-term recurrence: the image overlaps with the newest two blocks; right after a
        // restart with all that was kept.
        let near = if at == kept {
            0
        } else {
            at.saturating_sub(block).max(kept)
        };
        let (c, coupling) = basis.orthonormalize(&mut image, block, near, &mut seed);
        h.add_block(at, block, &c);
        next = image;
        run.progress("eigenpairs", ready as u64, k as u64)?;

        let m = basis.columns();
        let full = m + block > room;
        if !full && m < look_at {
            continue;
        }
        look_at = m + block.max(m / 8);
        let ritz = h.solve(m)?;
        // Residual of Op x = θ x, in the norm of M: the last rows of y through the coupling.
        let tails = ritz.tails(&coupling, at, block);
        let value = |j: usize| shift + 1.0 / ritz.theta[j];
        let first = value(locked.min(m - 1)).abs();
        // One step of inverse iteration (see `finish`) makes the residual of K x = λ M x equal to
        // tail / θ².
        let good = |j: usize| {
            let theta = ritz.theta[j];
            theta > 0.0
                && tails[j] <= 0.3 * options.tolerance * theta * theta * value(j).abs().max(first)
        };
        ready = (0..k).take_while(|&j| j < locked || good(j)).count();
        if ready == k || (full && restarts == options.max_restarts) {
            report.restarts += restarts;
            let last = LastBlock {
                values: &next,
                coupling: &coupling,
                at,
                columns: block,
            };
            return finish(pencil, &basis, &ritz, &last, locked, k + 1);
        }
        if full {
            restarts += 1;
            basis.columns.combine(&ritz.columns(keep), keep);
            h.clear();
            for (j, &t) in ritz.theta.iter().take(keep).enumerate() {
                h.set(j, j, t);
            }
            kept = keep;
            look_at = basis.columns() + block;
        }
    }
}

/// Slightly below zero, of the size of the smallest eigenvalue of a surface: the mean eigenvalue
/// over the number of rows.
fn default_shift(pencil: &Pencil<'_>) -> f64 {
    let trace: f64 = pencil.stiffness.diagonal().iter().sum();
    let total: f64 = pencil.lumped.iter().sum();
    let rows = pencil.rows() as f64;
    if trace > 0.0 {
        -trace / total / rows
    } else {
        -1.0
    }
}

/// The block that would be next, and how the newest block of the basis couples to it.
struct LastBlock<'a> {
    values: &'a [f64],
    coupling: &'a [f64],
    at: usize,
    columns: usize,
}

/// Ritz vectors, improved by one step of inverse iteration at no cost: `Op V y = θ V y + Q R y_last`,
/// with Q the block that would be next (Ericsson and Ruhe's purification). Then Rayleigh–Ritz with
/// K and M themselves.
fn finish(
    pencil: &Pencil<'_>,
    basis: &Basis<'_>,
    ritz: &Ritz,
    last: &LastBlock<'_>,
    locked: usize,
    wanted: usize,
) -> Result<Vec<Pair>, Error> {
    let (m, b) = (basis.columns(), last.columns);
    let count = wanted.min(m) - locked;
    let mut y = vec![0.0; m * count];
    let mut tail = vec![0.0; b * count];
    for j in 0..count {
        for i in 0..m {
            y[i * count + j] = ritz.y[i * m + locked + j];
        }
        for i in 0..b {
            tail[i * count + j] = (0..b)
                .map(|l| last.coupling[i * b + l] * y[(last.at + l) * count + j])
                .sum::<f64>()
                / ritz.theta[locked + j];
        }
    }
    let mut x = dense::product(basis.columns.tall(), &y, count);
    dense::add_product(&mut x, count, Tall::of(last.values, b), &tail, 1.0);

    let mut out = Vec::with_capacity(count + locked);
    if locked == 1 {
        out.push((0.0, basis.columns.column(0)));
    }
    out.extend(rayleigh_ritz(pencil, &x, count)?);
    Ok(out)
}

/// The operator seen by the basis.
struct Projected {
    values: Vec<f64>,
    width: usize,
}

/// Ritz values θ, descending, and coefficients (column `j` of the row-major `y`).
struct Ritz {
    theta: Vec<f64>,
    y: Vec<f64>,
}

impl Projected {
    fn new(width: usize) -> Self {
        Self {
            values: vec![0.0; width * width],
            width,
        }
    }

    fn set(&mut self, i: usize, j: usize, value: f64) {
        self.values[i * self.width + j] = value;
    }

    fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Columns `at..at + block`, and by symmetry the rows; the block on the diagonal is symmetrized.
    fn add_block(&mut self, at: usize, block: usize, c: &[f64]) {
        for j in 0..block {
            for i in 0..at + block {
                let value = if i < at {
                    c[i * block + j]
                } else {
                    f64::midpoint(c[i * block + j], c[(at + j) * block + i - at])
                };
                self.set(i, at + j, value);
                self.set(at + j, i, value);
            }
        }
    }

    fn solve(&self, m: usize) -> Result<Ritz, Error> {
        let part: Vec<f64> = (0..m)
            .flat_map(|i| {
                self.values[i * self.width..i * self.width + m]
                    .iter()
                    .copied()
            })
            .collect();
        let (ascending, vectors) = dense::symmetric_eigen(&part, m).ok_or_else(not_finite)?;
        let theta = ascending.into_iter().rev().collect();
        let mut y = vectors;
        y.chunks_mut(m).for_each(<[f64]>::reverse);
        Ok(Ritz { theta, y })
    }
}

impl Ritz {
    /// The coefficients of the first `keep` vectors.
    fn columns(&self, keep: usize) -> Vec<f64> {
        let rows = self.y.chunks(self.theta.len());
        rows.flat_map(|row| row[..keep].iter().copied()).collect()
    }

    fn tails(&self, coupling: &[f64], at: usize, block: usize) -> Vec<f64> {
        let m = self.theta.len();
        (0..m)
            .map(|j| {
                let square = |i: usize| {
                    let s: f64 = (0..block)
                        .map(|l| coupling[i * block + l] * self.y[(at + l) * m + j])
                        .sum();
                    s * s
                };
                (0..block).map(square).sum::<f64>().sqrt()
            })
            .collect()
    }
}
