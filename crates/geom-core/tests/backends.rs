//! Every backend follows the specification, and the comparison can fail.

use geom_core::algebra::SparseMatrix;
use geom_core::algebra::eigen::backend::{CYCLE, Cycle, Multigrid, SpectralBackend};
use geom_core::algebra::eigen::{Error, Options, eigenpairs};
use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
use geom_core::compute::BackendError;
use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::surface::laplace;
use geom_core::{Backend, Cpu, Run, specification};
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
    let mut random = SplitMix64::new(seed);
    (0..count).map(|_| random.symmetric() as f32).collect()
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

/// In units of the largest value.
fn in_units_of_the_largest(reference: &[f64], candidate: &[f32]) -> (Vec<f64>, Vec<f64>) {
    let largest = reference.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let wide = candidate.iter().map(|&x| f64::from(x) / largest).collect();
    (reference.iter().map(|x| x / largest).collect(), wide)
}

/// A cycle in f64 and by the backend, for a hierarchy and some columns, in units of the largest value.
fn cycles(
    backend: &dyn SpectralBackend,
    hierarchy: &Multigrid<'_>,
    columns: usize,
    seed: u64,
) -> (Vec<f64>, Vec<f64>) {
    let mut block = values(hierarchy.rows() * columns, seed);
    // Right-hand sides without a constant part, as residuals are.
    for j in 0..columns {
        let column = || block.iter().skip(j).step_by(columns);
        let mean = column().sum::<f32>() / hierarchy.rows() as f32;
        let column = block.iter_mut().skip(j).step_by(columns);
        column.for_each(|x| *x -= mean);
    }
    let wide: Vec<f64> = block.iter().map(|&x| f64::from(x)).collect();
    let reference = specification::cycle(hierarchy, &wide, columns);
    // What stood there before is replaced.
    let mut candidate = vec![f32::NAN; 3];
    let cycle = backend.prepare(hierarchy).unwrap();
    cycle.run(&block, columns, &mut candidate).unwrap();
    in_units_of_the_largest(&reference, &candidate)
}

/// Of sets of voxels, whose levels are few and small, and of a surface.
fn follows(backend: &dyn SpectralBackend, cases: u32) {
    // The same cases every time: a gate must not depend on luck.
    let config = ProptestConfig {
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(0x0b10_9e05),
        ..ProptestConfig::with_cases(cases)
    };
    proptest!(config, |(a in voxels(), b in voxels(), columns in 1usize..20, seed in any::<u64>())| {
        let laplacian = joined(a, b);
        // An isolated node has no diagonal to smooth with: it is no connected part.
        prop_assume!(laplacian.degrees().iter().all(|&d| d > 0.0));
        let hierarchy = Multigrid::of((&laplacian).into()).unwrap();
        let (reference, candidate) = cycles(backend, &hierarchy, columns, seed);
        prop_assert_eq!(CYCLE.first_break(&reference, &candidate), None);
    });
    let stiffness = laplace::stiffness(&shapes::torus(3.0, 1.0, 40, 17)).unwrap();
    let hierarchy = Multigrid::of((&stiffness).into()).unwrap();
    assert!(!hierarchy.levels().is_empty());
    let (reference, candidate) = cycles(backend, &hierarchy, 7, 5);
    assert_eq!(CYCLE.first_break(&reference, &candidate), None);
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
    assert!(!hierarchy.levels().is_empty());
    for columns in [1, 4, 6, 8, 16] {
        let (reference, mut candidate) = cycles(backend, &hierarchy, columns, columns as u64);
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
    let Some(gpu) = geom_core::testing::gpu_or_skip() else {
        return;
    };
    follows(&gpu, 24);
    cycles_follow(&gpu);
}

/// The same eigenvalues whichever backend proposes; and the residuals are f64 on both.
#[cfg(feature = "wgpu")]
#[test]
fn wgpu_finds_the_same_pairs() {
    let Some(gpu) = geom_core::testing::gpu_or_skip() else {
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
fn a_block_of_other_size_is_an_error() {
    let laplacian = two_bodies();
    let hierarchy = Multigrid::of((&laplacian).into()).unwrap();
    let cycle = Cpu.prepare(&hierarchy).unwrap();
    let mut out = vec![1.0];
    assert!(cycle.run(&[0.0; 7], 2, &mut out).is_err());
    cycle.run(&[], 0, &mut out).unwrap();
    assert!(out.is_empty());
}

/// A backend that fails where it gets ready, or in its cycles.
enum Odd {
    NotReady,
    /// What it makes of the values of a cycle, or why there are none.
    Cycle(fn(&mut Vec<f32>) -> Result<(), Error>),
}

impl Backend for Odd {
    fn name(&self) -> String {
        "odd".to_owned()
    }
}

impl SpectralBackend for Odd {
    fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, Error> {
        match *self {
            Self::NotReady => Err(BackendError::new("no such device").into()),
            Self::Cycle(spoil) => Ok(Box::new(OddCycle(hierarchy, spoil))),
        }
    }
}

struct OddCycle<'a>(&'a Multigrid<'a>, fn(&mut Vec<f32>) -> Result<(), Error>);

impl Cycle for OddCycle<'_> {
    fn run(&self, block: &[f32], columns: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        self.0.run(block, columns, out)?;
        (self.1)(out)
    }
}

/// What a backend fails of reaches the caller, and answers that make no sense are its failure too.
#[test]
fn what_a_backend_fails_of_reaches_the_caller() {
    let laplacian = two_bodies();
    let mass = laplacian.mass();
    let solved = |backend: &Odd| {
        let options = Options::default();
        eigenpairs(&laplacian, &mass, 4, &options, Run::on(backend))
    };
    let error = solved(&Odd::NotReady).unwrap_err();
    assert_eq!(error, Error::Backend(BackendError::new("no such device")));
    assert_eq!(error.to_string(), "no such device");
    let lost = Odd::Cycle(|_| Err(BackendError::new("device lost").into()));
    assert_eq!(solved(&lost).unwrap_err().to_string(), "device lost");
    let short = Odd::Cycle(|values| {
        values.pop();
        Ok(())
    });
    let long = Odd::Cycle(|values| {
        values.push(0.0);
        Ok(())
    });
    let nan = Odd::Cycle(|values| {
        values[3] = f32::NAN;
        Ok(())
    });
    for backend in [short, long, nan] {
        let error = solved(&backend).unwrap_err();
        assert!(matches!(error, Error::Backend(_)), "{error}");
        assert!(error.to_string().starts_with("odd gave"), "{error}");
    }
    // Zeros are numbers, and of no use: random directions take their place, which converge hardly, and the
    // report says so.
    let zeros = Odd::Cycle(|values| {
        values.fill(0.0);
        Ok(())
    });
    let pairs = solved(&zeros).unwrap();
    assert!(!pairs.report.converged);
    assert!(
        pairs.residuals.iter().any(|&r| r > 1e-3),
        "{:?}",
        pairs.residuals
    );
}

#[test]
fn multigrid_refuses_a_shift() {
    let laplacian = two_bodies();
    let mass = laplacian.mass();
    let shifted = Options {
        shift: Some(-0.1),
        ..Options::default()
    };
    let error = eigenpairs(&laplacian, &mass, 4, &shifted, Run::on(&Cpu)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "option shift is -0.1; it must be left out: multigrid has no shift"
    );
}
