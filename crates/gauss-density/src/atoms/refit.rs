//! Refit of the remaining atoms to the original density near the surface (Eqs. 3.11–3.14), with
//! analytic derivatives and bounds: quasi-Newton steps (limited-memory BFGS; Nocedal and Wright, *Numerical
//! Optimization*, 2006, algorithm 7.4) that start from one step length per parameter.

use std::collections::VecDeque;

use geom_core::compute::parallel;
use geom_core::options::{OutOfRange, require};
use geom_core::{Aabb, BrickGrid, Run};

use crate::atoms::samples::{self, Wanted};
use crate::backend::{DensityBackend, On, RefitSamples, RefitSums, SampleCell};
use crate::error::Error;
use crate::kernel::cull::{ActiveSet, Scratch};
use crate::kernel::prepared::Prepared;
use crate::model::Model;
use crate::options::{Cutoff, Options};
use crate::sample::band::sample_band;
use crate::sample::blocks::lattice_of;
use crate::sample::compare::{Comparison, NEAR, compare_bands};
use crate::sample::point::PointSampler;

/// The share of the density that may be lost by leaving out far atoms in the sums of samples.
const SAMPLE_EPS: f64 = 2e-5;

/// How to refit.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Refit {
    /// Distance between samples, Å.
    pub spacing: f64,
    /// `(g_l, g_u)`: lattice points with an original density in between are samples, besides the
    /// crossings of lattice edges with the surface and both ends of those edges, where the density is
    /// at least `g_l / 2`: below that a relative error says nothing.
    pub band: [f64; 2],
    /// `ρ_x`: how far a centre may move along each axis, Å.
    /// As the two bounds below, between 0 and 10, it holds for the whole refit, from where it starts, not per step.
    /// Larger ones fit better and leave less chemical meaning; 0 fixes the centres.
    pub max_shift: f64,
    /// `ρ_r`: how much a radius may change, Å.
    pub max_radius_change: f64,
    /// `ρ_κ`: how much a decay may change, Å⁻².
    pub max_decay_change: f64,
    /// No decay falls below this, Å⁻².
    pub min_decay: f64,
    /// At most this many steps are tried.
    /// Each costs one sum over all samples, whether it is accepted or not.
    pub iterations: u32,
    /// Stop when no parameter changes by more than this (Å, Å⁻²).
    /// Not before one step has been accepted. 0 leaves it to `iterations`, and to steps that lead nowhere.
    pub tolerance: f64,
    /// Most bytes for the samples.
    pub max_memory: u64,
}

impl Default for Refit {
    fn default() -> Self {
        Self {
            spacing: 0.5,
            band: [0.9, 1.1],
            max_shift: 0.5,
            max_radius_change: 0.5,
            max_decay_change: 0.2,
            min_decay: 0.05,
            iterations: 200,
            tolerance: 1e-4,
            max_memory: 4 << 30,
        }
    }
}

impl Refit {
    /// Is every field in its range?
    pub fn check(&self) -> Result<(), OutOfRange> {
        for (name, value) in [
            ("max_shift", self.max_shift),
            ("max_radius_change", self.max_radius_change),
            ("max_decay_change", self.max_decay_change),
            ("tolerance", self.tolerance),
        ] {
            require((0.0..=10.0).contains(&value), name, value, "be in [0, 10]")?;
        }
        let fine = (1e-6..=10.0).contains(&self.min_decay);
        require(fine, "min_decay", self.min_decay, "be in [1e-6, 10] Å⁻²")?;
        self.sampling().check()
    }

    fn sampling(&self) -> Options {
        Options {
            spacing: self.spacing,
            band: self.band,
            max_memory: self.max_memory,
            cutoff: Cutoff(1e-5),
            ..Options::default()
        }
    }
}

/// A refitted model.
#[derive(Clone, Debug, PartialEq)]
pub struct Refitted {
    /// The same atoms and tree with other centres, radii and decays. They no longer have their chemical
    /// meaning.
    pub model: Model,
    /// What happened.
    pub report: RefitReport,
}

