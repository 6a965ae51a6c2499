//! Block Davidson with multigrid: the residuals of the smallest pairs that are not yet found, sent
//! through one V-cycle, join the basis; then Rayleigh–Ritz in f64. Restarts keep the best Ritz vectors
//! and those of the step before (GD+k: Stathopoulos and Saad, 1998), which makes up for the
//! directions that are dropped.
//!
//! Graphs of voxels are three-dimensional, and a factor of their matrix has O(n^4/3) entries, too many for millions of nodes. Nothing
//! is factored here. If x is an approximate eigenvector with residual `r = K x − θ M x`, then `x − K⁻¹ r` is a better one, and an
//! approximate inverse will do for that direction, since the Rayleigh–Ritz step finds out how far to go along it.

use super::backend::On;
use super::basis::{Basis, Columns, Taken, random_block};
use super::multigrid::Multigrid;
use super::{Error, Options, Pair, Pencil, Report, not_finite, rayleigh_ritz};
use crate::algebra::dense::{self, Tall};
use crate::compute::BackendError;
use crate::compute::random::SplitMix64;

/// Blocks of room beyond those that a restart keeps. Each adds to the work of Rayleigh–Ritz and saves restarts.
const BLOCKS: usize = 3;

/// The smallest `k + 1` pairs of one connected part, the first `k` of them converged. Pairs are ready in order: those
/// behind the first that is not yet good enough are worked on, a block at a time, until it is. Convergence is asked at
/// 0.3 of the tolerance, a margin for what comes after.
pub(super) fn pairs(
    pencil: &Pencil<'_>,
    k: usize,
    options: &Options,
    run: On<'_>,
    report: &mut Report,
) -> Result<Vec<Pair>, Error> {
    let n = pencil.rows();
    run.progress("multigrid", 0, 1)?;
    let hierarchy = Multigrid::of(pencil.stiffness)?;
    let cycle = run.backend.prepare(&hierarchy)?;
    run.progress("multigrid", 1, 1)?;

    // Many pairs are sought in wider blocks: each step costs a dense eigenproblem.
    let b = (options.block * (1 + k / 64)).min(64);
    let keep = k + 1 + b;
    let room = keep + b + (BLOCKS * b).max(k / 2).next_multiple_of(b);
    let mut basis = Basis::new(Some(pencil.mass));
    let mut images = Columns::new();
    // Vᵀ K V, row after row of the columns at hand.
    let mut h: Vec<f64> = Vec::new();
    let mut random = SplitMix64::new(options.seed);

    // A known null vector is not searched for: it stays the first column.
    let locked = usize::from(pencil.constants_vanish());
    if locked == 1 {
        basis.columns.push(pencil.constant(), 1);
        images.push(vec![0.0; n], 1);
        h.push(0.0);
    }
    let mut block = pencil.mass_times(&random_block(n, b, &mut random), b);
    let mut directions = Vec::new();
    let mut before: Option<(Vec<f64>, usize)> = None;
    let mut restarts = 0;
    loop {
        // Residuals become directions. Single precision is enough for a proposal.
        let sizes = norms(&block, b);
        let narrow: Vec<f32> = block
            .chunks(b)
            .flat_map(|row| row.iter().zip(&sizes).map(|(x, s)| (x / s) as f32))
            .collect();
        cycle.run(&narrow, b, &mut directions)?;
        drop(narrow);
        let found = directions.len();
        BackendError::unless(found == n * b, &run.backend.name(), || {
            format!("{found} values for a cycle of {n} rows × {b}")
        })?;
        let finite = directions.iter().all(|x| x.is_finite());
        BackendError::unless(finite, &run.backend.name(), || {
            "a value that is not finite in a cycle".to_owned()
        })?;
        let mut w: Vec<f64> = directions.iter().copied().map(f64::from).collect();
        report.solves += b;
        let mut taken = Taken::nothing(basis.columns.count(), b);
        basis.orthonormalize(&mut w, b, (0, 0), &mut taken, &mut random);
        let image = pencil.stiffness.multiply(&w, b);
        basis.columns.push(w, b);
        h = bordered(
            &h,
            &dense::gram(&basis.columns.tall(), Tall::of(&image, b)),
            b,
        );
        images.push(image, b);

        let m = basis.columns.count();
        let (theta, y) = dense::symmetric_eigen(&h, m).ok_or_else(not_finite)?;
        // The residuals of the next pairs that are not yet good, block by block.
        let first = theta[locked.min(m - 1)];
        let mut ready = locked.min(k);
        let (targets, residuals) = loop {
            let targets: Vec<usize> = (ready..m).take(b).collect();
            let residuals = residuals(pencil, &basis, &images, &theta, &y, &targets);
            let good = targets
                .iter()
                .zip(weighted_norms(pencil, &residuals, targets.len()))
                .take_while(|&(&j, r)| j < k && r <= 0.3 * options.tolerance * theta[j].max(first))
                .count();
            ready += good;
            if good == 0 || ready >= k {
                break (targets, residuals);
            }
        };
        run.progress("eigenpairs", ready as u64, k as u64)?;
        let exhausted = m + b > room && restarts == options.max_restarts;
        if ready >= k || exhausted {
            report.restarts += restarts;
            let count = (k + 1).min(m) - locked;
            let x = dense::product(
                &basis.columns.tall(),
                &columns_of(&y, m, locked, count),
                count,
            );
            let mut out = Vec::with_capacity(k + 1);
            if locked == 1 {
                out.push((0.0, pencil.constant()));
            }
            out.extend(rayleigh_ritz(pencil, x, count)?);
            return Ok(out);
        }
        block = if targets.len() == b {
            residuals
        } else {
            random_block(n, b, &mut random)
        };
        if m + b > room {
            restarts += 1;
            let kept = combination(&y, m, keep, before.take(), b);
            let columns = kept.len() / m;
            let image = dense::product(&[Tall::of(&h, m)], &kept, columns);
            h = dense::gram(&[Tall::of(&kept, columns)], Tall::of(&image, columns));
            basis.columns.combine(&kept, columns, 0);
            images.combine(&kept, columns, 0);
        } else {
            before = Some((columns_of(&y, m, targets[0], targets.len()), m));
        }
    }
}

