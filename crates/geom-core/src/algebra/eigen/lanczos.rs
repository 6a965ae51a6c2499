//! Block Lanczos with thick restarts on `(K − σM)⁻¹ M`.
//!
//! The smallest eigenvalues λ of the pencil are wanted, but powers of a matrix bring out the largest. `θ = 1 / (λ − σ)` is an
//! eigenvalue of `(K − σM)⁻¹ M` with the same vector, and the λ nearest to σ have the largest |θ|, far apart from the rest. One
//! application is one product with M and one solve with the factor of `K − σM`. After m blocks the operator seen by the basis is a
//! band matrix, whose eigenvalues (Ritz values) converge from the largest on. When the basis is full, the best vectors are kept and
//! the rest given up: a restart.
//!
//! With σ in the middle of the wanted λ all of them are twice as near to it, in their own number, as from below, and a quarter of
//! the basis is not needed. `K − σM` is not definite then, but its pivots tell how many λ are below σ, so that none of these is
//! missed (Grimes, Lewis and Simon). Where such a σ is not found at once, or the basis gets full, σ < 0 makes `K − σM` positive
//! definite though K is singular.
//!
//! A new block is orthogonalized against the two before it, and together with the newest of these against all others only
//! when rounding may have brought more than [`DRIFT`] of them back, which the recurrence of the overlaps tells
//! (partial reorthogonalization: Simon, 1984; in blocks: Grimes, Lewis and Simon, 1994).

use std::ops::Range;

use super::backend::On;
use super::basis::{Basis, Taken, random_block};
use super::shifting::{Inverse, Shifting};
use super::{
    Error, Options, Pair, Pencil, RESIDUALS, Report, not_finite, rayleigh_ritz, residuals,
};
use crate::algebra::dense::{self, Tall};
use crate::compute::random::SplitMix64;

/// Overlap of a new block with an older one at which it is orthogonalized anew, but for shifts far below.
const DRIFT: f64 = 1e-9;
/// Overlap whose square is more than may stay: what is left of the block has other lengths and angles.
const MUCH: f64 = 1e-6;
/// How often a shift among the eigenvalues is guessed.
const GUESSES: usize = 3;
/// Errors of solutions up to this over `k`, in what the smallest eigenvalues are allowed, are not seen in residuals: up to about
/// ten times `k` of them are, where an eigenvalue is near the shift.
const SOUND: f64 = 0.05;
/// Beyond this another factor is better.
const UNSOUND: f64 = 2.0;
/// Steps of inverse iteration at the end, at most.
const STEPS: usize = 3;
/// What one step of rounding adds to an overlap, of the size of the operator.
const ROUNDING: f64 = 1e-14;

/// The smallest `k + 1` pairs of one connected part, the first `k` of them converged.
pub(super) fn pairs(
    pencil: &Pencil<'_>,
    k: usize,
    options: &Options,
    run: On<'_>,
    report: &mut Report,
) -> Result<Vec<Pair>, Error> {
    run.progress("factor", 0, 1)?;
    let mut shifting = Shifting::of(pencil);
    if let Some(mut guess) = shifting.middle(k).filter(|_| options.shift.is_none()) {
        for _ in 0..GUESSES {
            let (inverse, other) = shifting.among(k, guess)?;
            guess = other;
            let Some(inverse) = inverse else { continue };
            let start = Start::of(inverse, 1.0, k, options, report)?;
            if start.error.is_nan() || start.error > UNSOUND {
                continue;
            }
            run.progress("factor", 1, 1)?;
            if let Some(pairs) = search(pencil, start, k, options, run, report)? {
                return Ok(pairs);
            }
            break;
        }
    }
    let usual = shifting.usual;
    let shift = options.shift.unwrap_or(usual);
    let inverse = shifting.below(shift)?;
    drop(shifting);
    run.progress("factor", 1, 1)?;
    // Far below zero all θ are alike, and what the recurrence lacks of a product counts for more in a difference of two.
    let alike = (usual / shift).abs().min(1.0);
    let start = Start::of(inverse, alike, k, options, report)?;
    let found = search(pencil, start, k, options, run, report)?;
    Ok(found.expect("a search from below all eigenvalues goes on to its last restart"))
}

