//! How two matched shapes differ: locally, and as a whole.

use geom_core::{Point3, Run};

use crate::Error;
use crate::backend::{CorrespBackend, Kernels, On, RotationTask};
use crate::fit::{Neighbourhoods, distortions};
use crate::options::CompareOptions;
use crate::shape::{Map, VoxelShape};
use crate::truth::percentile;

/// Where the first shape differs from the second: a value per boundary node of the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// δ: by how much the diameter there differs from that of the partner, Å.
    pub diameters: Vec<f64>,
    /// e: root mean square distortion of the neighbourhood, Å.
    pub distortions: Vec<f64>,
    /// All of them at once.
    pub report: CompareReport,
}

/// A comparison in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CompareReport {
    /// Of the differences of diameters, Å.
    pub diameters: Spread,
    /// Of the distortions, Å.
    pub distortions: Spread,
    /// The share of the second shape's boundary nodes that are partners.
    pub coverage: f64,
}

/// Mean, 95th percentile and largest of some values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The 95th percentile.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        Self {
            mean: sorted.iter().sum::<f64>() / sorted.len().max(1) as f64,
            p95: percentile(&sorted, 0.95),
            max: sorted.last().copied().unwrap_or(0.0),
        }
    }
}

impl CompareReport {
    /// A distance of the shapes for retrieval, Å: the mean distortion, which says how far one has to be bent, and the
    /// mean difference of diameters, which says how much thicker it is, over the share of the other shape that is met.
    pub fn distance(&self) -> f64 {
        (self.distortions.mean + self.diameters.mean) / self.coverage.max(1e-3)
    }
}

/// Compares two shapes by a map of boundary nodes; `forward` as in [`Correspondence`](crate::Correspondence).
///
/// ```
/// use spectral_corresp::geom_core::{Cpu, Lattice, Point3, Run};
/// use spectral_corresp::{CompareOptions, Map, ShapeOptions, VoxelShape, compare};
/// let lattice = Lattice { origin: Point3::origin(), spacing: 1.5, counts: [10, 6, 6] };
/// let body = VoxelShape::of_flags(&lattice, vec![true; 360], &ShapeOptions::default(), Run::on(&Cpu))?;
/// let itself = Map::new(&body, &body, (0..body.boundary().len() as u32).collect())?;
/// let found = compare(&body, &body, &itself, &CompareOptions::default(), Run::on(&Cpu))?;
/// assert_eq!(found.report.coverage, 1.0);
/// assert!(found.report.distance() < 1e-6);
/// # Ok::<(), spectral_corresp::Error>(())
/// ```
pub fn compare<B: CorrespBackend + ?Sized>(
    a: &VoxelShape,
    b: &VoxelShape,
    forward: &Map,
    options: &CompareOptions,
    run: Run<'_, B>,
) -> Result<Comparison, Error> {
    compared(a, b, forward, options, run.with(run.backend.as_corresp()))
}

fn compared(
    a: &VoxelShape,
    b: &VoxelShape,
    forward: &Map,
    options: &CompareOptions,
    run: On<'_>,
) -> Result<Comparison, Error> {
    options.check()?;
    forward.check(a, b)?;
    run.progress("comparison", 0, 1)?;
    let there = b.boundary_points();
    let images: Vec<Point3> = forward.iter().map(|&j| there[j as usize]).collect();
    let near = Neighbourhoods::within(
        a.boundary_points(),
        options.radius,
        options.pairs,
        options.seed,
    )?;
    let task = RotationTask {
        rest: a.boundary_points(),
        now: &images,
        near: &near,
    };
    let mut rotations = Vec::new();
    run.rotations(&task, &mut rotations)?;
    let distortions: Vec<f64> = distortions(&task, &rotations)
        .into_iter()
        .map(f64::sqrt)
        .collect();
    let pairs = a.diameters().iter().zip(forward);
    let diameters: Vec<f64> = pairs
        .map(|(d, &j)| (d - b.diameters()[j as usize]).abs())
        .collect();
    let mut met = vec![false; there.len()];
    forward.iter().for_each(|&j| met[j as usize] = true);
    let report = CompareReport {
        diameters: Spread::of(&diameters),
        distortions: Spread::of(&distortions),
        coverage: met.iter().filter(|m| **m).count() as f64 / met.len() as f64,
    };
    run.progress("comparison", 1, 1)?;
    Ok(Comparison {
        diameters,
        distortions,
        report,
    })
}

/// How far nodes come back from where they went, Å: along maps from a shape through others to itself. `shapes[k]` is
/// mapped to the next one by `maps[k]`, the last one to the first.
///
/// With maps of all pairs of three shapes this tells a wrong one without a ground truth: right maps lead back.
pub fn cycle_error(shapes: &[&VoxelShape], maps: &[&Map]) -> Result<Spread, Error> {
    if maps.len() != shapes.len() || shapes.is_empty() {
        return Err(Error::Length {
            what: "maps of a cycle of shapes",
            found: maps.len(),
            expected: shapes.len().max(1),
        });
    }
    for (k, map) in maps.iter().enumerate() {
        map.check(shapes[k], shapes[(k + 1) % shapes.len()])?;
    }
    let points = shapes[0].boundary_points();
    let back = |i: u32| maps.iter().fold(i, |at, map| map[at as usize]);
    let errors =
        (0..points.len() as u32).map(|i| (points[back(i) as usize] - points[i as usize]).norm());
    Ok(Spread::of(&errors.collect::<Vec<_>>()))
}

/// Distances of all pairs of shapes, row by row: `map(i, j)` gives the map from shape i to shape j. As maps differ with
/// the direction, so do the distances; each entry is the mean of both.
pub fn distances<B: CorrespBackend + ?Sized>(
    shapes: &[&VoxelShape],
    map: impl Fn(usize, usize) -> Result<Map, Error>,
    options: &CompareOptions,
    run: Run<'_, B>,
) -> Result<Vec<f64>, Error> {
    let (n, run) = (shapes.len(), run.with(run.backend.as_corresp()));
    let mut out = vec![0.0; n * n];
    for (i, a) in shapes.iter().enumerate() {
        for (j, b) in shapes.iter().enumerate().filter(|(j, _)| *j != i) {
            let report = compared(a, b, &map(i, j)?, options, run)?.report;
            let half = 0.5 * report.distance();
            out[i * n + j] += half;
            out[j * n + i] += half;
        }
    }
    Ok(out)
}
