//! Every backend follows the specification; the comparisons can fail; threads do not matter.

use geom_core::compute::random::SplitMix64;
use geom_core::nalgebra::{Matrix3, Rotation3};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Lattice, Point3, Run, Vector3};
use proptest::prelude::*;
use spectral_corresp::backend::{
    CorrespBackend, NEAREST, ROTATIONS, RotationTask, Rows, SWEEP, SweepTask,
};
use spectral_corresp::fit::Neighbourhoods;
use spectral_corresp::{
    CompareOptions, Directions, MatchOptions, Morph, MorphOptions, ShapeOptions, Start, VoxelShape,
    compare, correspond, specification,
};

/// Points on the shell of a bent rod, so thick (Å), and where they went: each end turned, and noise.
struct Body {
    rest: Vec<Point3>,
    now: Vec<Point3>,
    near: Neighbourhoods,
    targets: Vec<Point3>,
    pull: Vec<f64>,
}

fn body(seed: u64, thick: f64) -> Body {
    let mut random = SplitMix64::new(seed);
    let mut draw =
        |size: f64| Vector3::new(random.symmetric(), random.symmetric(), random.symmetric()) * size;
    let mut rest: Vec<Point3> = (0..200)
        .map(|i| {
            let around = draw(1.0).normalize() * thick;
            Point3::new(100.0 + 0.3 * f64::from(i), -50.0, 20.0) + around
        })
        .collect();
    // Two that nobody is near to.
    rest.push(Point3::new(500.0, 0.0, 0.0));
    rest.push(Point3::new(0.0, 500.0, 0.0));
    let now: Vec<Point3> = rest
        .iter()
        .map(|p| {
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), (p.x - 130.0) / 40.0);
            let middle = Vector3::new(130.0, -50.0, 20.0);
            Point3::from(turn * (p.coords - middle) - middle + draw(0.08 * thick))
        })
        .collect();
    let targets = now.iter().map(|p| p + draw(3.0)).collect();
    let mut pull: Vec<f64> = rest.iter().map(|_| draw(1.0).x.max(0.0)).collect();
    (pull[200], pull[201]) = (0.0, 0.3);
    let near = Neighbourhoods::within(&rest, 8.0, 20, seed).unwrap();
    Body {
        rest,
        now,
        near,
        targets,
        pull,
    }
}

impl Body {
    fn task(&self) -> RotationTask<'_> {
        RotationTask {
            rest: &self.rest,
            now: &self.now,
            near: &self.near,
        }
    }

    fn sweep<'a>(&'a self, rotations: &'a [Matrix3<f64>]) -> SweepTask<'a> {
        SweepTask {
            shape: self.task(),
            rotations,
            targets: &self.targets,
            pull: &self.pull,
        }
    }

    /// As specified, where that is defined, and who has no neighbours.
    fn rotations(&self) -> Vec<Option<Matrix3<f64>>> {
        let all = 0..self.rest.len();
        all.map(|i| specification::rotation(&self.task(), i))
            .collect()
    }
}

