//! Morphs, comparisons and the truth: what holds for all of them, and cases done by hand.

use geom_core::nalgebra::Rotation3;
use geom_core::{Aabb, Cpu, Lattice, LatticeValues, Point3, Run, Vector3};
use spectral_corresp::compare::{cycle_error, distances};
use spectral_corresp::fit::superpose;
use spectral_corresp::morph::Overlap;
use spectral_corresp::options::{Components, Landmarks, Paths};
use spectral_corresp::{
    CompareOptions, Correspondence, Error, JointModes, Map, Morph, MorphOptions, ShapeOptions,
    Truth, Verdict, VoxelShape, compare,
};

fn shape_of(counts: [usize; 3], inside: impl Fn([usize; 3]) -> bool) -> VoxelShape {
    let lattice = Lattice {
        origin: Point3::new(3.0, -2.0, 1.0),
        spacing: 1.5,
        counts,
    };
    let flags = (0..lattice.len()).map(|at| inside(lattice.coordinates(at)));
    let options = ShapeOptions {
        components: Components::All,
        ..ShapeOptions::default()
    };
    VoxelShape::of_flags(&lattice, flags.collect(), &options, Run::on(&Cpu)).unwrap()
}

/// An L with a tail as thin as a lattice point, and a crumb that nothing joins to it.
fn body() -> VoxelShape {
    shape_of([18, 14, 5], |[i, j, k]| {
        let arm = (i < 12 && j < 5) || (i < 5 && j < 12);
        let tail = (12..17).contains(&i) && j == 2 && k == 2;
        (arm || tail || (i > 14 && j > 11 && k < 2)) && k < 5
    })
}

fn map(from: &VoxelShape, to: &VoxelShape, partners: impl IntoIterator<Item = u32>) -> Map {
    Map::new(from, to, partners.into_iter().collect()).unwrap()
}

/// A correspondence that says no more than where the boundary goes.
fn to(a: &VoxelShape, image: impl Fn(&Point3) -> Point3) -> Correspondence {
    let images: Vec<Point3> = a.boundary_points().iter().map(image).collect();
    let itself = map(a, a, 0..images.len() as u32);
    let pairs: Vec<(Point3, Point3)> = a
        .boundary_points()
        .iter()
        .copied()
        .zip(images.clone())
        .collect();
    Correspondence {
        forward: itself.clone(),
        backward: itself,
        rotations: vec![superpose(&pairs).rotation; images.len()],
        distances: vec![0.0; images.len()],
        images,
        coverage: 1.0,
        score: 0.0,
        verdict: Verdict::Good,
        turned: false,
        mirrored: false,
        modes: JointModes {
            values: Vec::new(),
            first: Vec::new(),
            second: Vec::new(),
            correlations: Vec::new(),
            dropped: 0,
            link: 1.0,
        },
        candidates: Vec::new(),
    }
}

/// The images of these tests are not on a second shape.
fn one_way() -> MorphOptions {
    MorphOptions {
        two_way: false,
        ..MorphOptions::default()
    }
}

fn morph(a: &VoxelShape, found: &Correspondence, options: &MorphOptions) -> Morph {
    Morph::new(a, a, found, options, Run::on(&Cpu)).unwrap()
}

fn rest(a: &VoxelShape) -> Vec<Point3> {
    (0..a.nodes()).map(|i| a.position(i)).collect()
}

/// The largest error of distances between nodes of the first part, Å.
fn unrigid(a: &[Point3], b: &[Point3]) -> f64 {
    let from = [0, a.len() / 3, a.len() / 2];
    let change = |(i, j): (usize, usize)| ((a[i] - a[j]).norm() - (b[i] - b[j]).norm()).abs();
    let pairs = from.iter().flat_map(|&i| (0..a.len()).map(move |j| (i, j)));
    pairs.map(change).fold(0.0, f64::max)
}

fn turned(axis: Vector3, angle: f64) -> impl Fn(&Point3) -> Point3 {
    let rotation = Rotation3::new(axis.normalize() * angle);
    move |p| rotation * p + Vector3::new(30.0, -4.0, 9.0)
}