/// A symmetric matrix with `b` columns (and rows) more. The new diagonal block is symmetrized; of the rest only the
/// upper half is given, and mirrored.
fn bordered(h: &[f64], new: &[f64], b: usize) -> Vec<f64> {
    let m = new.len() / b;
    let old = m - b;
    let mut out = vec![0.0; m * m];
    for i in 0..old {
        out[i * m..i * m + old].copy_from_slice(&h[i * old..(i + 1) * old]);
    }
    for i in 0..m {
        for j in 0..b {
            let value = if i < old {
                new[i * b + j]
            } else {
                f64::midpoint(new[i * b + j], new[(old + j) * b + i - old])
            };
            out[i * m + old + j] = value;
            out[(old + j) * m + i] = value;
        }
    }
    out
}

/// Some columns of a square matrix of `m` rows.
fn columns_of(y: &[f64], m: usize, first: usize, count: usize) -> Vec<f64> {
    (0..m)
        .flat_map(|i| y[i * m + first..i * m + first + count].iter().copied())
        .collect()
}

/// The first `keep` columns of y, and what the vectors of the step before add to them; orthonormal. That is the "+k" of
/// GD+k: without the last step's vectors a restart forgets the direction in which it was going, as conjugate gradients
/// would that begin anew.
fn combination(
    y: &[f64],
    m: usize,
    keep: usize,
    before: Option<(Vec<f64>, usize)>,
    b: usize,
) -> Vec<f64> {
    let mut columns: Vec<Vec<f64>> = (0..keep.min(m))
        .map(|j| (0..m).map(|i| y[i * m + j]).collect())
        .collect();
    if let Some((values, rows)) = before {
        let count = values.len() / rows;
        for j in 0..count.min(b) {
            let mut v: Vec<f64> = (0..m)
                .map(|i| if i < rows { values[i * count + j] } else { 0.0 })
                .collect();
            for _ in 0..2 {
                for c in &columns {
                    let dot: f64 = v.iter().zip(c).map(|(a, b)| a * b).sum();
                    v.iter_mut().zip(c).for_each(|(v, c)| *v -= dot * c);
                }
            }
            let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm > 1e-6 {
                v.iter_mut().for_each(|x| *x /= norm);
                columns.push(v);
            }
        }
    }
    (0..m)
        .flat_map(|i| columns.iter().map(move |c| c[i]))
        .collect()
}

/// `K x − θ M x` of some Ritz vectors. From stored images, without a product by K.
fn residuals(
    pencil: &Pencil<'_>,
    basis: &Basis<'_>,
    images: &Columns,
    theta: &[f64],
    y: &[f64],
    targets: &[usize],
) -> Vec<f64> {
    let (m, count) = (basis.columns.count(), targets.len());
    let y = columns_of(y, m, targets[0], count);
    let scaled: Vec<f64> = y
        .chunks(count)
        .flat_map(|row| row.iter().zip(targets).map(|(y, &j)| -theta[j] * y))
        .collect();
    let x = dense::product(&basis.columns.tall(), &scaled, count);
    let mut out = pencil.mass_times(&x, count);
    dense::add_product(&mut out, count, &images.tall(), &y, 1.0);
    out
}

/// The norm of each column; 1 for a column of zeros.
fn norms(block: &[f64], columns: usize) -> Vec<f64> {
    roots(dense::squares(block, columns, |_| 1.0))
}

/// The norm of each column in the inverse lumped mass; 1 for a column of zeros.
fn weighted_norms(pencil: &Pencil<'_>, block: &[f64], columns: usize) -> Vec<f64> {
    roots(dense::squares(block, columns, |i| 1.0 / pencil.lumped[i]))
}

fn roots(squares: Vec<f64>) -> Vec<f64> {
    let root = |s: f64| if s > 0.0 { s.sqrt() } else { 1.0 };
    squares.into_iter().map(root).collect()
}
