//! What holds for all shapes: closed forms of small graphs, invariance of the search, honest verdicts.

use std::f64::consts::PI;

use geom_core::algebra::graph::Neighbours;
use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::nalgebra::{Quaternion, UnitQuaternion};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, GridError, Lattice, Point3, Run, ScalarGrid, Vector3};
use spectral_corresp::correspond::joint_modes;
use spectral_corresp::options::{Components, HistogramOptions};
use spectral_corresp::{
    Correspondence, Directions, Error, Map, MatchOptions, Refine, ShapeOptions, Start, Verdict,
    VoxelShape, correspond,
};

/// Coarser than for proteins: a third of the nodes, and a test is to be quick.
const H: f64 = 2.2;

fn on_cpu(a: &VoxelShape, b: &VoxelShape, options: &MatchOptions) -> Correspondence {
    correspond(a, b, options, Run::on(&Cpu)).unwrap()
}

/// One start, one way: quick.
fn only(start: Start) -> MatchOptions {
    MatchOptions {
        start,
        directions: Directions::Forward,
        ..MatchOptions::default()
    }
}

fn lattice(counts: [usize; 3]) -> Lattice {
    Lattice {
        origin: Point3::origin(),
        spacing: H,
        counts,
    }
}

/// The points within `radius` of a chain of centres, turned as asked: a body without any symmetry, and its mirror image.
/// `bend` folds the far half over, in radians.
fn worm(mirrored: bool, bend: f64, rotation: &UnitQuaternion<f64>) -> VoxelShape {
    let beads = (0..26).map(|i| {
        let s = f64::from(i) * 2.0;
        // Thick at one end, with a bulge to one side and one to another: chiral.
        let radius = 8.0 - 0.12 * s;
        let body = Point3::new(s - 25.0, 0.0, 0.0);
        (body, radius)
    });
    let bulges = [
        (Point3::new(-15.0, 9.0, 0.0), 5.0),
        (Point3::new(0.0, 0.0, 8.5), 4.5),
        (Point3::new(14.0, -7.0, 1.0), 4.0),
    ];
    let bent = |p: Point3| {
        let y = if mirrored { -p.y } else { p.y };
        let (x, z) = (p.x.max(0.0), p.z);
        let (sin, cos) = bend.sin_cos();
        if p.x <= 0.0 {
            Point3::new(p.x, y, z)
        } else {
            Point3::new(x * cos - z * sin, y, x * sin + z * cos)
        }
    };
    let balls: Vec<(Point3, f64)> = beads
        .chain(bulges)
        .map(|(p, r)| (rotation * bent(p), r))
        .collect();
    of_balls(&balls)
}

fn of_balls(balls: &[(Point3, f64)]) -> VoxelShape {
    let low = balls
        .iter()
        .fold(Vector3::repeat(f64::INFINITY), |m, (p, r)| {
            m.inf(&(p.coords.add_scalar(-r - 4.0)))
        });
    let high = balls
        .iter()
        .fold(Vector3::repeat(f64::NEG_INFINITY), |m, (p, r)| {
            m.sup(&(p.coords.add_scalar(r + 4.0)))
        });
    let grid = Lattice {
        origin: Point3::from(low),
        spacing: H,
        counts: [0, 1, 2].map(|a| ((high[a] - low[a]) / H) as usize + 1),
    };
    let value = |i: usize| {
        let x = grid.point(grid.coordinates(i));
        let depth = balls.iter().map(|(p, r)| r - (x - p).norm());
        depth.fold(f64::NEG_INFINITY, f64::max) as f32
    };
    let values = (0..grid.len()).map(value).collect();
    let grid: Result<ScalarGrid, GridError> = ScalarGrid::new(grid, values);
    VoxelShape::of_grid(&grid.unwrap(), 0.0, &ShapeOptions::default(), Run::on(&Cpu)).unwrap()
}

fn some_rotation(seed: u64) -> UnitQuaternion<f64> {
    let mut random = SplitMix64::new(seed);
    let mut draw = || random.symmetric();
    UnitQuaternion::from_quaternion(Quaternion::new(draw(), draw(), draw(), draw()))
}

