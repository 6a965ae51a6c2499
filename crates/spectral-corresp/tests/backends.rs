//! Every backend follows the specification; the comparisons can fail; threads do not matter.

use geom_core::algebra::eigen::{
    self,
    backend::{Cycle, Multigrid, SpectralBackend},
};
use geom_core::compute::random::SplitMix64;
use geom_core::nalgebra::{Matrix3, Rotation3};
use geom_core::testing::same_on_any_threads;
use geom_core::{Backend, Cpu, Lattice, Point3, Run, Vector3};
use proptest::prelude::*;
use spectral_corresp::backend::{
    CorrespBackend, HistogramTask, NEAREST, Nearest, ROTATIONS, RotationTask, Rows, SWEEP,
    SweepTask,
};
use spectral_corresp::fit::Neighbourhoods;
use spectral_corresp::{
    CompareOptions, Directions, Error, MatchOptions, Morph, MorphOptions, ShapeOptions, Start,
    VoxelShape, compare, correspond, specification,
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
    let distances = |n: &[Nearest]| n.iter().map(|n| n.distance).collect::<Vec<_>>();
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

/// Distances and histograms are whole numbers: every backend finds the same.
fn distances_agree(backend: &dyn CorrespBackend, seed: u64, counts: [usize; 3], share: f64) {
    let mut random = SplitMix64::new(seed);
    let points: usize = counts.iter().product();
    let inside: Vec<bool> = (0..points).map(|_| random.unit() < share).collect();
    let reference = specification::squared_distances(counts, &inside);
    let mut found = vec![7; 3];
    backend
        .squared_distances(counts, &inside, &mut found)
        .unwrap();
    assert_eq!(found, reference, "{counts:?}");
}

/// Nodes of a lattice in a box of this size, which begins below 0.
struct Marked {
    points: Vec<[i32; 3]>,
    places: Vec<u32>,
    bars: usize,
    reach: u32,
}

fn marked(seed: u64, size: i32, bars: usize, reach: u32) -> Marked {
    let mut random = SplitMix64::new(seed);
    let mut axis = |size: i32| (random.unit() * f64::from(size)) as i32 - 5;
    let mut points: Vec<[i32; 3]> = (0..150)
        .map(|_| [axis(size), axis(size + 9), axis(7)])
        .collect();
    // One that nobody is near to.
    points.push([4 * size + 200, 0, 0]);
    let last = (bars as u32 - 1) * ONE;
    // The ends of the bars, too.
    let mut places: Vec<u32> = (0..149)
        .map(|_| (random.unit() * f64::from(last)) as u32)
        .collect();
    places.extend([0, last]);
    Marked {
        points,
        places,
        bars,
        reach,
    }
}

/// What a node counts.
const ONE: u32 = 1 << 16;

fn histograms_agree(backend: &dyn CorrespBackend, marked: &Marked) {
    let task = HistogramTask {
        points: &marked.points,
        reach: marked.reach,
        one: ONE,
        places: &marked.places,
        bars: marked.bars,
    };
    let reference = (0..marked.points.len()).flat_map(|i| specification::histogram(&task, i));
    let reference: Vec<u32> = reference.collect();
    let mut found = vec![7; 3];
    backend.histograms(&task, &mut found).unwrap();
    assert_eq!(found, reference);
    let alone = &found[150 * marked.bars..];
    assert_eq!(alone.iter().sum::<u32>(), ONE);
}

proptest! {
    #![proptest_config(geom_core::testing::cases(16))]

    #[test]
    fn distances_and_histograms_of_the_cpu_follow_the_specification(
        seed: u64, counts in [1usize..15, 1usize..15, 1usize..12], share in 0.7..1.01,
        size in 1i32..40, bars in 2usize..25, reach in 0u32..900,
    ) {
        distances_agree(&Cpu, seed, counts, share);
        histograms_agree(&Cpu, &marked(seed, size, bars, reach));
    }

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

/// What is wrong with the answers of a backend that else asks the processor.
#[derive(Clone, Copy)]
struct Odd {
    distances: fn(&mut Vec<u32>),
    bars: fn(&mut Vec<u32>),
    nearest: fn(&mut Vec<Nearest>),
    rotations: fn(&mut Vec<Matrix3<f64>>),
    places: fn(&mut Vec<Point3>),
}

/// Nothing.
const PLAIN: Odd = Odd {
    distances: |_| (),
    bars: |_| (),
    nearest: |_| (),
    rotations: |_| (),
    places: |_| (),
};

impl Backend for Odd {
    fn name(&self) -> String {
        "odd".to_owned()
    }
}

impl SpectralBackend for Odd {
    fn prepare<'a>(
        &'a self,
        hierarchy: &'a Multigrid<'a>,
    ) -> Result<Box<dyn Cycle + 'a>, eigen::Error> {
        Cpu.prepare(hierarchy)
    }
}

