//! What remeshing must keep and reach.

use crate::mesh::{Halfedges, SurfaceAudit, shapes};
use crate::testing::same_on_any_threads;
use crate::{Cpu, ImplicitField, Point3, Run, TriMesh, Vector3};

use super::*;
use crate::mesh::quality::{angles, edge_lengths};

/// A torus about z as a level set: positive inside, 1 at the surface.
struct Torus {
    major: f64,
    minor: f64,
}

impl ImplicitField for Torus {
    fn value(&self, x: &Point3) -> f64 {
        self.value_gradient(x).0
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let ring = x.x.hypot(x.y).max(1e-12);
        let d = Vector3::new(
            x.x - self.major * x.x / ring,
            x.y - self.major * x.y / ring,
            x.z,
        );
        (1.0 + self.minor - d.norm(), -d / d.norm().max(1e-12))
    }
}

fn uniform(edge_length: f64) -> Options {
    Options {
        sizing: Sizing::Uniform {
            edge_length: Some(edge_length),
        },
        ..Options::default()
    }
}

fn noisy_sphere(levels: u32, noise: f64) -> TriMesh {
    let (mut positions, triangles) = shapes::icosphere(1.0, levels).into_parts();
    for (i, p) in positions.iter_mut().enumerate() {
        let t = i as f64;
        *p += Vector3::new((7.1 * t).sin(), (5.3 * t).cos(), (3.7 * t).sin()) * noise;
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// The unit cube, its faces cut into `n × n` squares of two triangles; with `open`, without its top.
fn cube(n: u32, open: bool) -> TriMesh {
    let mut triangles = Vec::new();
    let mut positions: Vec<Point3> = Vec::new();
    let mut number = std::collections::HashMap::new();
    for axis in 0..3 {
        for side in 0..2 {
            if open && (axis, side) == (2, 1) {
                continue;
            }
            let mut at = |i: u32, j: u32| {
                let mut p = [0; 3];
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (n * side, i, j);
                *number.entry(p).or_insert_with(|| {
                    positions.push(Point3::from(p.map(|c| f64::from(c) / f64::from(n))));
                    positions.len() as u32 - 1
                })
            };
            for i in 0..n {
                for j in 0..n {
                    let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                    let squares = [[a, b, c], [a, c, d]];
                    let turned =
                        |[a, b, c]: [u32; 3]| if side == 0 { [a, c, b] } else { [a, b, c] };
                    triangles.extend(squares.map(turned));
                }
            }
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

fn on_cube(p: &Point3) -> bool {
    let near = |c: f64| c.abs() < 1e-9 || (c - 1.0).abs() < 1e-9;
    p.iter().any(|&c| near(c)) && p.iter().all(|&c| (-1e-9..1.0 + 1e-9).contains(&c))
}

#[test]
fn triangles_become_good_and_the_topology_stays() {
    for (name, mesh, length) in [
        ("finer", shapes::icosphere(1.0, 3), 0.05),
        ("coarser", shapes::icosphere(1.0, 4), 0.2),
        ("noisy", noisy_sphere(4, 0.02), 0.08),
        ("torus", shapes::torus(3.0, 1.0, 40, 12), 0.3),
        ("needles", shapes::torus(3.0, 1.0, 200, 12), 0.2),
    ] {
        let euler = mesh.euler_characteristic();
        let volume = mesh.volume();
        let options = Options {
            // Peaks of noise are not to be kept.
            max_deviation: (name == "noisy").then_some(f64::INFINITY),
            ..uniform(length)
        };
        let out = remesh(mesh, None, &options, Run::on(&Cpu)).unwrap();
        let report = &out.report;
        assert!(SurfaceAudit::of(&out.mesh).is_closed_manifold(), "{name}");
        assert_eq!(out.mesh.euler_characteristic(), euler, "{name}");
        assert!(report.converged, "{name}: {report:?}");
        assert!(report.after.min_angle_deg >= 30.0, "{name}: {report:?}");
        assert!(
            report.after.mean_min_angle_deg >= 52.0,
            "{name}: {report:?}"
        );
        assert!(
            (report.after.mean_edge / length - 1.0).abs() < 0.05,
            "{name}: {report:?}"
        );
        assert!(report.after.max_edge < 1.5 * length, "{name}: {report:?}");
        assert!(report.vertex_deviation.max < 1e-12, "{name}: {report:?}");
        assert!((out.mesh.volume() / volume - 1.0).abs() < 0.03, "{name}");
    }
}

#[test]
fn vertices_lie_on_the_level_set_and_triangles_face_out() {
    let field = Torus {
        major: 3.0,
        minor: 1.0,
    };
    // The input is a coarse, twisted likeness; the field knows better.
    let mesh = shapes::torus(3.0, 0.97, 30, 10);
    let out = remesh(mesh, Some(&field), &uniform(0.2), Run::on(&Cpu)).unwrap();
    assert!(out.report.converged, "{:?}", out.report);
    assert!(out.report.vertex_deviation.max < 1e-6, "{:?}", out.report);
    assert_eq!(out.report.off_level, 0);
    for t in 0..out.mesh.triangles().len() {
        let [a, b, c] = out.mesh.corners(t);
        let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let outward = -field.value_gradient(&middle).1;
        assert!(
            out.mesh.doubled_area_normal(t).normalize().dot(&outward) > 0.9,
            "triangle {t}"
        );
    }
    let exact = 4.0 * std::f64::consts::PI.powi(2) * 3.0;
    assert!((out.mesh.area() / exact - 1.0).abs() < 0.01);
}

#[test]
fn what_the_level_set_has_not_stays_as_the_input_has_it() {
    let field = Torus {
        major: 3.0,
        minor: 1.0,
    };
    // A ball in the hole of the torus, far from its surface.
    let (mut positions, mut triangles) = shapes::torus(3.0, 1.0, 40, 14).into_parts();
    let first = positions.len() as u32;
    let ball = shapes::icosphere(0.6, 3);
    positions.extend_from_slice(ball.positions());
    triangles.extend(ball.triangles().iter().map(|t| t.map(|v| v + first)));
    let mesh = TriMesh::new(positions, triangles).unwrap();
    let out = remesh(mesh, Some(&field), &uniform(0.2), Run::on(&Cpu)).unwrap();
    let on_ball = |p: &&Point3| p.coords.norm() < 1.5;
    let balls = out.mesh.positions().iter().filter(on_ball);
    let count = balls.clone().count();
    assert!(count > 100);
    assert!(
        balls
            .into_iter()
            .all(|p| (0.58..0.601).contains(&p.coords.norm()))
    );
    assert_eq!(out.report.off_level, count);
    assert!(out.report.converged, "{:?}", out.report);
    let audit = SurfaceAudit::of(&out.mesh);
    assert!(audit.is_closed_manifold());
    assert_eq!(audit.components.len(), 2);
}

#[test]
fn features_stay_where_they_are() {
    let options = Options {
        features: Features::Angle(30.0),
        ..uniform(0.11)
    };
    let out = remesh(cube(4, false), None, &options, Run::on(&Cpu)).unwrap();
    assert!(out.mesh.positions().iter().all(on_cube));
    assert!((out.mesh.volume() - 1.0).abs() < 1e-9);
    assert!((out.mesh.area() - 6.0).abs() < 1e-9);
    assert!(out.report.after.min_angle_deg > 30.0, "{:?}", out.report);
    // Twelve edges of length 1, cut to about 0.11.
    assert!(
        (96..=132).contains(&out.report.feature_edges),
        "{:?}",
        out.report
    );
    let corners = out
        .mesh
        .positions()
        .iter()
        .filter(|p| p.iter().all(|&c| c == 0.0 || c == 1.0));
    assert_eq!(corners.count(), 8);
    // The same by naming the edges.
    let mesh = cube(4, false);
    let edges = Halfedges::of(&mesh).unwrap();
    let sharp: Vec<[u32; 2]> = edges
        .edges()
        .map(|h| [edges.from(h).0, edges.to(h).0])
        .filter(|e| {
            let [p, q] = e.map(|v| mesh.positions()[v as usize]);
            (0..3)
                .filter(|&k| p[k] == q[k] && (p[k] == 0.0 || p[k] == 1.0))
                .count()
                == 2
        })
        .collect();
    assert_eq!(sharp.len(), 48);
    let named = Options {
        features: Features::Edges(sharp),
        ..options
    };
    assert_eq!(remesh(mesh, None, &named, Run::on(&Cpu)).unwrap(), out);
}

#[test]
fn boundaries_stay_where_they_are() {
    let options = Options {
        features: Features::Angle(30.0),
        ..uniform(0.09)
    };
    let out = remesh(cube(5, true), None, &options, Run::on(&Cpu)).unwrap();
    assert!((out.mesh.area() - 5.0).abs() < 1e-9);
    assert!(out.mesh.positions().iter().all(on_cube));
    let edges = Halfedges::of(&out.mesh).unwrap();
    let loops = edges.boundary_loops();
    assert_eq!(loops.len(), 1);
    let at = |v: crate::VertexId| out.mesh.positions()[v.0 as usize];
    assert!(loops[0].iter().all(|&v| at(v).z == 1.0));
    let ends = loops[0].iter().zip(loops[0].iter().cycle().skip(1));
    let length: f64 = ends.map(|(&a, &b)| (at(b) - at(a)).norm()).sum();
    assert!((length - 4.0).abs() < 1e-9);
    assert!(out.report.after.min_angle_deg > 30.0, "{:?}", out.report);
}

#[test]
fn labels_stay_where_they_are() {
    // Quarters of a torus: cut by x = 0 and by z = 0, across and along the triangles.
    let field = Torus {
        major: 3.0,
        minor: 1.0,
    };
    let mesh = shapes::torus(3.0, 1.0, 61, 25);
    let label_of = |c: [Point3; 3]| {
        let middle = (c[0].coords + c[1].coords + c[2].coords) / 3.0;
        u32::from(middle.x > 0.0) + 2 * u32::from(middle.z > 0.0) + 7
    };
    let labels_of = |mesh: &TriMesh| -> Vec<u32> {
        (0..mesh.triangles().len())
            .map(|t| label_of(mesh.corners(t)))
            .collect()
    };
    let area = |mesh: &TriMesh, labels: &[u32], label: u32| -> f64 {
        (0..mesh.triangles().len())
            .filter(|&t| labels[t] == label)
            .map(|t| 0.5 * mesh.doubled_area_normal(t).norm())
            .sum()
    };
    let labels = labels_of(&mesh);
    for field in [None, Some(&field as &dyn ImplicitField)] {
        for length in [0.15, 0.4] {
            let options = Options {
                labels: labels.clone(),
                ..uniform(length)
            };
            let out = remesh(mesh.clone(), field, &options, Run::on(&Cpu)).unwrap();
            assert!(SurfaceAudit::of(&out.mesh).is_closed_manifold());
            assert_eq!(out.labels.len(), out.mesh.triangles().len());
            let wrong = labels_of(&out.mesh)
                .into_iter()
                .zip(&out.labels)
                .filter(|(wanted, found)| wanted != *found)
                .count();
            // Only along the zigzags of the line across the triangles.
            assert!(
                20 * wrong < out.labels.len(),
                "{wrong} of {}",
                out.labels.len()
            );
            for label in 7..11 {
                let (before, after) = (
                    area(&mesh, &labels, label),
                    area(&out.mesh, &out.labels, label),
                );
                assert!(
                    (after / before - 1.0).abs() < 0.04,
                    "{label}: {before} {after}"
                );
            }
            // Two lines around the tube, two along it.
            let lines = 2.0 * std::f64::consts::TAU * (1.0 + 3.0) / length;
            let kept = out.report.feature_edges as f64;
            assert!((0.7..1.5).contains(&(kept / lines)), "{kept} {lines}");
            assert!(out.report.after.min_angle_deg > 15.0, "{:?}", out.report);
            assert!(out.report.vertex_deviation.max < 1e-6, "{:?}", out.report);
        }
    }
    let options = Options {
        labels: vec![1, 2],
        ..Options::default()
    };
    let triangles = mesh.triangles().len();
    assert_eq!(
        remesh(mesh, None, &options, Run::on(&Cpu)).unwrap_err(),
        Error::Labels {
            labels: 2,
            triangles
        }
    );
}

#[test]
fn edges_follow_the_curvature() {
    // Radii 1, 1, 3: curvature 3 at the poles of z, 1/9 and 1 at the waist.
    let (mut positions, triangles) = shapes::icosphere(1.0, 5).into_parts();
    for p in &mut positions {
        p.z *= 3.0;
    }
    let mesh = TriMesh::new(positions, triangles).unwrap();
    let tolerance = 0.002;
    let options = Options {
        sizing: Sizing::Curvature {
            tolerance,
            min_edge: 0.01,
            max_edge: 0.5,
            gradation: 0.3,
        },
        ..Options::default()
    };
    let out = remesh(mesh, None, &options, Run::on(&Cpu)).unwrap();
    assert!(out.report.converged, "{:?}", out.report);
    assert!(
        out.report.inner_deviation.max < 1.5 * tolerance,
        "{:?}",
        out.report
    );
    let mean_edge = |near: &dyn Fn(&Point3) -> bool| {
        let lengths: Vec<f64> = (0..out.mesh.triangles().len())
            .map(|t| out.mesh.corners(t))
            .filter(|c| c.iter().all(near))
            .flat_map(edge_lengths)
            .collect();
        lengths.iter().sum::<f64>() / lengths.len() as f64
    };
    let wanted =
        |curvature: f64| (6.0 * tolerance / curvature - 3.0 * tolerance * tolerance).sqrt();
    let pole = mean_edge(&|p| p.z.abs() > 2.93);
    let waist = mean_edge(&|p| p.z.abs() < 0.3);
    assert!(
        (pole / wanted(3.0) - 1.0).abs() < 0.2,
        "{pole} {}",
        wanted(3.0)
    );
    assert!(
        (waist / wanted(1.0) - 1.0).abs() < 0.2,
        "{waist} {}",
        wanted(1.0)
    );
}

#[test]
fn threads_do_not_matter() {
    let mesh = noisy_sphere(3, 0.03);
    same_on_any_threads(|| remesh(mesh.clone(), None, &uniform(0.07), Run::on(&Cpu)).unwrap());
}

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
    assert_eq!(stopped.unwrap_err(), Error::Cancelled(crate::Cancelled));
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
    let mesh = shapes::icosphere(1.0, 5);
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
