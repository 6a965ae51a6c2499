//! Eigenvalues against closed forms and invariants.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use geom_core::algebra::eigen::{EigenPairs, Error, Method, Options, eigenpairs};
use geom_core::algebra::{self, SparseMatrix};
use geom_core::mesh::shapes;
use geom_core::surface::laplace::{self, Mass};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Point3, Run, TriMesh};

fn modes(mesh: &TriMesh, k: usize) -> EigenPairs {
    let stiffness = laplace::stiffness(mesh).unwrap();
    let mass = laplace::lumped_mass(mesh);
    eigenpairs(&stiffness, &mass, k, &Options::default(), Run::on(&Cpu)).unwrap()
}

fn check(pairs: &EigenPairs, k: usize) {
    assert_eq!(pairs.values.len(), k);
    assert!(pairs.report.converged, "{:?}", pairs.residuals);
    assert!(
        pairs.residuals.iter().all(|&r| r <= 1e-9),
        "{:?}",
        pairs.residuals
    );
    assert!(pairs.values.is_sorted());
}

/// The first eigenvalues of a sphere of radius r are ℓ(ℓ + 1) / r², each 2ℓ + 1 times; the error
/// falls with the square of the edge length.
#[test]
fn sphere_converges_with_second_order() {
    let radius = 3.0;
    let exact: Vec<f64> = (0..6)
        .flat_map(|l| std::iter::repeat_n(f64::from(l * (l + 1)) / 9.0, 2 * l as usize + 1))
        .collect();
    let errors: Vec<f64> = (3..6)
        .map(|level| {
            let pairs = modes(&shapes::icosphere(radius, level), 36);
            check(&pairs, 36);
            assert_eq!(pairs.values[0], 0.0);
            (1..36)
                .map(|i| (pairs.values[i] / exact[i] - 1.0).abs())
                .fold(0.0, f64::max)
        })
        .collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.8..2.2).contains(&order), "{errors:?}");
    }
    assert!(errors[2] < 5e-3, "{errors:?}");
}

#[test]
fn bits_do_not_depend_on_threads() {
    let mesh = shapes::torus(3.0, 1.0, 40, 24);
    same_on_any_threads(|| {
        let mut pairs = modes(&mesh, 12);
        // From below all of them, and from their middle.
        let many = modes(&mesh, 24);
        pairs.values.extend(many.values);
        pairs.vectors.extend(many.vectors);
        (pairs.values, pairs.vectors)
    });
}