/// What a refit did.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RefitReport {
    /// Name of the backend.
    pub backend: String,
    /// Samples.
    pub samples: usize,
    /// Steps tried.
    pub iterations: u32,
    /// Steps that lowered the objective.
    pub accepted: u32,
    /// `½ Σ ((G − G0) / G0)²` over the samples, before and after.
    pub objective: [f64; 2],
    /// The largest `|G − G0| / G0` of a sample, before and after.
    pub worst: [f64; 2],
    /// The surface beside the original one, before and after.
    pub comparison: [Comparison; 2],
}

/// Moves atoms, radii and decays of a reduced model, within bounds, so that its density near the surface
/// comes close to that of the original. Protected atoms stay as they are. The objective never rises.
///
/// The bands and the sums of each step are taken on the backend; samples, steps and comparison of surfaces stay on
/// the CPU.
///
/// ```
/// use gauss_density::{Model, Refit, refit};
/// use geom_core::{Cpu, Point3, Run};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let atom = |radius| Model::new(vec![Point3::origin()], vec![radius], vec![1.0], vec![]);
/// let (original, smaller) = (atom(2.0)?, atom(1.9)?);
/// let fit = refit(&smaller, &original, &Refit::default(), Run::on(&Cpu))?;
/// let [before, after] = fit.report.objective;
/// assert!(after < 1e-3 * before && (fit.model.radii()[0] - 2.0).abs() < 0.01);
/// # Ok(())
/// # }
/// ```
///
/// The two may be any two models: neither the number of atoms nor the tree need have to do with the other's. Samples
/// are taken around the surface of the original, once; a model without one there comes back as it was.
///
/// # Errors
/// An option out of range; [`Error::TooManySamples`] or [`Error::GridTooLarge`] where memory does not suffice;
/// [`Error::Cancelled`]; what the backend refuses, and sums of it that are not finite.
pub fn refit<B: DensityBackend + ?Sized>(
    reduced: &Model,
    original: &Model,
    options: &Refit,
    run: Run<'_, B>,
) -> Result<Refitted, Error> {
    refit_on(
        reduced,
        original,
        options,
        run.with(run.backend.as_density()),
    )
}

fn refit_on(
    reduced: &Model,
    original: &Model,
    options: &Refit,
    run: On<'_>,
) -> Result<Refitted, Error> {
    options.check()?;
    let sampler = PointSampler::above(NEAR, original, Cutoff(SAMPLE_EPS))?;
    let sampling = Options {
        bounds: Some(lattice_of(sampler.prepared(), &options.sampling())?.bounds()),
        ..options.sampling()
    };
    let allowed = Allowed::around(reduced, options);
    let old = sample_band(original, &sampling, run)?.grid;
    let cells = samples_of(&allowed.widest(reduced), &sampler, &old, options)?;
    let beside = |model: &Model| {
        let new = sample_band(model, &sampling, run)?.grid;
        compare_bands((model, &new), (&sampler, &old), sampling.band[1])
    };
    let before = beside(reduced)?;
    let mut descent = Descent::start(reduced, &cells, allowed, run)?;
    let mut report = RefitReport {
        backend: run.backend.name(),
        samples: cells.iter().map(|c| c.points.len()).sum(),
        iterations: 0,
        accepted: 0,
        objective: [descent.sums.objective; 2],
        worst: [descent.sums.worst; 2],
        comparison: [before; 2],
    };
    if report.samples > 0 {
        descent.run(&mut report, options, run)?;
    }
    let model = with_parameters(reduced, &descent.at);
    report.objective[1] = descent.sums.objective;
    report.worst[1] = descent.sums.worst;
    if report.accepted > 0 {
        report.comparison[1] = beside(&model)?;
    }
    Ok(Refitted { model, report })
}

/// The samples of the original's surface, in cells of the atoms of the reduced model, as `widest` as they may become.
fn samples_of(
    widest: &Model,
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    options: &Refit,
) -> Result<Vec<SampleCell>, Error> {
    let wanted = Wanted {
        band: options.band,
        ends: true,
        interior: None,
        eps: SAMPLE_EPS,
        max_memory: options.max_memory,
    };
    let of_original = samples::collect(sampler, grid, &wanted)?;
    Ok(with_atoms_of(&Prepared::new(widest), of_original, options))
}

