//! Graph Laplacians: the stencil against the sum over all pairs, and spectra against closed forms.

use std::f64::consts::PI;

use geom_core::algebra::SparseMatrix;
use geom_core::algebra::eigen::{EigenPairs, Method, Operator, Options, eigenpairs};
use geom_core::algebra::graph::{Error, Laplacian, Neighbours, VoxelGraph};
use geom_core::nalgebra::DMatrix;
use geom_core::surface::laplace::Mass;
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Run};
use proptest::prelude::*;

const ALL: [Neighbours; 3] = [Neighbours::Six, Neighbours::Eighteen, Neighbours::TwentySix];

fn gaussian() -> [f64; 3] {
    [1.0, 2.0, 3.0].map(|d: f64| (-d).exp())
}

fn set(counts: [usize; 3], is_inside: impl Fn([usize; 3]) -> bool) -> Vec<bool> {
    let [nx, ny, nz] = counts;
    (0..nx * ny * nz)
        .map(|at| is_inside([at % nx, at / nx % ny, at / nx / ny]))
        .collect()
}

/// A ball with bumps, without symmetry.
fn lump(n: usize) -> VoxelGraph {
    let inside = set([n; 3], |p| {
        let [x, y, z] = p.map(|v| 2.0 * v as f64 / n as f64 - 1.03);
        let bump = 0.12 * ((5.0 * x).sin() * (4.0 * y).cos() + (3.0 * z + x).sin());
        (x * x + 1.2 * y * y + 0.9 * z * z).sqrt() < 0.75 + bump
    });
    VoxelGraph::new([n; 3], &inside, Neighbours::Eighteen, gaussian()).unwrap()
}

fn pairs(laplacian: &Laplacian, mass: &Mass, k: usize, options: &Options) -> EigenPairs {
    let found = eigenpairs(laplacian, mass, k, options, Run::on(&Cpu)).unwrap();
    assert!(found.report.converged, "{:?}", found.residuals);
    assert!(
        found.residuals.iter().all(|&r| r <= 1e-9),
        "{:?}",
        found.residuals
    );
    assert!(found.values.is_sorted());
    found
}

proptest! {
    #![proptest_config(geom_core::testing::cases(48))]

    /// Neighbours are those at distance 1, √2, √3; products, degrees and rows agree with that.
    #[test]
    fn stencil_is_the_sum_over_pairs(
        nx in 1usize..6, ny in 1usize..6, nz in 1usize..6, kind in 0usize..3, seed in any::<u64>(), columns in 1usize..12,
    ) {
        let inside = set([nx, ny, nz], |[i, j, k]| (seed >> ((i * 7 + j * 13 + k * 29) % 61)) & 1 == 1);
        let weights = [0.7, 0.2, 0.1];
        let graph = VoxelGraph::new([nx, ny, nz], &inside, ALL[kind], weights).unwrap();
        let n = graph.nodes();
        prop_assert_eq!(n, inside.iter().filter(|&&i| i).count());
        let weight = |a: usize, b: usize| {
            let (p, q) = (graph.point(a), graph.point(b));
            let away = [0, 1, 2].map(|k| p[k].abs_diff(q[k]));
            let squared: usize = away.iter().map(|d| d * d).sum();
            let near = away.iter().all(|&d| d <= 1) && squared >= 1 && squared <= kind + 1;
            if near { weights[squared - 1] } else { 0.0 }
        };
        let degrees = graph.degrees();
        for (a, degree) in degrees.iter().enumerate() {
            prop_assert_eq!(graph.node(graph.point(a)), Some(a));
            let sum: f64 = (0..n).map(|b| weight(a, b)).sum();
            prop_assert!((degree - sum).abs() < 1e-12);
            let around: f64 = graph.around(a).map(|(b, w)| { assert_eq!(w, weight(a, b)); w }).sum();
            prop_assert!((around - sum).abs() < 1e-12);
        }
        prop_assert_eq!(graph.node([nx, 0, 0]), None);
        let laplacian = Laplacian::of_voxels(graph.clone());
        let block: Vec<f64> = (0..n * columns).map(|i| ((i * i) as f64 * 0.37).sin()).collect();
        let product = Operator::from(&laplacian).multiply(&block, columns);
        for a in 0..n {
            for c in 0..columns {
                let expected: f64 = (0..n)
                    .map(|b| weight(a, b) * (block[a * columns + c] - block[b * columns + c]))
                    .sum();
                prop_assert!((product[a * columns + c] - expected).abs() < 1e-12);
            }
        }
        // The same as a general graph.
        let all: Vec<(u32, u32, f64)> = (0..n)
            .flat_map(|a| (0..n).map(move |b| (a as u32, b as u32)))
            .map(|(a, b)| (a, b, weight(a as usize, b as usize)))
            .collect();
        let general = Laplacian::of_weights(&SparseMatrix::from_triplets(n, n, &all).unwrap()).unwrap();
        let other = Operator::from(&general).multiply(&block, columns);
        for (a, b) in product.iter().zip(&other) {
            prop_assert!((a - b).abs() < 1e-12);
        }
    }
}

