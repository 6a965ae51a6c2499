//! The smallest eigenpairs of `K x = λ M x`.
//!
//! Every connected part of the matrix is solved by itself, so that equal parts cannot mix and each
//! has its own zero. A part of few rows is solved densely; a large one of a matrix by block Lanczos on
//! `(K − σM)⁻¹ M` with a sparse factor, σ in the middle of the wanted ones or slightly below zero (shift–invert), a large one of a
//! graph by block Davidson over multigrid: see [`Method`].
//!
//! Files: `parts.rs` finds the connected parts; `direct.rs` solves small ones; `lanczos.rs` and `davidson.rs` are the two
//! iterations over the bases of `basis.rs`, the first with the inverses of `shifting.rs`; `multigrid.rs` is the approximate inverse, [`backend`] what of it may run
//! elsewhere. Whatever found a pair, its residual is computed anew from K and M in f64.

pub mod backend;
mod basis;
mod davidson;
mod direct;
mod lanczos;
mod multigrid;
mod parts;
mod shifting;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use crate::algebra::Operator;
pub use backend::SpectralBackend;
pub use multigrid::Multigrid;

use std::ops::Range;

use crate::compute::parallel;
use rayon::prelude::*;

use self::backend::On;
use crate::algebra::Mass;
use crate::algebra::{self, SparseMatrix, dense};
use crate::compute::BackendError;
use crate::options::{OutOfRange, require};
use crate::{Cancelled, Run};

/// Rows up to which a part is solved densely.
const DENSE_ROWS: usize = 384;
/// The same where so many pairs are wanted that an iteration is of no use.
const LARGEST_DENSE: usize = 2048;
/// Vectors whose residuals are measured at once.
const RESIDUALS: usize = 8;
/// Parts whose pairs are held at a time: small ones among them are solved side by side.
const SIDE_BY_SIDE: usize = 16;
/// Searches for a part in which pairs are found to be missing.
const ATTEMPTS: usize = 4;

/// How a large connected part is solved. Parts of at most 384 rows are solved densely with either, and up to 2048 rows
/// if more than a third of their pairs is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// [`ShiftInvert`](Self::ShiftInvert) for a sparse matrix, [`Multigrid`](Self::Multigrid) for a
    /// graph Laplacian.
    #[default]
    Auto,
    /// Block Lanczos on `(K − σM)⁻¹ M` with a sparse factor. The method for surfaces, whose factors stay sparse; any mass.
    ShiftInvert,
    /// Block Davidson with a multigrid cycle in place of the inverse. The method for voxel graphs and
    /// others that fill space, whose factors do not stay sparse. K needs rows that sum to zero, or
    /// nearly so, and few positive entries beside the diagonal.
    Multigrid,
}

impl Method {
    fn of(self, operator: Operator<'_>) -> Self {
        match self {
            Self::Auto if operator.is_graph() => Self::Multigrid,
            Self::Auto => Self::ShiftInvert,
            given => given,
        }
    }
}

/// What to compute.
///
/// The defaults suit surfaces. For voxel graphs, where every digit takes more cycles, a larger tolerance saves time.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Largest residual `‖K x − λ M x‖ / (λ ‖M x‖)` of a pair, in the norm of the inverse lumped
    /// mass; for λ = 0 the smallest λ that is not zero stands in the denominator. Pairs come out
    /// better than asked.
    pub tolerance: f64,
    /// How large parts are solved.
    pub method: Method,
    /// σ of shift–invert, below all eigenvalues: `K − σM` must be positive definite. `None`: in the middle of the wanted ones, by
    /// Weyl's law and the signs of pivots, which count those below it so that none is missed; where they are few, or that fails, a
    /// small negative number from the diagonal of K and the trace of M. Multigrid has no shift and refuses one; a part that is solved densely needs none.
    pub shift: Option<f64>,
    /// Vectors per block of the Krylov space; an eigenvalue of higher multiplicity in one connected
    /// part may lose copies, which `verify` finds out. 1 to 64. More vectors per block find multiple eigenvalues more
    /// surely and use the processor better; each takes part in every product, so that few pairs come slower.
    pub block: usize,
    /// Most restarts of the Krylov space per part.
    pub max_restarts: usize,
    /// Counts the eigenvalues below the last gap by the signs of a factor L D Lᵀ, and searches anew
    /// with larger blocks if one is missing. One more factorization per large part: little for a
    /// surface, more than the search itself for a voxel graph.
    pub verify: bool,
    /// Neighbouring eigenvalues whose difference is at most this share of the larger one form a
    /// cluster.
    pub cluster_gap: f64,
    /// Seed of the start vectors.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            tolerance: 1e-9,
            method: Method::Auto,
            shift: None,
            block: 8,
            max_restarts: 60,
            verify: false,
            cluster_gap: 1e-3,
            seed: 1,
        }
    }
}