/// The way down from the reduced model: where it is, and what it has learnt of the objective.
struct Descent<'a> {
    start: &'a Model,
    /// Where the backend keeps them.
    samples: Box<dyn RefitSamples + 'a>,
    allowed: Allowed,
    at: Vec<Five>,
    sums: RefitSums,
    /// Those of a trial, for reuse.
    next: RefitSums,
    memory: Memory,
    /// Length of the next step, relative to the one that the memory gives.
    tau: f64,
}

impl<'a> Descent<'a> {
    fn start(
        reduced: &'a Model,
        cells: &'a [SampleCell],
        allowed: Allowed,
        run: On<'a>,
    ) -> Result<Self, Error> {
        let mut sums = RefitSums::default();
        let mut samples = run.backend.refit_samples(&Prepared::new(reduced), cells)?;
        samples.sums(reduced, &mut sums)?;
        let name = run.backend.name();
        sums.check_lengths(&name, reduced.atoms())?;
        sums.check_finite(&name)?;
        Ok(Self {
            start: reduced,
            samples,
            allowed,
            at: parameters(reduced),
            sums,
            next: RefitSums::default(),
            memory: Memory::default(),
            tau: 1.0,
        })
    }

    /// Steps until nothing changes, nothing gets better, or the steps are used up.
    fn run(&mut self, report: &mut RefitReport, options: &Refit, run: On<'_>) -> Result<(), Error> {
        let most = u64::from(options.iterations);
        while report.iterations < options.iterations {
            run.progress("refit", u64::from(report.iterations), most)?;
            let step = self.memory.step(&self.at, &self.sums, &self.allowed);
            let trial = self.allowed.moved(&self.at, &step, self.tau);
            let change = largest(&difference(&trial, &self.at));
            if change < options.tolerance && report.accepted > 0 || change == 0.0 {
                break;
            }
            report.iterations += 1;
            if self.accepts(trial, run)? {
                report.accepted += 1;
            } else if !self.shortens() {
                break;
            }
        }
        Ok(())
    }

    /// Goes to a trial if the objective is lower there.
    fn accepts(&mut self, trial: Vec<Five>, run: On<'_>) -> Result<bool, Error> {
        let model = with_parameters(self.start, &trial);
        self.samples.sums(&model, &mut self.next)?;
        let name = run.backend.name();
        self.next.check_lengths(&name, model.atoms())?;
        // A trial may go too far for numbers: then it is not lower, and the next step is shorter.
        let lower = self.next.objective < self.sums.objective;
        if lower {
            self.next.check_finite(&name)?;
            let change = difference(&self.next.gradient, &self.sums.gradient);
            self.memory.learn(difference(&trial, &self.at), change);
            self.at = trial;
            std::mem::swap(&mut self.sums, &mut self.next);
            self.tau = 1.0;
        }
        Ok(lower)
    }

    /// A shorter step next; or, when the memory points to nothing good, one from the gradient alone. `false` when
    /// neither is left.
    fn shortens(&mut self) -> bool {
        self.tau *= 0.5;
        if self.tau < 0.2 && self.memory.forget() {
            self.tau = 1.0;
        }
        self.tau >= 1e-6
    }
}

/// The same points with the atoms of another model that can matter there after the refit: `widest` has its largest
/// radii and smallest decays.
fn with_atoms_of(
    widest: &Prepared<'_>,
    mut cells: Vec<SampleCell>,
    options: &Refit,
) -> Vec<SampleCell> {
    // A moved centre is like a moved point.
    let slack = options.max_shift * 3.0f64.sqrt();
    let floor = 0.5 * options.band[0];
    let reach = widest.reach.radius(SAMPLE_EPS / 4.0, floor) + slack;
    let clusters = widest.clusters();
    parallel::for_each_init(&mut cells, Scratch::default, |scratch, _, whole| {
        let cell =
            std::mem::replace(whole, SampleCell::new(vec![], vec![], vec![])).at_least(floor);
        if cell.points.is_empty() {
            return;
        }
        let around = Aabb::of_points(&cell.points).inflated(slack);
        let near = widest.near(&clusters, &around, reach);
        let all = ActiveSet::gather(widest, &widest.atoms_near(&near, &around, reach));
        let mut kept = ActiveSet::default();
        all.cull_into(
            &(&around).into(),
            0.75 * SAMPLE_EPS,
            floor,
            scratch,
            &mut kept,
        );
        *whole = SampleCell {
            exact: cell.exact,
            target: cell.target,
            ..SampleCell::new(kept.atom, kept.levels, cell.points)
        };
    });
    cells.retain(|cell| !cell.points.is_empty());
    cells
}

