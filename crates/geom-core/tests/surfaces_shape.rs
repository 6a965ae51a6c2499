//! Curvature and isolines against closed forms; repair of every fault there is.

use std::f64::consts::TAU;

use geom_core::mesh::{Halfedges, SurfaceAudit, shapes};
use geom_core::surface::curvature::{self, Principal, angle_defects, principal};
use geom_core::surface::isoline::{IsolineError, isolines};
use geom_core::surface::repair::{self, RepairError, repair};
use geom_core::testing::same_on_any_threads;
use geom_core::{Point3, TriMesh, Vector3};
use proptest::prelude::*;

/// A piece of a surface over a grid of parameters, pushed off the grid a little so that no symmetry
/// helps.
fn patch(n: u32, at: impl Fn(f64, f64) -> Point3) -> (TriMesh, Vec<[f64; 2]>) {
    let parameters: Vec<[f64; 2]> = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| (i, j)))
        .map(|(i, j)| {
            let (x, y) = (f64::from(i), f64::from(j));
            let wobble = |t: f64| 0.2 * (12.9 * x + 78.2 * y + t).sin();
            [
                (x + wobble(0.0)) / f64::from(n),
                (y + wobble(2.0)) / f64::from(n),
            ]
        })
        .collect();
    let positions = parameters.iter().map(|&[u, v]| at(u, v)).collect();
    let triangles = (0..n)
        .flat_map(|i| (0..n).map(move |j| i * (n + 1) + j))
        .flat_map(|a| [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]])
        .collect();
    (TriMesh::new(positions, triangles).unwrap(), parameters)
}

/// Largest error of the principal curvatures away from the boundary.
fn worst(
    (mesh, parameters): &(TriMesh, Vec<[f64; 2]>),
    exact: impl Fn(f64, f64) -> (f64, f64),
) -> f64 {
    principal(mesh, 2)
        .iter()
        .zip(parameters)
        .filter(|(_, p)| p.iter().all(|c| (0.15..0.85).contains(c)))
        .map(|(c, &[u, v])| {
            let (max, min) = exact(u, v);
            (c.max - max).abs().max((c.min - min).abs())
        })
        .fold(0.0, f64::max)
}

/// Halving the grid divides the error by nearly four.
fn assert_second_order(errors: [f64; 3]) {
    for pair in errors.windows(2) {
        assert!(pair[1] < pair[0] / 3.0, "{errors:?}");
    }
}

#[test]
fn curvature_of_a_sphere_converges() {
    let at = |u: f64, v: f64| {
        let (a, b) = (u + 0.2, v * 1.2 - 0.6);
        Point3::new(
            2.0 * b.cos() * a.cos(),
            2.0 * b.cos() * a.sin(),
            2.0 * b.sin(),
        )
    };
    let errors = [10, 20, 40].map(|n| worst(&patch(n, at), |_, _| (0.5, 0.5)));
    assert_second_order(errors);
    assert!(errors[2] < 1e-3, "{errors:?}");
}

#[test]
fn curvature_of_a_cylinder_converges() {
    let at = |u: f64, v: f64| Point3::new(3.0 * (u - 0.5).cos(), 3.0 * (u - 0.5).sin(), 3.0 * v);
    let errors = [10, 20, 40].map(|n| worst(&patch(n, at), |_, _| (1.0 / 3.0, 0.0)));
    assert_second_order(errors);
    let (mesh, parameters) = patch(40, at);
    for (c, &[u, _]) in principal(&mesh, 2).iter().zip(&parameters) {
        let around = Vector3::new(-(u - 0.5).sin(), (u - 0.5).cos(), 0.0);
        assert!(c.max_direction.dot(&around).abs() > 0.99, "{c:?}");
        assert!(
            c.min_direction.z.abs() > 0.99 && c.confidence > 0.8,
            "{c:?}"
        );
        let n = Vector3::new((u - 0.5).cos(), (u - 0.5).sin(), 0.0);
        assert!(c.normal.dot(&n) > 0.9999, "{c:?}");
        assert!((c.max_direction.cross(&c.min_direction) - c.normal).norm() < 1e-12);
    }
}

