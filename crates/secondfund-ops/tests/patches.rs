//! The kernels of patches follow the specification on every backend, and the comparison can fail.

use geom_core::algebra::quadrature::gauss;
use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::{Backend, Cpu, Point3, Run, Vector3};
use proptest::prelude::*;
use secondfund_ops::backend::{
    OperatorBackend, PATCH_MATRICES, PatchMatrices, PatchTask, TriangleTask,
};
use secondfund_ops::forms::{Conductor, TriangleMatrix};
use secondfund_ops::operators::assemble;
use secondfund_ops::specification::{PatchValues, patch_values};
use secondfund_ops::{Element, Error, FlowOptions, SpectrumOptions, Surface, smooth_quads};

use crate::backends::{LAWS, conductor};

/// Bernstein polynomials of a degree at a place, with their first and second derivatives.
fn bernstein(degree: usize, t: f64) -> [Vec<f64>; 3] {
    let raised = |lower: Vec<f64>, k: usize| -> Vec<f64> {
        let at = |i: usize| if i < lower.len() { lower[i] } else { 0.0 };
        let before = |i: usize| if i > 0 { at(i - 1) } else { 0.0 };
        let step = |i: usize| (1.0 - t) * at(i) + t * before(i);
        (0..=k).map(step).collect()
    };
    let of_degree = |p: usize| (1..=p).fold(vec![1.0], raised);
    // B' = p (B_{i−1} − B_i) of one degree less.
    let slope = |lower: &[f64], p: usize| -> Vec<f64> {
        let at = |i: usize| lower.get(i).copied().unwrap_or(0.0);
        let before = |i: usize| if i > 0 { at(i - 1) } else { 0.0 };
        (0..=p).map(|i| p as f64 * (before(i) - at(i))).collect()
    };
    let second = slope(&slope(&of_degree(degree - 2), degree - 1), degree);
    [
        of_degree(degree),
        slope(&of_degree(degree - 1), degree),
        second,
    ]
}

/// Shaken pieces of a torus as tensor-product patches.
struct Pieces {
    functions: usize,
    weights: Vec<f64>,
    basis: Vec<f64>,
    points: Vec<Point3>,
    factors: Vec<f64>,
}

impl Pieces {
    fn of([p, q]: [usize; 2], rule: usize, count: usize, seed: u64) -> Self {
        let mut random = SplitMix64::new(seed);
        let functions = (p + 1) * (q + 1);
        let (mut weights, mut basis) = (Vec::new(), Vec::new());
        for (v, wv) in gauss(rule) {
            for (u, wu) in gauss(rule) {
                let (a, b) = (bernstein(p, u), bernstein(q, v));
                weights.push(wu * wv);
                for (i, j) in [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)] {
                    basis.extend(b[j].iter().flat_map(|y| a[i].iter().map(move |x| x * y)));
                }
            }
        }
        let mut points = Vec::new();
        for _ in 0..count {
            let [s, t] = [0, 1].map(|_| std::f64::consts::PI * random.symmetric());
            for k in 0..functions {
                let along = s + 0.3 * (k % (p + 1)) as f64 / p as f64;
                let around = t + 0.5 * (k / (p + 1)) as f64 / q as f64;
                let [near, far] = [0, 1].map(|_| 0.1 * random.symmetric());
                let (tube, ring) = (0.15 * (1.0 + 0.01 * near), 0.3 + 0.15 * around.cos());
                let ring = ring * (1.0 + 0.01 * far);
                let (x, y) = (ring * along.cos(), ring * along.sin());
                points.push(Point3::new(x, y, tube * around.sin()));
            }
        }
        let factors = points.iter().map(|p| 1.0 + p.x * p.x).collect();
        Self {
            functions,
            weights,
            basis,
            points,
            factors,
        }
    }

    fn task(&self, conductor: Conductor, with_fields: bool) -> PatchTask<'_> {
        PatchTask {
            functions: self.functions,
            weights: &self.weights,
            basis: &self.basis,
            points: &self.points,
            factors: if with_fields { &self.factors } else { &[] },
            conductor,
            least: 1e-12,
            mass: true,
        }
    }
}