/// Two equal spheres and a torus: a zero each, and no mode spans two of them.
#[test]
fn parts_have_a_zero_each() {
    let one = shapes::icosphere(1.0, 3);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (mesh, shift) in [
        (&one, 0.0),
        (&one, 10.0),
        (&shapes::torus(3.0, 1.0, 24, 12), 30.0),
    ] {
        let first = positions.len() as u32;
        positions.extend(
            mesh.positions()
                .iter()
                .map(|p| p + Point3::new(shift, 0.0, 0.0).coords),
        );
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    let pairs = modes(&TriMesh::new(positions, triangles).unwrap(), 12);
    check(&pairs, 12);
    assert_eq!(pairs.report.parts, 3);
    assert_eq!(pairs.values[..3], [0.0; 3]);
    assert!(pairs.values[3] > 0.0);
    let n = one.positions().len();
    for vector in &pairs.vectors {
        let on = |range: std::ops::Range<usize>| vector[range].iter().any(|&x| x != 0.0);
        let parts = [on(0..n), on(n..2 * n), on(2 * n..vector.len())];
        assert_eq!(parts.iter().filter(|&&p| p).count(), 1);
    }
}

/// Twenty spheres of other sizes, of which every fifth is too large to be solved densely: what each gives alone, in order.
#[test]
fn many_parts_give_what_each_gives_alone() {
    let spheres: Vec<TriMesh> = (0..20)
        .map(|i| shapes::icosphere(1.0 + 0.07 * f64::from(i), if i % 5 == 3 { 3 } else { 2 }))
        .collect();
    let (mut positions, mut triangles, mut starts) = (Vec::new(), Vec::new(), Vec::new());
    for (i, sphere) in spheres.iter().enumerate() {
        let first = positions.len() as u32;
        starts.push(first as usize);
        let shift = Point3::new(5.0 * i as f64, 0.0, 0.0).coords;
        positions.extend(sphere.positions().iter().map(|p| p + shift));
        triangles.extend(sphere.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    starts.push(positions.len());
    let all = TriMesh::new(positions, triangles).unwrap();
    type MassOf = fn(&TriMesh) -> Mass;
    let masses: [MassOf; 2] = [laplace::lumped_mass, |m| {
        laplace::consistent_mass(m).unwrap()
    }];
    for mass in masses {
        let pairs_of = |mesh: &TriMesh, k| {
            let stiffness = laplace::stiffness(mesh).unwrap();
            eigenpairs(
                &stiffness,
                &mass(mesh),
                k,
                &Options::default(),
                Run::on(&Cpu),
            )
            .unwrap()
        };
        let pairs = pairs_of(&all, 60);
        check(&pairs, 60);
        assert_eq!(pairs.report.parts, 20);
        let mut alone: Vec<(f64, usize)> = Vec::new();
        for (i, sphere) in spheres.iter().enumerate() {
            alone.extend(pairs_of(sphere, 9).values.into_iter().map(|v| (v, i)));
        }
        alone.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for ((value, vector), (expected, part)) in
            pairs.values.iter().zip(&pairs.vectors).zip(alone)
        {
            assert!((value - expected).abs() <= 1e-8, "{value} {expected}");
            let own = starts[part]..starts[part + 1];
            let outside = vector
                .iter()
                .enumerate()
                .any(|(i, &x)| x != 0.0 && !own.contains(&i));
            assert!(!outside, "{value} of part {part} is elsewhere, too");
        }
    }
}

#[test]
fn consistent_mass_brackets_the_lumped_one() {
    let mesh = shapes::icosphere(1.0, 4);
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let mass = laplace::consistent_mass(&mesh).unwrap();
    let pairs = eigenpairs(&stiffness, &mass, 9, &Options::default(), Run::on(&Cpu)).unwrap();
    check(&pairs, 9);
    for (i, exact) in [0.0, 2.0, 2.0, 2.0, 6.0, 6.0, 6.0, 6.0, 6.0]
        .iter()
        .enumerate()
    {
        assert!(
            (pairs.values[i] - exact).abs() <= 0.01 * exact,
            "{:?}",
            pairs.values
        );
    }
    let Mass::Consistent(matrix) = &mass else {
        unreachable!()
    };
    let x = &pairs.vectors[4];
    let m = matrix.multiply(x, 1);
    let norm: f64 = x.iter().zip(&m).map(|(x, m)| x * m).sum();
    assert!((norm - 1.0).abs() < 1e-10, "{norm}");
}

/// A flat torus has no place in space, but a grid on it has: the five-point stiffness of squares of
/// side h, whose eigenvalues are known, and tend to those of the torus with second order.
fn flat_torus(nx: usize, ny: usize, h: f64) -> (SparseMatrix, Mass) {
    weighted_torus(nx, ny, h, |_| 1.0)
}

/// The same with a weight for the edges to the right of and above each point.
fn weighted_torus(
    nx: usize,
    ny: usize,
    h: f64,
    weight: impl Fn(usize) -> f64,
) -> (SparseMatrix, Mass) {
    let at = |i: usize, j: usize| (i % nx + nx * (j % ny)) as u32;
    let mut entries = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            let own = at(i, j);
            let w = weight(own as usize);
            for other in [at(i + 1, j), at(i, j + 1)] {
                entries.extend([(own, own, w), (other, other, w)]);
                entries.extend([(own, other, -w), (other, own, -w)]);
            }
        }
    }
    let matrix = SparseMatrix::from_triplets(nx * ny, nx * ny, &entries).unwrap();
    (matrix, Mass::Lumped(vec![h * h; nx * ny]))
}

/// Its eigenvalues, ascending.
fn of_flat_torus(nx: usize, ny: usize, h: f64) -> Vec<f64> {
    let wave = |p: usize, n: usize| 2.0 - 2.0 * (std::f64::consts::TAU * p as f64 / n as f64).cos();
    let mut exact: Vec<f64> = (0..nx * ny)
        .map(|c| (wave(c % nx, nx) + wave(c / nx, ny)) / (h * h))
        .collect();
    exact.sort_by(f64::total_cmp);
    exact
}

#[test]
fn flat_torus_against_its_closed_form() {
    let (nx, ny, h) = (60usize, 34usize, 0.25);
    let (stiffness, mass) = flat_torus(nx, ny, h);
    let exact = of_flat_torus(nx, ny, h);
    let options = Options {
        verify: true,
        ..Options::default()
    };
    let pairs = eigenpairs(&stiffness, &mass, 60, &options, Run::on(&Cpu)).unwrap();
    check(&pairs, 60);
    assert_eq!(pairs.report.verified, Some(true));
    for (found, exact) in pairs.values.iter().zip(&exact) {
        assert!(
            (found - exact).abs() <= 1e-10 * exact.max(0.01),
            "{found} {exact}"
        );
    }
    // Pairs and fourfold values are clusters.
    assert!(pairs.clusters.iter().any(|c| c.len() == 4));
    assert!(
        pairs
            .clusters
            .iter()
            .all(|c| exact[c.end - 1] / exact[c.start] < 1.05)
    );
}

/// A shift far below makes the wanted pairs lie close together, so that they take restart upon restart, and what blocks have of
/// each other counts for more.
#[test]
fn many_restarts_lose_no_orthogonality() {
    let (nx, ny, h) = (60usize, 34usize, 0.25);
    let (stiffness, mass) = flat_torus(nx, ny, h);
    let options = Options {
        shift: Some(-50.0),
        ..Options::default()
    };
    let pairs = eigenpairs(&stiffness, &mass, 20, &options, Run::on(&Cpu)).unwrap();
    check(&pairs, 20);
    assert!(pairs.report.restarts >= 4, "{:?}", pairs.report);
    for (found, exact) in pairs.values.iter().zip(of_flat_torus(nx, ny, h)) {
        assert!(
            (found - exact).abs() <= 1e-10 * exact.max(0.01),
            "{found} {exact}"
        );
    }
}

/// A few heavy edges change what the mean of the diagonal is, not where the smallest eigenvalues are: the shift stays near those.
#[test]
fn weights_of_many_orders_take_no_restart() {
    let (nx, ny, h) = (60usize, 34usize, 0.25);
    let weight = |i: usize| if i.is_multiple_of(23) { 1e4 } else { 1.0 };
    let (stiffness, mass) = weighted_torus(nx, ny, h, weight);
    // Few enough for a shift near zero; and more.
    for k in [15, 20] {
        let pairs = eigenpairs(&stiffness, &mass, k, &Options::default(), Run::on(&Cpu)).unwrap();
        check(&pairs, k);
        assert_eq!(pairs.report.restarts, 0, "{:?}", pairs.report);
    }
}

/// From the middle of the wanted eigenvalues all of them are the same as from below, also the lowest, and come for fewer solves.
#[test]
fn the_middle_of_the_spectrum() {
    let solved = |stiffness: &SparseMatrix, mass: &Mass, k: usize, shift: Option<f64>| {
        let options = Options {
            shift,
            tolerance: 1e-10,
            ..Options::default()
        };
        let pairs = eigenpairs(stiffness, mass, k, &options, Run::on(&Cpu)).unwrap();
        assert!(pairs.report.converged, "{:?}", pairs.residuals);
        pairs
    };
    let mesh = potato();
    let lumped = laplace::lumped_mass(&mesh);
    let Mass::Lumped(masses) = &lumped else {
        unreachable!()
    };
    let stiffness = laplace::stiffness(&mesh).unwrap();
    // No eigenvalue is zero with the mass added, and none is known.
    let screened = stiffness.plus(0.5, &SparseMatrix::diagonal_of(masses));
    let (screened, consistent) = (screened.unwrap(), laplace::consistent_mass(&mesh).unwrap());
    for (stiffness, mass) in [
        (&stiffness, &lumped),
        (&screened, &lumped),
        (&stiffness, &consistent),
    ] {
        for k in [16, 40, 150] {
            let middle = solved(stiffness, mass, k, None);
            let below = solved(stiffness, mass, k, Some(-0.1));
            same_values(&below, &middle, 1.0);
            let (few, many) = (middle.report.solves, below.report.solves);
            assert!(few < many, "{few} of {many}");
            assert_eq!(middle.report.restarts, 0);
        }
    }
    // Values of many copies, of which a block of eight finds no more at once.
    let exact = of_flat_torus(60, 60, 0.25);
    let (stiffness, mass) = flat_torus(60, 60, 0.25);
    let pairs = solved(&stiffness, &mass, 120, None);
    for (found, exact) in pairs.values.iter().zip(&exact) {
        assert!((found - exact).abs() <= 1e-9 * exact.max(0.01));
    }
    let unit = |i: usize, j: usize| {
        let products = pairs.vectors[i].iter().zip(&pairs.vectors[j]);
        products.map(|(x, y)| x * y * 0.0625).sum::<f64>()
    };
    for (i, j) in (0..120).flat_map(|i| (0..=i).map(move |j| (i, j))) {
        assert!((unit(i, j) - f64::from(i == j)).abs() < 1e-10);
    }
}

/// A rectangle a × b with free borders: π² (p²/a² + q²/b²).
#[test]
fn rectangle_converges_with_second_order() {
    let (a, b) = (3.0, 2.0);
    let mut exact: Vec<f64> = (0..20u32)
        .flat_map(|p| {
            (0..20u32).map(move |q| (f64::from(p) / a).powi(2) + (f64::from(q) / b).powi(2))
        })
        .map(|s| s * std::f64::consts::PI.powi(2))
        .collect();
    exact.sort_by(f64::total_cmp);
    let errors: Vec<f64> = [1u32, 2, 4]
        .iter()
        .map(|&refine| {
            let (nx, ny) = (15 * refine, 10 * refine);
            let pairs = modes(&rectangle(a, b, nx, ny), 12);
            check(&pairs, 12);
            (1..12)
                .map(|i| (pairs.values[i] / exact[i] - 1.0).abs())
                .fold(0.0, f64::max)
        })
        .collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.8..2.3).contains(&order), "{errors:?}");
    }
}