#[test]
fn curvature_of_a_torus_converges() {
    let (major, minor) = (3.0, 1.0);
    let at = |u: f64, v: f64| {
        let (a, b) = (1.5 * u, TAU * 0.5 * v + 0.4);
        let r = major + minor * b.cos();
        Point3::new(r * a.cos(), r * a.sin(), minor * b.sin())
    };
    let exact = |_: f64, v: f64| {
        let b = TAU * 0.5 * v + 0.4;
        (1.0 / minor, b.cos() / (major + minor * b.cos()))
    };
    let errors = [16, 32, 64].map(|n| worst(&patch(n, at), exact));
    assert_second_order(errors);
    assert!(errors[2] < 4e-3, "{errors:?}");
}

#[test]
fn curvature_of_an_ellipsoid_converges() {
    // Radii 1, 2, 3: mean and Gaussian curvature at a point.
    let [a, b, c] = [1.0f64, 2.0, 3.0];
    let squash = |p: &Point3| Point3::new(a * p.x, b * p.y, c * p.z);
    let errors = [3, 4, 5].map(|levels| {
        let (positions, triangles) = shapes::icosphere(1.0, levels).into_parts();
        let mesh = TriMesh::new(positions.iter().map(squash).collect(), triangles).unwrap();
        let found = principal(&mesh, 2);
        mesh.positions()
            .iter()
            .zip(&found)
            .map(|(p, found)| {
                let [x, y, z] = [p.x, p.y, p.z];
                let s = x * x / a.powi(4) + y * y / b.powi(4) + z * z / c.powi(4);
                let gaussian = 1.0 / (a * b * c * s).powi(2);
                let r = x * x + y * y + z * z;
                let mean = (a * a + b * b + c * c - r) / (2.0 * (a * b * c).powi(2) * s.powf(1.5));
                let (g, m) = (found.gaussian() - gaussian, found.mean() - mean);
                (g / gaussian).abs().max((m / mean).abs())
            })
            .fold(0.0, f64::max)
    });
    assert!(
        errors[1] < errors[0] / 3.0 && errors[2] < errors[1] / 3.0,
        "{errors:?}"
    );
    assert!(errors[2] < 0.03, "{errors:?}");
}

#[test]
fn a_plane_is_flat_and_its_directions_are_not_trusted() {
    let (mesh, _) = patch(6, |u, v| Point3::new(u, v, 0.0));
    for c in principal(&mesh, 2) {
        assert!(c.max.abs() < 1e-9 && c.min.abs() < 1e-9, "{c:?}");
        assert!((c.normal - Vector3::z()).norm() < 1e-9);
    }
    // A lone triangle determines nothing.
    let p = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [5., 5., 5.]].map(Point3::from);
    let lone = TriMesh::new(p.to_vec(), vec![[0, 1, 2]]).unwrap();
    assert!(
        principal(&lone, 2)
            .iter()
            .all(|c: &Principal| c.confidence == 0.0)
    );
}