impl Options {
    /// Refuses values that make no sense, naming the field.
    pub fn check(&self) -> Result<(), Error> {
        let between = self.tolerance > 0.0 && self.tolerance < 1.0;
        require(between, "tolerance", self.tolerance, "lie between 0 and 1")?;
        if let Some(shift) = self.shift {
            require(shift.is_finite(), "shift", shift, "be a finite number")?;
        }
        let fits = (1..=64).contains(&self.block);
        require(fits, "block", self.block, "lie between 1 and 64")?;
        let any = self.max_restarts > 0;
        require(any, "max_restarts", self.max_restarts, "be at least 1")?;
        let share = self.cluster_gap >= 0.0 && self.cluster_gap < 1.0;
        require(
            share,
            "cluster_gap",
            self.cluster_gap,
            "be at least 0 and below 1",
        )?;
        Ok(())
    }
}

/// Why there are no eigenpairs.
///
/// The matrices are looked at first, then the masses; [`Error::TooMany`] comes when a part is reached that is too large
/// for what is asked. Not to converge is no error: see [`Report::converged`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option makes no sense.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// A mass is zero, negative or not finite where the stiffness is not zero.
    #[error("the mass of row {row} is {mass}; it must be positive where the stiffness is not zero")]
    Mass {
        /// The row.
        row: usize,
        /// Its mass.
        mass: f64,
    },
    /// The number of masses is not the number of rows.
    #[error("{found} masses for {rows} rows")]
    MassLength {
        /// Masses given.
        found: usize,
        /// Rows of the stiffness.
        rows: usize,
    },
    /// More pairs are asked of a large part than the iteration is made for.
    #[error(
        "{asked} pairs of a connected part of {rows} rows: of a part of more than {LARGEST_DENSE} rows \
         at most a third of the pairs can be found"
    )]
    TooMany {
        /// Pairs asked for.
        asked: usize,
        /// Rows of the part.
        rows: usize,
    },
    /// A matrix is not finite, not symmetric, not definite, or too large.
    #[error(transparent)]
    Matrix(#[from] algebra::Error),
    /// The watcher asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The backend failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

#[cfg(feature = "wgpu")]
impl From<crate::GpuError> for Error {
    fn from(error: crate::GpuError) -> Self {
        Self::Backend(error.into())
    }
}

/// Eigenpairs in ascending order.
#[derive(Clone, Debug, PartialEq)]
pub struct EigenPairs {
    /// Eigenvalues, in the unit of K over the unit of M (Å⁻² for a surface).
    pub values: Vec<f64>,
    /// One vector per eigenvalue, one number per row, with `xᵀ M x = 1`. The entry of largest
    /// magnitude (the first of them) is positive.
    pub vectors: Vec<Vec<f64>>,
    /// Relative residual of each pair: see [`Options::tolerance`].
    pub residuals: Vec<f64>,
    /// Runs of two or more nearly equal eigenvalues; in each of them only the space is defined.
    pub clusters: Vec<Range<usize>>,
    /// How they were found.
    pub report: Report,
}

/// How eigenpairs were found. Sums are over all parts that were iterated; a part that is solved densely adds nothing to
/// `solves` and `restarts`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Report {
    /// Backend of the block products.
    pub backend: String,
    /// Connected parts of the matrix.
    pub parts: usize,
    /// Rows without stiffness and mass, e.g. vertices of no triangle: left out, zero in each vector.
    pub isolated: usize,
    /// Solved right-hand sides.
    pub solves: usize,
    /// Restarts of Krylov spaces.
    pub restarts: usize,
    /// Entries of the largest factor.
    pub factor_entries: usize,
    /// Whether every residual is within the tolerance.
    pub converged: bool,
    /// Whether the number of eigenvalues was confirmed; `None` when that was not asked for.
    pub verified: Option<bool>,
    /// Whether the last cluster may go on beyond the last pair.
    pub last_cluster_cut: bool,
}