#[test]
fn modes_of_a_bar_are_cosines() {
    // Long and thick enough to be a shape, thin enough that its first modes run along it: those of a path of 60 nodes,
    // whose edges are shared by all four rows.
    let n = 60;
    let flags = vec![true; 4 * n];
    let options = ShapeOptions {
        neighbours: Neighbours::Six,
        ..ShapeOptions::default()
    };
    let bar = VoxelShape::of_flags(&lattice([n, 2, 2]), flags, &options, Run::on(&Cpu)).unwrap();
    let modes = bar.modes(3, Run::on(&Cpu)).unwrap();
    // Each node has two neighbours across the bar and two along it (one at the ends): half of the weight of the ends'
    // mass is missing, so values lie near those of the free path with mass 4.
    for (k, value) in (1u32..).zip(&modes.values) {
        let path = (1.0 - (PI * f64::from(k) / (n as f64)).cos()) / 2.0;
        assert!((value / path - 1.0).abs() < 0.02, "{k}: {value} {path}");
    }
    for mode in &modes.vectors {
        let largest = mode.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        assert!((largest - 1.0).abs() < 1e-12);
    }
    assert!(modes.clusters.is_empty());
    // A cube does not know its axes.
    let cube =
        VoxelShape::of_flags(&lattice([9; 3]), vec![true; 729], &options, Run::on(&Cpu)).unwrap();
    let modes = cube.modes(3, Run::on(&Cpu)).unwrap();
    assert_eq!(modes.clusters.len(), 1);
    assert_eq!((modes.clusters[0].clone(), modes.report.parts), (0..3, 1));
}

#[test]
fn a_ball_has_its_radius_as_diameters() {
    let (middle, radius) = (Vector3::new(0.3, -0.2, 0.1), 10.0 * H);
    let ball = of_balls(&[(Point3::from(middle), radius)]);
    for &n in ball.skeleton() {
        assert!((ball.position(n as usize).coords - middle).norm() < H);
    }
    assert!(
        ball.diameters()
            .iter()
            .all(|d| (d - radius).abs() < 1.7 * H)
    );
    // In the middle of a lattice there is one centre.
    let inside = (0..23usize.pow(3)).map(|i| {
        let at = [i % 23, i / 23 % 23, i / 529].map(|c| (c as i64 - 11).pow(2));
        at.iter().sum::<i64>() <= 100
    });
    let options = ShapeOptions::default();
    let central =
        VoxelShape::of_flags(&lattice([23; 3]), inside.collect(), &options, Run::on(&Cpu)).unwrap();
    assert_eq!(central.skeleton().len(), 1);
    let near = |d: &f64| (d / H - 10.0).abs() <= 1.0;
    assert!(central.diameters().iter().all(near));
    let volume = 4.0 / 3.0 * PI * radius.powi(3);
    assert!((ball.volume() / volume - 1.0).abs() < 0.03);
    // Normals point outwards.
    let points = ball.boundary_points().iter().zip(ball.normals());
    assert!(
        points
            .clone()
            .all(|(p, n)| (p.coords - middle).normalize().dot(n) > 0.95)
    );
}

#[test]
fn parts_and_cavities_are_as_asked() {
    let counts = [30, 12, 12];
    let flag = |i: usize| {
        let [x, y, z] = [i % 30, i / 30 % 12, i / 360];
        // Two blocks, the larger with a cavity.
        let inside = (1..11).contains(&y) && (1..11).contains(&z);
        let cavity = (7..9).contains(&x) && (4..7).contains(&y) && (4..7).contains(&z);
        inside && !cavity && ((1..17).contains(&x) || (20..28).contains(&x))
    };
    let flags: Vec<bool> = (0..30 * 144).map(flag).collect();
    let of = |components, fill_cavities| {
        let options = ShapeOptions {
            components,
            fill_cavities,
            ..ShapeOptions::default()
        };
        VoxelShape::of_flags(&lattice(counts), flags.clone(), &options, Run::on(&Cpu)).unwrap()
    };
    let largest = of(Components::Largest, false);
    assert_eq!(
        (largest.nodes(), largest.report().left_out.clone()),
        (1600 - 18, vec![800])
    );
    let filled = of(Components::Largest, true);
    assert_eq!((filled.nodes(), filled.report().filled), (1600, 18));
    // Of two that are equal the first is kept, and the other is reported.
    let equal: Vec<bool> = (0..30 * 144)
        .map(|i| flag(i + 20 - i % 30) && [3, 4, 5, 12, 13, 14].contains(&(i % 30)))
        .collect();
    let first = VoxelShape::of_flags(
        &lattice(counts),
        equal,
        &ShapeOptions::default(),
        Run::on(&Cpu),
    )
    .unwrap();
    assert_eq!(first.report().left_out, vec![first.nodes()]);
    assert!(first.boundary_points().iter().all(|p| p.x < 6.0 * H));
    assert_eq!(of(Components::All, false).nodes(), 2400 - 18);
    assert_eq!(of(Components::MinFraction(0.6), false).nodes(), 1600 - 18);
    assert_eq!(of(Components::MinFraction(0.4), false).nodes(), 2400 - 18);
}