#[test]
fn a_morph_starts_at_the_first_shape_and_ends_at_the_images() {
    let a = body();
    let bend = |p: &Point3| Rotation3::new(Vector3::z() * (0.03 * p.x)) * p;
    for paths in [Paths::Rotating, Paths::Linear] {
        let options = MorphOptions {
            paths,
            sigma: 0.0,
            ..one_way()
        };
        let morph = morph(&a, &to(&a, bend), &options);
        assert_eq!(morph.at(0.0).unwrap(), rest(&a));
        let end = morph.at(1.0).unwrap();
        for (&node, p) in a.boundary().iter().zip(a.boundary_points()) {
            assert_eq!(end[node as usize], bend(p));
        }
        // Near the end it is near it.
        let near = morph.at(1.0 - 1e-9).unwrap();
        let apart = near
            .iter()
            .zip(&end)
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f64::max);
        assert!(
            apart < if paths == Paths::Rotating { 1e-6 } else { 0.2 },
            "{apart}"
        );
        // Without a low-pass the first frame is the first shape.
        let frame = morph.frame(0.0, Run::on(&Cpu)).unwrap();
        let lattice = frame.grid.lattice();
        let inside = (0..lattice.len()).filter(|&at| frame.flags[at]);
        let places: Vec<Point3> = inside
            .map(|at| lattice.point(lattice.coordinates(at)))
            .collect();
        assert_eq!(places.len(), a.nodes());
        let apart = places
            .iter()
            .zip(&rest(&a))
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f64::max);
        assert!(apart < 1e-9);
    }
}

#[test]
fn a_rigid_motion_is_rigid_all_the_way() {
    let a = body();
    // The crumb is a part of its own.
    let parts = |p: &[Point3]| -> Vec<Vec<Point3>> {
        let far = |p: &Point3| p.x > 23.0 && p.y > 15.0;
        let rest = rest(&a);
        let some = |crumb: bool| {
            p.iter()
                .zip(&rest)
                .filter(|(_, r)| far(r) == crumb)
                .map(|(p, _)| *p)
                .collect()
        };
        vec![some(false), some(true)]
    };
    for angle in [0.7, 2.9] {
        let found = to(&a, turned(Vector3::new(1.0, 2.0, 3.0), angle));
        let morph = morph(&a, &found, &one_way());
        assert!(
            unrigid(&rest(&a), morph.target()) < 1e-8,
            "{}",
            unrigid(&rest(&a), morph.target())
        );
        for t in [0.25, 0.5, -0.3, 1.4] {
            let now = morph.at(t).unwrap();
            for (a, b) in parts(&rest(&a)).iter().zip(&parts(&now)) {
                assert!(unrigid(a, b) < 1e-8, "{angle} {t}: {}", unrigid(a, b));
            }
            let report = morph.frame(t, Run::on(&Cpu)).unwrap().report;
            assert!((report.largest_stretch - 1.0).abs() < 1e-8 && report.self_overlap == 0.0);
            assert_eq!(report.strained, 0.0);
        }
    }
    // Without a factor it is as rigid as conjugate gradients are exact.
    let found = to(&a, turned(Vector3::z(), 1.2));
    let iterated = MorphOptions {
        direct_nodes: 0,
        ..one_way()
    };
    let morph = morph(&a, &found, &iterated);
    assert!(!morph.report().factored);
    let now = morph.at(0.5).unwrap();
    for (a, b) in parts(&rest(&a)).iter().zip(&parts(&now)) {
        assert!(unrigid(a, b) < 1e-3);
    }
    // A frame is compared with what lies within reach, and refuses to look at the whole world.
    let frame = morph.frame(0.5, Run::on(&Cpu)).unwrap();
    let bounds = |far: f64| Aabb::of_points(&[Point3::origin(), Point3::new(far, 1.0, 1.0)]);
    let nowhere = |points: &[Point3]| Ok::<_, Error>(vec![false; points.len()]);
    let first = |points: &[Point3]| Ok::<_, Error>((0..points.len()).map(|i| i == 0).collect());
    assert!(frame.overlap(&bounds(1.0), first).unwrap().volume_ratio > 100.0);
    for far in [1e12, f64::INFINITY] {
        let refused = frame.overlap(&bounds(far), nowhere);
        assert!(
            matches!(refused, Err(Error::TooLarge { .. })),
            "{refused:?}"
        );
    }
}