/// Something for x, y, z, radius and decay of an atom.
type Five = [f64; 5];

fn parameters(model: &Model) -> Vec<Five> {
    let others = model.radii().iter().zip(model.decays());
    let all = model.centers().iter().zip(others);
    all.map(|(x, (&r, &kappa))| [x.x, x.y, x.z, r, kappa])
        .collect()
}

fn with_parameters(model: &Model, all: &[Five]) -> Model {
    model.with_atoms(
        all.iter().map(|p| [p[0], p[1], p[2]].into()).collect(),
        all.iter().map(|p| p[3]).collect(),
        all.iter().map(|p| p[4]).collect(),
    )
}

fn difference(a: &[Five], b: &[Five]) -> Vec<Five> {
    let pairs = a.iter().zip(b);
    pairs
        .map(|(a, b)| std::array::from_fn(|p| a[p] - b[p]))
        .collect()
}

fn dot(a: &[Five], b: &[Five]) -> f64 {
    let products = a.as_flattened().iter().zip(b.as_flattened());
    products.map(|(a, b)| a * b).sum()
}

/// `to += factor · from`.
fn add(to: &mut [Five], factor: f64, from: &[Five]) {
    let pairs = to.as_flattened_mut().iter_mut().zip(from.as_flattened());
    pairs.for_each(|(to, from)| *to += factor * from);
}

fn largest(of: &[Five]) -> f64 {
    let all = of.as_flattened().iter();
    all.fold(0.0, |most, v| most.max(v.abs()))
}

/// The bounds of the parameters; a protected atom's are its own.
/// A box, so that a step is projected onto it by a clamp, component by component.
struct Allowed {
    low: Vec<Five>,
    high: Vec<Five>,
}

impl Allowed {
    fn around(start: &Model, options: &Refit) -> Self {
        let by = [
            options.max_shift,
            options.max_shift,
            options.max_shift,
            options.max_radius_change,
            options.max_decay_change,
        ];
        let of = |a: usize, at: &Five, sign: f64| -> Five {
            let free = if start.is_protected(a) { 0.0 } else { sign };
            std::array::from_fn(|p| at[p] + free * by[p])
        };
        let all = parameters(start);
        let bounds = |sign| all.iter().enumerate().map(move |(a, at)| (a, *at, sign));
        let high = bounds(1.0).map(|(a, at, sign)| of(a, &at, sign)).collect();
        let low = bounds(-1.0).map(|(a, at, sign)| {
            let [x, y, z, r, kappa] = of(a, &at, sign);
            // A decay that starts below the smallest one may stay there.
            [x, y, z, r.max(0.0), kappa.max(options.min_decay.min(at[4]))]
        });
        Self {
            low: low.collect(),
            high,
        }
    }

    /// The model whose atoms reach farthest.
    fn widest(&self, start: &Model) -> Model {
        start.with_atoms(
            start.centers().to_vec(),
            self.high.iter().map(|p| p[3]).collect(),
            self.low.iter().map(|p| p[4]).collect(),
        )
    }

    /// Where a step of relative length `tau` leads.
    fn moved(&self, at: &[Five], step: &[Five], tau: f64) -> Vec<Five> {
        let mut new = at.to_vec();
        add(&mut new, tau, step);
        let bounds = self.low.as_flattened().iter().zip(self.high.as_flattened());
        for (value, (low, high)) in new.as_flattened_mut().iter_mut().zip(bounds) {
            *value = value.clamp(*low, *high);
        }
        new
    }

