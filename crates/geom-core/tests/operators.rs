//! The Laplace operators by identities.

use geom_core::algebra::{Cholesky, SparseMatrix};
use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::nalgebra::{Complex, DMatrix, Rotation3};
use geom_core::surface::laplace::{self, EdgeWeights, Error, Mass};
use geom_core::{MeshError, Point3, TriMesh, Vector3, testing::same_on_any_threads};
use proptest::prelude::*;

/// A planar patch of `n × n` cells with its inner vertices shaken, in a plane askew to the axes.
fn plane(n: usize, shake: f64, seed: u64) -> TriMesh {
    let turn = Rotation3::from_euler_angles(0.3, -0.7, 1.1);
    let mut random = SplitMix64::new(seed);
    let mut random = move || random.unit() - 0.5;
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let inner = i > 0 && i < n && j > 0 && j < n;
            let size = if inner { shake } else { 0.0 };
            let p = Vector3::new(i as f64 + size * random(), j as f64 + size * random(), 0.0);
            positions.push(Point3::from(turn * p));
        }
    }
    let at = |i: usize, j: usize| (i + (n + 1) * j) as u32;
    let triangles = (0..n * n).flat_map(|c| {
        let (i, j) = (c % n, c / n);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        if (i + j) % 2 == 0 {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, b, d], [b, c, d]]
        }
    });
    TriMesh::new(positions, triangles.collect()).unwrap()
}

fn on_border(n: usize, v: usize) -> bool {
    let (i, j) = (v % (n + 1), v / (n + 1));
    i == 0 || i == n || j == 0 || j == n
}