/// A box of voxels with 6 neighbours: sums of the eigenvalues of three paths, 2 − 2 cos(π p / n).
#[test]
fn box_against_its_closed_form() {
    let counts = [24usize, 18, 11];
    let graph = VoxelGraph::new(counts, &set(counts, |_| true), Neighbours::Six, [1.0; 3]).unwrap();
    let laplacian = Laplacian::of_voxels(graph);
    let path = |p: usize, n: usize| 2.0 - 2.0 * (PI * p as f64 / n as f64).cos();
    let mut exact: Vec<f64> = (0..counts.iter().product())
        .map(|at: usize| {
            let [nx, ny, nz] = counts;
            path(at % nx, nx) + path(at / nx % ny, ny) + path(at / nx / ny, nz)
        })
        .collect();
    exact.sort_by(f64::total_cmp);
    let options = Options {
        verify: true,
        ..Options::default()
    };
    let found = pairs(&laplacian, &laplacian.mass(), 40, &options);
    assert_eq!(found.report.verified, Some(true));
    for (a, b) in found.values.iter().zip(&exact) {
        assert!((a - b).abs() <= 1e-10 * b.max(1e-2), "{a} {b}");
    }
}

/// A cube: eigenvalues of multiplicity three and six are all found.
#[test]
fn cube_has_multiple_eigenvalues() {
    let graph = VoxelGraph::new([17; 3], &[true; 17 * 17 * 17], Neighbours::Six, [1.0; 3]).unwrap();
    let laplacian = Laplacian::of_voxels(graph);
    let found = pairs(&laplacian, &laplacian.mass(), 23, &Options::default());
    let lengths: Vec<usize> = found.clusters.iter().map(|c| c.len()).collect();
    assert_eq!(lengths, [3, 3, 3, 6, 3, 3], "{:?}", found.values);
}

/// V = D^(1/2) x are the eigenvectors of 1 − D^(−1/2) W D^(−1/2), and its eigenvalues lie in 0…2.
#[test]
fn normalized_laplacian() {
    let laplacian = Laplacian::of_voxels(lump(11));
    let n = laplacian.nodes();
    let found = pairs(&laplacian, &laplacian.degree_mass(), 8, &Options::default());
    let degrees = laplacian.degrees();
    let identity: Vec<f64> = (0..n * n)
        .map(|i| f64::from(u8::from(i % (n + 1) == 0)))
        .collect();
    let k = Operator::from(&laplacian).multiply(&identity, n);
    let normalized = DMatrix::from_fn(n, n, |i, j| k[i * n + j] / (degrees[i] * degrees[j]).sqrt());
    let mut exact: Vec<f64> = normalized.symmetric_eigenvalues().iter().copied().collect();
    exact.sort_by(f64::total_cmp);
    assert!(exact[0].abs() < 1e-12 && *exact.last().unwrap() < 2.0);
    for (value, exact) in found.values.iter().zip(&exact) {
        assert!((value - exact).abs() < 1e-12, "{value} {exact}");
    }
    for (value, x) in found.values.iter().zip(&found.vectors) {
        let v = DMatrix::from_fn(n, 1, |i, _| x[i] * degrees[i].sqrt());
        assert!((v.norm() - 1.0).abs() < 1e-9);
        assert!((&normalized * &v - &v * *value).norm() < 1e-10);
    }
}

