//! T-meshes and splines on a torus: elements of two levels, their flow, extraction, samples with normals, matrices. Throughput
//! in elements (samples) per second.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geom_core::mesh::shapes;
use geom_core::testing::gpu_or_skip;
use geom_core::{Cpu, Run};
use tspline::backend::SplineBackend;
use tspline::{Basis, Extraction, QualityOptions, Surface, TMesh, TMeshOptions, analysis, improve};

/// `12 n × 8 n` quads; of half of them four may be one.
fn torus(n: u32) -> TMesh {
    let fine = shapes::quad_torus(1.0, 0.4, 12 * n, 8 * n);
    let half = |q: usize| u8::from(fine.corners(q)[0].x > 0.0);
    let allowed: Vec<u8> = (0..fine.quads().len()).map(half).collect();
    TMesh::build(&fine, &allowed, &TMeshOptions::default()).expect("a torus")
}

fn meshes(c: &mut Criterion) {
    let mut group = c.benchmark_group("tspline/mesh");
    group.sample_size(10);
    let mesh = torus(28);
    group.throughput(Throughput::Elements(mesh.elements().len() as u64));
    group.bench_function("build", |b| b.iter(|| torus(28)));
    for basis in [Basis::Hierarchical, Basis::Rational] {
        group.bench_function(BenchmarkId::new("extraction", format!("{basis:?}")), |b| {
            b.iter(|| Extraction::of(&mesh, basis).expect("a closed surface"));
        });
    }
    let ground = shapes::torus(1.0, 0.4, 144, 70);
    let small = torus(8);
    group.throughput(Throughput::Elements(small.elements().len() as u64));
    group.bench_function("improve", |b| {
        b.iter(|| {
            improve(
                small.clone(),
                &ground,
                &QualityOptions::default(),
                Run::on(&Cpu),
            )
        });
    });
    group.finish();
}

fn surfaces(c: &mut Criterion) {
    let mut group = c.benchmark_group("tspline/surface");
    group.sample_size(10);
    let surface = Surface::new(torus(28), Basis::Hierarchical, Run::on(&Cpu)).expect("a surface");
    let parameters: Vec<f64> = (0..8).map(|i| f64::from(i) / 7.0).collect();
    let patches = surface.patches().len() as u64;
    group.throughput(Throughput::Elements(64 * patches));
    let mut backends: Vec<Box<dyn SplineBackend>> = vec![Box::new(Cpu)];
    if let Some(gpu) = gpu_or_skip() {
        backends.push(Box::new(gpu));
    }
    for backend in &backends {
        group.bench_function(BenchmarkId::new("samples", backend.name()), |b| {
            b.iter(|| {
                let run = Run::on(&**backend);
                surface.sample(&parameters, run).expect("samples")
            });
        });
    }
    group.throughput(Throughput::Elements(patches));
    group.bench_function("matrices", |b| b.iter(|| analysis::matrices(&surface)));
    group.finish();
}

criterion_group!(benches, meshes, surfaces);
criterion_main!(benches);