fn rectangle(a: f64, b: f64, nx: u32, ny: u32) -> TriMesh {
    let positions = (0..=ny).flat_map(|j| {
        (0..=nx).map(move |i| {
            let (x, y) = (
                a * f64::from(i) / f64::from(nx),
                b * f64::from(j) / f64::from(ny),
            );
            Point3::new(x, y, 0.0)
        })
    });
    let at = |i: u32, j: u32| i + (nx + 1) * j;
    let triangles = (0..nx * ny).flat_map(|c| {
        let (i, j) = (c % nx, c / nx);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        if (i + j) % 2 == 0 {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, b, d], [b, c, d]]
        }
    });
    TriMesh::new(positions.collect(), triangles.collect()).unwrap()
}

/// A body without symmetry: no eigenvalue of the first ones is multiple.
fn potato() -> TriMesh {
    let (positions, triangles) = shapes::icosphere(1.0, 4).into_parts();
    let bend = |p: &Point3| {
        let r = 1.0
            + 0.2 * (2.0 * p.x + 0.3).sin()
            + 0.15 * (3.0 * p.y * p.z + p.x).cos()
            + 0.1 * (2.0 * p.y + p.z).sin();
        Point3::new(1.3 * r * p.x, r * p.y, 0.8 * r * p.z)
    };
    TriMesh::new(positions.iter().map(bend).collect(), triangles).unwrap()
}