/// The `k` smallest eigenpairs of `K x = λ M x`, fewer if the matrix has fewer.
///
/// K is symmetric, and `K − σM` positive definite for σ slightly below zero, as for every stiffness
/// matrix and graph Laplacian. Rows without stiffness *and* mass are left out. `k = 0` gives nothing.
///
/// ```
/// use geom_core::algebra::eigen::{Options, eigenpairs};
/// use geom_core::algebra::{Mass, SparseMatrix};
/// use geom_core::{Cpu, Run};
/// // The Laplacian of three nodes in a row: 0, 1 and 3.
/// let entries = [(0, 0, 1.0), (0, 1, -1.0), (1, 0, -1.0), (1, 1, 2.0), (1, 2, -1.0), (2, 1, -1.0), (2, 2, 1.0)];
/// let matrix = SparseMatrix::from_triplets(3, 3, &entries)?;
/// let mass = Mass::Lumped(vec![1.0; 3]);
/// let pairs = eigenpairs(&matrix, &mass, 2, &Options::default(), Run::on(&Cpu))?;
/// assert!(pairs.values[0].abs() < 1e-12 && (pairs.values[1] - 1.0).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Time goes into a factor and solves with it (surfaces), or into cycles (graphs); memory into about 3 `k` vectors and 15 blocks.
/// Progress is told in the stages `eigenpairs`, `factor`, `multigrid`, `vectors` and `verify`. The same bits for any number of
/// threads on the CPU.
///
/// # Errors
/// [`Error`], by cause. [`algebra::Error::NotPositiveDefinite`] says that the shift is not below all eigenvalues, or
/// that K is no stiffness; if the pencil has several connected parts, the row that it names is counted within its part.
pub fn eigenpairs<'a, B: SpectralBackend + ?Sized>(
    stiffness: impl Into<Operator<'a>>,
    mass: &Mass,
    k: usize,
    options: &Options,
    run: Run<'_, B>,
) -> Result<EigenPairs, Error> {
    let run = run.with(run.backend.as_spectral());
    eigenpairs_on(stiffness.into(), mass, k, options, run)
}