/// The inverse for one shift, and the image of the first block.
struct Start<'a> {
    inverse: Inverse<'a>,
    basis: Basis<'a>,
    random: SplitMix64,
    image: Vec<f64>,
    /// Of the image: see [`Inverse::error`]. In what the tolerance allows the smallest eigenvalues, of which `k` reach to about the
    /// shift.
    error: f64,
    /// What overlap may stay.
    limit: f64,
}

impl<'a> Start<'a> {
    fn of(
        inverse: Inverse<'a>,
        alike: f64,
        k: usize,
        options: &Options,
        report: &mut Report,
    ) -> Result<Self, Error> {
        report.factor_entries = report.factor_entries.max(inverse.factor_entries());
        report.solves += options.block;
        let basis = Basis::new(inverse.mass);
        let mut random = SplitMix64::new(options.seed);
        let block = random_block(inverse.rows(), options.block, &mut random);
        let image = inverse.apply(&basis.image(&block, options.block), options.block)?;
        let error = inverse.error(&basis, [&block, &image], options.block);
        Ok(Self {
            inverse,
            basis,
            random,
            image,
            error: error * k as f64 / options.tolerance,
            limit: DRIFT * alike,
        })
    }
}

/// The pairs by the inverse for one shift; `None` where it is among the eigenvalues and the basis gets full.
fn search(
    pencil: &Pencil<'_>,
    start: Start<'_>,
    k: usize,
    options: &Options,
    run: On<'_>,
    report: &mut Report,
) -> Result<Option<Vec<Pair>>, Error> {
    let Start {
        inverse,
        mut basis,
        mut random,
        image: mut next,
        error,
        limit,
    } = start;
    let (shift, below) = (inverse.shift, inverse.below);
    let block = options.block;
    // Enough room that a restart keeps a good part of the space.
    let keep = k + 1 + block;
    let room = keep + 2 * k + 14 * block;
    let mut h = Projected::new(room + block);

    // A known null vector is not searched for.
    let locked = usize::from(pencil.constants_vanish());
    if locked == 1 {
        basis.columns.push(inverse.adopt(pencil.constant()), 1);
        h.set(0, 0, -1.0 / shift);
    }
    let step = |q: &[f64], basis: &Basis<'_>, report: &mut Report| {
        report.solves += block;
        inverse.apply(&basis.image(q, block), block)
    };
    let mut taken = Taken::nothing(locked, block);
    basis.orthonormalize(&mut next, block, (0, 0), &mut taken, &mut random);
    let mut drift = Drift::within(limit);
    let mut restarts = 0;
    let mut kept = 0;
    let mut ready = 0;
    let mut checks = Checks::new(k, below > 0, options);
    loop {
        // The block joins the basis; its image is what the basis lacks, and how it couples.
        let at = basis.columns.count();
        basis.columns.push(next, block);
        let mut image = step(basis.columns.last(), &basis, report)?;
        // Three-term recurrence: the image overlaps with the newest two blocks; right after a
        // restart with all that was kept.
        let near = if at == kept {
            0
        } else {
            at.saturating_sub(block).max(kept)
        };
        let mut taken = Taken::nothing(at + block, block);
        basis.orthonormalize(&mut image, block, (locked, near), &mut taken, &mut random);
        h.add_block(at, block, &taken.c);
        if let Some(overlap) = drift.step(&h, at, block, (locked, near), &taken.r) {
            basis.reorthogonalize(&mut image, block);
            if overlap > MUCH {
                let mut rest = Taken::nothing(at + block, block);
                basis.orthonormalize(&mut image, block, (0, 0), &mut rest, &mut random);
                taken.r = dense::product(&[Tall::of(&rest.r, block)], &taken.r, block);
            }
        }
        let coupling = taken.r;
        next = image;
        run.progress("eigenpairs", ready as u64, k as u64)?;

        let m = basis.columns.count();
        let full = m + block > room;
        if !full && m < checks.next {
            continue;
        }
        let ritz = h.solve(m, inverse.lowest())?;
        // Residual of Op x = θ x, in the norm of M: the last rows of y through the coupling.
        let tails = ritz.tails(&coupling, at, block);
        let value = |j: usize| shift + 1.0 / ritz.theta[j];
        let first = value(locked.min(m - 1)).abs();
        // One step of inverse iteration (see `finish`) makes the residual of K x = λ M x equal to
        // tail / θ². This is its share of what is allowed.
        let share = |j: usize| {
            let theta = ritz.theta[j];
            if theta != 0.0 {
                let allowed = 0.3 * options.tolerance * theta * theta;
                tails[j] / (allowed * value(j).abs().max(first))
            } else {
                f64::INFINITY
            }
        };
        ready = (0..k)
            .take_while(|&j| j < locked || share(j) <= 1.0)
            .count();
        // Not before all that are below the shift are there.
        ready = if ritz.below == below { ready } else { 0 };
        checks.plan(m, block, (locked..k).map(share).fold(0.0, f64::max));
        if ready == k || (full && below == 0 && restarts == options.max_restarts) {
            report.restarts += restarts;
            run.progress("vectors", 0, 1)?;
            let last = LastBlock {
                ritz: &ritz,
                values: &next,
                coupling: &coupling,
                at,
                columns: block,
            };
            let allowed = (error * k as f64 > SOUND).then_some(0.5 * options.tolerance);
            let wanted = locked..k + 1;
            return finish(pencil, inverse, basis, &last, wanted, allowed, report).map(Some);
        }
        if full && below > 0 {
            return Ok(None);
        }
        if full {
            restarts += 1;
            basis.restart(&ritz.columns(keep), keep, locked, &mut random);
            let mut rest = Taken::nothing(keep, block);
            basis.orthonormalize(&mut next, block, (0, 0), &mut rest, &mut random);
            h.clear();
            for (j, &t) in ritz.theta.iter().take(keep).enumerate() {
                h.set(j, j, t);
            }
            kept = keep;
            drift = Drift::within(limit);
            checks.restart(keep + 2 * block);
        }
    }
}

