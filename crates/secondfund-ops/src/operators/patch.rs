//! The matrices of patches that share a basis, and what they do to the surface itself: the kernels of the CPU.
//!
//! Functions are taken four at a time and points in batches, so that the inner loops are products of small dense blocks.

use geom_core::compute::parallel;
use geom_core::{Point3, Vector3};
use rayon::prelude::*;

use super::pattern::packed;
use crate::backend::{PatchMatrices, PatchTask, Slots};
use crate::catmull::{Jet, ROWS};
use crate::forms::{Forms, Symmetric};

/// Functions that are taken together.
const LANES: usize = 4;
/// Points that are taken together: what they need stays in the nearest cache.
const BATCH: usize = 16;

type Lane = [f64; LANES];

/// A task with its basis in lanes, the last ones filled up with zeros.
struct Lanes<'a> {
    task: &'a PatchTask<'a>,
    /// Lanes of a row.
    width: usize,
    basis: Vec<Lane>,
}

/// The surface at a point of the quadrature.
struct At {
    /// `x_u`, `x_v`.
    first: [Vector3; 2],
    forms: Forms,
    /// Of the point, with its area.
    weight: f64,
    /// Times the weight.
    conductivity: Symmetric,
}

/// What a batch of points adds.
#[derive(Default)]
struct Batch {
    /// Points that have an area: which, and their weight with it.
    points: Vec<(usize, f64)>,
    /// Per point and lane the flux `A ∇Nᵢ` in both directions.
    flux: Vec<[Lane; 2]>,
    /// The square matrices of a patch, row after row in lanes.
    stiffness: Vec<Lane>,
    mass: Vec<Lane>,
}

/// Places of a patch, coordinate by coordinate, and the factors of its weight.
struct Places {
    points: Vec<[Lane; 3]>,
    factors: Vec<Lane>,
}

impl<'a> Lanes<'a> {
    fn of(task: &'a PatchTask<'a>) -> Self {
        let width = task.functions.div_ceil(LANES);
        let rows = task.basis.chunks_exact(task.functions.max(1));
        Self {
            task,
            width,
            basis: rows.flat_map(in_lanes).collect(),
        }
    }

    /// One of the six rows of a point.
    #[inline]
    fn row(&self, point: usize, row: usize) -> &[Lane] {
        let start = (point * ROWS + row) * self.width;
        &self.basis[start..start + self.width]
    }

    fn places(&self, patch: usize) -> Places {
        let n = self.task.functions;
        let range = patch * n..(patch + 1) * n;
        let points = self.task.points[range.clone()].chunks(LANES).map(|points| {
            let mut lanes = [[0.0; LANES]; 3];
            for (l, p) in points.iter().enumerate() {
                (0..3).for_each(|c| lanes[c][l] = p[c]);
            }
            lanes
        });
        let factors = match self.task.factors {
            [] => Vec::new(),
            f => in_lanes(&f[range]).collect(),
        };
        Places {
            points: points.collect(),
            factors,
        }
    }

    #[inline]
    fn jet(&self, point: usize, places: &Places) -> Jet {
        let mut rows = [Vector3::zeros(); ROWS];
        for (k, out) in rows.iter_mut().enumerate() {
            let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for (basis, place) in self.row(point, k).iter().zip(&places.points) {
                for l in 0..LANES {
                    x[l] += basis[l] * place[0][l];
                    y[l] += basis[l] * place[1][l];
                    z[l] += basis[l] * place[2][l];
                }
            }
            *out = Vector3::new(total(x), total(y), total(z));
        }
        let [x, u, v, uu, uv, vv] = rows;
        Jet {
            position: Point3::from(x),
            first: [u, v],
            second: [uu, uv, vv],
        }
    }

    /// The surface at a point; nothing where it has no area.
    fn at(&self, point: usize, places: &Places) -> Option<At> {
        let jet = self.jet(point, places);
        let area = jet.area_normal().norm();
        // NaN, too.
        if area.is_nan() || area <= self.task.least {
            return None;
        }
        let factor = match &places.factors[..] {
            [] => 1.0,
            factors => {
                let pairs = self.row(point, 0).iter().zip(factors);
                let product =
                    |(n, f): (&Lane, &Lane)| n[0] * f[0] + n[1] * f[1] + n[2] * f[2] + n[3] * f[3];
                pairs.map(product).sum()
            }
        };
        let weight = self.task.weights[point] * area;
        let forms = jet.forms();
        let conductor = &self.task.conductor;
        Some(At {
            first: jet.first,
            conductivity: conductor.in_coordinates(&forms, factor) * weight,
            forms,
            weight,
        })
    }