/// Values over the largest of them, what is below 1e-6 of a unit being nothing.
fn over_largest(values: &[f64], largest: f64) -> Vec<f64> {
    values.iter().map(|x| x / largest.max(1e-6)).collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |s: f64, x| s.max(x.abs()))
}

fn packed(square: &[f64], n: usize) -> Vec<f64> {
    let rows = square.chunks(n).enumerate();
    rows.flat_map(|(i, row)| row[i..].to_vec()).collect()
}

/// All values of a patch beside those of the specification, each kind over its largest.
fn compared(spec: &PatchValues, n: usize, found: [&[f64]; 4]) -> [Vec<f64>; 2] {
    let forces: Vec<f64> = spec.forces.iter().flat_map(|f| [f.x, f.y, f.z]).collect();
    let kinds = [
        packed(&spec.stiffness, n),
        packed(&spec.mass, n),
        spec.sums.as_flattened().to_vec(),
        forces,
    ];
    let mut both = [Vec::new(), Vec::new()];
    for (kind, (wanted, found)) in kinds.iter().zip(found).enumerate() {
        assert_eq!(wanted.len(), found.len());
        // Forces are sums of the stiffness with places.
        let largest = match kind {
            3 => largest(&kinds[0]),
            _ => largest(wanted),
        };
        both[0].extend(over_largest(wanted, largest));
        both[1].extend(over_largest(found, largest));
    }
    both
}

fn agreement(backend: &dyn OperatorBackend, task: &PatchTask<'_>) {
    let n = task.functions;
    let mut out = PatchMatrices::default();
    let mut forces = Vec::new();
    backend.patch_matrices(task, &mut out).unwrap();
    backend.patch_forces(task, &mut forces).unwrap();
    let forces: Vec<f64> = forces.iter().flat_map(|f| [f.x, f.y, f.z]).collect();
    assert_eq!(out.skipped, vec![0; task.patches()]);
    let size = n * (n + 1) / 2;
    for patch in 0..task.patches() {
        let [wanted, found] = compared(
            &patch_values(task, patch),
            n,
            [
                &out.stiffness[patch * size..(patch + 1) * size],
                &out.mass[patch * size..(patch + 1) * size],
                out.sums[patch * n..(patch + 1) * n].as_flattened(),
                &forces[patch * 3 * n..(patch + 1) * 3 * n],
            ],
        );
        let broken = PATCH_MATRICES.first_break(&wanted, &found);
        assert_eq!(broken, None, "patch {patch}, {:?}", task.conductor);
    }
    let stiffness = out.stiffness.clone();
    let without = PatchTask {
        mass: false,
        ..*task
    };
    backend.patch_matrices(&without, &mut out).unwrap();
    assert_eq!((out.stiffness, out.mass), (stiffness, vec![]));
}