fn same_values(a: &EigenPairs, b: &EigenPairs, scale: f64) {
    for (a, b) in a.values.iter().zip(&b.values) {
        assert!(
            (a * scale - b).abs() <= 1e-9 * b.max(1e-3),
            "{} {b}",
            a * scale
        );
    }
}

#[test]
fn renumbering_scale_and_rigid_motion() {
    let mesh = potato();
    let reference = modes(&mesh, 15);
    check(&reference, 15);
    let n = mesh.positions().len();
    // Every vertex somewhere else.
    let place = |v: usize| (v * 1009 + 77) % n;
    let mut positions = vec![Point3::origin(); n];
    for (v, &p) in mesh.positions().iter().enumerate() {
        positions[place(v)] = p;
    }
    let triangles = mesh
        .triangles()
        .iter()
        .rev()
        .map(|t| t.map(|v| place(v as usize) as u32));
    let renumbered = modes(&TriMesh::new(positions, triangles.collect()).unwrap(), 15);
    same_values(&reference, &renumbered, 1.0);
    for (a, b) in reference.vectors.iter().zip(&renumbered.vectors) {
        for v in 0..n {
            assert!((a[v] - b[place(v)]).abs() < 1e-6, "{v}");
        }
    }
    // λ ~ s⁻², and vectors ~ s⁻¹ since xᵀ M x = 1.
    for scale in [1e-3, 1e3] {
        let scaled = mesh.positions().iter().map(|p| p * scale).collect();
        let scaled = modes(
            &TriMesh::new(scaled, mesh.triangles().to_vec()).unwrap(),
            15,
        );
        for (a, b) in reference.values.iter().zip(&scaled.values) {
            let b = b * scale * scale;
            assert!((a - b).abs() <= 1e-9 * a.max(1e-3), "{a} {b}");
        }
        assert!((scaled.vectors[3][7] * scale - reference.vectors[3][7]).abs() < 1e-7);
    }
    let turn = geom_core::nalgebra::Rotation3::from_euler_angles(0.4, 1.2, -0.8);
    let shift = geom_core::Vector3::new(50.0, -20.0, 3.0);
    let moved = mesh.positions().iter().map(|p| turn * p + shift).collect();
    let moved = modes(&TriMesh::new(moved, mesh.triangles().to_vec()).unwrap(), 15);
    same_values(&reference, &moved, 1.0);
}