#[test]
fn straight_paths_shrink_what_turns() {
    let a = body();
    let angle = 1.3;
    let options = MorphOptions {
        paths: Paths::Linear,
        ..one_way()
    };
    let morph = morph(&a, &to(&a, turned(Vector3::z(), angle)), &options);
    let half = morph.at(0.5).unwrap();
    let flat = |p: &Point3, q: &Point3| (p - q).xy().norm();
    let (first, rest) = (a.boundary()[0] as usize, rest(&a));
    for &node in a.boundary() {
        let node = node as usize;
        let (before, now) = (
            flat(&rest[node], &rest[first]),
            flat(&half[node], &half[first]),
        );
        assert!((now - before * (angle / 2.0f64).cos()).abs() < 1e-9);
    }
}

#[test]
fn frames_have_the_volume_between() {
    let a = shape_of([22, 9, 9], |_| true);
    let b = shape_of([17, 9, 9], |_| true);
    // Out of step with the lattice, where whole layers would have one value.
    let turn = Rotation3::new(Vector3::new(0.2, 0.1, 0.3));
    let squeeze = |p: &Point3| turn * Point3::new(p.x * 17.0 / 22.0, p.y, p.z);
    let mut found = to(&a, squeeze);
    found.backward = map(&b, &a, 0..b.boundary().len() as u32);
    let morph = Morph::new(&a, &b, &found, &one_way(), Run::on(&Cpu)).unwrap();
    for t in [-0.2, 0.0, 0.3, 0.8, 1.0, 1.1] {
        let frame = morph.frame(t, Run::on(&Cpu)).unwrap();
        let share = t.clamp(0.0, 1.0);
        let wanted = a.volume() * (1.0 - share) + b.volume() * share;
        assert!((frame.report.volume / wanted - 1.0).abs() < 0.005);
        assert!((frame.report.wanted_volume - wanted).abs() < 1e-6);
        let above = frame
            .grid
            .values()
            .iter()
            .filter(|v| f64::from(**v) >= frame.level)
            .count();
        let inside = frame.flags.iter().filter(|f| **f).count();
        assert!(
            above.abs_diff(inside) <= inside / 20,
            "the level is between: {above} {inside}"
        );
    }
    let longest = morph.frame(1.0, Run::on(&Cpu)).unwrap().report;
    assert!(longest.smallest_stretch > 0.7 && longest.smallest_stretch < 17.0 / 22.0 + 1e-9);
}

#[test]
fn both_ways_end_at_the_second_shape() {
    let (a, b) = (
        shape_of([22, 9, 9], |_| true),
        shape_of([17, 10, 9], |_| true),
    );
    let scale = Vector3::new(16.0 / 21.0, 9.0 / 8.0, 1.0);
    let mut found = to(&a, |p| {
        Point3::from(p.coords.component_mul(&scale) + Vector3::new(0.7, 0.2, 0.0))
    });
    let nearest = |q: &Point3| {
        let apart = |i: &u32| (found.images[*i as usize] - q).norm();
        let all = 0..found.images.len() as u32;
        all.min_by(|i, j| apart(i).total_cmp(&apart(j))).unwrap()
    };
    found.backward = map(&b, &a, b.boundary_points().iter().map(nearest));
    let options = MorphOptions {
        sigma: 0.0,
        ..MorphOptions::default()
    };
    let morph = Morph::new(&a, &b, &found, &options, Run::on(&Cpu)).unwrap();
    for (t, shape) in [(0.0, &a), (1.0, &b)] {
        let frame = morph.frame(t, Run::on(&Cpu)).unwrap();
        let lattice = frame.grid.lattice();
        let places = (0..lattice.len()).filter(|&at| frame.flags[at]);
        let places: Vec<Point3> = places
            .map(|at| lattice.point(lattice.coordinates(at)))
            .collect();
        let nodes = rest(shape);
        let apart = places.iter().zip(&nodes).map(|(a, b)| (a - b).norm());
        assert!(places.len() == shape.nodes() && apart.fold(0.0, f64::max) < 1e-9);
    }
    let half = morph.frame(0.5, Run::on(&Cpu)).unwrap().report;
    assert!((half.volume / (0.5 * (a.volume() + b.volume())) - 1.0).abs() < 0.005);
}