#[test]
fn a_mesh_has_the_lattice_points_within() {
    let sphere = shapes::icosphere(12.0, 4);
    let body = VoxelShape::of_mesh(&sphere, H, &ShapeOptions::default(), Run::on(&Cpu)).unwrap();
    for k in 0..body.lattice().len() {
        let at = body.lattice().coordinates(k);
        let r = body.lattice().point(at).coords.norm();
        if (r - 12.0).abs() > 0.05 {
            assert_eq!(body.graph().node(at).is_some(), r < 12.0, "{at:?} {r}");
        }
    }
    // What lists the triangles of each row is counted, too: many triangles on few lattice points.
    let fine = shapes::icosphere(12.0, 6);
    let tight = ShapeOptions {
        max_memory: 400_000,
        ..ShapeOptions::default()
    };
    assert!(VoxelShape::of_mesh(&sphere, H, &tight, Run::on(&Cpu)).is_ok());
    let error = VoxelShape::of_mesh(&fine, H, &tight, Run::on(&Cpu)).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    let open: Vec<_> = sphere.triangles()[10..].to_vec();
    let open = geom_core::TriMesh::new(sphere.positions().to_vec(), open).unwrap();
    let error =
        VoxelShape::of_mesh(&open, 0.5, &ShapeOptions::default(), Run::on(&Cpu)).unwrap_err();
    assert!(matches!(error, Error::Open { .. }), "{error}");
}

#[test]
fn a_shape_corresponds_to_itself() {
    let body = worm(false, 0.0, &UnitQuaternion::identity());
    let itself: Vec<u32> = (0..body.boundary().len() as u32).collect();
    let options = MatchOptions {
        start: Start::Given(itself.clone()),
        refine: Refine::None,
        ..MatchOptions::default()
    };
    let found = on_cpu(&body, &body, &options);
    assert_eq!(found.forward.partners(), itself);
    assert_eq!(found.backward.partners(), itself);
    assert!(found.score < 1e-6 && found.coverage == 1.0 && found.verdict == Verdict::Good);
    assert!(!found.unmatched(0.1).contains(&true) && found.unmatched(-1.0).contains(&true));
    // Two equal shapes, linked at the boundary: joint modes move in phase and are those of one.
    let alone = body.modes(3, Run::on(&Cpu)).unwrap();
    assert!(found.modes.correlations.iter().take(3).all(|c| *c > 0.99));
    assert!(found.modes.values[0] < alone.values[0] * 1.001);
    // Found without help, too.
    let found = on_cpu(&body, &body, &only(Start::Spectral));
    assert_eq!(found.verdict, Verdict::Good);
    let wrong = found
        .forward
        .iter()
        .zip(&itself)
        .filter(|(a, b)| a != b)
        .count();
    assert!(wrong * 20 < itself.len(), "{wrong} of {}", itself.len());
}

/// Mean distance of the partners from where a rotation takes the nodes, in spacings.
fn error(
    a: &VoxelShape,
    b: &VoxelShape,
    found: &Correspondence,
    rotation: &UnitQuaternion<f64>,
) -> f64 {
    let pairs = a.boundary_points().iter().zip(&found.forward);
    let off = pairs.map(|(p, &j)| (rotation * p - b.boundary_points()[j as usize]).norm());
    off.sum::<f64>() / found.forward.len() as f64 / H
}