/// Large bodies by both methods: the same pairs.
#[test]
fn multigrid_agrees_with_the_factor() {
    let laplacian = Laplacian::of_voxels(lump(26));
    assert!(laplacian.nodes() > 2000);
    for mass in [laplacian.mass(), laplacian.degree_mass()] {
        let by = |method| {
            let options = Options {
                method,
                ..Options::default()
            };
            pairs(&laplacian, &mass, 12, &options)
        };
        let (auto, direct) = (by(Method::Auto), by(Method::ShiftInvert));
        assert_eq!(auto.report.factor_entries, 0);
        assert!(direct.report.factor_entries > 0);
        for (a, b) in auto.values.iter().zip(&direct.values) {
            assert!((a - b).abs() <= 1e-9 * b.max(1e-3), "{a} {b}");
        }
        for (a, b) in auto.vectors.iter().zip(&direct.vectors) {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
}

/// Three bodies: a zero each, and no mode lives on two of them. Single voxels have no degree.
#[test]
fn parts_have_a_zero_each() {
    let counts = [40, 14, 14];
    let inside = set(counts, |[i, j, k]| {
        let voxel = i == 38 && j == 7 && k == 7;
        voxel || (i < 12) || ((14..36).contains(&i) && i != 25)
    });
    let graph = VoxelGraph::new(counts, &inside, Neighbours::TwentySix, gaussian()).unwrap();
    let laplacian = Laplacian::of_voxels(graph.clone());
    let plain = pairs(&laplacian, &laplacian.mass(), 10, &Options::default());
    assert_eq!(plain.values[..4], [0.0; 4]);
    assert!(plain.values[4] > 1e-3);
    assert_eq!((plain.report.parts, plain.report.isolated), (4, 0));
    let normalized = pairs(
        &laplacian,
        &laplacian.degree_mass(),
        10,
        &Options::default(),
    );
    assert_eq!(normalized.values[..3], [0.0; 3]);
    assert_eq!(
        (normalized.report.parts, normalized.report.isolated),
        (3, 1)
    );
    let body = |node: usize| match graph.point(node)[0] {
        0..12 => 0,
        12..25 => 1,
        25..37 => 2,
        _ => 3,
    };
    for vector in plain.vectors.iter().chain(&normalized.vectors) {
        let mut on = [false; 4];
        for (node, _) in vector.iter().enumerate().filter(|&(_, &x)| x != 0.0) {
            on[body(node)] = true;
        }
        assert_eq!(on.iter().filter(|&&o| o).count(), 1);
    }
}

/// Two equal bodies that hang together by a thread: nearly equal eigenvalues, two by two.
#[test]
fn nearly_equal_eigenvalues() {
    let counts = [33, 15, 13];
    let inside = set(counts, |[i, j, k]| i != 16 || (j == 7 && k == 6));
    let graph = VoxelGraph::new(counts, &inside, Neighbours::Six, [1.0; 3]).unwrap();
    let laplacian = Laplacian::of_voxels(graph);
    let options = Options {
        verify: true,
        ..Options::default()
    };
    let found = pairs(&laplacian, &laplacian.mass(), 14, &options);
    assert_eq!(found.report.verified, Some(true));
    assert_eq!(found.report.parts, 1);
    assert_eq!(found.values[0], 0.0);
    assert!(found.values[1] > 0.0 && found.values[1] < 0.02 * found.values[2]);
    for i in (2..14).step_by(2) {
        let gap = found.values[i + 1] - found.values[i];
        assert!(gap < 0.05 * found.values[i], "{:?}", found.values);
    }
}

/// Two equal shapes with every node linked: in-phase modes (D − W) f = λ (D + c) f, anti-phase modes
/// (D − W + 2c) f = λ (D + c) f.
#[test]
fn joint_graph_of_two_equal_shapes() {
    let (graph, c) = (lump(16), 0.3);
    let n = graph.nodes();
    let links: Vec<(u32, u32, f64)> = (0..n as u32)
        .flat_map(|i| [(i, i + n as u32, c), (i + n as u32, i, c)])
        .collect();
    let links = SparseMatrix::from_triplets(2 * n, 2 * n, &links).unwrap();
    let joint = Laplacian::joint(vec![graph.clone(), graph.clone()], &links).unwrap();
    assert_eq!(joint.nodes(), 2 * n);
    let found = pairs(&joint, &joint.degree_mass(), 8, &Options::default());
    let single = Laplacian::of_voxels(graph);
    let mass = Mass::Lumped(single.degrees().iter().map(|d| d + c).collect());
    let in_phase = pairs(&single, &mass, 8, &Options::default());
    assert!(found.values[7] < 2.0 * c / 5.0);
    for (a, b) in found.values.iter().zip(&in_phase.values) {
        assert!((a - b).abs() <= 1e-9 * b.max(1e-3), "{a} {b}");
    }
    for vector in &found.vectors {
        assert!((0..n).all(|i| (vector[i] - vector[n + i]).abs() < 1e-7));
    }
}

#[test]
fn bad_input_is_named() {
    let new = |inside: &[bool], weights| {
        VoxelGraph::new([2, 2, 2], inside, Neighbours::Eighteen, weights)
    };
    assert_eq!(
        new(&[true; 7], [1.0; 3]).unwrap_err(),
        Error::Flags {
            found: 7,
            expected: 8
        }
    );
    let negative = new(&[true; 8], [1.0, -2.0, f64::NAN]).unwrap_err();
    assert_eq!(
        negative,
        Error::Weight {
            from: 0,
            to: 1,
            weight: -2.0
        }
    );
    let graph = new(&[true; 8], [1.0, 0.5, f64::NAN]).unwrap(); // corners are not in use
    let links = SparseMatrix::from_triplets(3, 3, &[]).unwrap();
    let error = Laplacian::joint(vec![graph], &links).unwrap_err();
    assert_eq!(
        error,
        Error::Links {
            found: 3,
            expected: 8
        }
    );
    let weights = SparseMatrix::from_triplets(3, 3, &[(0, 1, -1.0), (1, 0, -1.0)]).unwrap();
    let error = Laplacian::of_weights(&weights).unwrap_err();
    assert_eq!(
        error,
        Error::Weight {
            from: 0,
            to: 1,
            weight: -1.0
        }
    );
    let one_way = SparseMatrix::from_triplets(3, 3, &[(0, 1, 1.0)]).unwrap();
    assert!(matches!(
        Laplacian::of_weights(&one_way),
        Err(Error::Matrix(_))
    ));
    let huge = VoxelGraph::new([usize::MAX; 3], &[], Neighbours::Six, [1.0; 3]);
    assert!(matches!(huge, Err(Error::Flags { .. })));
    let none = VoxelGraph::new([4, 4, 4], &[false; 64], Neighbours::Six, [1.0; 3]).unwrap();
    let laplacian = Laplacian::of_voxels(none);
    assert_eq!(laplacian.nodes(), 0);
    assert!(
        pairs(&laplacian, &laplacian.mass(), 5, &Options::default())
            .values
            .is_empty()
    );
}

#[test]
fn bits_do_not_depend_on_threads() {
    let laplacian = Laplacian::of_voxels(lump(22));
    same_on_any_threads(|| {
        let found = pairs(&laplacian, &laplacian.degree_mass(), 6, &Options::default());
        (found.values, found.vectors)
    });
}