#[test]
fn vectors_are_orthonormal_and_signed() {
    let mesh = potato();
    let Mass::Lumped(mass) = laplace::lumped_mass(&mesh) else {
        unreachable!()
    };
    let pairs = modes(&mesh, 20);
    for (i, a) in pairs.vectors.iter().enumerate() {
        for (j, b) in pairs.vectors.iter().enumerate() {
            let dot: f64 = (0..mass.len()).map(|v| a[v] * mass[v] * b[v]).sum();
            assert!(
                (dot - f64::from(u8::from(i == j))).abs() < 1e-9,
                "{i} {j} {dot}"
            );
        }
        let largest = a
            .iter()
            .fold(0.0f64, |m, &x| if x.abs() > m.abs() { x } else { m });
        assert!(largest > 0.0);
    }
}

/// Both methods, and the dense one, find the same pairs.
#[test]
fn methods_agree() {
    let mesh = rectangle(3.0, 2.0, 24, 17);
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let mass = laplace::lumped_mass(&mesh);
    let by = |method, k| {
        let options = Options {
            method,
            verify: true,
            ..Options::default()
        };
        let pairs = eigenpairs(&stiffness, &mass, k, &options, Run::on(&Cpu)).unwrap();
        check(&pairs, k);
        assert_eq!(pairs.report.verified, Some(true));
        pairs
    };
    let lanczos = by(Method::ShiftInvert, 20);
    let davidson = by(Method::Multigrid, 20);
    let dense = by(Method::Auto, stiffness.rows() / 2);
    same_values(&lanczos, &davidson, 1.0);
    same_values(&dense, &davidson, 1.0);
}

/// Products of blocks have code for eight columns and for what is left of them.
#[test]
fn any_width_of_a_block() {
    let mesh = potato();
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let mass = laplace::lumped_mass(&mesh);
    let reference = modes(&mesh, 21);
    for block in [1, 3, 5, 7, 11, 16] {
        let options = Options {
            block,
            ..Options::default()
        };
        let pairs = eigenpairs(&stiffness, &mass, 21, &options, Run::on(&Cpu)).unwrap();
        check(&pairs, 21);
        same_values(&reference, &pairs, 1.0);
    }
}

/// Of a fivefold eigenvalue a block of one may lose copies; the count finds that out and goes on.
#[test]
fn verification_finds_lost_copies() {
    let mesh = shapes::icosphere(1.0, 4);
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let mass = laplace::lumped_mass(&mesh);
    let options = Options {
        block: 1,
        verify: true,
        ..Options::default()
    };
    let pairs = eigenpairs(&stiffness, &mass, 16, &options, Run::on(&Cpu)).unwrap();
    assert_eq!(pairs.report.verified, Some(true));
    let reference = modes(&mesh, 16);
    same_values(&reference, &pairs, 1.0);
}

#[test]
fn isolated_vertices_and_tiny_parts() {
    let (mut positions, mut triangles) = shapes::icosphere(1.0, 2).into_parts();
    let n = positions.len();
    // A vertex of no triangle, and a triangle by itself.
    positions.extend(
        [(9.0, 0.0), (20.0, 0.0), (21.0, 0.0), (20.0, 1.0)].map(|(x, y)| Point3::new(x, y, 0.0)),
    );
    triangles.push([n as u32 + 1, n as u32 + 2, n as u32 + 3]);
    let pairs = modes(&TriMesh::new(positions, triangles).unwrap(), 5);
    check(&pairs, 5);
    assert_eq!((pairs.report.parts, pairs.report.isolated), (2, 1));
    assert_eq!(pairs.values[..2], [0.0, 0.0]);
    assert!(pairs.values[2] > 1.0);
    assert!(pairs.vectors.iter().all(|v| v[n] == 0.0));
}