proptest! {
    #![proptest_config(geom_core::testing::cases(64))]

    /// Gauss and Bonnet hold for any triangles, also where many meet in an edge.
    #[test]
    fn angle_defects_sum_to_the_euler_characteristic(
        corners in prop::collection::vec(prop::array::uniform3(0..20u32), 1..60),
        places in prop::collection::vec(prop::array::uniform3(-5.0..5.0f64), 20),
    ) {
        let mut triangles: Vec<[u32; 3]> = corners
            .into_iter()
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        triangles.sort_unstable();
        triangles.dedup();
        let mesh =
            TriMesh::new(places.into_iter().map(Point3::from).collect(), triangles).unwrap();
        let total: f64 = angle_defects(&mesh).iter().sum();
        prop_assert!((total - TAU * mesh.euler_characteristic() as f64).abs() < 1e-10);
    }

    /// On any closed surface any field has closed lines only; each point has the level's value, and
    /// larger values lie on the left.
    #[test]
    fn isolines_of_closed_surfaces_are_closed(
        values in prop::collection::vec(-3..4i8, 42), level in -3..4i8,
    ) {
        let sphere = shapes::icosphere(1.0, 1);
        let values: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
        let level = f64::from(level);
        let lines = isolines(&sphere, &values, &[level]).unwrap();
        let crossed = sphere
            .triangles()
            .iter()
            .filter(|t| {
                let above = t.iter().filter(|&&v| values[v as usize] >= level).count();
                above == 1 || above == 2
            })
            .count();
        prop_assert_eq!(lines.iter().map(|l| l.triangles.len()).sum::<usize>(), crossed);
        for line in &lines {
            prop_assert!(line.closed && line.points.len() == line.triangles.len());
            for (i, &t) in line.triangles.iter().enumerate() {
                let corners = sphere.triangles()[t as usize];
                let (p, q) = (line.points[i], line.points[(i + 1) % line.points.len()]);
                let normal = sphere.doubled_area_normal(t as usize);
                let left = normal.cross(&(q - p));
                for v in corners {
                    let side = left.dot(&(sphere.positions()[v as usize] - p));
                    let above = values[v as usize] - level;
                    // On the line itself where they are equal.
                    prop_assert!(side * above >= -1e-12 && (above != 0.0 || side.abs() < 1e-9));
                }
            }
        }
    }

    /// Whatever comes in, a manifold comes out, and once more changes nothing.
    #[test]
    fn repair_gives_a_manifold(
        corners in prop::collection::vec(prop::array::uniform3(0..14u32), 0..30),
        places in prop::collection::vec(prop::array::uniform3(0..3i8), 14),
        fill in 0..8usize,
    ) {
        let triangles: Vec<[u32; 3]> = corners
            .into_iter()
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        let positions = places.iter().map(|p| Point3::from(p.map(f64::from))).collect();
        let mesh = TriMesh::new(positions, triangles).unwrap();
        let options = repair::Options { fill, ..repair::Options::default() };
        let Ok(repaired) = repair(mesh, &options) else { return Ok(()) };
        let edges = Halfedges::of(&repaired.mesh);
        prop_assert!(edges.is_ok(), "{:?}", edges);
        let audit = SurfaceAudit::of(&repaired.mesh);
        prop_assert!(audit.is_manifold(), "{:?}", audit);
        prop_assert_eq!(audit.unused_vertices.count, 0);
        prop_assert_eq!(edges.unwrap().boundary_loops().len(), repaired.report.open_loops);
        // What is in and what is out has no meaning where such components overlap.
        let keep = repair::Options { merge: -1.0, fill: 0, outward: false, ..options };
        let again = repair(repaired.mesh.clone(), &keep).unwrap();
        prop_assert_eq!(again.mesh, repaired.mesh);
    }
}

#[test]
fn isolines_end_at_boundaries_and_say_what_is_wrong() {
    let (mesh, parameters) = patch(5, |u, v| Point3::new(u, v, 0.0));
    let values: Vec<f64> = parameters.iter().map(|p| p[0] + p[1]).collect();
    let lines = isolines(&mesh, &values, &[1.0, 5.0]).unwrap();
    assert_eq!(lines.len(), 1);
    assert!(!lines[0].closed);
    assert_eq!(lines[0].points.len(), lines[0].triangles.len() + 1);
    assert!(
        lines[0]
            .points
            .iter()
            .all(|p| (p.x + p.y - 1.0).abs() < 1e-12)
    );
    assert!((lines[0].length() - 2f64.sqrt()).abs() < 0.2);
    let wrong = isolines(&mesh, &values[1..], &[1.0]).unwrap_err();
    assert_eq!(
        wrong,
        IsolineError::Length {
            values: 35,
            vertices: 36
        }
    );
    let mut nan = values.clone();
    nan[7] = f64::NAN;
    assert_eq!(
        isolines(&mesh, &nan, &[1.0]).unwrap_err(),
        IsolineError::NotFinite { vertex: 7 }
    );
    assert_eq!(
        isolines(&mesh, &values, &[0.0, f64::INFINITY]).unwrap_err(),
        IsolineError::Level { level: 1 }
    );
}

#[test]
fn threads_do_not_matter() {
    let torus = shapes::torus(3.0, 1.0, 50, 30);
    let values: Vec<f64> = torus
        .positions()
        .iter()
        .map(|p| (p.x * 1.3).sin() + p.z)
        .collect();
    same_on_any_threads(|| {
        (
            principal(&torus, 2),
            isolines(&torus, &values, &[-0.5, 0.0, 0.3, 0.8]).unwrap(),
        )
    });
}

/// The mesh as an STL file would hold it: each triangle with corners of its own.
fn shattered(mesh: &TriMesh) -> TriMesh {
    let positions = (0..mesh.triangles().len())
        .flat_map(|t| mesh.corners(t))
        .collect();
    let triangles = (0..mesh.triangles().len() as u32)
        .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
        .collect();
    TriMesh::new(positions, triangles).unwrap()
}

fn moved(mesh: &TriMesh, by: Vector3) -> TriMesh {
    let positions = mesh.positions().iter().map(|p| p + by).collect();
    TriMesh::new(positions, mesh.triangles().to_vec()).unwrap()
}

