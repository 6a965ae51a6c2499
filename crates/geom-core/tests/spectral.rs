//! Eigenvalues against closed forms and invariants.

use geom_core::laplace::{self, Mass};
use geom_core::mesh::shapes;
use geom_core::spectral::{EigenPairs, Options, eigenpairs};
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
        let pairs = modes(&mesh, 12);
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