impl CorrespBackend for Odd {
    fn squared_distances(
        &self,
        counts: [usize; 3],
        inside: &[bool],
        out: &mut Vec<u32>,
    ) -> Result<(), Error> {
        Cpu.squared_distances(counts, inside, out)?;
        (self.distances)(out);
        Ok(())
    }
    fn histograms(&self, task: &HistogramTask<'_>, out: &mut Vec<u32>) -> Result<(), Error> {
        Cpu.histograms(task, out)?;
        (self.bars)(out);
        Ok(())
    }
    fn nearest(
        &self,
        queries: Rows<'_>,
        targets: Rows<'_>,
        out: &mut Vec<Nearest>,
    ) -> Result<(), Error> {
        Cpu.nearest(queries, targets, out)?;
        (self.nearest)(out);
        Ok(())
    }
    fn rotations(&self, task: &RotationTask<'_>, out: &mut Vec<Matrix3<f64>>) -> Result<(), Error> {
        Cpu.rotations(task, out)?;
        (self.rotations)(out);
        Ok(())
    }
    fn sweep(&self, task: &SweepTask<'_>, out: &mut Vec<Point3>) -> Result<(), Error> {
        Cpu.sweep(task, out)?;
        (self.places)(out);
        Ok(())
    }
}

/// Answers that do not fit are an error that names the backend.
#[test]
fn odd_answers_are_an_error() {
    let (a, b) = (shape(0), shape(2));
    let cases: [(Odd, &str); 8] = [
        (
            Odd {
                distances: |d| d.truncate(9),
                ..PLAIN
            },
            "squared distances",
        ),
        (
            Odd {
                bars: |d| d.push(0),
                ..PLAIN
            },
            "bars",
        ),
        (
            Odd {
                nearest: Vec::clear,
                ..PLAIN
            },
            "nearest rows",
        ),
        (
            Odd {
                nearest: |n| n[0].index = u32::MAX,
                ..PLAIN
            },
            "4294967295",
        ),
        (
            Odd {
                rotations: |r| r.truncate(1),
                ..PLAIN
            },
            "1 rotations",
        ),
        (
            Odd {
                rotations: |r| r[0][0] = f64::NAN,
                ..PLAIN
            },
            "not finite",
        ),
        (
            Odd {
                places: Vec::clear,
                ..PLAIN
            },
            "0 places",
        ),
        (
            Odd {
                places: |p| p[0].x = f64::INFINITY,
                ..PLAIN
            },
            "not finite",
        ),
    ];
    for (odd, what) in cases {
        let flags = vec![true; 480];
        let lattice = Lattice {
            counts: [12, 8, 5],
            ..*a.lattice()
        };
        let made = VoxelShape::of_flags(&lattice, flags, &ShapeOptions::default(), Run::on(&odd));
        let error = match made {
            Err(error) => error,
            Ok(_) => correspond(&a, &b, &options(), Run::on(&odd)).unwrap_err(),
        };
        let text = error.to_string();
        assert!(
            text.starts_with("odd gave") && text.contains(what),
            "{text}"
        );
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
    VoxelShape::of_flags(
        &lattice,
        inside.collect(),
        &ShapeOptions::default(),
        Run::on(&Cpu),
    )
    .unwrap()
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
        proptest!(geom_core::testing::cases(8), |(
            seed: u64, counts in [1usize..15, 1usize..15, 1usize..12], share in 0.7..1.01,
            size in 1i32..40, bars in 2usize..25, reach in 0u32..900,
        )| {
            distances_agree(&gpu, seed, counts, share);
            histograms_agree(&gpu, &marked(seed, size, bars, reach));
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