/// Tasks of every law, with few points and with more than one group takes at once.
fn with_tasks(seed: u64, gauss: f64, limit: f64, mut check: impl FnMut(&PatchTask<'_>)) {
    for (degrees, rule) in [([3, 3], 4), ([4, 3], 3), ([2, 2], 9)] {
        let pieces = Pieces::of(degrees, rule, 3, seed);
        for law in LAWS {
            check(&pieces.task(conductor(law, gauss, limit), seed.is_multiple_of(2)));
        }
    }
}

proptest! {
    #![proptest_config(geom_core::testing::cases(8))]

    #[test]
    fn patches_of_the_cpu_follow_the_specification(seed: u64, gauss in -1.0..1.0, limit in prop_oneof![Just(f64::INFINITY), 3.0..30.0]) {
        with_tasks(seed, gauss, limit, |task| agreement(&Cpu, task));
    }

    /// The comparison can fail: one altered value is found, at its place.
    #[test]
    fn a_wrong_value_of_a_patch_is_caught(seed: u64, place in any::<prop::sample::Index>()) {
        with_tasks(seed, 1.0, f64::INFINITY, |task| {
            let (n, values) = (task.functions, patch_values(task, 0));
            let forces: Vec<f64> = values.forces.iter().flat_map(|f| [f.x, f.y, f.z]).collect();
            let matrices = [packed(&values.stiffness, n), packed(&values.mass, n)];
            let found = [&matrices[0], &matrices[1], values.sums.as_flattened(), &forces];
            let [wanted, mut wrong] = compared(&values, n, found);
            let i = place.index(wanted.len());
            wrong[i] += 1e-3;
            assert_eq!(PATCH_MATRICES.first_break(&wanted, &wrong).map(|b| b.index), Some(i));
        });
    }
}

/// A backend that answers what makes no sense: values that are no numbers, or too few of them.
struct Wrong {
    nan: bool,
    /// Matrices make sense.
    forces_alone: bool,
}

impl Backend for Wrong {
    fn name(&self) -> String {
        "wrong".to_owned()
    }
}

impl OperatorBackend for Wrong {
    fn triangle_matrices(
        &self,
        task: &TriangleTask<'_>,
        out: &mut Vec<TriangleMatrix>,
    ) -> Result<(), Error> {
        Cpu.triangle_matrices(task, out)
    }
    fn patch_matrices(&self, task: &PatchTask<'_>, out: &mut PatchMatrices) -> Result<(), Error> {
        Cpu.patch_matrices(task, out)?;
        if self.forces_alone {
            return Ok(());
        }
        if self.nan {
            out.stiffness.iter_mut().for_each(|k| *k = f64::NAN);
        } else {
            out.skipped.pop();
        }
        Ok(())
    }
    fn patch_forces(&self, task: &PatchTask<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
        out.clear();
        if self.nan {
            out.resize(task.points.len(), Vector3::repeat(f64::NAN));
        }
        Ok(())
    }
    fn distances(&self, rows: &[f32], width: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        Cpu.distances(rows, width, out)
    }
}

#[test]
fn answers_that_make_no_sense_are_errors() {
    let quads = shapes::quad_torus(1.0, 0.4, 16, 8);
    let surface = Surface::new(quads.clone()).unwrap();
    let element = Element::CatmullClark(&surface);
    for [nan, forces_alone] in [[true, false], [false, false], [true, true], [false, true]] {
        let wrong = Wrong { nan, forces_alone };
        let matrices = assemble(&element, &SpectrumOptions::default(), Run::on(&wrong));
        assert_eq!(matrices.is_ok(), forces_alone);
        let smoothed = smooth_quads(&quads, &FlowOptions::default(), Run::on(&wrong));
        assert!(smoothed.is_err());
    }
}

/// Points without an area are left out and counted, and the rest is as it was.
fn flat_points_are_left_out(backend: &dyn OperatorBackend) {
    let mut pieces = Pieces::of([3, 3], 3, 2, 5);
    let place = pieces.points[0];
    pieces.points[..16].fill(place);
    let task = pieces.task(conductor(LAWS[0], 0.0, f64::INFINITY), false);
    let mut out = PatchMatrices::default();
    backend.patch_matrices(&task, &mut out).unwrap();
    assert_eq!(out.skipped, [9, 0]);
    assert!(out.stiffness[..136].iter().all(|&k| k == 0.0));
    assert!(out.stiffness[136..].iter().any(|&k| k != 0.0));
    let mut forces = Vec::new();
    backend.patch_forces(&task, &mut forces).unwrap();
    assert!(forces[..16].iter().all(|f| f.norm() == 0.0) && forces[16].norm() > 0.0);
}

#[test]
fn points_without_an_area_are_left_out() {
    flat_points_are_left_out(&Cpu);
}

#[cfg(feature = "wgpu")]
mod gpu {
    use geom_core::testing::gpu_or_skip;

    use super::*;

    #[test]
    fn patches_follow_the_specification() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(geom_core::testing::cases(8), |(seed: u64, gauss in -1.0..1.0, limit in prop_oneof![Just(f64::INFINITY), 3.0..30.0])| {
            with_tasks(seed, gauss, limit, |task| agreement(&gpu, task));
        });
    }

    #[test]
    fn points_without_an_area_are_left_out() {
        let Some(gpu) = gpu_or_skip() else { return };
        flat_points_are_left_out(&gpu);
    }
}