/// When to look at the Ritz values next. A look is a dense eigenproblem of all columns at hand: as dear as two steps for 30 pairs,
/// as seven for 100, as twenty for 300. So the first comes when it is likely to be the last, by what measured surfaces have in
/// common: their eigenvalues grow evenly (Weyl), and what Lanczos needs to find `k` of them depends on little else.
struct Checks {
    next: usize,
    /// Columns for each digit of the last pair's residual.
    digit: f64,
    /// Columns and worst share of the last look.
    last: Option<(usize, f64)>,
}

impl Checks {
    /// `11/5 k + ⅘ (b³ k)^¼ (digits + 3)` columns, of which surfaces of any size need from 20 less to 10 more: 3 to 300 pairs,
    /// blocks b of 4 to 16, 4 to 12 digits.
    fn new(k: usize, is_among: bool, options: &Options) -> Self {
        let digit = 0.8 * ((options.block.pow(3) * k) as f64).sqrt().sqrt();
        let digits = 3.0 - options.tolerance.log10();
        let [each, share] = if is_among { [1.27, 0.9] } else { [2.2, 1.0] };
        Self {
            next: (each * k as f64 + share * digit * digits) as usize,
            digit,
            last: None,
        }
    }

    /// The basis has become another: no fall is known of it.
    fn restart(&mut self, next: usize) {
        (self.next, self.last) = (next, None);
    }

    /// The worst residual falls by a factor per column, and the longer the faster: as many columns as take it to 1, and at
    /// least a block.
    fn plan(&mut self, m: usize, block: usize, worst: f64) {
        let usual = self.digit * worst.log10();
        let guess = self.last.map_or(usual, |(before, larger)| {
            let fall = (larger / worst).ln() / (m - before) as f64;
            if fall > 0.0 {
                worst.ln() / fall
            } else {
                m as f64 / 8.0
            }
        });
        // Of no use where a residual is not finite.
        let ahead = if guess.is_finite() { guess as usize } else { 0 };
        self.next = m + ahead.clamp(block, (m / 3).max(block));
        self.last = Some((m, worst));
    }
}

/// Overlaps `Vᵀ Q` of the two newest blocks Q with the columns before, as rounding lets them grow.
///
/// Estimated from the recurrence that the blocks themselves obey, with rounding added at each step: no product with the
/// basis is needed to know when one would be.
struct Drift {
    newest: Vec<f64>,
    before: Vec<f64>,
    /// What may stay.
    limit: f64,
}

impl Drift {
    /// Of a basis that has none yet.
    fn within(limit: f64) -> Self {
        Self {
            newest: Vec::new(),
            before: Vec::new(),
            limit,
        }
    }

