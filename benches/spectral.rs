//! The spectral base: operators, factors, eigenpairs of surfaces and of voxel graphs, and the block
//! products on each backend.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geom_core::algebra::eigen::backend::{Multigrid, SpectralBackend};
use geom_core::algebra::eigen::{Options, eigenpairs};
use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
use geom_core::algebra::{SparseMatrix, Symbolic};
use geom_core::mesh::shapes;
use geom_core::surface::laplace::{self, EdgeWeights};
use geom_core::testing::gpu_or_skip;
use geom_core::{Cpu, Run, TriMesh};

/// A torus of 20 000 vertices.
fn surface() -> TriMesh {
    shapes::torus(3.0, 1.3, 200, 100)
}

/// A ball of about 34 000 voxels.
fn body() -> Laplacian {
    let n = 42;
    let inside: Vec<bool> = (0..n * n * n)
        .map(|at: usize| {
            let [x, y, z] = [at % n, at / n % n, at / n / n].map(|v| v as f64 - 20.3);
            x * x + 1.1 * y * y + 0.9 * z * z < 400.0
        })
        .collect();
    let weights = [1.0, 2.0, 3.0].map(|d: f64| (-d).exp());
    let graph = VoxelGraph::new([n; 3], &inside, Neighbours::Eighteen, weights);
    Laplacian::of_voxels(graph.expect("a ball"))
}

fn operators(c: &mut Criterion) {
    let mesh = surface();
    let mut group = c.benchmark_group("spectral/operators");
    group.throughput(Throughput::Elements(mesh.triangles().len() as u64));
    group.bench_function("stiffness", |b| {
        b.iter(|| laplace::stiffness(black_box(&mesh)))
    });
    group.bench_function("robust", |b| b.iter(|| laplace::robust(black_box(&mesh))));
    group.bench_function("connection", |b| {
        b.iter(|| laplace::connection(black_box(&mesh), 4, EdgeWeights::One));
    });
    group.finish();
}

fn factors(c: &mut Criterion) {
    let mesh = surface();
    let stiffness = laplace::stiffness(&mesh).expect("a torus");
    let one = SparseMatrix::diagonal_of(&vec![1e-3; stiffness.rows()]);
    let matrix = stiffness.plus(1.0, &one).expect("equal sizes");
    let symbolic = Symbolic::of(&matrix).expect("a pattern");
    let factor = symbolic.factor(&matrix).expect("positive definite");
    let mut group = c.benchmark_group("spectral/factor");
    group.sample_size(20);
    group.throughput(Throughput::Elements(matrix.rows() as u64));
    group.bench_function("symbolic", |b| b.iter(|| Symbolic::of(black_box(&matrix))));
    group.bench_function("numeric", |b| {
        b.iter(|| symbolic.factor(black_box(&matrix)))
    });
    for columns in [1, 8, 32] {
        let mut block = vec![1.0; matrix.rows() * columns];
        group.bench_function(BenchmarkId::new("solve", columns), |b| {
            b.iter(|| factor.solve_in_place(black_box(&mut block), columns));
        });
    }
    group.finish();
}

fn pairs(c: &mut Criterion) {
    let mesh = surface();
    let stiffness = laplace::stiffness(&mesh).expect("a torus");
    let mass = laplace::lumped_mass(&mesh);
    let laplacian = body();
    let degrees = laplacian.degree_mass();
    let mut group = c.benchmark_group("spectral/eigenpairs");
    group.sample_size(10);
    let options = Options::default();
    for k in [10, 50] {
        group.bench_function(BenchmarkId::new("surface", k), |b| {
            b.iter(|| eigenpairs(&stiffness, &mass, k, &options, Run::on(&Cpu)));
        });
    }
    group.bench_function(BenchmarkId::new("voxels", 10), |b| {
        b.iter(|| eigenpairs(&laplacian, &degrees, 10, &options, Run::on(&Cpu)));
    });
    group.finish();
}

fn products(c: &mut Criterion) {
    let laplacian = body();
    let hierarchy = Multigrid::of((&laplacian).into()).expect("a connected graph");
    let columns = 8;
    let block = vec![1.0f32; laplacian.nodes() * columns];
    let mut group = c.benchmark_group("spectral/products");
    group.sample_size(20);
    group.throughput(Throughput::Elements(block.len() as u64));
    group.bench_function("hierarchy", |b| {
        b.iter(|| Multigrid::of((&laplacian).into()))
    });
    let mut time = |backend: &dyn SpectralBackend| {
        let name = backend.name();
        let cycle = backend.prepare(&hierarchy).expect("room for the hierarchy");
        group.bench_function(BenchmarkId::new("cycle", &name), |b| {
            let mut out = Vec::new();
            b.iter(|| cycle.run(black_box(&block), columns, &mut out));
        });
    };
    time(&Cpu);
    if let Some(gpu) = gpu_or_skip() {
        time(&gpu);
    }
    group.finish();
}

criterion_group!(benches, operators, factors, pairs, products);
criterion_main!(benches);