/// Not generic over backends, so that it is compiled once: checks, parts, a solver per part, and the smallest of all
/// they found in rows of the whole. Each part is asked for as many pairs as are wanted in all, since any of them may
/// have the lowest.
fn eigenpairs_on(
    stiffness: Operator<'_>,
    mass: &Mass,
    k: usize,
    options: &Options,
    run: On<'_>,
) -> Result<EigenPairs, Error> {
    options.check()?;
    let options = &Options {
        method: options.method.of(stiffness),
        ..options.clone()
    };
    if let (Method::Multigrid, Some(shift)) = (options.method, options.shift) {
        let must = "be left out: multigrid has no shift";
        return Err(OutOfRange::new("shift", shift, must).into());
    }
    // The graphs of an operator are symmetric by construction.
    stiffness.matrix().check_hermitian()?;
    let n = stiffness.rows();
    let lumped = parts::check_mass(stiffness, mass)?;
    let split = parts::split(stiffness, mass, &lumped);
    let mut report = Report {
        backend: run.backend.name(),
        parts: split.parts.len(),
        isolated: split.isolated,
        converged: true,
        verified: options.verify.then_some(true),
        ..Report::default()
    };
    // One pair more than asked shows whether a cluster is cut.
    let wanted = if k == 0 { 0 } else { k + 1 };
    let mut pairs: Vec<(f64, usize, Vec<f64>)> = Vec::new();
    let rows_in_all: usize = split.parts.iter().map(Vec::len).sum();
    let mut rows_done = 0;
    // Small parts, and those of which a third of the pairs is asked, are solved densely.
    let many = |rows: &[u32]| 3 * k > rows.len();
    let most = |rows: &[u32]| match many(rows) {
        true => LARGEST_DENSE,
        false => DENSE_ROWS,
    };
    // Part by part, so that each has its own zero and no mode spans two.
    let solve = |rows: &[u32], report: &mut Report| {
        let whole = rows.len() == n;
        let (part_k, part_m) = if whole {
            (None, None)
        } else {
            (
                Some(stiffness.part(rows)),
                Some(parts::restrict(mass, rows)),
            )
        };
        let pencil = Pencil {
            stiffness: part_k.as_ref().map_or(stiffness, Operator::from),
            mass: part_m.as_ref().unwrap_or(mass),
            lumped: rows.iter().map(|&i| lumped[i as usize]).collect(),
        };
        if rows.len() <= most(rows) {
            direct::pairs(&pencil, wanted)
        } else if many(rows) {
            let rows = rows.len();
            Err(Error::TooMany { asked: k, rows })
        } else {
            iterate(&pencil, k, options, run, report)
        }
    };
    for (batch, some) in split.parts.chunks(SIDE_BY_SIDE).enumerate() {
        if wanted == 0 {
            break;
        }
        run.progress("eigenpairs", rows_done as u64, rows_in_all as u64)?;
        let mut beside = parallel::map_each(some, |rows| {
            // Larger ones use all threads, and much memory.
            (rows.len() <= DENSE_ROWS).then(|| solve(rows, &mut Report::default()))
        });
        for (i, (rows, found)) in some.iter().zip(&mut beside).enumerate() {
            run.progress("eigenpairs", rows_done as u64, rows_in_all as u64)?;
            let found = match found.take() {
                Some(found) => found?,
                None => solve(rows, &mut report)?,
            };
            let index = batch * SIDE_BY_SIDE + i;
            pairs.extend(
                found
                    .into_iter()
                    .map(|(value, vector)| (value, index, vector)),
            );
            // Only the smallest can be among the answer.
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            pairs.truncate(wanted);
            rows_done += rows.len();
        }
    }

    // The answer in rows of the whole: zero on all parts but one.
    let beyond = (pairs.len() > k).then(|| pairs[k].0);
    pairs.truncate(k);
    let values: Vec<f64> = pairs.iter().map(|p| p.0).collect();
    let vectors: Vec<Vec<f64>> = pairs
        .into_par_iter()
        .map(|(_, index, vector)| {
            let rows = &split.parts[index];
            let mut all = if rows.len() == n {
                vector
            } else {
                let mut all = vec![0.0; n];
                for (&row, x) in rows.iter().zip(vector) {
                    all[row as usize] = x;
                }
                all
            };
            orient(&mut all);
            all
        })
        .collect();
    // Judged anew in f64, however the pairs were found.
    let whole = Pencil {
        stiffness,
        mass,
        lumped,
    };
    let residuals = residuals(&whole, &values, &vectors);
    report.converged = residuals.iter().all(|&r| r <= options.tolerance);
    let clusters = clusters(&values, options.cluster_gap);
    report.last_cluster_cut = beyond.is_some_and(|next| {
        values
            .last()
            .is_some_and(|&last| is_close(last, next, options.cluster_gap))
    });
    Ok(EigenPairs {
        values,
        vectors,
        residuals,
        clusters,
        report,
    })
}

/// The matrices of one connected part. Rows are those of the part.
struct Pencil<'a> {
    stiffness: Operator<'a>,
    mass: &'a Mass,
    /// Row sums of the mass, or its diagonal where they are not positive.
    lumped: Vec<f64>,
}

