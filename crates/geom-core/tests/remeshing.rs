//! What remeshing must keep and reach.

use geom_core::mesh::quality::edge_lengths;
use geom_core::mesh::{Halfedges, SurfaceAudit, shapes};
use geom_core::search::crossing::crossing_pairs;
use geom_core::surface::remesh::{Error, Features, Options, Sizing, inside, remesh};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, ImplicitField, Point3, Run, TriMesh, Vector3, VertexId};
use proptest::prelude::*;

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

pub(super) fn uniform(edge_length: f64) -> Options {
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
    let at = |v: VertexId| out.mesh.positions()[v.0 as usize];
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

/// A torus with a hole: closed and open parts, features in between.
fn open_torus() -> (TriMesh, i64) {
    let (positions, mut triangles) = shapes::torus(3.0, 1.0, 7, 5).into_parts();
    triangles.truncate(60);
    let mesh = TriMesh::new(positions, triangles).unwrap();
    let euler = mesh.euler_characteristic();
    (mesh, euler)
}

proptest! {
    /// Any allowed changes in any order leave a manifold of the same topology.
    #[test]
    fn changes_keep_the_manifold(
        steps in prop::collection::vec((0..3u8, any::<prop::sample::Index>()), 0..120),
    ) {
        let (start, euler) = open_torus();
        let labels = (0..start.triangles().len() as u32).map(|t| t / 20).collect();
        // Which of the edges that there are then.
        let steps = steps.iter().map(|(what, pick)| (*what, |edges| pick.index(edges)));
        let crease = |v: u32| v.is_multiple_of(5);
        let (end, labels) = inside::changed(&start, labels, crease, steps).unwrap();
        prop_assert_eq!(labels.len(), end.triangles().len());
        let audit = SurfaceAudit::of(&end);
        prop_assert!(audit.is_manifold(), "{:?}", audit);
        prop_assert_eq!(audit.orientation_conflicts.count, 0);
        prop_assert_eq!(audit.duplicate_faces.count, 0);
        prop_assert_eq!(end.euler_characteristic(), euler);
    }
}

/// Around the narrow hole of a torus of few triangles, where they fold sharply. Without an eye on it, four pairs of
/// triangles crossed each other on both.
#[test]
fn what_does_not_cross_itself_is_not_made_to() {
    for (minor, around, across) in [(0.97, 24, 14), (0.9, 16, 12)] {
        let torus = shapes::torus(1.0, minor, around, across);
        assert!(crossing_pairs(&torus).is_empty());
        let out = remesh(torus, None, &uniform(0.15), Run::on(&Cpu)).unwrap();
        let crossing = crossing_pairs(&out.mesh);
        assert!(crossing.is_empty(), "{minor}: {crossing:?}");
        assert_eq!(out.mesh.euler_characteristic(), 0);
        assert!(out.report.lengths.median > 0.8, "{:?}", out.report.lengths);
    }
}