#[test]
fn any_number_of_pairs() {
    let small = shapes::icosphere(1.0, 1);
    assert!(modes(&small, 0).values.is_empty());
    // As many as there are, if more are asked for.
    let all = modes(&small, 1000);
    check(&all, 42);
    let trace: f64 = {
        let k = laplace::stiffness(&small).unwrap();
        let Mass::Lumped(m) = laplace::lumped_mass(&small) else {
            unreachable!()
        };
        k.diagonal().iter().zip(&m).map(|(k, m)| k / m).sum()
    };
    assert!((all.values.iter().sum::<f64>() / trace - 1.0).abs() < 1e-12);
    // Of a large part not nearly all.
    let large = shapes::torus(3.0, 1.0, 80, 40);
    let stiffness = laplace::stiffness(&large).unwrap();
    let mass = laplace::lumped_mass(&large);
    let error =
        eigenpairs(&stiffness, &mass, 3000, &Options::default(), Run::on(&Cpu)).unwrap_err();
    assert_eq!(
        error,
        Error::TooMany {
            asked: 3000,
            rows: 3200
        }
    );
    let empty = SparseMatrix::from_triplets(0, 0, &[]).unwrap();
    let none = eigenpairs(
        &empty,
        &Mass::Lumped(Vec::new()),
        3,
        &Options::default(),
        Run::on(&Cpu),
    );
    assert!(none.unwrap().values.is_empty());
}

#[test]
fn bad_input_is_named() {
    let mesh = shapes::icosphere(1.0, 2);
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let solve = |stiffness: &SparseMatrix, mass: &Mass, options: &Options| {
        eigenpairs(stiffness, mass, 3, options, Run::on(&Cpu)).unwrap_err()
    };
    let n = stiffness.rows();
    let defaults = Options::default();
    let mut masses = vec![1.0; n];
    masses[4] = f64::NAN;
    let nan = solve(&stiffness, &Mass::Lumped(masses.clone()), &defaults);
    assert_eq!(
        nan,
        Error::Matrix(algebra::Error::NotFinite { row: 4, column: 4 })
    );
    masses[4] = -1.0;
    let negative = solve(&stiffness, &Mass::Lumped(masses), &defaults);
    assert_eq!(negative, Error::Mass { row: 4, mass: -1.0 });
    let short = solve(&stiffness, &Mass::Lumped(vec![1.0; 2]), &defaults);
    assert_eq!(short, Error::MassLength { found: 2, rows: n });
    let wide = SparseMatrix::from_triplets(2, 3, &[(0, 2, 1.0), (1, 1, 1.0)]).unwrap();
    let not_square = solve(&wide, &Mass::Lumped(vec![1.0; 2]), &defaults);
    assert!(matches!(
        not_square,
        Error::Matrix(algebra::Error::Shape { .. })
    ));
    let (column, _) = stiffness.row(0).nth(1).unwrap();
    let skew = stiffness.map(|i, j, a| if (i, j) == (0, column) { a + 0.5 } else { a });
    let asymmetric = solve(&skew, &laplace::lumped_mass(&mesh), &defaults);
    assert_eq!(
        asymmetric,
        Error::Matrix(algebra::Error::NotSymmetric { row: 0, column })
    );
    for (options, field) in [
        (
            Options {
                tolerance: f64::NAN,
                ..defaults.clone()
            },
            "tolerance",
        ),
        (
            Options {
                block: 0,
                ..defaults.clone()
            },
            "block",
        ),
        (
            Options {
                max_restarts: 0,
                ..defaults.clone()
            },
            "max_restarts",
        ),
        (
            Options {
                shift: Some(f64::INFINITY),
                ..defaults.clone()
            },
            "shift",
        ),
        (
            Options {
                cluster_gap: -1.0,
                ..defaults.clone()
            },
            "cluster_gap",
        ),
    ] {
        let error = solve(&stiffness, &laplace::lumped_mass(&mesh), &options);
        assert!(
            matches!(&error, Error::Option(out) if out.option == field),
            "{error}"
        );
        assert!(error.to_string().contains(field));
    }
    // A shift inside of the spectrum gives no definite matrix.
    let mesh = shapes::icosphere(1.0, 3);
    let inside = Options {
        shift: Some(3.0),
        ..defaults
    };
    let error = solve(
        &laplace::stiffness(&mesh).unwrap(),
        &laplace::lumped_mass(&mesh),
        &inside,
    );
    assert!(matches!(
        error,
        Error::Matrix(algebra::Error::NotPositiveDefinite { .. })
    ));
}