#[test]
fn a_turned_shape_is_found_and_its_mirror_image_is_not() {
    let body = worm(false, 0.0, &UnitQuaternion::identity());
    let rotation = some_rotation(3);
    let turned = worm(false, 0.0, &rotation);
    let both = MatchOptions {
        start: Start::Spectral,
        ..MatchOptions::default()
    };
    let found = on_cpu(&body, &turned, &both);
    let off = error(&body, &turned, &found, &rotation);
    assert!(
        off < 1.2 && found.verdict == Verdict::Good,
        "{off} {}",
        found.score
    );
    assert!(!found.mirrored);
    let right = found.score;
    let found = on_cpu(&body, &worm(true, 0.0, &rotation), &only(Start::Rigid));
    assert!(found.score > right + 0.3, "{} {right}", found.score);
    assert!(
        found.mirrored && found.verdict != Verdict::Good,
        "{} {:?}",
        found.score,
        found.verdict
    );
    for seed in [8, 21] {
        let rotation = some_rotation(seed);
        let turned = worm(false, 0.0, &rotation);
        let found = on_cpu(&body, &turned, &only(Start::Spectral));
        let off = error(&body, &turned, &found, &rotation);
        assert!(off < 1.2 && found.verdict == Verdict::Good, "{seed}: {off}");
    }
}

/// The same body with its axes in another order, and so its nodes; and with it whatever signs its modes have.
#[test]
fn renumbered_nodes_are_found_again() {
    let third =
        UnitQuaternion::from_scaled_axis(Vector3::repeat(1.0).normalize() * (2.0 * PI / 3.0));
    let identity = UnitQuaternion::identity();
    let (body, turned) = (worm(false, 0.0, &identity), worm(false, 0.0, &third));
    assert_eq!(body.nodes(), turned.nodes());
    let found = on_cpu(&body, &turned, &only(Start::Spectral));
    let pairs = body.boundary_points().iter().zip(&found.forward);
    let there = |(p, j): &(&Point3, &u32)| {
        (third * *p - turned.boundary_points()[**j as usize]).norm() < 1e-6
    };
    let right = pairs.filter(there).count();
    assert!(right * 20 > 19 * found.forward.len(), "{right}");
}

#[test]
fn a_bent_shape_is_followed_by_the_fit_and_by_the_thesis() {
    let body = worm(false, 0.0, &UnitQuaternion::identity());
    let rotation = some_rotation(5);
    let bent = worm(false, 0.9, &rotation);
    // Where nodes go that are far from the hinge.
    let image = |p: &Point3| {
        let (sin, cos) = 0.9f64.sin_cos();
        let there = Point3::new(p.x * cos - p.z * sin, p.y, p.x * sin + p.z * cos);
        rotation * if p.x > 0.0 { there } else { *p }
    };
    let off = |found: &Correspondence| {
        let nodes = body.boundary_points().iter().zip(&found.forward);
        let far: Vec<f64> = nodes
            .filter(|(p, _)| p.x.abs() > 9.0)
            .map(|(p, &j)| (image(p) - bent.boundary_points()[j as usize]).norm())
            .collect();
        far.iter().sum::<f64>() / far.len() as f64
    };
    let found = on_cpu(&body, &bent, &only(Start::Spectral));
    assert!(
        off(&found) < 2.0 && found.verdict == Verdict::Good,
        "{} {}",
        off(&found),
        found.score
    );
    let thesis = MatchOptions {
        start: Start::Thesis,
        refine: Refine::Thesis {
            tolerance: 0.01,
            most: 150,
        },
        ..MatchOptions::default()
    };
    let theirs = on_cpu(&body, &bent, &thesis);
    assert!(off(&theirs) < 8.0, "{}", off(&theirs));
    // Three anchors are enough where nothing else is known.
    let pick = [
        Point3::new(-30.0, 2.0, 0.0),
        Point3::new(-12.0, 12.0, 0.0),
        Point3::new(22.0, 0.0, 3.0),
    ];
    let anchors = MatchOptions {
        start: Start::Anchors(pick.iter().map(|p| (*p, image(p))).collect()),
        ..MatchOptions::default()
    };
    assert!(off(&on_cpu(&body, &bent, &anchors)) < 2.5);
}