fn together(parts: &[TriMesh]) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for part in parts {
        let first = positions.len() as u32;
        positions.extend_from_slice(part.positions());
        triangles.extend(part.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    TriMesh::new(positions, triangles).unwrap()
}

fn unit_cube() -> TriMesh {
    let p = (0..8u8)
        .map(|i| Point3::from([i & 1, (i >> 1) & 1, i >> 2].map(f64::from)))
        .collect();
    let squares = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = squares
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    TriMesh::new(p, triangles).unwrap()
}

#[test]
fn a_shattered_and_twisted_surface_is_made_whole() {
    let sphere = shapes::icosphere(1.0, 3);
    let (positions, mut triangles) = shattered(&sphere).into_parts();
    // Less than half upside down, one twice, one with two corners in one place.
    for t in (0..triangles.len()).step_by(3) {
        triangles[t].swap(0, 1);
    }
    triangles.push(triangles[5]);
    triangles.push([0, 1, triangles[1][0]]);
    let mesh = TriMesh::new(positions, triangles).unwrap();
    let repaired = repair(mesh, &repair::Options::default()).unwrap();
    let audit = SurfaceAudit::of(&repaired.mesh);
    assert!(audit.is_closed_manifold());
    assert_eq!(repaired.mesh.positions().len(), sphere.positions().len());
    assert!((repaired.mesh.volume() - sphere.volume()).abs() < 1e-9);
    let report = repaired.report;
    assert_eq!(
        report.merged_vertices,
        3 * sphere.triangles().len() - sphere.positions().len()
    );
    assert_eq!(
        report.reversed_triangles,
        sphere.triangles().len().div_ceil(3)
    );
    assert!(
        report.duplicate_triangles + report.collapsed_triangles >= 1,
        "{report:?}"
    );
}

#[test]
fn solids_that_touch_part() {
    let cube = unit_cube();
    for (by, edges) in [
        (Vector3::new(1.0, 1.0, 0.0), 1),
        (Vector3::new(1.0, 1.0, 1.0), 0),
    ] {
        let touching = together(&[cube.clone(), moved(&cube, by)]);
        let repaired = repair(touching, &repair::Options::default()).unwrap();
        let audit = SurfaceAudit::of(&repaired.mesh);
        assert!(audit.is_closed_manifold());
        assert_eq!(audit.components.len(), 2);
        assert!(
            audit
                .components
                .iter()
                .all(|c| (c.volume - 1.0).abs() < 1e-12)
        );
        assert_eq!(repaired.report.nonmanifold_edges, edges);
        assert_eq!(repaired.report.split_vertices, 1 + edges);
    }
}

#[test]
fn solids_turn_out_and_cavities_in() {
    let turned = |mesh: TriMesh| {
        let (p, t) = mesh.into_parts();
        TriMesh::new(p, t.into_iter().map(|[a, b, c]| [a, c, b]).collect()).unwrap()
    };
    let sphere = |r| shapes::icosphere(r, 2);
    let mesh = together(&[turned(sphere(3.0)), sphere(2.0), turned(sphere(1.0))]);
    let repaired = repair(mesh, &repair::Options::default()).unwrap();
    assert_eq!(repaired.report.turned_components, 3);
    let exact = sphere(3.0).volume() - sphere(2.0).volume() + sphere(1.0).volume();
    assert!((repaired.mesh.volume() - exact).abs() < 1e-9);
    let dropped = repair::Options {
        least_component: 321,
        ..repair::Options::default()
    };
    let none = repair(repaired.mesh, &dropped).unwrap();
    assert_eq!(none.report.dropped_components, 3);
    assert!(none.mesh.triangles().is_empty() && none.mesh.positions().is_empty());
}

#[test]
fn holes_are_filled_and_flat_triangles_flipped() {
    let sphere = shapes::icosphere(1.0, 3);
    let (positions, mut triangles) = sphere.clone().into_parts();
    // All around two vertices: holes of five and six edges.
    triangles.retain(|t| !t.contains(&0) && !t.contains(&200));
    let open = TriMesh::new(positions, triangles).unwrap();
    let small = repair::Options {
        fill: 5,
        ..repair::Options::default()
    };
    let once = repair(open.clone(), &small).unwrap();
    assert_eq!((once.report.filled_holes, once.report.open_loops), (1, 1));
    let large = repair::Options {
        fill: 10,
        ..repair::Options::default()
    };
    let filled = repair(open, &large).unwrap();
    assert_eq!(filled.report.fill_triangles, 3 + 4);
    assert_eq!(filled.report.unused_vertices, 2);
    assert!(SurfaceAudit::of(&filled.mesh).is_closed_manifold());
    assert!((filled.mesh.volume() / sphere.volume() - 1.0).abs() < 0.01);

    // A vertex in the middle of the edge between two triangles: a cap of no area.
    let p = [[0., 0.], [2., 0.], [1., 1.], [1., -1.], [1., 0.]];
    let p = p.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
    let cap = TriMesh::new(p, vec![[0, 4, 2], [4, 1, 2], [0, 1, 4], [1, 0, 3]]).unwrap();
    let repaired = repair(cap, &repair::Options::default()).unwrap();
    assert_eq!(repaired.report.flipped_triangles, 1);
    assert!((repaired.mesh.area() - 2.0).abs() < 1e-12);
    assert_eq!(repaired.mesh.euler_characteristic(), 1);
    assert_eq!(SurfaceAudit::of(&repaired.mesh).boundary_edges.count, 4);
}

/// Two flat triangles along one edge: the flip that mends the first mends the second before its turn (found by `cargo xtask fuzz
/// --target repair --case 3803`).
#[test]
fn a_flip_may_mend_two_flat_triangles() {
    let p = [[0., 0.], [1., 0.], [0.5, 0.05], [0.5, -0.05]];
    let p = p.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
    let lens = TriMesh::new(p, vec![[0, 1, 2], [1, 0, 3]]).unwrap();
    let options = repair::Options {
        flat: 0.1,
        ..repair::Options::default()
    };
    let repaired = repair(lens, &options).unwrap();
    assert_eq!(repaired.report.flipped_triangles, 1);
    assert_eq!(repaired.report.flat_triangles, 0);
    assert!((repaired.mesh.area() - 0.05).abs() < 1e-12);
}

#[test]
fn one_sided_surfaces_are_refused() {
    let n = 12u32;
    let positions = (0..n)
        .flat_map(|i| [-0.3, 0.3].map(|s| (TAU * f64::from(i) / f64::from(n), s)))
        .map(|(t, s)| {
            let r = 2.0 + s * (t / 2.0).cos();
            Point3::new(r * t.cos(), r * t.sin(), s * (t / 2.0).sin())
        })
        .collect();
    let at = |i: u32, side: u32| 2 * (i % n) + if i >= n { 1 - side } else { side };
    let triangles = (0..n)
        .flat_map(|i| {
            let (a, b, c, d) = (at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 1));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let strip = TriMesh::new(positions, triangles).unwrap();
    let error = repair(strip, &repair::Options::default()).unwrap_err();
    assert!(matches!(error, RepairError::OneSided { .. }));
    let options = repair::Options {
        merge: f64::NAN,
        ..repair::Options::default()
    };
    let error = repair(unit_cube(), &options).unwrap_err();
    assert!(matches!(error, RepairError::Option(out) if out.option == "merge"));
}

/// A vertex's normal may be off, where its triangles lie on one side of it: the fit finds the slope, and with it the
/// curvatures. Here a saddle with curvatures 1 and −1/2, seen from a normal 40° off.
#[test]
fn curvatures_do_not_hang_on_the_normal_that_the_fit_is_made_over() {
    let places: Vec<Vector3> = (0..49)
        .map(|i| [i % 7, i / 7].map(|c| 0.002 * f64::from(c - 3)))
        .map(|[x, y]| Vector3::new(x, y, -0.5 * x * x + 0.25 * y * y))
        .filter(|d| d.norm() > 0.0)
        .collect();
    for turn in 0..8 {
        let angle = std::f64::consts::FRAC_PI_4 * f64::from(turn);
        let tilt = 40f64.to_radians();
        let normal = Vector3::new(
            tilt.sin() * angle.cos(),
            tilt.sin() * angle.sin(),
            tilt.cos(),
        );
        let found = curvature::fit_cubic(normal, &places).unwrap();
        assert!((found.max - 1.0).abs() < 0.01, "{}", found.max);
        assert!((found.min + 0.5).abs() < 0.01, "{}", found.min);
        assert!(found.max_direction.x.abs() > 0.999);
        assert!(found.normal.z > 0.999);
    }
}
