//! Values and laws known in closed form: spectra of small graphs, histograms, the energy of a map.

use std::f64::consts::PI;

use geom_core::algebra::eigen::{Options, eigenpairs};
use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
use geom_core::algebra::{Mass, SparseMatrix};
use geom_core::compute::random::SplitMix64;
use geom_core::nalgebra::{Matrix3, Rotation3};
use geom_core::{Cpu, Point3, Run, Vector3};
use spectral_corresp::backend::{CorrespBackend, HistogramTask, RotationTask, SweepTask};
use spectral_corresp::fit::Neighbourhoods;

fn block(counts: [usize; 3], neighbours: Neighbours) -> VoxelGraph {
    let weights = [1.0, 2.0, 3.0].map(|d: f64| (-d).exp());
    let inside = vec![true; counts.iter().product()];
    VoxelGraph::new(counts, &inside, neighbours, weights).unwrap()
}

fn spectrum(laplacian: &Laplacian, mass: &Mass) -> Vec<f64> {
    let options = Options::default();
    let run = Run::on(&Cpu);
    let pairs = eigenpairs(laplacian, mass, laplacian.nodes(), &options, run);
    pairs.unwrap().values
}

fn assert_near(found: &[f64], exact: &[f64], within: f64) {
    assert_eq!(found.len(), exact.len());
    for (f, e) in found.iter().zip(exact) {
        assert!((f - e).abs() <= within, "{found:?} {exact:?}");
    }
}

#[test]
fn small_graphs_have_the_spectra_of_the_books() {
    let of = |graph: VoxelGraph| {
        let laplacian = Laplacian::of_voxels(graph);
        spectrum(&laplacian, &laplacian.degree_mass())
    };
    assert_near(
        &of(block([3, 1, 1], Neighbours::Six)),
        &[0.0, 1.0, 2.0],
        1e-12,
    );
    // A bar: the ends have half the mass.
    let n = 40;
    let bar: Vec<f64> = (0..n)
        .map(|k| 1.0 - (PI * f64::from(k) / f64::from(n - 1)).cos())
        .collect();
    assert_near(&of(block([n as usize, 1, 1], Neighbours::Six)), &bar, 1e-12);
    let (low, high) = (2.0 / 3.0, 4.0 / 3.0);
    let faces = [0.0, low, low, low, high, high, high, 2.0];
    assert_near(&of(block([2; 3], Neighbours::Six)), &faces, 1e-12);
    let all = block([2; 3], Neighbours::TwentySix);
    assert_near(&all.degrees(), &[1.5594312; 8], 1e-7);
    let (low, high) = (0.88281, 1.29076);
    let corners = [0.0, low, low, low, high, high, high, 1.47929];
    assert_near(&of(all), &corners, 5e-6);
}

/// Two graphs with links of weight `c` between nodes of the same number.
fn linked(graph: &VoxelGraph, c: f64) -> Laplacian {
    let n = graph.nodes() as u32;
    let links: Vec<_> = (0..n)
        .flat_map(|i| [(i, n + i, c), (n + i, i, c)])
        .collect();
    let rows = 2 * n as usize;
    let links = SparseMatrix::from_triplets(rows, rows, &links).unwrap();
    Laplacian::joint(vec![graph.clone(), graph.clone()], &links).unwrap()
}