#[test]
fn symmetric_bodies_are_doubtful() {
    let ends = [(-16.0, 10.0), (0.0, 6.5), (16.0, 10.0)];
    let dumbbell = |rotation: UnitQuaternion<f64>| {
        of_balls(&ends.map(|(x, r)| (rotation * Point3::new(x, 0.0, 0.0), r)))
    };
    let (upright, turned) = (
        dumbbell(UnitQuaternion::identity()),
        dumbbell(some_rotation(4)),
    );
    let found = on_cpu(&upright, &turned, &only(Start::Rigid));
    assert!(found.score < 4.0);
    assert_eq!(found.verdict, Verdict::Doubtful, "{:?}", found.candidates);
}

/// A trunk on four legs, no two of one length.
fn table() -> VoxelShape {
    let trunk = (0..11).map(|i| (Point3::new(3.0 * f64::from(i) - 15.0, 0.0, 0.0), 8.0));
    let legs = [
        (-13.0, -6.0, 11),
        (-13.0, 6.0, 12),
        (13.0, -6.0, 13),
        (13.0, 6.0, 14),
    ];
    let legs = legs.into_iter().flat_map(|(x, y, beads)| {
        (0..beads).map(move |i| (Point3::new(x, 1.6 * y, -6.0 - 2.5 * f64::from(i)), 4.6))
    });
    of_balls(&trunk.chain(legs).collect::<Vec<_>>())
}

#[test]
fn legs_that_are_swapped_below_the_knee_are_never_good() {
    let body = table();
    let points = body.boundary_points();
    let nearest = |p: Point3| {
        let distance = |q: &Point3| (q - p).norm_squared();
        let ends = 0..points.len() as u32;
        ends.min_by(|&i, &j| {
            distance(&points[i as usize]).total_cmp(&distance(&points[j as usize]))
        })
    };
    // Left for right, of the two legs at one end.
    let swapped: Vec<u32> = points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let shin = p.x < 0.0 && p.z < -20.0;
            let side = if p.y > 0.0 { -19.2 } else { 19.2 };
            let there = Point3::new(p.x, p.y + side, p.z);
            if shin {
                nearest(there).unwrap()
            } else {
                i as u32
            }
        })
        .collect();
    let wrong = |map: &[u32]| (0u32..).zip(map).filter(|(i, j)| i != *j).count();
    assert!(wrong(&swapped) * 12 > points.len());
    let with = |refine| MatchOptions {
        refine,
        ..only(Start::Given(swapped.clone()))
    };
    // As it is: nearly all fits, but for the knees.
    let found = on_cpu(&body, &body, &with(Refine::None));
    assert!(found.score < 4.0, "{}", found.score);
    assert_eq!(found.verdict, Verdict::Doubtful);
    // The fit hangs the shins back on.
    let found = on_cpu(&body, &body, &with(Refine::Annealed));
    let far = |(p, &j): (&Point3, &u32)| (p - points[j as usize]).norm() > 2.0 * H;
    let far = points
        .iter()
        .zip(&found.forward)
        .filter(|e| far(*e))
        .count();
    assert!(far * 50 < points.len(), "{far} of {}", points.len());
    assert_eq!(found.verdict, Verdict::Good, "{}", found.score);
}

#[test]
fn anchors_hold_the_joint_graph_together_more_than_other_links() {
    let body = worm(false, 0.0, &UnitQuaternion::identity());
    let itself: Vec<u32> = (0..body.boundary().len() as u32).collect();
    let map = Map::new(&body, &body, itself.clone()).unwrap();
    let options = MatchOptions {
        modes: 2,
        link: 0.02,
        ..MatchOptions::default()
    };
    let with = |anchored: &[u32]| {
        let on = Run::on(&Cpu as &dyn spectral_corresp::CorrespBackend);
        joint_modes(&body, &body, &map, &map, anchored, &options, on)
    };
    // Equal shapes in phase: links weigh on both ends alike, so they only add to the mass.
    let (plain, held) = (with(&[]).unwrap(), with(&itself).unwrap());
    assert!(held.values[0] < plain.values[0]);
    let beyond = body.boundary().len() as u32;
    assert!(matches!(with(&[beyond]), Err(Error::Length { .. })));
}