impl Pencil<'_> {
    fn rows(&self) -> usize {
        self.stiffness.rows()
    }

    /// `K − σM`.
    fn shifted(&self, shift: f64) -> Result<SparseMatrix, Error> {
        let stiffness = self.stiffness.assembled()?;
        Ok(match self.mass {
            Mass::Consistent(mass) => stiffness.plus(-shift, mass)?,
            Mass::Lumped(mass) => stiffness.plus(-shift, &SparseMatrix::diagonal_of(mass))?,
        })
    }

    /// `M X`.
    fn mass_times(&self, block: &[f64], columns: usize) -> Vec<f64> {
        parts::mass_times(self.mass, block, columns)
    }

    /// The constant of length one in the product of M.
    fn constant(&self) -> Vec<f64> {
        let n = self.rows();
        let total: f64 = self.mass_times(&vec![1.0; n], 1).iter().sum();
        vec![1.0 / total.sqrt(); n]
    }

    /// Does K map constants to zero? Then the constant is an eigenvector known beforehand. Row sums are compared with
    /// 10⁻¹² of the row's magnitudes: rounding of a stiffness passes, a boundary condition does not.
    fn constants_vanish(&self) -> bool {
        (0..self.rows()).all(|i| {
            let (sum, size) = self
                .stiffness
                .row(i)
                .fold((0.0, 0.0), |(s, m), (_, a)| (s + a, m + f64::abs(a)));
            sum.abs() <= 1e-12 * size
        })
    }
}

type Pair = (f64, Vec<f64>);

/// The smallest `k + 1` pairs of a large part, counted if that is asked for. A search may miss a copy of a multiple
/// eigenvalue, if the start block has nothing of it; the count tells, and it is sought again with other start vectors
/// and blocks twice as wide, four times in all.
fn iterate(
    pencil: &Pencil<'_>,
    k: usize,
    options: &Options,
    run: On<'_>,
    report: &mut Report,
) -> Result<Vec<Pair>, Error> {
    let mut options = options.clone();
    for attempt in 1.. {
        let found = match options.method {
            Method::Multigrid => davidson::pairs(pencil, k, &options, run, report)?,
            _ => lanczos::pairs(pencil, k, &options, run, report)?,
        };
        if !options.verify {
            return Ok(found);
        }
        run.progress("verify", 0, 1)?;
        let complete = is_complete(pencil, &found, k)?;
        run.progress("verify", 1, 1)?;
        if complete || attempt == ATTEMPTS {
            report.verified = Some(report.verified == Some(true) && complete);
            return Ok(found);
        }
        // Other start vectors, and room for more copies of one eigenvalue.
        options.seed = options.seed.wrapping_add(1);
        options.block = (2 * options.block).min(64);
    }
    unreachable!("the last attempt returns")
}

/// Are there as many eigenvalues below a gap at the end of the wanted ones as were found? The signs of
/// the pivots of K − μM say how many there are (Sylvester's law of inertia). The shift is put into a gap, where pivots
/// are surely not zero; pairs behind the last gap are not counted.
fn is_complete(pencil: &Pencil<'_>, found: &[Pair], k: usize) -> Result<bool, Error> {
    let values: Vec<f64> = found.iter().map(|p| p.0).collect();
    // The last gap wide enough to put a shift into.
    let gap = (1..=k.min(values.len() - 1))
        .rev()
        .find(|&j| !is_close(values[j - 1], values[j], 1e-6));
    let Some(count) = gap else {
        return Ok(false);
    };
    let shift = f64::midpoint(values[count - 1], values[count]);
    let shifted = pencil.shifted(shift)?;
    let below = algebra::Symbolic::of(&shifted)?.negative_eigenvalues(&shifted)?;
    Ok(below == Some(count))
}