#[test]
fn few_landmarks_lead_the_rest() {
    let a = shape_of([25, 8, 8], |_| true);
    let bend = |p: &Point3| Rotation3::new(Vector3::z() * (0.02 * p.x)) * p;
    let options = MorphOptions {
        landmarks: Landmarks::Harmonic { radius: 4.0 },
        ..one_way()
    };
    let harmonic = morph(&a, &to(&a, bend), &options);
    let landmarks = harmonic.landmarks();
    // The eight corners are tips; the rest lies deep inside.
    let at_corner = |&&n: &&u32| {
        let p = a.graph().point(n as usize);
        [0, 24].contains(&p[0]) && [0, 7].contains(&p[1]) && [0, 7].contains(&p[2])
    };
    assert_eq!(
        landmarks.iter().filter(at_corner).count(),
        8,
        "{landmarks:?}"
    );
    assert!(landmarks.len() > 8 && landmarks.len() < 40);
    // They are where all of the boundary would take them, and the others not far.
    let dense = morph(&a, &to(&a, bend), &one_way());
    for (i, (few, all)) in harmonic.target().iter().zip(dense.target()).enumerate() {
        let limit = if landmarks.contains(&(i as u32)) {
            1e-12
        } else {
            4.5
        };
        assert!((few - all).norm() < limit, "{i}: {few} {all}");
    }
    // Given ones, too.
    let given = landmarks
        .iter()
        .map(|&n| (n, dense.target()[n as usize]))
        .collect();
    let custom = MorphOptions {
        landmarks: Landmarks::Custom(given),
        ..one_way()
    };
    assert_eq!(
        morph(&a, &to(&a, bend), &custom).target(),
        harmonic.target()
    );
}

#[test]
fn what_makes_no_sense_is_refused() {
    let a = body();
    let found = to(&a, |p| *p);
    let make = |found: &Correspondence, landmarks: Landmarks| {
        let options = MorphOptions {
            landmarks,
            ..one_way()
        };
        Morph::new(&a, &a, found, &options, Run::on(&Cpu))
            .map(|_| ())
            .unwrap_err()
    };
    let nowhere = (0, Point3::new(f64::NAN, 0.0, 0.0));
    for given in [(u32::MAX, Point3::origin()), nowhere] {
        let refused = make(&found, Landmarks::Custom(vec![given]));
        assert!(matches!(refused, Error::Landmark { .. }));
    }
    assert!(matches!(
        make(&found, Landmarks::Harmonic { radius: 0.0 }),
        Error::Option(_)
    ));
    let mut short = found.clone();
    short.images.pop();
    assert!(matches!(
        make(&short, Landmarks::Boundary),
        Error::Length { .. }
    ));
    let mut lost = found.clone();
    lost.images[3].x = f64::INFINITY;
    assert!(matches!(
        make(&lost, Landmarks::Boundary),
        Error::NotFinite { point: 3 }
    ));
    let fine = morph(&a, &found, &one_way());
    for time in [f64::NAN, f64::INFINITY, 1e30, -11.0] {
        assert!(matches!(fine.at(time), Err(Error::Time { .. })), "{time}");
    }
    let small = MorphOptions {
        max_memory: 1000,
        ..one_way()
    };
    let refused = morph(&a, &found, &small).frame(0.5, Run::on(&Cpu));
    assert!(matches!(refused, Err(Error::TooLarge { .. })));
    assert!(matches!(
        Overlap::of(&[true], &[]),
        Err(Error::Length { .. })
    ));
    assert!(matches!(
        Overlap::of(&[false], &[true]),
        Err(Error::Empty { .. })
    ));
    let far: Vec<u32> = vec![9999; a.boundary().len()];
    let refused = Map::new(&a, &a, far);
    assert!(matches!(refused, Err(Error::Image { node: 0, .. })));
    assert!(cycle_error(&[&a], &[]).is_err() && cycle_error(&[], &[]).is_err());
}