fn lumped(mass: &Mass) -> Vec<f64> {
    match mass {
        Mass::Lumped(values) => values.clone(),
        Mass::Consistent(matrix) => matrix.multiply(&vec![1.0; matrix.rows()], 1),
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}

fn rows_sum_to_zero(matrix: &SparseMatrix) {
    let sums = matrix.multiply(&vec![1.0; matrix.rows()], 1);
    assert!(
        largest(&sums) <= 1e-12 * largest(matrix.values()),
        "{}",
        largest(&sums)
    );
    matrix.check_hermitian().unwrap();
}

/// Eigenvalues of a small matrix, ascending.
fn eigenvalues(matrix: &SparseMatrix) -> Vec<f64> {
    let n = matrix.rows();
    let mut values: Vec<f64> = DMatrix::from_fn(n, n, |i, j| matrix.get(i, j))
        .symmetric_eigenvalues()
        .iter()
        .copied()
        .collect();
    values.sort_by(f64::total_cmp);
    values
}

#[test]
fn rows_sum_to_zero_and_masses_to_the_area() {
    for mesh in [
        shapes::icosphere(2.0, 3),
        shapes::torus(3.0, 1.0, 31, 17),
        plane(9, 0.4, 3),
    ] {
        rows_sum_to_zero(&laplace::stiffness(&mesh).unwrap());
        let robust = laplace::robust(&mesh).unwrap();
        rows_sum_to_zero(&robust.stiffness);
        let area = mesh.area();
        let (one, other) = (
            laplace::lumped_mass(&mesh),
            laplace::consistent_mass(&mesh).unwrap(),
        );
        let sums = lumped(&one);
        for mass in [&one, &other, &robust.mass] {
            let total: f64 = lumped(mass).iter().sum();
            assert!((total / area - 1.0).abs() < 1e-12, "{total} {area}");
        }
        // Rows of the consistent mass sum to the lumped one.
        let off: Vec<f64> = sums
            .iter()
            .zip(lumped(&other))
            .map(|(a, b)| a - b)
            .collect();
        assert!(largest(&off) < 1e-12 * area);
    }
}

/// One-sided: no eigenvalue below zero, exactly one zero per connected surface.
#[test]
fn positive_but_for_one_zero() {
    for mesh in [
        shapes::icosphere(1.0, 2),
        plane(6, 0.9, 5),
        shapes::torus(2.0, 0.7, 11, 8),
    ] {
        for matrix in [
            laplace::stiffness(&mesh).unwrap(),
            laplace::robust(&mesh).unwrap().stiffness,
        ] {
            let values = eigenvalues(&matrix);
            assert!(values[0].abs() < 1e-12 && values[1] > 1e-3, "{values:?}");
        }
    }
}

proptest! {
    #![proptest_config(geom_core::testing::cases(32))]

    /// Linear functions on a plane: constant gradient, no Laplacian inside, energy = area · slope².
    #[test]
    fn linear_functions(seed in any::<u64>(), x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0) {
        let n = 7;
        let mesh = plane(n, 0.5, seed);
        let direction = Vector3::new(x, y, z);
        let f: Vec<f64> = mesh.positions().iter().map(|p| p.coords.dot(&direction) + 2.0).collect();
        let normal = mesh.doubled_area_normal(0).normalize();
        let slope = direction - normal * normal.dot(&direction);
        for g in laplace::gradient(&mesh, &f).unwrap() {
            prop_assert!((g - slope).norm() < 1e-12);
        }
        for stiffness in [laplace::stiffness(&mesh).unwrap(), laplace::robust(&mesh).unwrap().stiffness] {
            let kf = stiffness.multiply(&f, 1);
            for (v, k) in kf.iter().enumerate() {
                prop_assert!(on_border(n, v) || k.abs() < 1e-11, "{v} {k}");
            }
            let energy: f64 = f.iter().zip(&kf).map(|(f, k)| f * k).sum();
            prop_assert!((energy - mesh.area() * slope.norm_squared()).abs() < 1e-9);
        }
    }

    /// div ∘ grad = −K, and the divergence of anything sums to zero.
    #[test]
    fn divergence_of_gradient(seed in any::<u64>()) {
        let mesh = plane(6, 0.6, seed);
        let f: Vec<f64> = (0..mesh.positions().len()).map(|v| ((v as f64) * 1.7 + seed as f64 % 9.0).sin()).collect();
        let gradient = laplace::gradient(&mesh, &f).unwrap();
        let divergence = laplace::divergence(&mesh, &gradient).unwrap();
        let kf = laplace::stiffness(&mesh).unwrap().multiply(&f, 1);
        for (d, k) in divergence.iter().zip(&kf) {
            prop_assert!((d + k).abs() < 1e-11);
        }
        let field: Vec<Vector3> = (0..mesh.triangles().len())
            .map(|t| Vector3::new((t as f64).sin(), (t as f64 * 0.3).cos(), 0.4))
            .collect();
        let sum: f64 = laplace::divergence(&mesh, &field).unwrap().iter().sum();
        prop_assert!(sum.abs() < 1e-11);
    }

    /// The tufted cover: no negative weights whatever the triangles, and still no eigenvalue below zero.
    #[test]
    fn robust_weights_are_not_negative(seed in any::<u64>(), flat in 0.0f64..1.0) {
        // A patch pressed flat: obtuse, nearly degenerate triangles.
        let mesh = plane(5, 0.8, seed);
        let (positions, triangles) = mesh.into_parts();
        let pressed = positions.iter().map(|p| Point3::new(p.x, p.y * flat * flat, 0.0)).collect();
        let mesh = TriMesh::new(pressed, triangles).unwrap();
        let robust = laplace::robust(&mesh).unwrap();
        let scale = largest(robust.stiffness.values());
        for i in 0..robust.stiffness.rows() {
            for (j, a) in robust.stiffness.row(i) {
                prop_assert!(i == j || a <= 1e-8 * scale, "{i} {j} {a}");
            }
        }
        rows_sum_to_zero(&robust.stiffness);
        prop_assert!(eigenvalues(&robust.stiffness)[0] > -1e-9 * scale);
    }
}

#[test]
fn robust_equals_plain_where_all_is_delaunay() {
    let mesh = shapes::icosphere(1.5, 3);
    let robust = laplace::robust(&mesh).unwrap();
    assert_eq!((robust.report.flips, robust.report.added), (0, 0.0));
    let plain = laplace::stiffness(&mesh).unwrap();
    for i in 0..plain.rows() {
        for (j, a) in plain.row(i) {
            assert!((robust.stiffness.get(i, j) - a).abs() < 1e-12);
        }
    }
    let (a, b) = (lumped(&robust.mass), lumped(&laplace::lumped_mass(&mesh)));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-14));
}

