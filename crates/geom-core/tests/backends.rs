//! Every backend follows the specification, and the comparison can fail.

use geom_core::algebra::SparseMatrix;
use geom_core::algebra::eigen::{APPLY_BLOCK, CYCLE, Multigrid, Operator, SpectralBackend};
use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
use geom_core::mesh::shapes;
use geom_core::surface::laplace;
use geom_core::{Cpu, testing};
use proptest::prelude::*;

/// A random set of voxels, about two thirds of a box, and weights whose rows sum to at most 1.
fn voxels() -> impl Strategy<Value = VoxelGraph> {
    let size = (3usize..9, 3usize..9, 3usize..9);
    (size, 0u8..3, any::<u64>()).prop_map(|((nx, ny, nz), kind, seed)| {
        let neighbours =
            [Neighbours::Six, Neighbours::Eighteen, Neighbours::TwentySix][usize::from(kind)];
        let inside: Vec<bool> = values(nx * ny * nz, seed)
            .iter()
            .map(|&v| v > -0.3)
            .collect();
        VoxelGraph::new([nx, ny, nz], &inside, neighbours, [0.04, 0.02, 0.01]).unwrap()
    })
}

/// Numbers in −1…1.
fn values(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed | 1;
    (0..count)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f32 / (1u64 << 52) as f32 - 1.0
        })
        .collect()
}

/// Two voxel sets with links between nodes of equal number.
fn joined(a: VoxelGraph, b: VoxelGraph) -> Laplacian {
    let (first, all) = (a.nodes() as u32, (a.nodes() + b.nodes()) as u32);
    let links: Vec<(u32, u32, f64)> = (0..first.min(all - first))
        .step_by(3)
        .flat_map(|i| [(i, first + i, 0.1), (first + i, i, 0.1)])
        .collect();
    let links = SparseMatrix::from_triplets(all as usize, all as usize, &links).unwrap();
    Laplacian::joint(vec![a, b], &links).unwrap()
}

/// The product in f64: the specification.
fn exact(operator: Operator<'_>, block: &[f32], columns: usize) -> Vec<f32> {
    let wide: Vec<f64> = block.iter().map(|&x| f64::from(x)).collect();
    let product = operator.multiply(&wide, columns);
    product.into_iter().map(|y| y as f32).collect()
}

/// In units of the largest value.
fn in_units_of_the_largest(reference: &[f64], candidate: &[f32]) -> (Vec<f64>, Vec<f64>) {
    let largest = reference.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let wide = candidate.iter().map(|&x| f64::from(x) / largest).collect();
    (reference.iter().map(|x| x / largest).collect(), wide)
}

fn follows(backend: &dyn SpectralBackend, cases: u32) {
    let config = ProptestConfig::with_cases(cases);
    proptest!(config, |(a in voxels(), b in voxels(), columns in 1usize..20, seed in any::<u64>())| {
        let laplacian = joined(a, b);
        let operator = Operator::from(&laplacian);
        let block = values(laplacian.nodes() * columns, seed);
        let candidate = backend.apply_block(operator, &block, columns).unwrap();
        let reference = exact(operator, &block, columns);
        prop_assert_eq!(APPLY_BLOCK.first_break(&reference, &candidate), None);
    });
    // Sums along rows of a surface are small, too.
    let stiffness = laplace::stiffness(&shapes::torus(3.0, 1.0, 40, 17)).unwrap();
    let scaled = stiffness.map(|_, _, a| a / 16.0);
    let block = values(scaled.rows() * 7, 5);
    let candidate = backend.apply_block((&scaled).into(), &block, 7).unwrap();
    assert_eq!(
        APPLY_BLOCK.first_break(&exact((&scaled).into(), &block, 7), &candidate),
        None
    );
}

/// Voxels of a ball and of a box beside it, joined.
fn two_bodies() -> Laplacian {
    let n = 20;
    let inside: Vec<bool> = (0..n * n * n)
        .map(|at| {
            let [x, y, z] = [at % n, at / n % n, at / n / n].map(|v| v as f64 - 9.7);
            x * x + y * y + z * z < 90.0
        })
        .collect();
    let weights = [1.0, 2.0, 3.0].map(|d: f64| (-d).exp());
    let ball = VoxelGraph::new([n; 3], &inside, Neighbours::Eighteen, weights).unwrap();
    let block = vec![true; 12 * 13 * 14];
    let block = VoxelGraph::new([12, 13, 14], &block, Neighbours::TwentySix, weights).unwrap();
    joined(ball, block)
}