#[test]
fn a_shape_does_not_differ_from_itself() {
    let (a, b) = (body(), shape_of([18, 14, 5], |_| true));
    let itself = map(&a, &a, 0..a.boundary().len() as u32);
    let options = CompareOptions::default();
    let found = compare(&a, &a, &itself, &options, Run::on(&Cpu)).unwrap();
    assert!(found.diameters.iter().all(|d| *d == 0.0));
    assert!(found.distortions.iter().all(|e| *e < 1e-6));
    assert_eq!(found.report.coverage, 1.0);
    // All nodes on one: everything is lost.
    let one = map(&a, &a, vec![0; itself.len()]);
    let lost = compare(&a, &a, &one, &options, Run::on(&Cpu)).unwrap();
    assert!(lost.report.distortions.mean > 5.0 && lost.report.coverage < 0.01);
    assert!(lost.report.distortions.max >= lost.report.distortions.p95);
    // A walk from node to node and back.
    let n = itself.len() as u32;
    let next = map(&a, &a, itself.iter().map(|i| (i + 1) % n));
    let back = map(&a, &a, itself.iter().map(|i| (i + n - 1) % n));
    assert_eq!(cycle_error(&[&a, &a], &[&next, &back]).unwrap().max, 0.0);
    let once = cycle_error(&[&a], &[&next]).unwrap();
    let points = a.boundary_points();
    let steps = (0..points.len()).map(|i| (points[(i + 1) % points.len()] - points[i]).norm());
    assert!((once.mean - steps.sum::<f64>() / points.len() as f64).abs() < 1e-9);
    // Of shapes that are equal, nothing but zeros; and the same both ways.
    let maps = |i: usize, j: usize| {
        let shapes = [&a, &a, &b];
        let there = shapes[j].boundary().len() as u32;
        let first = 0..shapes[i].boundary().len() as u32;
        Ok(map(shapes[i], shapes[j], first.map(|k| k.min(there - 1))))
    };
    let all = distances(&[&a, &a, &b], maps, &options, Run::on(&Cpu)).unwrap();
    assert!(all[1] < 1e-6 && all[2] > 1.0 && all[2] == all[6] && all[0] == 0.0);
}

#[test]
fn a_missing_part_is_seen_where_it_was() {
    let bar = |[_, j, k]: [usize; 3]| j < 8 && k < 8;
    let knob = |[i, j, k]: [usize; 3]| (2..7).contains(&i) && j >= 8 && (1..6).contains(&k);
    let a = shape_of([30, 15, 8], |p| bar(p) || knob(p));
    let b = shape_of([30, 15, 8], bar);
    let nearest = |p: &Point3| {
        let apart = |j: &u32| (b.boundary_points()[*j as usize] - p).norm_squared();
        let all = 0..b.boundary().len() as u32;
        all.min_by(|i, j| apart(i).total_cmp(&apart(j))).unwrap()
    };
    let found = map(&a, &b, a.boundary_points().iter().map(nearest));
    let options = CompareOptions {
        radius: 6.0,
        ..CompareOptions::default()
    };
    let turned = compare(&b, &a, &found, &options, Run::on(&Cpu));
    assert_eq!(turned, Err(Error::Direction));
    let found = compare(&a, &b, &found, &options, Run::on(&Cpu)).unwrap();
    let mean = |values: &[f64], is_in: &dyn Fn(&Point3) -> bool| {
        let some = a
            .boundary_points()
            .iter()
            .zip(values)
            .filter(|(p, _)| is_in(p));
        some.clone().map(|(_, v)| v).sum::<f64>() / some.count() as f64
    };
    let far = |p: &Point3| p.x > 25.0;
    let on_knob = |p: &Point3| p.y > -2.0 + 1.5 * 8.5;
    assert!(mean(&found.distortions, &far) < 1e-6 && mean(&found.diameters, &far) < 0.1);
    assert!(mean(&found.distortions, &on_knob) > 1.0 && mean(&found.diameters, &on_knob) > 0.5);
}