    /// The matrices of a patch, in place of what was there, and the number of points without area.
    fn matrices(&self, patch: usize, batch: &mut Batch, out: Slots<'_>) {
        let (n, width) = (self.task.functions, self.width);
        let places = self.places(patch);
        let square = n * width;
        batch.stiffness.clear();
        batch
            .stiffness
            .resize(square.next_multiple_of(LANES * width), [0.0; LANES]);
        batch.mass.clone_from(&batch.stiffness);
        out.sums.fill([0.0; 3]);
        let count = self.task.weights.len();
        *out.skipped = 0;
        for first in (0..count).step_by(BATCH) {
            batch.points.clear();
            batch.flux.clear();
            for q in first..count.min(first + BATCH) {
                let Some(at) = self.at(q, &places) else {
                    *out.skipped += 1;
                    continue;
                };
                let (weight, forms, a) = (at.weight, at.forms, at.conductivity);
                let curvatures = [1.0, forms.mean(), forms.gaussian()];
                let values = self.row(q, 0).as_flattened();
                for (sums, value) in out.sums.iter_mut().zip(values) {
                    for (sum, curvature) in sums.iter_mut().zip(&curvatures) {
                        *sum += weight * value * curvature;
                    }
                }
                for (x, y) in self.row(q, 1).iter().zip(self.row(q, 2)) {
                    let (mut f, mut g) = ([0.0; LANES], [0.0; LANES]);
                    for l in 0..LANES {
                        f[l] = a.xx * x[l] + a.xy * y[l];
                        g[l] = a.xy * x[l] + a.yy * y[l];
                    }
                    batch.flux.push([f, g]);
                }
                batch.points.push((q, weight));
            }
            self.add(batch, !out.mass.is_empty());
        }
        pack(n, width, &batch.stiffness, out.stiffness);
        pack(n, width, &batch.mass, out.mass);
    }

    /// Adds a batch to the blocks of the matrices on and above the diagonal.
    fn add(&self, batch: &mut Batch, with_mass: bool) {
        let width = self.width;
        for i in 0..width {
            for j in i..width {
                let mut sum = [[0.0; LANES]; LANES];
                for (k, &(q, _)) in batch.points.iter().enumerate() {
                    let [f, g] = &batch.flux[k * width + i];
                    rank_one(&mut sum, f, &self.row(q, 1)[j]);
                    rank_one(&mut sum, g, &self.row(q, 2)[j]);
                }
                store(&mut batch.stiffness, &sum, (i, j), width);
            }
        }
        if !with_mass {
            return;
        }
        for i in 0..width {
            for j in i..width {
                let mut sum = [[0.0; LANES]; LANES];
                for &(q, weight) in &batch.points {
                    let values = self.row(q, 0);
                    let mut left = values[i];
                    left.iter_mut().for_each(|x| *x *= weight);
                    rank_one(&mut sum, &left, &values[j]);
                }
                store(&mut batch.mass, &sum, (i, j), width);
            }
        }
    }

    /// `∫ Nᵢ_a A^{ab} x_b dA` of a patch, in place of what was there.
    fn forces(&self, patch: usize, out: &mut [Vector3]) {
        let places = self.places(patch);
        out.fill(Vector3::zeros());
        for q in 0..self.task.weights.len() {
            let Some(at) = self.at(q, &places) else {
                continue;
            };
            let ([u, v], a) = (at.first, at.conductivity);
            let (f, g) = (u * a.xx + v * a.xy, u * a.xy + v * a.yy);
            let along = self.row(q, 1).as_flattened().iter();
            let slopes = along.zip(self.row(q, 2).as_flattened());
            for (out, (x, y)) in out.iter_mut().zip(slopes) {
                *out += f * *x + g * *y;
            }
        }
    }
}

fn in_lanes(row: &[f64]) -> impl Iterator<Item = Lane> + '_ {
    row.chunks(LANES).map(|part| {
        let mut lane = [0.0; LANES];
        lane[..part.len()].copy_from_slice(part);
        lane
    })
}

/// Adds `a bᵀ`.
#[inline(always)]
fn rank_one(sum: &mut [Lane; LANES], a: &Lane, b: &Lane) {
    for r in 0..LANES {
        for l in 0..LANES {
            sum[r][l] += a[r] * b[l];
        }
    }
}

#[inline]
fn total([a, b, c, d]: Lane) -> f64 {
    (a + b) + (c + d)
}

fn store(square: &mut [Lane], block: &[Lane; LANES], (i, j): (usize, usize), width: usize) {
    for (r, row) in block.iter().enumerate() {
        let lane = &mut square[(i * LANES + r) * width + j];
        for l in 0..LANES {
            lane[l] += row[l];
        }
    }
}

/// The upper half of a square matrix of `n` rows, row after row.
fn pack(n: usize, width: usize, square: &[Lane], out: &mut [f64]) {
    if out.is_empty() {
        return;
    }
    for i in 0..n {
        let row = square[i * width..(i + 1) * width].as_flattened();
        let start = packed(n, i, i);
        out[start..start + n - i].copy_from_slice(&row[i..n]);
    }
}

/// [`OperatorBackend::patch_matrices`](crate::OperatorBackend::patch_matrices).
pub(crate) fn matrices(task: &PatchTask<'_>, out: &mut PatchMatrices) {
    out.reset(task);
    if task.patches() == 0 {
        return;
    }
    let lanes = Lanes::of(task);
    (out.slots(task).enumerate())
        .with_min_len(64)
        .for_each_init(Batch::default, |batch, (patch, slots)| {
            lanes.matrices(patch, batch, slots);
        });
}

/// [`OperatorBackend::patch_forces`](crate::OperatorBackend::patch_forces).
pub(crate) fn forces(task: &PatchTask<'_>, out: &mut Vec<Vector3>) {
    out.clear();
    out.resize(task.points.len(), Vector3::zeros());
    if task.patches() == 0 {
        return;
    }
    let lanes = Lanes::of(task);
    parallel::for_chunks(out, task.functions, |patch, out| lanes.forces(patch, out));
}