/// The best pairs of the span of `count` columns, by K and M themselves. Small in memory beside the search, it takes
/// out of the vectors what single steps have left of each other, and gives `xᵀ M x = 1`.
fn rayleigh_ritz(pencil: &Pencil<'_>, mut x: Vec<f64>, count: usize) -> Result<Vec<Pair>, Error> {
    use dense::Tall;
    let tall = Tall::of(&x, count);
    let image = pencil.stiffness.multiply(&x, count);
    let a = dense::gram(&[tall], Tall::of(&image, count));
    drop(image);
    let g = match pencil.mass {
        Mass::Lumped(masses) => dense::weighted_gram(tall, masses),
        Mass::Consistent(mass) => {
            let image = mass.multiply(&x, count);
            dense::gram(&[tall], Tall::of(&image, count))
        }
    };
    let (r, dead) = dense::upper_cholesky(&g, count, 1e-12);
    if let Some(&row) = dead.first() {
        return Err(algebra::Error::NotPositiveDefinite { row }.into());
    }
    let inverse = dense::upper_inverse(&r, count);
    let c = dense::product(&[Tall::of(&a, count)], &inverse, count);
    let reduced = dense::gram(&[Tall::of(&inverse, count)], Tall::of(&c, count));
    let (values, u) = dense::symmetric_eigen(&reduced, count).ok_or_else(not_finite)?;
    let turn = dense::product(&[Tall::of(&inverse, count)], &u, count);
    dense::turn(&mut x, count, &turn);

    let vectors = dense::separate(&x, count);
    Ok(values.into_iter().zip(vectors).collect())
}

fn not_finite() -> Error {
    algebra::Error::NotFinite { row: 0, column: 0 }.into()
}

/// The entry of largest magnitude, the first of them, becomes positive. A vector and its negative are equally good;
/// without a rule, small changes of the input would flip signs.
fn orient(vector: &mut [f64]) {
    let largest = parallel::argmax(vector.len(), |i| vector[i].abs());
    if largest.is_some_and(|(i, _)| vector[i] < 0.0) {
        vector.iter_mut().for_each(|x| *x = -*x);
    }
}

/// `‖K x − λ M x‖ / (max(λ, λ₁) ‖M x‖)` with the first λ₁ that is not zero, in the norm of the inverse lumped mass, in
/// which `M x` of a unit vector has about the length 1.
fn residuals(
    pencil: &Pencil<'_>,
    values: &[f64],
    vectors: &[impl AsRef<[f64]> + Sync],
) -> Vec<f64> {
    let Pencil {
        stiffness, lumped, ..
    } = pencil;
    let top = values.last().copied().unwrap_or(0.0);
    // A zero has no relative residual of its own: the first value that is not zero lends its size.
    let first = values
        .iter()
        .copied()
        .find(|&v| v > 1e-10 * top)
        .unwrap_or_else(|| {
            let trace: f64 = stiffness.diagonal().iter().sum();
            let total: f64 = lumped.iter().sum();
            trace / total / lumped.len().max(1) as f64
        });
    let norms = |block: &[f64], columns| {
        let weight = |i: usize| {
            if lumped[i] > 0.0 {
                1.0 / lumped[i]
            } else {
                0.0
            }
        };
        let squares = dense::squares(block, columns, weight);
        squares.into_iter().map(f64::sqrt)
    };
    values
        .chunks(RESIDUALS)
        .zip(vectors.chunks(RESIDUALS))
        .flat_map(|(values, vectors)| {
            // Some side by side: one pass over the matrix.
            let c = values.len();
            let x = dense::together(vectors);
            let mx = pencil.mass_times(&x, c);
            let mut r = stiffness.multiply(&x, c);
            r.par_chunks_mut(c)
                .zip(mx.par_chunks(c))
                .with_min_len(4096)
                .for_each(|(r, mx)| {
                    for ((r, m), value) in r.iter_mut().zip(mx).zip(values) {
                        *r -= value * m;
                    }
                });
            let sizes = norms(&mx, c).zip(norms(&r, c));
            let share = |(&value, (size, r)): (&f64, (f64, f64))| r / (value.max(first) * size);
            values.iter().zip(sizes).map(share).collect::<Vec<f64>>()
        })
        .collect()
}

fn is_close(a: f64, b: f64, gap: f64) -> bool {
    (b - a).abs() <= gap * a.abs().max(b.abs())
}

/// Chains: in a run each value is close to the next, so its ends may differ by more than the gap.
fn clusters(values: &[f64], gap: f64) -> Vec<Range<usize>> {
    let mut out = Vec::new();
    let mut start = 0;
    for i in 1..=values.len() {
        if i == values.len() || !is_close(values[i - 1], values[i], gap) {
            if i - start > 1 {
                out.push(start..i);
            }
            start = i;
        }
    }
    out
}