#[test]
fn linked_graphs_move_in_phase_and_against_each_other() {
    // A cycle of two edges and two links.
    let edge = VoxelGraph::new([2, 1, 1], &[true; 2], Neighbours::Six, [1.0; 3]).unwrap();
    for c in [0.3, 1.0, 2.0] {
        let joint = linked(&edge, c);
        let mut exact = [0.0, 2.0 * c / (1.0 + c), 2.0 / (1.0 + c), 2.0];
        exact.sort_by(f64::total_cmp);
        assert_near(&spectrum(&joint, &joint.degree_mass()), &exact, 1e-12);
    }
    // Two equal bodies: (D − W) f = λ (D + c) f in phase, (D − W + 2c) f = λ (D + c) f against each other.
    let body = block([7, 3, 2], Neighbours::TwentySix);
    let (n, c) = (body.nodes(), 1.0);
    let degrees = body.degrees();
    let mass = Mass::Lumped(degrees.iter().map(|d| d + c).collect());
    let in_phase = spectrum(&Laplacian::of_voxels(body.clone()), &mass);
    let stiff = |i: usize| {
        let others = body.around(i).map(move |(j, w)| (i as u32, j as u32, -w));
        others
            .chain([(i as u32, i as u32, degrees[i] + 2.0 * c)])
            .collect::<Vec<_>>()
    };
    let entries: Vec<_> = (0..n).flat_map(stiff).collect();
    let stiff = SparseMatrix::from_triplets(n, n, &entries).unwrap();
    let against = eigenpairs(&stiff, &mass, n, &Options::default(), Run::on(&Cpu)).unwrap();
    let mut exact = [in_phase.clone(), against.values.clone()].concat();
    exact.sort_by(f64::total_cmp);
    let joint = linked(&body, c);
    let found = eigenpairs(
        &joint,
        &joint.degree_mass(),
        2 * n,
        &Options::default(),
        Run::on(&Cpu),
    );
    let found = found.unwrap();
    assert_near(&found.values, &exact, 1e-8);
    // Below the first of the second kind both bodies do the same.
    let below = found
        .values
        .iter()
        .zip(&found.vectors)
        .filter(|(v, _)| **v < against.values[0] - 1e-6);
    assert!(below.clone().count() > 2);
    for (_, mode) in below {
        let (first, second) = mode.split_at(n);
        assert!(first.iter().zip(second).all(|(x, y)| (x - y).abs() < 1e-7));
    }
}

#[test]
fn bars_share_a_node_between_their_middles() {
    let one = 1000;
    let of = |points: &[[i32; 3]], places: &[u32]| {
        let task = HistogramTask {
            points,
            reach: 4,
            one,
            places,
            bars: 5,
        };
        let mut found = Vec::new();
        Cpu.histograms(&task, &mut found).unwrap();
        found
    };
    // Alone, a node goes from one bar to the next as its place grows by one.
    for step in (0..=1000).step_by(100) {
        let row = of(&[[3, 4, 5]], &[2 * one + step]);
        assert_eq!(row, [0, 0, one - step, step, 0]);
    }
    // Two steps away is near, two and a diagonal is not; the last bar's middle is the end.
    let points = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [-1, -1, -1]];
    let found = of(&points, &[0, one, 4 * one, 4 * one]);
    assert_eq!(found[..5], [one, one, 0, 0, one]);
    assert_eq!(found[5..10], [one, one, 0, 0, one]);
    assert_eq!(found[10..15], [0, one, 0, 0, one]);
    assert_eq!(found[15..], [one, 0, 0, 0, one]);
}

/// `Σ_i Σ_j |(X_i − X_j) − R_i (P_i − P_j)|²`, and the same of the edges alone.
fn energy(rest: &[Point3], now: &[Point3], near: &Neighbourhoods) -> (f64, f64) {
    let task = RotationTask { rest, now, near };
    let mut rotations = Vec::new();
    Cpu.rotations(&task, &mut rotations).unwrap();
    let (mut sum, mut size) = (0.0, 0.0);
    for (i, r) in rotations.iter().enumerate() {
        for &j in near.of(i) {
            let (e, d) = (rest[i] - rest[j as usize], now[i] - now[j as usize]);
            sum += (d - r * e).norm_squared();
            size += e.norm_squared();
        }
    }
    (sum, size)
}

fn cloud(seed: u64, flat: [f64; 3]) -> Vec<Point3> {
    let mut random = SplitMix64::new(seed);
    let mut draw = || random.symmetric() * 12.0;
    (0..60)
        .map(|_| Point3::new(draw() * flat[0], draw() * flat[1], draw() * flat[2]))
        .collect()
}

