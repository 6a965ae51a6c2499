//! Refit of the remaining atoms to the original density near the surface (Eqs. 3.11–3.14), with
//! analytic derivatives, one step length per parameter, and bounds.

use geom_core::Run;
use rayon::prelude::*;

use crate::backend::DensityBackend;
use crate::band::sample_band;
use crate::compare::{Comparison, NEAR, compare_on};
use crate::error::{Error, require};
use crate::model::Model;
use crate::options::{Cutoff, Options};
use crate::point::PointSampler;
use crate::prepared::Prepared;
use crate::sample::lattice_of;
use crate::sites::{self, SiteCell, Wanted};
use crate::terms::RefitSums;

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
    pub max_shift: f64,
    /// `ρ_r`: how much a radius may change, Å.
    pub max_radius_change: f64,
    /// `ρ_κ`: how much a decay may change, Å⁻².
    pub max_decay_change: f64,
    /// No decay falls below this, Å⁻².
    pub min_decay: f64,
    /// At most this many steps are tried.
    pub iterations: u32,
    /// Stop when no parameter changes by more than this (Å, Å⁻²).
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
    pub fn check(&self) -> Result<(), Error> {
        for (name, value) in [
            ("max_shift", self.max_shift),
            ("max_radius_change", self.max_radius_change),
            ("max_decay_change", self.max_decay_change),
            ("tolerance", self.tolerance),
        ] {
            require((0.0..=10.0).contains(&value), name, value, "in [0, 10]")?;
        }
        let fine = (1e-6..=10.0).contains(&self.min_decay);
        require(fine, "min_decay", self.min_decay, "in [1e-6, 10] Å⁻²")?;
        self.sampling().check()
    }

    fn sampling(&self) -> Options {
        Options {
            spacing: self.spacing,
            band: self.band,
            max_memory: self.max_memory,
            cutoff: Cutoff::AfterPowers(1e-5),
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
pub fn refit<B: DensityBackend + ?Sized>(
    reduced: &Model,
    original: &Model,
    options: &Refit,
    run: Run<'_, B>,
) -> Result<Refitted, Error> {
    options.check()?;
    let sampler = PointSampler::above(NEAR, original, Cutoff::AfterPowers(SAMPLE_EPS))?;
    let sampling = Options {
        bounds: Some(lattice_of(sampler.prepared(), &options.sampling())?.bounds()),
        ..options.sampling()
    };
    let grid = sample_band(original, &sampling, run)?.grid;
    let wanted = Wanted {
        band: options.band,
        ends: true,
        interior: None,
        eps: SAMPLE_EPS,
        max_memory: options.max_memory,
    };
    let of_original = sites::collect(&sampler, &grid, &wanted)?;
    drop(grid);
    let cells = with_atoms_of(&Prepared::new(reduced), of_original, options);
    let samples = cells.iter().map(|c| c.points.len()).sum();

    let mut model = reduced.clone();
    let mut sums = run.backend.refit_sums(&Prepared::new(&model), &cells)?;
    let mut report = RefitReport {
        backend: run.backend.name(),
        samples,
        iterations: 0,
        accepted: 0,
        objective: [sums.objective; 2],
        worst: [sums.worst; 2],
        comparison: [compare_on(reduced, &sampler, &sampling, run)?; 2],
    };
    let mut tau = 1.0;
    while report.iterations < options.iterations && samples > 0 {
        run.progress(
            "refit",
            u64::from(report.iterations),
            u64::from(options.iterations),
        )?;
        report.iterations += 1;
        let (trial, change) = stepped(&model, reduced, &sums, tau, options);
        if change < options.tolerance && report.accepted > 0 || change == 0.0 {
            break;
        }
        let next = run.backend.refit_sums(&Prepared::new(&trial), &cells)?;
        if next.objective < sums.objective {
            (model, sums) = (trial, next);
            report.accepted += 1;
            tau = (1.5 * tau).min(1.0);
        } else {
            tau *= 0.5;
            if tau < 1e-6 {
                break;
            }
        }
    }
    report.objective[1] = sums.objective;
    report.worst[1] = sums.worst;
    if report.accepted > 0 {
        report.comparison[1] = compare_on(&model, &sampler, &sampling, run)?;
    }
    Ok(Refitted { model, report })
}

/// The same points with the atoms of another model that can matter there after the refit.
fn with_atoms_of(reduced: &Prepared<'_>, cells: Vec<SiteCell>, options: &Refit) -> Vec<SiteCell> {
    use crate::members::{Members, Scratch};
    use geom_core::Aabb;
    // A moved centre is like a moved point.
    let slack = options.max_shift * 3.0f64.sqrt();
    let floor = 0.5 * options.band[0];
    let reach = reduced.reach.radius(SAMPLE_EPS / 4.0, floor) + slack + options.max_radius_change;
    let clusters = reduced.clusters();
    cells
        .into_par_iter()
        .map(|cell| cell.at_least(floor))
        .filter(|cell| !cell.points.is_empty())
        .map_init(Scratch::default, |scratch, cell| {
            let around = Aabb::of_points(&cell.points).inflated(slack);
            let near = reduced.near(&clusters, &around, reach);
            let all = Members::gather(&reduced.tree, &reduced.atoms_near(&near, &around, reach));
            let mut kept = Members::default();
            all.cull_into(
                &(&around).into(),
                0.75 * SAMPLE_EPS,
                floor,
                scratch,
                &mut kept,
            );
            SiteCell {
                exact: cell.exact,
                target: cell.target,
                ..SiteCell::new(kept.atom, kept.levels, cell.points)
            }
        })
        .collect()
}

/// The model after a step of relative length `tau`, within the bounds around `start`; and the largest change.
fn stepped(
    model: &Model,
    start: &Model,
    sums: &RefitSums,
    tau: f64,
    options: &Refit,
) -> (Model, f64) {
    // Parameters that hardly act get no wild steps.
    let mut largest = [0.0f64; 5];
    for curvature in &sums.curvature {
        for (top, &c) in largest.iter_mut().zip(curvature) {
            *top = top.max(c);
        }
    }
    largest = [
        largest[0].max(largest[1]).max(largest[2]),
        largest[0].max(largest[1]).max(largest[2]),
        largest[0].max(largest[1]).max(largest[2]),
        largest[3],
        largest[4],
    ];
    let mut change: f64 = 0.0;
    let (mut centers, mut radii, mut decays) = (
        model.centers().to_vec(),
        model.radii().to_vec(),
        model.decays().to_vec(),
    );
    for a in (0..model.atoms()).filter(|&a| !model.is_protected(a)) {
        let step = |p: usize| {
            let damped = sums.curvature[a][p] + 1e-3 * largest[p];
            if damped > 0.0 {
                -tau * sums.gradient[a][p] / damped
            } else {
                0.0
            }
        };
        let mut moved = |value: &mut f64, p: usize, low: f64, high: f64| {
            let new = (*value + step(p)).clamp(low, high.max(low));
            change = change.max((new - *value).abs());
            *value = new;
        };
        let at = start.centers()[a];
        for k in 0..3 {
            moved(
                &mut centers[a][k],
                k,
                at[k] - options.max_shift,
                at[k] + options.max_shift,
            );
        }
        let (r, kappa) = (start.radii()[a], start.decays()[a]);
        let by = options.max_radius_change;
        moved(&mut radii[a], 3, (r - by).max(0.0), r + by);
        let by = options.max_decay_change;
        // A decay that starts below the smallest one may stay there.
        let least = (kappa - by).max(options.min_decay.min(kappa));
        moved(&mut decays[a], 4, least, kappa + by);
    }
    (model.with_atoms(centers, radii, decays), change)
}