fn flat(points: &[Point3]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

fn rotations_agree(backend: &dyn CorrespBackend, body: &Body) {
    let mut found = vec![Matrix3::zeros(); 3];
    backend.rotations(&body.task(), &mut found).unwrap();
    assert_eq!(found.len(), body.rest.len());
    let mut defined = 0;
    for (reference, found) in body.rotations().iter().zip(&found) {
        assert!((found.determinant() - 1.0).abs() < 1e-5);
        if let Some(reference) = reference {
            defined += 1;
            let broken = ROTATIONS.first_break(reference.as_slice(), found.as_slice());
            assert_eq!(broken, None);
        }
    }
    assert!(defined >= 195);
}

fn sweeps_agree(backend: &dyn CorrespBackend, body: &Body) {
    let identity = Matrix3::identity();
    let rotations: Vec<_> = body
        .rotations()
        .iter()
        .map(|r| r.unwrap_or(identity))
        .collect();
    let task = body.sweep(&rotations);
    let reference: Vec<Point3> = (0..body.rest.len())
        .map(|i| specification::sweep(&task, i))
        .collect();
    let mut found = vec![Point3::origin(); 7];
    backend.sweep(&task, &mut found).unwrap();
    assert_eq!(found[200], body.now[200]);
    // Over the extent of the shape.
    let scaled = |points: &[Point3]| flat(points).iter().map(|x| x / 600.0).collect::<Vec<_>>();
    assert_eq!(
        SWEEP.first_break(&scaled(&reference), &scaled(&found)),
        None
    );
}

fn rows(seed: u64, count: usize, width: usize) -> Vec<f64> {
    let mut random = SplitMix64::new(seed);
    (0..count * width)
        .map(|_| 200.0 + 40.0 * random.symmetric())
        .collect()
}

fn nearest_agree(backend: &dyn CorrespBackend, seed: u64, counts: [usize; 2], width: usize) {
    let (a, b) = (rows(seed, counts[0], width), rows(!seed, counts[1], width));
    let (queries, targets) = (Rows { values: &a, width }, Rows { values: &b, width });
    let mut found = Vec::new();
    backend.nearest(queries, targets, &mut found).unwrap();
    let reference =
        (0..counts[0]).map(|q| specification::nearest(queries.row(q), targets).unwrap());
    let reference: Vec<_> = reference.collect();
    let distances =
        |n: &[spectral_corresp::backend::Nearest]| n.iter().map(|n| n.distance).collect::<Vec<_>>();
    assert_eq!(
        NEAREST.first_break(&distances(&reference), &distances(&found)),
        None
    );
    for (q, (r, f)) in reference.iter().zip(&found).enumerate() {
        let to = |t: u32| {
            queries
                .row(q)
                .iter()
                .zip(targets.row(t as usize))
                .map(|(x, y)| (x - y).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        assert!(
            r.index == f.index || (to(f.index) - r.distance).abs() <= 1e-5 * (1.0 + r.distance)
        );
    }
}

/// Of several that are equally near, the first; and without targets nothing.
fn ties(backend: &dyn CorrespBackend) {
    let rows = |values| Rows { values, width: 3 };
    let targets = [4.0, 0.0, 0.0, -4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, -4.0, 0.0];
    let mut found = Vec::new();
    backend
        .nearest(rows(&[0.0; 3]), rows(&targets), &mut found)
        .unwrap();
    assert_eq!((found[0].index, found[0].distance), (0, 4.0));
    backend
        .nearest(rows(&[0.0; 3]), rows(&[]), &mut found)
        .unwrap();
    assert!(found.is_empty());
}

proptest! {
    #![proptest_config(geom_core::testing::cases(16))]

    #[test]
    fn the_cpu_follows_the_specification(seed: u64, thick in 0.5..6.0) {
        let body = body(seed, thick);
        rotations_agree(&Cpu, &body);
        sweeps_agree(&Cpu, &body);
    }

    #[test]
    fn nearest_rows_of_the_cpu_follow_the_specification(seed: u64, n in 1usize..60, m in 1usize..90, width in 1usize..33) {
        nearest_agree(&Cpu, seed, [n, m], width);
    }

    /// The comparisons can fail: one altered value is found, at its place.
    #[test]
    fn a_wrong_value_is_caught(seed: u64, place in 0usize..600) {
        let body = body(seed, 6.0);
        let reference: Vec<f64> = flat(&body.now).iter().map(|x| x / 600.0).collect();
        for (agreement, by) in [(SWEEP, 3e-5), (ROTATIONS, 3e-4), (NEAREST, 3e-5)] {
            let mut wrong = reference.clone();
            wrong[place] += by;
            assert_eq!(agreement.first_break(&reference, &wrong).map(|b| b.index), Some(place));
        }
    }
}

#[test]
fn the_first_of_the_nearest_is_taken() {
    ties(&Cpu);
}

/// Thousands of rows lie in groups of blocks, most of which are passed by; on whole numbers many rows are equally near.
#[test]
fn no_row_is_passed_by() {
    for (width, size) in [(6, 1.0), (8, 0.05), (11, 0.05), (2, 0.1)] {
        let whole = |seed, count| -> Vec<f64> {
            let rows = rows(seed, count, width).into_iter();
            rows.map(|x| (x * size).round()).collect()
        };
        let (a, b) = (whole(3, 50), whole(4, 3000));
        let (queries, targets) = (Rows { values: &a, width }, Rows { values: &b, width });
        let mut found = Vec::new();
        Cpu.nearest(queries, targets, &mut found).unwrap();
        for (q, found) in found.iter().enumerate() {
            let exact = specification::nearest(queries.row(q), targets).unwrap();
            assert_eq!(found.index, exact.index, "{width} {q}");
            assert!((found.distance - exact.distance).abs() < 1e-12);
        }
    }
}

/// A T of lattice points, its arm bent by a slant.
fn shape(slant: usize) -> VoxelShape {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.5,
        counts: [12, 18, 5],
    };
    let inside = (0..lattice.len()).map(|at| {
        let [i, j, k] = lattice.coordinates(at);
        let bar = j < 5 && (1..5).contains(&k);
        let middle = 4 + slant * j / 9;
        bar || (i >= middle && i < middle + 4 && k < 4)
    });
    VoxelShape::of_flags(&lattice, inside.collect(), &ShapeOptions::default()).unwrap()
}

/// One start and one way: the others are of the same kernels.
fn options() -> MatchOptions {
    MatchOptions {
        start: Start::Thesis,
        directions: Directions::Forward,
        modes: 4,
        ..MatchOptions::default()
    }
}

#[test]
fn threads_do_not_matter() {
    let (a, b) = (shape(0), shape(2));
    same_on_any_threads(|| {
        let run = Run::on(&Cpu);
        let found = correspond(&a, &b, &options(), run).unwrap();
        let morph = Morph::new(&a, &b, &found, &MorphOptions::default(), run).unwrap();
        let frame = morph.frame(0.4, run).unwrap();
        let compared = compare(&a, &b, &found.forward, &CompareOptions::default(), run).unwrap();
        (found, frame, compared)
    });
}

#[cfg(feature = "wgpu")]
mod gpu {
    use geom_core::testing::gpu_or_skip;

    use super::*;

    #[test]
    fn kernels_follow_the_specification() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(geom_core::testing::cases(8), |(seed: u64, thick in 0.5..6.0, n in 1usize..60, m in 1usize..90, width in 1usize..33)| {
            let body = body(seed, thick);
            rotations_agree(&gpu, &body);
            sweeps_agree(&gpu, &body);
            nearest_agree(&gpu, seed, [n, m], width);
        });
        ties(&gpu);
    }

    #[test]
    fn whole_matches_obey_the_same_laws() {
        let Some(gpu) = gpu_or_skip() else { return };
        let (a, b) = (shape(0), shape(2));
        let of = |run: Run<'_, dyn CorrespBackend>| correspond(&a, &b, &options(), run).unwrap();
        let (here, there) = (of(Run::on(&Cpu)), of(Run::on(&gpu)));
        assert_eq!(here.verdict, there.verdict);
        assert!(
            (here.score - there.score).abs() < 0.1 * here.score,
            "{} {}",
            here.score,
            there.score
        );
        let apart = |(x, y): (&Point3, &Point3)| (x - y).norm();
        let mean = here
            .images
            .iter()
            .zip(&there.images)
            .map(apart)
            .sum::<f64>()
            / here.images.len() as f64;
        assert!(mean < 1.5, "{mean}");
    }
}
