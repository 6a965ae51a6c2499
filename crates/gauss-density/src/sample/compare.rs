//! How far the surface of one model lies from that of another, as a share of the density.

use geom_core::compute::parallel;
use geom_core::{BrickGrid, ImplicitField, LatticeValues, Run};

use crate::backend::{DensityBackend, On};
use crate::error::Error;
use crate::model::Model;
use crate::options::{Cutoff, Options};
use crate::sample::band::sample_band;
use crate::sample::blocks::lattice_of;
use crate::sample::point::{PointSampler, root_on_edge};

/// A surface beside that of the original model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Comparison {
    /// `e_G^M`: the largest `|1 − G| / G` over the new surface, `G` the original density (Eq. 3.10).
    pub surface_max: f64,
    /// Its root mean square.
    pub surface_rms: f64,
    /// Surface points: the crossings of lattice edges with the new surface.
    pub points: u64,
    /// The share of the original interior (`G` at or above the band) that lies outside of the new surface.
    pub lost_interior: f64,
}

/// Points of surfaces lie above this density, and so does what is compared with them.
pub(crate) const NEAR: f64 = 0.25;

/// Compares the surface of a model with that of the original on the lattice of `options`. Both bands are sampled
/// on the backend; the roots on lattice edges stay on the CPU.
///
/// ```
/// use gauss_density::{Model, Options, compare};
/// use geom_core::{Cpu, Point3, Run};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let atom = |radius| Model::new(vec![Point3::origin()], vec![radius], vec![1.0], vec![]);
/// let apart = compare(&atom(1.9)?, &atom(2.0)?, &Options::default(), Run::on(&Cpu))?;
/// // On the smaller sphere the density of the larger is e^(2² − 1.9²).
/// let density = 0.39f64.exp();
/// assert!((apart.surface_max - (1.0 - 1.0 / density)).abs() < 1e-4);
/// # Ok(())
/// # }
/// ```
///
/// Not symmetric: errors are taken on the first model's surface, in the density of the second. Where the first model
/// has no surface on the lattice, all but `lost_interior` is 0.
///
/// # Errors
/// As of [`sample_band`](crate::sample_band()).
pub fn compare<B: DensityBackend + ?Sized>(
    model: &Model,
    original: &Model,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Comparison, Error> {
    compare_on(model, original, options, run.with(run.backend.as_density()))
}

fn compare_on(
    model: &Model,
    original: &Model,
    options: &Options,
    run: On<'_>,
) -> Result<Comparison, Error> {
    options.check()?;
    let sampler = PointSampler::above(NEAR, original, Cutoff(1e-5))?;
    let options = Options {
        bounds: Some(lattice_of(sampler.prepared(), options)?.bounds()),
        ..options.clone()
    };
    let old = sample_band(original, &options, run)?.grid;
    let new = sample_band(model, &options, run)?.grid;
    compare_bands((model, &new), (&sampler, &old), options.band[1])
}

/// The bands of both on the same lattice; at `high` and above the original is interior.
/// Sums per plane of points and in the order of planes, so that they have the same bits for any number of threads.
pub(crate) fn compare_bands(
    (model, new): (&Model, &BrickGrid),
    (original, old): (&PointSampler<'_>, &BrickGrid),
    high: f64,
) -> Result<Comparison, Error> {
    let sampler = PointSampler::above(NEAR, model, Cutoff(1e-5))?;
    let lattice = *new.lattice();
    let [nx, ny, nz] = lattice.counts;
    let planes: Vec<(f64, f64, u64, [u64; 2])> = parallel::map(nz, |z| {
        let (mut worst, mut squares, mut points, mut lost) = (0.0f64, 0.0, 0, [0u64; 2]);
        for y in 0..ny {
            for x in 0..nx {
                let p = [x, y, z];
                let inside = new.at(p) >= 1.0;
                if f64::from(old.at(p)) >= high {
                    lost[0] += u64::from(!inside);
                    lost[1] += 1;
                }
                for axis in 0..3 {
                    let mut q = p;
                    q[axis] += 1;
                    if q[axis] < lattice.counts[axis] && (new.at(q) >= 1.0) != inside {
                        let at = root_on_edge(&sampler, new, p, q);
                        let exact = original.value(&at);
                        // Inner surfaces of a hollow body have no counterpart.
                        if exact < high {
                            let off = (1.0 - exact).abs() / exact;
                            worst = worst.max(off);
                            squares += off * off;
                            points += 1;
                        }
                    }
                }
            }
        }
        (worst, squares, points, lost)
    });
    let mut result = Comparison::default();
    let mut lost = [0, 0];
    for (worst, squares, points, part) in planes {
        result.surface_max = result.surface_max.max(worst);
        result.surface_rms += squares;
        result.points += points;
        lost[0] += part[0];
        lost[1] += part[1];
    }
    result.surface_rms = (result.surface_rms / result.points.max(1) as f64).sqrt();
    result.lost_interior = lost[0] as f64 / lost[1].max(1) as f64;
    Ok(result)
}