#[test]
fn threads_do_not_matter() {
    let body = worm(false, 0.0, &UnitQuaternion::identity());
    let bent = worm(false, 0.5, &some_rotation(2));
    same_on_any_threads(|| {
        let found = on_cpu(&body, &bent, &only(Start::Spectral));
        let bits = found
            .images
            .iter()
            .flat_map(|p| [p.x, p.y, p.z])
            .map(f64::to_bits);
        (found.forward, found.backward, bits.collect::<Vec<_>>())
    });
}

#[test]
fn bad_input_is_refused_by_name() {
    let fine = ShapeOptions::default();
    let of = |counts: [usize; 3], inside: bool| {
        let lattice = lattice(counts);
        VoxelShape::of_flags(&lattice, vec![inside; lattice.len()], &fine, Run::on(&Cpu))
    };
    assert!(matches!(
        of([8, 8, 8], false).unwrap_err(),
        Error::Empty { .. }
    ));
    assert!(matches!(
        of([3, 3, 3], true).unwrap_err(),
        Error::TooSmall { boundary: 26, .. }
    ));
    let grid = |value: f32| ScalarGrid::new(lattice([8, 8, 8]), vec![value; 512]).unwrap();
    let at =
        |value, level| VoxelShape::of_grid(&grid(value), level, &fine, Run::on(&Cpu)).unwrap_err();
    assert!(matches!(at(2.0, 1.0), Error::Full { .. }));
    assert!(matches!(at(0.5, 1.0), Error::Empty { .. }));
    let huge = Lattice {
        counts: [100_000; 3],
        ..lattice([1; 3])
    };
    let error = VoxelShape::of_flags(&huge, Vec::new(), &fine, Run::on(&Cpu)).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");

    let nan = ScalarGrid::new(lattice([8; 3]), vec![f32::NAN; 512]);
    assert!(matches!(nan, Err(GridError::NotFinite { .. })));

    let a = of([10, 8, 6], true).unwrap();
    let many = a.modes(a.nodes(), Run::on(&Cpu)).unwrap_err();
    assert!(matches!(many, Error::TooManyModes { .. }), "{many}");
    let coarse = Lattice {
        spacing: 1.6,
        ..lattice([10, 8, 6])
    };
    let coarse = VoxelShape::of_flags(&coarse, vec![true; 480], &fine, Run::on(&Cpu)).unwrap();
    let error = |b: &VoxelShape, options: MatchOptions| {
        correspond(&a, b, &options, Run::on(&Cpu)).unwrap_err()
    };
    assert!(matches!(
        error(&coarse, MatchOptions::default()),
        Error::SpacingMismatch { .. }
    ));
    let line = |x: f64| (Point3::new(x, 0.0, 0.0), Point3::new(x, 1.0, 0.0));
    let anchors = Start::Anchors(vec![line(0.0), line(5.0), line(9.0)]);
    let with = |start| MatchOptions {
        start,
        ..MatchOptions::default()
    };
    assert_eq!(error(&a, with(anchors)), Error::Anchors { count: 3 });
    assert!(matches!(
        error(&a, with(Start::Given(vec![0]))),
        Error::Length { .. }
    ));
    let beyond = Start::Given(vec![1_000_000; a.boundary().len()]);
    assert!(matches!(
        error(&a, with(beyond)),
        Error::Image { node: 0, .. }
    ));
    let tight = MatchOptions {
        max_memory: 10_000,
        ..MatchOptions::default()
    };
    assert!(matches!(error(&a, tight), Error::Memory { nodes: 960, .. }));
    for wrong in [
        MatchOptions {
            link: 0.0,
            ..MatchOptions::default()
        },
        MatchOptions {
            unit: f64::NAN,
            ..MatchOptions::default()
        },
        MatchOptions {
            modes: 0,
            ..MatchOptions::default()
        },
        MatchOptions {
            verdict: [5.0, 4.0],
            ..MatchOptions::default()
        },
        MatchOptions {
            histograms: HistogramOptions {
                radius: 0.9 * H,
                ..HistogramOptions::default()
            },
            ..MatchOptions::default()
        },
        MatchOptions {
            histograms: HistogramOptions {
                radius: -1.0,
                ..HistogramOptions::default()
            },
            ..MatchOptions::default()
        },
    ] {
        assert!(matches!(error(&a, wrong), Error::Option(_)));
    }
}
