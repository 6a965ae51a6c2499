//! Block Lanczos with full orthogonalization and thick restarts on `(K − σM)⁻¹ M`.

use rayon::prelude::*;

use super::{Error, Options, Pair, Pencil, Report, SpectralBackend};
use crate::Run;
use crate::laplace::Mass;
use crate::linalg::dense::{self, Tall};
use crate::linalg::{SparseMatrix, Symbolic};

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
    let shifted = shifted(pencil, shift)?;
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
        let at = basis.columns;
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

        let m = basis.columns;
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
            basis.compress(&ritz, keep);
            h.clear();
            for (j, &t) in ritz.theta.iter().take(keep).enumerate() {
                h.set(j, j, t);
            }
            kept = keep;
            look_at = basis.columns + block;
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

/// `K − σM`.
fn shifted(pencil: &Pencil<'_>, shift: f64) -> Result<SparseMatrix, Error> {
    Ok(match pencil.mass {
        Mass::Consistent(mass) => pencil.stiffness.plus(-shift, mass)?,
        Mass::Lumped(mass) => pencil
            .stiffness
            .plus(-shift, &SparseMatrix::diagonal_of(mass))?,
    })
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
    let (n, m, b) = (pencil.rows(), basis.columns, last.columns);
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
    let mut x = dense::product(basis.tall(), &y, count);
    dense::add_product(&mut x, count, Tall::of(last.values, b), &tail, 1.0);

    let image = pencil.stiffness.multiply(&x, count);
    let a = dense::gram(Tall::of(&x, count), Tall::of(&image, count));
    let image = pencil.mass_times(&x, count);
    let g = dense::gram(Tall::of(&x, count), Tall::of(&image, count));
    drop(image);
    let (r, dead) = dense::upper_cholesky(&g, count, 1e-12);
    if let Some(&row) = dead.first() {
        return Err(crate::linalg::Error::NotPositiveDefinite { row }.into());
    }
    let inverse = dense::upper_inverse(&r, count);
    let c = dense::product(Tall::of(&a, count), &inverse, count);
    let reduced = dense::gram(Tall::of(&inverse, count), Tall::of(&c, count));
    let (values, u) = dense::symmetric_eigen(&reduced, count).ok_or_else(not_finite)?;
    let turn = dense::product(Tall::of(&inverse, count), &u, count);
    let x = dense::product(Tall::of(&x, count), &turn, count);

    let mut out = Vec::with_capacity(count + locked);
    if locked == 1 {
        out.push((0.0, basis.column(0)));
    }
    let vectors: Vec<Vec<f64>> = (0..count)
        .into_par_iter()
        .map(|j| (0..n).map(|i| x[i * count + j]).collect())
        .collect();
    out.extend(values.into_iter().zip(vectors));
    Ok(out)
}

fn not_finite() -> Error {
    crate::linalg::Error::NotFinite { row: 0, column: 0 }.into()
}

/// M-orthonormal vectors, row after row, with room for more.
struct Basis<'a> {
    pencil: &'a Pencil<'a>,
    values: Vec<f64>,
    room: usize,
    columns: usize,
}

impl<'a> Basis<'a> {
    fn new(pencil: &'a Pencil<'a>, room: usize) -> Self {
        Self {
            pencil,
            values: vec![0.0; pencil.rows() * room],
            room,
            columns: 0,
        }
    }

    fn tall(&self) -> Tall<'_> {
        self.from(0)
    }

    /// The columns from `first` on.
    fn from(&self, first: usize) -> Tall<'_> {
        Tall {
            values: &self.values,
            width: self.room,
            first,
            columns: self.columns - first,
        }
    }

    fn column(&self, j: usize) -> Vec<f64> {
        self.values[j..]
            .iter()
            .step_by(self.room)
            .copied()
            .collect()
    }

    fn push(&mut self, block: &[f64], columns: usize) {
        let at = self.columns;
        self.values
            .par_chunks_mut(self.room)
            .zip(block.par_chunks(columns))
            .with_min_len(4096)
            .for_each(|(row, new)| row[at..at + columns].copy_from_slice(new));
        self.columns += columns;
    }

    /// The first Ritz vectors become the basis.
    fn compress(&mut self, ritz: &Ritz, keep: usize) {
        let (m, room) = (self.columns, self.room);
        let y: Vec<f64> = (0..m)
            .flat_map(|i| ritz.y[i * m..i * m + keep].iter().copied())
            .collect();
        let kept = dense::product(self.tall(), &y, keep);
        self.values
            .par_chunks_mut(room)
            .zip(kept.par_chunks(keep))
            .with_min_len(4096)
            .for_each(|(row, new)| row[..keep].copy_from_slice(new));
        self.columns = keep;
    }

    /// Makes a block W orthonormal and orthogonal to the basis V: `W = V C + Q R`; Q replaces W. A
    /// column that depends on the others is replaced by a random one, with a zero in R. But for
    /// rounding, W overlaps with the columns from `near` on only: they are taken off first, so that
    /// one pass over all the others cleans up.
    fn orthonormalize(
        &self,
        w: &mut Vec<f64>,
        b: usize,
        near: usize,
        seed: &mut u64,
    ) -> (Vec<f64>, Vec<f64>) {
        let m = self.columns;
        let mut c = vec![0.0; m * b];
        let mut r: Vec<f64> = (0..b * b)
            .map(|i| f64::from(i.is_multiple_of(b + 1)))
            .collect();
        for pass in 0..6 {
            let first = if pass == 0 { near } else { 0 };
            let image = self.pencil.mass_times(w, b);
            let more = dense::gram(self.from(first), Tall::of(&image, b));
            dense::add_product(w, b, self.from(first), &more, -1.0);
            let image = self.pencil.mass_times(w, b);
            let gram = dense::gram(Tall::of(w, b), Tall::of(&image, b));
            let (factor, dead) = dense::upper_cholesky(&gram, b, 1e-14);
            *w = dense::product(Tall::of(w, b), &dense::upper_inverse(&factor, b), b);
            let add = dense::product(Tall::of(&more, b), &r, b);
            c[first * b..]
                .iter_mut()
                .zip(add)
                .for_each(|(c, a)| *c += a);
            r = dense::product(Tall::of(&factor, b), &r, b);
            for &j in &dead {
                let fresh = random_block(self.pencil.rows(), 1, seed);
                for (row, x) in w.chunks_mut(b).zip(fresh) {
                    row[j] = x;
                }
            }
            // What was left of each column: rounding grows by the inverse of its root.
            let clean = (0..b).all(|j| {
                let gone: f64 = more.iter().skip(j).step_by(b).map(|x| x * x).sum();
                let pivot = factor[j * b + j].powi(2);
                pivot > 1e-2 * (gone + gram[j * b + j])
            });
            if pass > 0 && clean && dead.is_empty() {
                break;
            }
        }
        (c, r)
    }
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

/// Numbers in −1…1, one per row and column, from a counter: the same on every machine.
fn random_block(rows: usize, columns: usize, seed: &mut u64) -> Vec<f64> {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let base = *seed;
    (0..(rows * columns) as u64)
        .into_par_iter()
        .map(|i| {
            // SplitMix64.
            let mut z = base.wrapping_add((i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^= z >> 31;
            (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
        .collect()
}
