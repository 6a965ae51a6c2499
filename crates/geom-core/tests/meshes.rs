//! Measures of shapes whose area, volume, normals and topology are known in closed form.

use std::f64::consts::PI;

use geom_core::mesh::{EXTERIOR, Halfedges, INTERIOR, SurfaceAudit, VolumeAudit, shapes};
use geom_core::nalgebra::{Rotation3, Vector3};
use geom_core::{Point3, QuadMesh, TriMesh};
use proptest::prelude::*;

/// Each refinement divides the error by four: second order.
fn converges(error: impl Fn(u32) -> f64, refinements: [u32; 3]) {
    let errors = refinements.map(|n| error(n).abs());
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(
            (1.8..2.2).contains(&order),
            "order {order}, errors {errors:?}"
        );
    }
}

#[test]
fn spheres_converge_in_area_and_volume() {
    let r = 1.7;
    let (area, volume) = (4.0 * PI * r * r, 4.0 / 3.0 * PI * r.powi(3));
    converges(|n| shapes::icosphere(r, n).area() - area, [2, 3, 4]);
    converges(|n| shapes::icosphere(r, n).volume() - volume, [2, 3, 4]);
    converges(|n| shapes::quad_sphere(r, 1 << n).area() - area, [3, 4, 5]);
    converges(
        |n| shapes::quad_sphere(r, 1 << n).volume() - volume,
        [3, 4, 5],
    );
    let sphere = shapes::icosphere(r, 3);
    for (p, n) in sphere.positions().iter().zip(sphere.vertex_normals()) {
        assert!((n - p.coords / r).norm() < 0.01);
    }
    let quads = shapes::quad_sphere(r, 16);
    for (p, n) in quads.positions().iter().zip(quads.vertex_normals()) {
        assert!((n - p.coords / r).norm() < 0.01, "{p} {n}");
    }
}

#[test]
fn ellipsoids_converge() {
    let (a, c) = (1.0, 2.0);
    let of = |n| shapes::ellipsoid(Vector3::new(a, a, c), n);
    // A prolate spheroid.
    let e = f64::sqrt(1.0 - a * a / (c * c));
    let area = 2.0 * PI * a * a * (1.0 + c / (a * e) * e.asin());
    converges(|n| of(n).area() - area, [3, 4, 5]);
    converges(|n| of(n).volume() - 4.0 / 3.0 * PI * a * a * c, [3, 4, 5]);
}

#[test]
fn tori_converge() {
    let (major, minor) = (5.0, 2.0);
    let (area, volume) = (
        4.0 * PI * PI * major * minor,
        2.0 * PI * PI * major * minor * minor,
    );
    converges(
        |n| shapes::torus(major, minor, 8 << n, 4 << n).area() - area,
        [2, 3, 4],
    );
    converges(
        |n| shapes::torus(major, minor, 8 << n, 4 << n).volume() - volume,
        [2, 3, 4],
    );
    converges(
        |n| shapes::quad_torus(major, minor, 8 << n, 4 << n).area() - area,
        [2, 3, 4],
    );
    converges(
        |n| shapes::quad_torus(major, minor, 8 << n, 4 << n).volume() - volume,
        [2, 3, 4],
    );
}

#[test]
fn components_are_taken_apart() {
    let (mut positions, mut triangles) = shapes::icosphere(1.0, 1).into_parts();
    for (radius, at) in [(3.0, 20.0), (2.0, -20.0)] {
        let first = positions.len() as u32;
        let ball = shapes::icosphere(radius, 2);
        let shift = Vector3::new(at, 0.0, 0.0);
        positions.extend(ball.positions().iter().map(|p| p + shift));
        // From the last triangle to the first: an order that components keep.
        let moved = ball.triangles().iter().map(|t| t.map(|v| v + first));
        triangles.extend(moved.rev());
    }
    positions.push(Point3::origin());
    let mesh = TriMesh::new(positions, triangles).unwrap();
    let parts = mesh.components();
    let areas: Vec<f64> = parts.iter().map(TriMesh::area).collect();
    assert!((areas.iter().sum::<f64>() / mesh.area() - 1.0).abs() < 1e-12);
    for (part, (radius, level)) in parts.iter().zip([(3.0, 2), (2.0, 2), (1.0, 1)]) {
        let ball = shapes::icosphere(radius, level);
        assert!((part.area() - ball.area()).abs() < 1e-9);
        assert_eq!(part.positions().len(), ball.positions().len());
        assert!(SurfaceAudit::of(part).is_closed_manifold());
    }
    let (used, numbers) = mesh.without_unused();
    let all: Vec<u32> = (0..mesh.positions().len() as u32 - 1).collect();
    assert!(numbers == all && used.triangles() == mesh.triangles());
    assert!(used.positions() == &mesh.positions()[..all.len()]);
    let (first, second) = (Point3::origin(), mesh.positions());
    let shifted = mesh.triangles().iter().map(|t| t.map(|v| v + 1));
    let positions = std::iter::once(first).chain(second.iter().copied());
    let shifted = TriMesh::new(positions.collect(), shifted.collect()).unwrap();
    assert!(shifted.without_unused().0 == used);
    assert_eq!(parts.len(), 3);
    assert_eq!(parts[2].triangles(), shapes::icosphere(1.0, 1).triangles());
    assert!(TriMesh::default().components().is_empty());
}

