//! Angles and distances that remeshing promises, what it excepts, and what it refuses.

use geom_core::mesh::quality::{angles, edge_lengths};
use geom_core::mesh::shapes;
use geom_core::surface::remesh::{Cause, Error, Features, Options, Sizing, remesh};
use geom_core::{Cancelled, Cpu, Point3, Run, TriMesh};

use super::remeshing::uniform;

#[test]
fn what_is_too_large_to_be_measured_is_refused_before_the_work() {
    let curved = Options {
        sizing: Sizing::Curvature {
            tolerance: 1e198,
            min_edge: 2e198,
            max_edge: 4e199,
            gradation: 0.3,
        },
        ..Options::default()
    };
    let grow = |scale: f64| {
        let (mut positions, triangles) = shapes::icosphere(1.0, 1).into_parts();
        positions.iter_mut().for_each(|p| p.coords *= scale);
        TriMesh::new(positions, triangles).unwrap()
    };
    for options in [uniform(5e199), uniform(1e100), Options::default(), curved] {
        let error = remesh(grow(1e200), None, &options, Run::on(&Cpu)).unwrap_err();
        assert_eq!(error, Error::TooLarge { triangle: 0 });
    }
    // Large, but all squares are finite: what is asked for decides.
    let error = remesh(grow(1e70), None, &uniform(1e-100), Run::on(&Cpu)).unwrap_err();
    assert!(matches!(error, Error::TooMany { .. }), "{error}");
    assert!(remesh(grow(1e40), None, &uniform(5e39), Run::on(&Cpu)).is_ok());
}