    /// Takes out of a step what leads out at once.
    fn keep_inside(&self, at: &[Five], step: &mut [Five]) {
        let bounds = self.low.as_flattened().iter().zip(self.high.as_flattened());
        let places = at.as_flattened().iter().zip(bounds);
        for (step, (at, (low, high))) in step.as_flattened_mut().iter_mut().zip(places) {
            if *step < 0.0 && at <= low || *step > 0.0 && at >= high {
                *step = 0.0;
            }
        }
    }
}

/// The last steps and the changes of the gradient that came with them.
/// (`s` and `y` of the literature on BFGS.) What is remembered has `s · y > 0`, so the implied matrix is positive
/// definite and a step leads downhill but for what the bounds take away.
#[derive(Default)]
struct Memory {
    pairs: VecDeque<(Vec<Five>, Vec<Five>)>,
}

impl Memory {
    /// Steps that are remembered.
    const STEPS: usize = 12;

    fn learn(&mut self, step: Vec<Five>, change: Vec<Five>) {
        let bent = dot(&step, &change);
        if bent > 1e-10 * (dot(&step, &step) * dot(&change, &change)).sqrt() {
            self.pairs.push_back((step, change));
            if self.pairs.len() > Self::STEPS {
                self.pairs.pop_front();
            }
        }
    }

    /// Forgets everything; was there something?
    fn forget(&mut self) -> bool {
        let any = !self.pairs.is_empty();
        self.pairs.clear();
        any
    }

    /// The next step. Without a memory: the gradient over the diagonal of the Gauss–Newton matrix.
    /// The two-loop recursion, started from that diagonal, scaled to the last change. If the bounds leave nothing of it
    /// that leads downhill, the memory is emptied and the plain step taken.
    fn step(&mut self, at: &[Five], sums: &RefitSums, allowed: &Allowed) -> Vec<Five> {
        let mut step = sums.gradient.clone();
        step.as_flattened_mut().iter_mut().for_each(|g| *g = -*g);
        allowed.keep_inside(at, &mut step);
        let downhill = step.clone();
        let scale = inverse_diagonal(&sums.curvature);
        let mut shares = Vec::new();
        for (s, y) in self.pairs.iter().rev() {
            let share = dot(s, &step) / dot(s, y);
            add(&mut step, -share, y);
            shares.push(share);
        }
        if let Some((s, y)) = self.pairs.back() {
            let factor = dot(s, y) / dot(y, &times(y, &scale));
            step.as_flattened_mut()
                .iter_mut()
                .for_each(|v| *v *= factor);
        }
        step = times(&step, &scale);
        for ((s, y), share) in self.pairs.iter().zip(shares.iter().rev()) {
            let other = dot(y, &step) / dot(s, y);
            add(&mut step, share - other, s);
        }
        allowed.keep_inside(at, &mut step);
        if dot(&step, &downhill) > 0.0 || !self.forget() {
            return step;
        }
        times(&downhill, &scale)
    }
}

fn times(a: &[Five], b: &[Five]) -> Vec<Five> {
    let pairs = a.iter().zip(b);
    pairs
        .map(|(a, b)| std::array::from_fn(|p| a[p] * b[p]))
        .collect()
}

/// One over the curvatures, damped so that parameters that hardly act get no wild steps; 0 if nothing acts.
fn inverse_diagonal(curvature: &[Five]) -> Vec<Five> {
    let mut most = [0.0f64; 5];
    for of_atom in curvature {
        for (top, &c) in most.iter_mut().zip(of_atom) {
            *top = top.max(c);
        }
    }
    let of_centers = most[0].max(most[1]).max(most[2]);
    most[..3].fill(of_centers);
    let inverse = |of_atom: &Five| -> Five {
        std::array::from_fn(|p| {
            let damped = of_atom[p] + 1e-3 * most[p];
            if damped > 0.0 { 1.0 / damped } else { 0.0 }
        })
    };
    curvature.iter().map(inverse).collect()
}