fn cycles_follow(backend: &dyn SpectralBackend) {
    let laplacian = two_bodies();
    let hierarchy = Multigrid::of((&laplacian).into()).unwrap();
    assert!(hierarchy.levels() >= 2);
    let cycle = backend.prepare(&hierarchy).unwrap();
    for columns in [1, 4, 6, 8, 16] {
        let mut block = values(laplacian.nodes() * columns, columns as u64);
        // Right-hand sides without a constant part, as residuals are.
        for j in 0..columns {
            let column = || block.iter().skip(j).step_by(columns);
            let mean = column().sum::<f32>() / laplacian.nodes() as f32;
            block
                .iter_mut()
                .skip(j)
                .step_by(columns)
                .for_each(|x| *x -= mean);
        }
        let wide: Vec<f64> = block.iter().map(|&x| f64::from(x)).collect();
        let reference = geom_core::algebra::eigen::exact_cycle(&hierarchy, &wide, columns);
        let candidate = cycle.run(&block, columns).unwrap();
        let (reference, mut candidate) = in_units_of_the_largest(&reference, &candidate);
        assert_eq!(CYCLE.first_break(&reference, &candidate), None);
        // The comparison can fail.
        let at = candidate.len() / 2;
        candidate[at] += 3e-3 * candidate[at].abs() + 3e-4;
        assert_eq!(
            CYCLE.first_break(&reference, &candidate).map(|b| b.index),
            Some(at)
        );
    }
}

#[test]
fn cpu_follows_the_specification() {
    follows(&Cpu, 64);
    cycles_follow(&Cpu);
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_follows_the_specification() {
    let Some(gpu) = testing::gpu_or_skip() else {
        return;
    };
    follows(&gpu, 24);
    cycles_follow(&gpu);
}

/// The same eigenvalues whichever backend proposes; and the residuals are f64 on both.
#[cfg(feature = "wgpu")]
#[test]
fn wgpu_finds_the_same_pairs() {
    use geom_core::Run;
    use geom_core::algebra::eigen::{Options, eigenpairs};
    let Some(gpu) = testing::gpu_or_skip() else {
        return;
    };
    let laplacian = two_bodies();
    let mass = laplacian.degree_mass();
    let options = Options::default();
    let on_cpu = eigenpairs(&laplacian, &mass, 6, &options, Run::on(&Cpu)).unwrap();
    let on_gpu = eigenpairs(&laplacian, &mass, 6, &options, Run::on(&gpu)).unwrap();
    assert!(on_gpu.report.backend.starts_with("wgpu"));
    for pairs in [&on_cpu, &on_gpu] {
        assert!(
            pairs.residuals.iter().all(|&r| r <= 1e-9),
            "{:?}",
            pairs.residuals
        );
    }
    for (a, b) in on_cpu.values.iter().zip(&on_gpu.values) {
        assert!((a - b).abs() <= 1e-12 * a.max(1e-3), "{a} {b}");
    }
}

#[test]
fn a_wrong_value_is_caught() {
    let laplacian = two_bodies();
    let scaled = values(laplacian.nodes() * 3, 1);
    let reference = exact((&laplacian).into(), &scaled, 3);
    let mut wrong = Cpu.apply_block((&laplacian).into(), &scaled, 3).unwrap();
    wrong[100] += 1e-3;
    assert_eq!(
        APPLY_BLOCK.first_break(&reference, &wrong).map(|b| b.index),
        Some(100)
    );
}

#[test]
fn a_block_of_other_size_is_an_error() {
    let laplacian = two_bodies();
    assert!(Cpu.apply_block((&laplacian).into(), &[0.0; 7], 2).is_err());
    let hierarchy = Multigrid::of((&laplacian).into()).unwrap();
    assert!(Cpu.prepare(&hierarchy).unwrap().run(&[0.0; 7], 2).is_err());
    let nothing = Cpu.apply_block((&laplacian).into(), &[], 0).unwrap();
    assert!(nothing.is_empty());
}