#[test]
fn bad_input_is_named() {
    let run = Run::on(&Cpu);
    let tetrahedron = |triangles: &[[u32; 3]]| {
        let corners = [
            [0., 0., 0.],
            [1., 0., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [0., 0., 2.],
        ];
        TriMesh::new(corners.map(Point3::from).to_vec(), triangles.to_vec()).unwrap()
    };
    let options = Options::default();
    let fails = |mesh, options: &Options| remesh(mesh, None, options, run).unwrap_err();
    assert_eq!(fails(TriMesh::default(), &options), Error::Empty);
    let three = tetrahedron(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
    assert!(matches!(fails(three, &options), Error::NotManifold(_)));
    let flat = tetrahedron(&[[0, 3, 4]]);
    assert_eq!(fails(flat, &options), Error::Degenerate { triangle: 0 });
    // One bad value at a time, blamed by its name.
    let sphere = shapes::icosphere(1.0, 1);
    for (bad, name) in [
        (uniform(-1.0), "edge_length"),
        (uniform(f64::NAN), "edge_length"),
        (
            Options {
                min_angle_deg: 75.0,
                ..Options::default()
            },
            "min_angle_deg",
        ),
        (
            Options {
                features: Features::Angle(0.0),
                ..Options::default()
            },
            "features",
        ),
        (
            Options {
                sizing: Sizing::Curvature {
                    tolerance: 0.01,
                    min_edge: 0.1,
                    max_edge: 0.5,
                    gradation: 1e-310,
                },
                ..Options::default()
            },
            "gradation",
        ),
    ] {
        let error = fails(sphere.clone(), &bad);
        assert!(
            matches!(&error, Error::Option(out) if out.option == name),
            "{error}"
        );
    }
    let named = Options {
        features: Features::Edges(vec![[0, 99]]),
        ..Options::default()
    };
    let missing = Error::NoSuchEdge {
        feature: 0,
        from: 0,
        to: 99,
    };
    assert_eq!(fails(sphere.clone(), &named), missing);
    // Refused by an estimate, before memory is asked for.
    let error = fails(sphere.clone(), &uniform(1e-5));
    assert!(matches!(error, Error::TooMany { estimate, .. } if estimate > 200_000_000_000));
    let stop = |_: &'static str, _: u64, _: u64| std::ops::ControlFlow::Break(());
    let stopped = remesh(sphere, None, &options, run.watched_by(&stop));
    assert_eq!(stopped.unwrap_err(), Error::Cancelled(Cancelled));
}

/// A dumb-bell: two balls joined by a thin rod.
fn dumbbell(rod: f64) -> TriMesh {
    let (mut positions, triangles) = shapes::icosphere(1.0, 5).into_parts();
    for p in &mut positions {
        // Radius of the profile along z from −3 to 3.
        let z = 3.0 * p.z;
        let ball = |at: f64| (1.0 - (z - at) * (z - at)).max(0.0).sqrt();
        let waist = if z.abs() < 2.0 { rod } else { 0.0 };
        let wanted = ball(2.0).max(ball(-2.0)).max(waist);
        let now = p.x.hypot(p.y).max(1e-12);
        (p.x, p.y, p.z) = (p.x / now * wanted, p.y / now * wanted, z);
    }
    TriMesh::new(positions, triangles).unwrap()
}

#[test]
fn edges_become_shorter_where_the_surface_is_narrow() {
    let mesh = dumbbell(0.03);
    let volume = mesh.volume();
    let options = uniform(0.25);
    let out = remesh(mesh.clone(), None, &options, Run::on(&Cpu)).unwrap();
    let report = &out.report;
    assert!(report.refinements > 0, "{report:?}");
    assert!(report.after.min_angle_deg >= 30.0, "{report:?}");
    assert_eq!(report.allowed_deviation, 0.3 * 0.25);
    let farthest = report.inner_deviation.max.max(report.reverse_deviation);
    assert!(farthest <= report.allowed_deviation, "{report:?}");
    assert!(
        report.converged && report.exceptions.is_empty(),
        "{report:?}"
    );
    assert!((out.mesh.volume() / volume - 1.0).abs() < 0.03);
    assert!(report.lengths.min < 0.5 && report.lengths.percent_99 < 4.0 / 3.0);
    // On the balls, away from the rod, edges are as long as asked for.
    let far = |p: &Point3| p.z.abs() > 2.3;
    for t in 0..out.mesh.triangles().len() {
        let corners = out.mesh.corners(t);
        if corners.iter().all(far) {
            let longest = edge_lengths(corners).into_iter().fold(0.0, f64::max);
            assert!(longest > 0.18, "triangle {t}: {longest}");
        }
    }
    // Without refinement they are as asked for everywhere, and the report says what that costs.
    let stiff = Options {
        refinements: 0,
        ..options
    };
    let stiff = remesh(mesh, None, &stiff, Run::on(&Cpu)).unwrap();
    assert_eq!(stiff.report.shortened, 0.0);
    assert!(stiff.mesh.triangles().len() < out.mesh.triangles().len());
    let report = &stiff.report;
    let missed =
        report.inner_deviation.max.max(report.reverse_deviation) > report.allowed_deviation;
    assert!(missed || !report.exceptions.is_empty(), "{report:?}");
    assert!(!report.converged);
}

#[test]
fn a_tighter_bound_is_kept_too() {
    let mesh = shapes::icosphere(1.0, 4);
    let bound = 0.004;
    let options = Options {
        max_deviation: Some(bound),
        ..uniform(0.3)
    };
    let out = remesh(mesh.clone(), None, &options, Run::on(&Cpu)).unwrap();
    let report = &out.report;
    assert!(report.inner_deviation.max <= bound, "{report:?}");
    assert!(report.reverse_deviation <= bound, "{report:?}");
    // Chords of 0.3 alone would be three times as far away.
    let loose = Options {
        max_deviation: Some(f64::INFINITY),
        ..options
    };
    let out = remesh(mesh, None, &loose, Run::on(&Cpu)).unwrap();
    assert!(out.report.inner_deviation.max > 2.0 * bound);
    assert_eq!(out.report.refinements, 0);
}

#[test]
fn a_ragged_border_makes_no_needles() {
    // A square whose left border is a fine zigzag.
    let n = 40;
    let at = |i: u32, j: u32| {
        let ragged = if i == 0 && j % 2 == 1 { 0.012 } else { 0.0 };
        Point3::new(f64::from(i) / 40.0 + ragged, f64::from(j) / 40.0, 0.0)
    };
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for j in 0..=n {
        positions.extend((0..=n).map(|i| at(i, j)));
    }
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mesh = TriMesh::new(positions, triangles).unwrap();
    let out = remesh(mesh, None, &uniform(0.1), Run::on(&Cpu)).unwrap();
    let report = &out.report;
    assert!(report.after.min_angle_deg >= 30.0, "{report:?}");
    assert!(report.reverse_deviation < 0.03, "{report:?}");
    // The four corners of the square stay.
    for corner in [at(0, 0), at(n, 0), at(n, n), at(0, n)] {
        assert!(out.mesh.positions().contains(&corner), "{corner}");
    }
    // The border has about ten edges per side, not forty.
    assert!(report.feature_edges < 55, "{report:?}");
    assert!(report.after.nearly_regular > 0.97, "{report:?}");
}

#[test]
fn angles_between_kept_edges_are_exceptions() {
    // A fan of three thin triangles: its tip has 12°.
    let tip = |k: u32| {
        let a = f64::from(4 * k).to_radians();
        Point3::new(a.cos(), a.sin(), 0.0)
    };
    let positions = vec![Point3::origin(), tip(0), tip(1), tip(2), tip(3)];
    let mesh = TriMesh::new(positions, vec![[0, 1, 2], [0, 2, 3], [0, 3, 4]]).unwrap();
    let out = remesh(mesh, None, &uniform(0.1), Run::on(&Cpu)).unwrap();
    let kept: Vec<_> = out
        .report
        .exceptions
        .iter()
        .filter(|e| e.cause == Cause::KeptEdges)
        .collect();
    assert!(!kept.is_empty(), "{:?}", out.report);
    for e in &out.report.exceptions {
        let angles = angles(out.mesh.corners(e.triangle as usize));
        let smallest = angles.into_iter().fold(f64::INFINITY, f64::min);
        assert_eq!(smallest.to_degrees(), e.angle_deg);
    }
    assert!(!out.report.converged);
}