    /// After the step that brought the block at column `at` into the basis and left the next one with
    /// the factor `r`: the largest, if beyond the limit. It is to be taken out of both at once: the block after them has
    /// what either has left.
    fn step(
        &mut self,
        h: &Projected,
        at: usize,
        b: usize,
        (locked, near): (usize, usize),
        r: &[f64],
    ) -> Option<f64> {
        let m = at + b;
        self.newest.resize(m * b, 0.0);
        self.before.resize(m * b, 0.0);
        let columns = |from: usize| -> Vec<f64> {
            let row = |i: usize| (0..b).map(move |j| h.get(from + i, at + j));
            (0..b).flat_map(row).collect()
        };
        let image = h.times(&self.newest, m, b);
        let own = dense::product(&[Tall::of(&self.newest, b)], &columns(at), b);
        let old = if near < at && near + b == at {
            dense::product(&[Tall::of(&self.before, b)], &columns(near), b)
        } else {
            vec![0.0; m * b]
        };
        let size = ROUNDING * h.largest(locked..m);
        let overlap = image.iter().zip(&own).zip(&old).map(|((i, o), b)| {
            let sum = i - o - b;
            sum + size.copysign(sum)
        });
        let overlap: Vec<f64> = overlap.collect();
        let mut next = dense::product(&[Tall::of(&overlap, b)], &dense::upper_inverse(r, b), b);
        for (i, row) in next.chunks_mut(b).enumerate() {
            if i < locked || i >= near {
                row.fill(ROUNDING);
            }
        }
        let worst = next.iter().fold(0.0, |s, &x| f64::max(s, x.abs()));
        let much = worst > self.limit;
        if much {
            next.fill(ROUNDING);
            self.newest.fill(ROUNDING);
        }
        self.before = std::mem::replace(&mut self.newest, next);
        much.then_some(worst)
    }
}

/// The last Ritz values, the block that would be next, and how the newest block of the basis couples to it.
struct LastBlock<'a> {
    ritz: &'a Ritz,
    values: &'a [f64],
    coupling: &'a [f64],
    at: usize,
    columns: usize,
}

/// Ritz vectors, improved by one step of inverse iteration at no cost: `Op V y = θ V y + Q R y_last`,
/// with Q the block that would be next (Ericsson and Ruhe's purification). Then Rayleigh–Ritz with
/// K and M themselves. The step is free since the image of the newest block is known: it lowers the parts of high
/// eigenvalues once more. Those whose residual is above what is given are [polished].
fn finish(
    pencil: &Pencil<'_>,
    inverse: Inverse<'_>,
    basis: Basis<'_>,
    last: &LastBlock<'_>,
    wanted: Range<usize>,
    allowed: Option<f64>,
    report: &mut Report,
) -> Result<Vec<Pair>, Error> {
    let ritz = last.ritz;
    let (m, b) = (basis.columns.count(), last.columns);
    let locked = wanted.start;
    let count = wanted.end.min(m) - locked;
    let mut y = vec![0.0; (m + b) * count];
    for j in 0..count {
        for i in 0..m {
            y[i * count + j] = ritz.y[i * m + locked + j];
        }
        for i in 0..b {
            y[(m + i) * count + j] = (0..b)
                .map(|l| last.coupling[i * b + l] * y[(last.at + l) * count + j])
                .sum::<f64>()
                / ritz.theta[locked + j];
        }
    }
    let mut blocks = basis.columns.tall();
    blocks.push(Tall::of(last.values, b));
    let mut x = dense::product(&blocks, &y, count);
    inverse.restore(&mut x, count);
    // Rayleigh–Ritz needs neither, and blocks of its own.
    drop(basis);
    let inverse = allowed.map(|allowed| (inverse, allowed));

    let pairs = rayleigh_ritz(pencil, x, count)?;
    let pairs = match inverse {
        Some((inverse, allowed)) => polished(pencil, &inverse, pairs, allowed, report)?,
        None => pairs,
    };
    let known = (locked == 1).then(|| (0.0, pencil.constant()));
    Ok(known.into_iter().chain(pairs).collect())
}