#[test]
fn the_truth_follows_the_atoms() {
    // Two rows of atoms; the second one swings away.
    let atoms: Vec<Point3> = (0..40)
        .map(|i| {
            let (row, i) = (i / 20, f64::from(i % 20));
            Point3::new(
                1.4 * i,
                40.0 * f64::from(row) + (i * 1.7).sin(),
                (i * 2.3).cos(),
            )
        })
        .collect();
    let swing = turned(Vector3::new(0.0, 1.0, 1.0), 1.0);
    let moved: Vec<Point3> = atoms
        .iter()
        .map(|p| if p.y > 20.0 { swing(p) } else { *p })
        .collect();
    let truth = Truth::new(&atoms, &[1.7; 40], &moved).unwrap();
    let (near, far) = (Point3::new(5.0, 4.0, 1.0), Point3::new(9.0, 37.0, -2.0));
    assert!((truth.image(&near) - near).norm() < 1e-9);
    assert!((truth.image(&far) - swing(&far)).norm() < 1e-9);
    // A large atom takes the points near its surface from small ones.
    let pair = [Point3::origin(), Point3::new(10.0, 0.0, 0.0)];
    let apart = [Point3::origin(), Point3::new(10.0, 7.0, 0.0)];
    let point = Point3::new(6.0, 0.0, 0.0);
    let of = |radii: &[f64]| Truth::new(&pair, radii, &apart).unwrap().image(&point);
    assert!((of(&[1.0, 1.0]) - Point3::new(6.0, 7.0, 0.0)).norm() < 1e-9);
    assert!((of(&[5.9, 1.0]) - point).norm() < 1e-9);
    // Reports.
    let a = body();
    let itself = map(&a, &a, 0..a.boundary().len() as u32);
    let still = Truth::new(&atoms, &[1.7; 40], &atoms).unwrap();
    let judged = still.judge(&a, &a, &itself).unwrap();
    assert!(judged.mean < 1e-9 && judged.p95 < 1e-9 && judged.floor < 1e-9);
    assert_eq!((judged.within_3, judged.within_5), (1.0, 1.0));
    let shifted: Vec<Point3> = atoms.iter().map(|p| p + Vector3::x() * 4.0).collect();
    let shifted = Truth::new(&atoms, &[1.7; 40], &shifted).unwrap();
    let judged = shifted.judge(&a, &a, &itself).unwrap();
    assert!((judged.mean - 4.0).abs() < 1e-9 && (judged.median - 4.0).abs() < 1e-9);
    assert_eq!((judged.within_3, judged.within_5), (0.0, 1.0));
    assert!(judged.floor < 4.0 && judged.floor > 0.3);
    let residues: Vec<u32> = (0..40).map(|i| i / 4).collect();
    assert_eq!(
        still.residue_accuracy(&residues, &a, &a, &itself).unwrap(),
        1.0
    );
    // Refusals.
    assert!(matches!(
        Truth::new(&[], &[], &[]),
        Err(Error::Length { .. })
    ));
    assert!(matches!(
        Truth::new(&pair, &[1.0], &apart),
        Err(Error::Length { .. })
    ));
    assert!(matches!(
        Truth::new(&pair, &[1.0, f64::NAN], &apart),
        Err(Error::Nearest(_))
    ));
    let other = shape_of([12, 9, 5], |_| true);
    assert_eq!(still.judge(&other, &a, &itself), Err(Error::Direction));
    assert!(
        still
            .residue_accuracy(&residues[1..], &a, &a, &itself)
            .is_err()
    );
}