#[test]
fn prisms_and_boxes_are_exact() {
    let (r, h, n) = (1.5, 4.0, 7);
    let prism = shapes::cylinder(r, h, n, 3);
    let n = f64::from(n);
    let end = 0.5 * n * r * r * (2.0 * PI / n).sin();
    let side = n * 2.0 * r * (PI / n).sin() * h;
    assert!((prism.area() - 2.0 * end - side).abs() < 1e-12);
    assert!((prism.volume() - end * h).abs() < 1e-12);
    converges(
        |n| shapes::cylinder(r, h, 8 << n, 2).volume() - PI * r * r * h,
        [2, 3, 4],
    );

    let extent = Vector3::new(1.0, 2.0, 3.5);
    let tets = shapes::box_tets(extent, [2, 3, 4]);
    let surface = tets.region_surface(INTERIOR);
    assert!((tets.volume() - 7.0).abs() < 1e-12);
    assert!((surface.volume() - 7.0).abs() < 1e-12);
    assert!((surface.area() - 2.0 * (2.0 + 7.0 + 3.5)).abs() < 1e-12);
    assert_eq!(surface.bounds().extent(), extent);
}

#[test]
fn volumes_of_regions_add_up() {
    let volume = 4.0 / 3.0 * PI * 8.0;
    converges(|n| shapes::ball(2.0, 1 << n).volume() - volume, [2, 3, 4]);
    let shell = shapes::shell(2.0, 3.0, 4);
    let walls = shell.region_surface(EXTERIOR);
    assert!((walls.volume() - shell.volume()).abs() < 1e-9);
    assert!((shell.volume() / volume - (27.0 / 8.0 - 1.0)).abs() < 0.03);
    let mesh = shapes::ball_in_box(2.0, 4.0, 4);
    assert!((mesh.volume() - 512.0).abs() < 1e-9);
    let (inside, outside) = (mesh.region_volume(INTERIOR), mesh.region_volume(EXTERIOR));
    assert!((inside + outside - 512.0).abs() < 1e-9);
    let surface = mesh.region_surface(INTERIOR);
    assert!((surface.volume() - inside).abs() < 1e-9);
    assert!(VolumeAudit::of(&mesh).is_valid());
}

#[test]
fn the_euler_characteristic_tells_balls_from_tori() {
    let surfaces: [(TriMesh, i64); 5] = [
        (shapes::icosphere(1.0, 2), 2),
        (shapes::ellipsoid(Vector3::new(1.0, 2.0, 3.0), 1), 2),
        (shapes::cylinder(1.0, 2.0, 5, 2), 2),
        (shapes::torus(3.0, 1.0, 9, 7), 0),
        (shapes::shell(1.0, 2.0, 2).region_surface(EXTERIOR), 4),
    ];
    for (surface, expected) in &surfaces {
        assert_eq!(surface.euler_characteristic(), *expected);
        let audit = SurfaceAudit::of(surface);
        assert!(audit.is_closed_manifold(), "{audit}");
        assert_eq!(audit.euler_characteristic(), *expected);
        assert!((audit.area() - surface.area()).abs() < 1e-9 * surface.area());
        assert!((audit.volume() - surface.volume()).abs() < 1e-9 * surface.area());
        agrees(&Halfedges::of(surface).unwrap(), &audit);
    }
    let quads: [(QuadMesh, i64); 2] = [
        (shapes::quad_sphere(1.0, 5), 2),
        (shapes::quad_torus(3.0, 1.0, 9, 7), 0),
    ];
    for (surface, expected) in &quads {
        assert_eq!(surface.euler_characteristic(), *expected);
        let audit = SurfaceAudit::of_quads(surface);
        assert!(audit.is_closed_manifold(), "{audit}");
        assert!((audit.area() - surface.area()).abs() < 1e-9 * surface.area());
        assert!((audit.volume() - surface.volume()).abs() < 1e-9 * surface.area());
        agrees(&Halfedges::of_quads(surface).unwrap(), &audit);
    }
    // A ball; a ball with a cavity.
    assert_eq!(shapes::ball(1.0, 2).euler_characteristic(), 1);
    assert_eq!(shapes::shell(1.0, 2.0, 1).euler_characteristic(), 2);
    assert_eq!(shapes::ball_in_box(1.0, 2.0, 2).euler_characteristic(), 1);
}

fn agrees<const N: usize>(halfedges: &Halfedges<N>, audit: &SurfaceAudit) {
    assert_eq!(halfedges.faces(), audit.faces);
    assert_eq!(halfedges.len(), 2 * audit.edges);
    assert_eq!(halfedges.edges().count(), audit.edges);
    assert!(halfedges.boundary_loops().is_empty());
    let mut around = 0;
    for v in 0..halfedges.vertices() as u32 {
        around += halfedges.around(geom_core::VertexId(v)).count();
    }
    assert_eq!(around, halfedges.len(), "each half-edge leaves one vertex");
}

proptest! {
    #![proptest_config(geom_core::testing::cases(256))]

    /// Moved and turned bodies keep their measures; a mirrored one has negative volume.
    #[test]
    fn measures_do_not_depend_on_place(
        axis in [-3.0..3.0, -3.0..3.0, -3.0..3.0],
        shift in [-1e4..1e4, -1e4..1e4, -1e4..1e4],
    ) {
        let torus = shapes::torus(3.0, 1.0, 12, 8);
        let (area, volume) = (torus.area(), torus.volume());
        let turn = Rotation3::new(Vector3::from(axis));
        let (positions, triangles) = torus.into_parts();
        let moved: Vec<Point3> = positions.iter().map(|p| turn * p + Vector3::from(shift)).collect();
        let moved = TriMesh::new(moved, triangles.clone()).unwrap();
        prop_assert!((moved.area() - area).abs() < 1e-8 * area);
        prop_assert!((moved.volume() - volume).abs() < 1e-8 * volume);
        let mirrored = triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        let mirrored = TriMesh::new(positions, mirrored).unwrap();
        prop_assert!((mirrored.volume() + volume).abs() < 1e-9 * volume);
    }
}