#[test]
fn progress_and_cancellation() {
    let mesh = shapes::torus(3.0, 1.0, 40, 24);
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let mass = laplace::lumped_mass(&mesh);
    for method in [Method::ShiftInvert, Method::Multigrid] {
        let options = Options {
            method,
            ..Options::default()
        };
        let calls = Mutex::new(Vec::new());
        let monitor = |stage: &'static str, done: u64, total: u64| {
            assert!(done <= total);
            calls.lock().unwrap().push(stage);
            ControlFlow::Continue(())
        };
        let run = Run::on(&Cpu).watched_by(&monitor);
        eigenpairs(&stiffness, &mass, 6, &options, run).unwrap();
        let calls = calls.into_inner().unwrap();
        assert!(
            calls.len() > 4 && calls.contains(&"eigenpairs"),
            "{calls:?}"
        );
        // At every call it can be stopped.
        for stop_at in [0, 1, calls.len() / 2, calls.len() - 1] {
            let count = AtomicUsize::new(0);
            let stop = |_: &'static str, _: u64, _: u64| {
                if count.fetch_add(1, Ordering::Relaxed) == stop_at {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            };
            let run = Run::on(&Cpu).watched_by(&stop);
            let stopped = eigenpairs(&stiffness, &mass, 6, &options, run);
            assert_eq!(stopped.unwrap_err(), Error::Cancelled(geom_core::Cancelled));
            assert_eq!(count.into_inner(), stop_at + 1);
        }
    }
}

/// Too few restarts are said to be too few.
#[test]
fn unfinished_pairs_are_reported() {
    let (stiffness, mass) = flat_torus(70, 70, 1.0);
    for method in [Method::ShiftInvert, Method::Multigrid] {
        let options = Options {
            method,
            tolerance: 1e-15,
            max_restarts: 1,
            ..Options::default()
        };
        let pairs = eigenpairs(&stiffness, &mass, 30, &options, Run::on(&Cpu)).unwrap();
        assert!(!pairs.report.converged);
        assert!(pairs.residuals.iter().any(|&r| r > 1e-15));
    }
}

/// Needles and caps: the robust operator gives nearly the spectrum of good triangles.
#[test]
fn badly_shaped_triangles() {
    let good = modes(&rectangle(1.0, 1.0, 32, 32), 6);
    // The same square in triangles of aspect 10.
    let bad = rectangle(1.0, 1.0, 160, 16);
    let robust = laplace::robust(&bad).unwrap();
    let pairs = eigenpairs(
        &robust.stiffness,
        &robust.mass,
        6,
        &Options::default(),
        Run::on(&Cpu),
    )
    .unwrap();
    check(&pairs, 6);
    for (a, b) in good.values.iter().zip(&pairs.values).skip(1) {
        assert!((a / b - 1.0).abs() < 0.02, "{a} {b}");
    }
    // A vertex on an edge makes a triangle without area: the plain form refuses, this one does not.
    let (mut positions, mut triangles) = rectangle(1.0, 1.0, 8, 8).into_parts();
    let [a, b, c] = triangles[20];
    let middle = Point3::from((positions[a as usize].coords + positions[b as usize].coords) / 2.0);
    positions.push(middle);
    let new = positions.len() as u32 - 1;
    triangles[20] = [a, new, c];
    triangles.extend([[new, b, c], [a, b, new]]);
    let mesh = TriMesh::new(positions, triangles).unwrap();
    let degenerate = laplace::stiffness(&mesh).unwrap_err();
    assert_eq!(
        degenerate,
        laplace::Error::Degenerate {
            triangle: mesh.triangles().len() - 1
        }
    );
    let robust = laplace::robust(&mesh).unwrap();
    let pairs = eigenpairs(
        &robust.stiffness,
        &robust.mass,
        6,
        &Options::default(),
        Run::on(&Cpu),
    )
    .unwrap();
    let reference = modes(&rectangle(1.0, 1.0, 8, 8), 6);
    for (a, b) in reference.values.iter().zip(&pairs.values).skip(1) {
        assert!((a / b - 1.0).abs() < 0.05, "{a} {b}");
    }
}