#[test]
fn the_energy_is_that_of_bending_alone() {
    let rest = cloud(5, [1.0; 3]);
    let near = Neighbourhoods::within(&rest, 9.0, 20, 1).unwrap();
    let turn = Rotation3::new(Vector3::new(0.4, -1.9, 0.7));
    let moved: Vec<Point3> = rest
        .iter()
        .map(|p| turn * p + Vector3::new(70.0, -3.0, 5.0))
        .collect();
    let (left, size) = energy(&rest, &moved, &near);
    assert!(left < 1e-20 * size, "{left} {size}");
    let mirrored: Vec<Point3> = rest.iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
    let (left, size) = energy(&rest, &mirrored, &near);
    assert!(left > 0.1 * size, "{left} {size}");
    // The step of a sweep without any pull goes against the gradient (the rotations are the best ones at each place, so
    // that they do not count): dE/dX_i = 4 n_i (X_i − its mean).
    let bent: Vec<Point3> = moved
        .iter()
        .zip(cloud(6, [0.1; 3]))
        .map(|(p, d)| p + d.coords)
        .collect();
    let task = RotationTask {
        rest: &rest,
        now: &bent,
        near: &near,
    };
    let mut rotations = Vec::new();
    Cpu.rotations(&task, &mut rotations).unwrap();
    let free = vec![0.0; rest.len()];
    let sweep = SweepTask {
        shape: task,
        rotations: &rotations,
        targets: &bent,
        pull: &free,
    };
    let mut next = Vec::new();
    Cpu.sweep(&sweep, &mut next).unwrap();
    for i in [0, 17, 42] {
        let slope = (bent[i] - next[i]) * (4.0 * near.of(i).len() as f64);
        for axis in 0..3 {
            let at = |step: f64| {
                let mut there = bent.clone();
                there[i][axis] += step;
                energy(&rest, &there, &near).0
            };
            let difference = (at(1e-4) - at(-1e-4)) / 2e-4;
            assert!(
                (difference - slope[axis]).abs() <= 1e-6 * slope.norm(),
                "{difference} {slope}"
            );
        }
    }
}

#[test]
fn every_neighbourhood_has_a_proper_rotation() {
    let pair = vec![Point3::origin(), Point3::new(1.0, 2.0, -2.0)];
    let bodies = [
        cloud(7, [1.0; 3]),
        cloud(8, [1.0, 1.0, 0.0]),
        cloud(9, [1.0, 0.0, 0.0]),
        pair,
    ];
    for (k, rest) in bodies.iter().enumerate() {
        let near = Neighbourhoods::within(rest, 30.0, 60, 1).unwrap();
        let turn = Rotation3::new(Vector3::new(-1.4, 0.3, 2.2));
        let mirrored = rest
            .iter()
            .map(|p| turn * Point3::new(p.x, -p.y, p.z))
            .collect();
        let now: [Vec<Point3>; 3] = [
            rest.iter().map(|p| turn * p).collect(),
            mirrored,
            vec![Point3::origin(); rest.len()],
        ];
        for (m, now) in now.iter().enumerate() {
            let mut found = Vec::new();
            Cpu.rotations(
                &RotationTask {
                    rest,
                    now,
                    near: &near,
                },
                &mut found,
            )
            .unwrap();
            for r in &found {
                let off = (r.transpose() * r - Matrix3::identity()).norm();
                assert!(
                    off < 1e-12 && (r.determinant() - 1.0).abs() < 1e-12,
                    "{k} {m} {r}"
                );
            }
            // A line, a plane and a pair are their own mirror images.
            let (left, size) = energy(rest, now, &near);
            let exact = m == 0 || (m == 1 && k > 0);
            assert!(!exact || left < 1e-18 * size, "{k} {m} {left}");
        }
    }
}