/// Some steps of inverse iteration for pairs whose residual is more than allowed; the last one has not converged, and is not asked.
fn polished(
    pencil: &Pencil<'_>,
    inverse: &Inverse<'_>,
    pairs: Vec<Pair>,
    allowed: f64,
    report: &mut Report,
) -> Result<Vec<Pair>, Error> {
    let (values, mut vectors): (Vec<f64>, Vec<Vec<f64>>) = pairs.into_iter().unzip();
    let mut far: Vec<usize> = (0..values.len() - 1).collect();
    for _ in 0..STEPS {
        let of_far: Vec<f64> = far.iter().map(|&j| values[j]).collect();
        let found: Vec<&[f64]> = far.iter().map(|&j| vectors[j].as_slice()).collect();
        let found = residuals(pencil, &of_far, &found);
        let mut found = found.into_iter();
        far.retain(|_| found.next().is_some_and(|r| r > allowed));
        if far.is_empty() {
            break;
        }
        let mut block = dense::together(&vectors);
        report.solves += far.len();
        for some in far.chunks(RESIDUALS) {
            inverse.step(pencil, &values, some, &mut block)?;
        }
        vectors = dense::separate(&block, values.len());
    }
    Ok(values.into_iter().zip(vectors).collect())
}

/// The operator seen by the basis. Symmetric, of fixed `width`; what lies beyond the columns at hand is zero.
struct Projected {
    values: Vec<f64>,
    /// Where each row is not zero: a block couples with its neighbours.
    spans: Vec<Range<usize>>,
    width: usize,
}

/// Ritz values θ in the order of λ, and coefficients (column `j` of the row-major `y`).
struct Ritz {
    theta: Vec<f64>,
    y: Vec<f64>,
    /// How many λ are below the shift.
    below: usize,
}

impl Projected {
    fn new(width: usize) -> Self {
        Self {
            values: vec![0.0; width * width],
            spans: vec![0..0; width],
            width,
        }
    }

    fn set(&mut self, i: usize, j: usize, value: f64) {
        self.values[i * self.width + j] = value;
        let span = &mut self.spans[i];
        if value != 0.0 {
            *span = match *span == (0..0) {
                true => j..j + 1,
                false => span.start.min(j)..span.end.max(j + 1),
            };
        }
    }

    fn get(&self, i: usize, j: usize) -> f64 {
        self.values[i * self.width + j]
    }

    /// Its first `m` rows and columns, which are all that are not zero, times a block of `b` vectors.
    fn times(&self, block: &[f64], m: usize, b: usize) -> Vec<f64> {
        let mut out = vec![0.0; m * b];
        for (i, out) in out.chunks_mut(b).enumerate() {
            let span = self.spans[i].clone();
            for (x, &t) in block[span.start * b..].chunks(b).zip(&self.row(i)[span]) {
                out.iter_mut().zip(x).for_each(|(y, x)| *y += t * x);
            }
        }
        out
    }

    /// The largest magnitude in these rows: about the size of the operator.
    fn largest(&self, rows: Range<usize>) -> f64 {
        let of_row = |i: usize| self.row(i)[self.spans[i].clone()].iter();
        rows.flat_map(of_row).fold(0.0, |s, x| f64::max(s, x.abs()))
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.width..][..self.width]
    }

    fn clear(&mut self) {
        self.values.fill(0.0);
        self.spans.fill(0..0);
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

    /// Its first `m` rows and columns.
    fn leading(&self, m: usize) -> Vec<f64> {
        let rows = self.values.chunks(self.width).take(m);
        rows.flat_map(|row| row[..m].iter().copied()).collect()
    }

    /// In the order of λ: θ up to `lowest` belong to those below the shift, the largest to the smallest λ, and so do those
    /// above it. What is between is of no eigenvalue, and comes last.
    fn solve(&self, m: usize, lowest: f64) -> Result<Ritz, Error> {
        let part = self.leading(m);
        let (mut theta, mut y) = dense::symmetric_eigen(&part, m).ok_or_else(not_finite)?;
        let below = theta.partition_point(|&t| t <= lowest);
        let turn = |row: &mut [f64]| {
            row[..below].reverse();
            row[below..].reverse();
        };
        turn(&mut theta);
        y.chunks_mut(m).for_each(turn);
        Ok(Ritz { theta, y, below })
    }
}

impl Ritz {
    /// The coefficients of the first `keep` vectors.
    fn columns(&self, keep: usize) -> Vec<f64> {
        let rows = self.y.chunks(self.theta.len());
        rows.flat_map(|row| row[..keep].iter().copied()).collect()
    }

    /// `‖R y_last‖` of each Ritz vector: the length of what the operator leads out of the basis, which is the residual
    /// of Op x = θ x.
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