/// Files need the readers.
#[cfg(feature = "io")]
mod files {
    use super::*;

    fn read(path: &std::path::Path) -> TriMesh {
        geom_core::io::mesh::read(path)
            .unwrap()
            .mesh
            .into_triangles()
    }

    /// Computed by SciPy 1.17 (`eigsh`, shift–invert) on cotangent matrices and lumped masses that
    /// NumPy assembled from the same files: closed, and with the triangles left out whose centroid has
    /// |y − 0.1| ≤ 0.05, which opens the surface and cuts it in two.
    #[test]
    fn the_values_of_scipy() {
        let spot = read(&fixtures::path("spot.ply"));
        let bob = read(&fixtures::path("bob_small.ply"));
        let keeps = |t: &&[u32; 3]| {
            let y: f64 = t.iter().map(|&v| spot.positions()[v as usize].y).sum();
            (y / 3.0 - 0.1).abs() > 0.05
        };
        let kept = spot.triangles().iter().filter(keeps).copied().collect();
        let open = TriMesh::new(spot.positions().to_vec(), kept).unwrap();
        let cases: [(&TriMesh, usize, [f64; 11]); 3] = [
            (
                &spot,
                1,
                [
                    1.59169021243,
                    4.63635109912,
                    6.73597143152,
                    8.29059418426,
                    10.7500031737,
                    10.849267976,
                    12.1063565413,
                    15.3004365103,
                    17.3950277116,
                    21.4070153387,
                    24.8445048805,
                ],
            ),
            (
                &bob,
                1,
                [
                    2.43822037527,
                    4.20625792636,
                    6.79108764719,
                    12.2258026431,
                    12.7040785045,
                    15.1896900745,
                    16.6455169908,
                    19.9520445686,
                    20.5525810965,
                    22.0344170757,
                    23.1596314391,
                ],
            ),
            (
                &open,
                2,
                [
                    0.0,
                    3.43789925984,
                    3.53527109059,
                    5.28440968385,
                    9.51252960119,
                    10.1226755612,
                    11.5346451018,
                    13.3868867809,
                    15.4471500495,
                    16.2140337532,
                    16.9850760985,
                ],
            ),
        ];
        for (mesh, parts, exact) in cases {
            let pairs = modes(mesh, 12);
            check(&pairs, 12);
            assert_eq!(pairs.report.parts, parts);
            assert!(pairs.values[..parts].iter().all(|&v| v == 0.0));
            for (found, exact) in pairs.values[1..].iter().zip(exact) {
                assert!((found - exact).abs() <= 1e-8 * exact, "{found} {exact}");
            }
        }
    }

    /// Every surface of the larger data set: small residuals, a zero per part, and no value missing,
    /// which the signs of the pivots of a shifted matrix say.
    #[test]
    fn nothing_is_missing_on_the_larger_data_set() {
        let Some(folder) = fixtures::shared_or_skip("meshes") else {
            return;
        };
        let mut files: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e != "tsv"))
            .collect();
        files.sort();
        assert!(!files.is_empty());
        for path in files {
            let mesh = read(&path);
            let (stiffness, mass) = match laplace::stiffness(&mesh) {
                Ok(stiffness) => (stiffness, laplace::lumped_mass(&mesh)),
                Err(laplace::Error::Degenerate { .. }) => {
                    let robust = laplace::robust(&mesh).unwrap();
                    (robust.stiffness, robust.mass)
                }
                Err(error) => panic!("{}: {error}", path.display()),
            };
            let options = Options {
                verify: true,
                ..Options::default()
            };
            let k = 30.min(mesh.positions().len() / 4);
            let pairs = eigenpairs(&stiffness, &mass, k, &options, Run::on(&Cpu)).unwrap();
            check(&pairs, k);
            assert_eq!(pairs.report.verified, Some(true), "{}", path.display());
            let zeros = pairs.values.iter().filter(|&&v| v == 0.0).count();
            assert_eq!(zeros, pairs.report.parts.min(k), "{}", path.display());
        }
    }
}