/// A square cut along its long diagonal is flipped to the short one: the exact weights are known.
#[test]
fn robust_flips_to_delaunay() {
    let rhomb = |x: f64, y: f64| Point3::new(x, y, 0.0);
    let positions = vec![
        rhomb(-2.0, 0.0),
        rhomb(0.0, -1.0),
        rhomb(2.0, 0.0),
        rhomb(0.0, 1.0),
    ];
    let long = TriMesh::new(positions.clone(), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
    let short = TriMesh::new(positions, vec![[0, 1, 3], [1, 2, 3]]).unwrap();
    let robust = laplace::robust(&long).unwrap();
    let reference = laplace::stiffness(&short).unwrap();
    assert_eq!(robust.report.flips, 2); // on each sheet
    for i in 0..4 {
        for j in 0..4 {
            assert!((robust.stiffness.get(i, j) - reference.get(i, j)).abs() < 1e-12);
        }
    }
}

/// Three triangles on one edge, one of them without area, any orientation.
#[test]
fn robust_takes_what_the_plain_form_refuses() {
    let p = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    let positions = vec![
        p(0.0, 0.0, 0.0),
        p(1.0, 0.0, 0.0),
        p(0.5, 1.0, 0.0),
        p(0.5, -1.0, 0.2),
        p(0.5, 0.0, 1.0),
        p(0.5, 0.0, 0.0), // on the edge
        p(9.0, 9.0, 9.0), // of no triangle
    ];
    let triangles = vec![[0, 1, 2], [0, 1, 3], [1, 0, 4], [0, 1, 5]];
    let mesh = TriMesh::new(positions, triangles).unwrap();
    assert_eq!(
        laplace::stiffness(&mesh).unwrap_err(),
        Error::Degenerate { triangle: 3 }
    );
    let message = laplace::stiffness(&mesh).unwrap_err().to_string();
    assert!(
        message.contains("triangle 3") && message.contains("robust"),
        "{message}"
    );
    let robust = laplace::robust(&mesh).unwrap();
    assert!(robust.report.added > 0.0 && robust.report.added < 1e-4);
    rows_sum_to_zero(&robust.stiffness);
    assert_eq!(robust.stiffness.row(6).count(), 0);
    // Vertex 5 is a vertex of a needle and of the zero of no other part.
    let values = eigenvalues(&robust.stiffness);
    assert!(values[1].abs() < 1e-8 && values[2] > 1e-3, "{values:?}");
    // Order and orientation of the triangles do not matter.
    let turned = vec![[3, 1, 0], [2, 0, 1], [5, 0, 1], [1, 0, 4]];
    let other = laplace::robust(&TriMesh::new(mesh.positions().to_vec(), turned).unwrap()).unwrap();
    assert!(
        (largest(other.stiffness.values()) / largest(robust.stiffness.values()) - 1.0).abs() < 1e-6
    );
}

#[test]
fn all_vertices_in_one_place() {
    let mesh = TriMesh::new(vec![Point3::origin(); 3], vec![[0, 1, 2]]).unwrap();
    assert_eq!(
        laplace::robust(&mesh).unwrap_err(),
        Error::Degenerate { triangle: 0 }
    );
    let empty = TriMesh::default();
    assert_eq!(laplace::robust(&empty).unwrap().stiffness.rows(), 0);
    assert_eq!(laplace::stiffness(&empty).unwrap().rows(), 0);
}

#[test]
fn lengths_are_checked() {
    let mesh = shapes::icosphere(1.0, 1);
    let wrong = laplace::gradient(&mesh, &[0.0; 3]).unwrap_err();
    assert_eq!(
        wrong,
        Error::Length {
            element: "vertex",
            found: 3,
            expected: 42
        }
    );
    assert!(laplace::divergence(&mesh, &[Vector3::zeros()]).is_err());
}

/// Around a vertex the frames turn by the angle defect; over a closed surface by 2π χ (Gauss–Bonnet).
#[test]
fn transport_around_vertices_is_the_angle_defect() {
    use std::f64::consts::TAU;
    for (mesh, chi) in [
        (shapes::icosphere(1.0, 2), 2.0),
        (shapes::torus(2.0, 0.6, 19, 12), 0.0),
    ] {
        let form = laplace::connection(&mesh, 1, EdgeWeights::One).unwrap();
        let edges = geom_core::mesh::Halfedges::of(&mesh).unwrap();
        let between = |f: u32, g: u32| {
            form.transports
                .iter()
                .find_map(|t| match t.faces {
                    [a, b] if (a, b) == (f, g) => Some(t.angle),
                    [a, b] if (a, b) == (g, f) => Some(-t.angle),
                    _ => None,
                })
                .unwrap()
        };
        let mut total = 0.0;
        for v in 0..mesh.positions().len() as u32 {
            let around: Vec<_> = edges.around(geom_core::VertexId(v)).collect();
            let faces: Vec<u32> = around.iter().map(|&h| edges.face(h).0).collect();
            let turn: f64 = (0..faces.len())
                .map(|i| between(faces[i], faces[(i + 1) % faces.len()]))
                .sum();
            let angles: f64 = around
                .iter()
                .map(|&h| {
                    let at = |v: geom_core::VertexId| mesh.positions()[v.0 as usize];
                    let p = at(edges.from(h));
                    let (a, b) = (at(edges.to(h)) - p, at(edges.from(edges.previous(h))) - p);
                    a.angle(&b)
                })
                .sum();
            let defect = TAU - angles;
            // Whichever way round, up to whole turns.
            let off = |x: f64| (x / TAU - (x / TAU).round()).abs();
            assert!(off(turn - defect).min(off(turn + defect)) < 1e-10);
            total += defect;
        }
        assert!((total - TAU * chi).abs() < 1e-9);
    }
}

/// A flat patch carries parallel fields of any order: the smallest eigenvalue is zero. On a sphere none
/// does: the smallest eigenvalue of the form of vectors tends to 1 / r².
#[test]
fn parallel_fields() {
    let smallest = |mesh: &TriMesh, order: u32, weights: EdgeWeights| {
        let form = laplace::connection(mesh, order, weights).unwrap();
        form.matrix.check_hermitian().unwrap();
        let n = form.areas.len();
        let tiny: Vec<_> = form
            .areas
            .iter()
            .map(|&a| Complex::from(1e-6 * a))
            .collect();
        let shifted = form
            .matrix
            .plus(1.0, &SparseMatrix::diagonal_of(&tiny))
            .unwrap();
        let factor = Cholesky::of(&shifted).unwrap();
        let mut z: Vec<Complex<f64>> = (0..n)
            .map(|f| Complex::from_polar(1.0, (f * f) as f64))
            .collect();
        let mut value = f64::NAN;
        for _ in 0..60 {
            let mz: Vec<_> = z.iter().zip(&form.areas).map(|(z, &a)| z * a).collect();
            z = factor.solve(&mz).unwrap();
            let norm: f64 = z
                .iter()
                .zip(&form.areas)
                .map(|(z, a)| z.norm_sqr() * a)
                .sum();
            z.iter_mut().for_each(|z| *z /= norm.sqrt());
            let lz = form.matrix.multiply(&z, 1);
            value = z.iter().zip(&lz).map(|(z, l)| (z.conj() * l).re).sum();
        }
        value
    };
    for order in [1, 2, 4] {
        for weights in [EdgeWeights::One, EdgeWeights::Shape] {
            assert!(smallest(&plane(7, 0.5, 11), order, weights).abs() < 1e-10);
        }
    }
    let sphere = smallest(&shapes::icosphere(2.0, 4), 1, EdgeWeights::Shape);
    assert!((sphere * 4.0 - 1.0).abs() < 0.15, "{sphere}");
    let crosses = smallest(&shapes::icosphere(2.0, 3), 4, EdgeWeights::Shape);
    assert!(crosses > sphere);
}

/// The frames are a choice: another first corner per triangle leaves the smallest eigenvalues alone.
#[test]
fn connection_does_not_depend_on_frames() {
    let mesh = shapes::torus(2.0, 0.7, 12, 7);
    let turned = mesh
        .triangles()
        .iter()
        .enumerate()
        .map(|(t, &[a, b, c])| match t % 3 {
            0 => [a, b, c],
            1 => [b, c, a],
            _ => [c, a, b],
        });
    let other = TriMesh::new(mesh.positions().to_vec(), turned.collect()).unwrap();
    let values = |mesh: &TriMesh| {
        let form = laplace::connection(mesh, 4, EdgeWeights::One).unwrap();
        let n = form.areas.len();
        // A Hermitian matrix as a real one of twice the size.
        let real = DMatrix::from_fn(2 * n, 2 * n, |i, j| {
            let a = form.matrix.get(i % n, j % n);
            match (i < n, j < n) {
                (true, true) | (false, false) => a.re,
                (true, false) => -a.im,
                (false, true) => a.im,
            }
        });
        let mut values: Vec<f64> = real.symmetric_eigenvalues().iter().copied().collect();
        values.sort_by(f64::total_cmp);
        values
    };
    for (a, b) in values(&mesh).iter().zip(values(&other)) {
        assert!((a - b).abs() < 1e-10);
        assert!(*a > -1e-12);
    }
}

#[test]
fn connection_needs_an_oriented_manifold() {
    let positions: Vec<Point3> = (0..5)
        .map(|i| Point3::new((i * i) as f64, i as f64, (i % 2) as f64))
        .collect();
    let fan = TriMesh::new(positions, vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]).unwrap();
    let error = laplace::connection(&fan, 4, EdgeWeights::One).unwrap_err();
    assert!(
        matches!(error, Error::Mesh(MeshError::NonManifoldEdge { .. })),
        "{error}"
    );
    assert!(error.to_string().contains("edge"), "{error}");
    // The plain form is a sum over triangles: such an edge has as many terms as triangles.
    rows_sum_to_zero(&laplace::stiffness(&fan).unwrap());
}

#[test]
fn bits_do_not_depend_on_threads() {
    let mesh = plane(40, 0.9, 2);
    same_on_any_threads(|| {
        let robust = laplace::robust(&mesh).unwrap();
        (robust, laplace::stiffness(&mesh).unwrap())
    });
}
