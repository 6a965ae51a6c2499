//! Cross fields, integer-grid maps, and whole quadrangulations of a torus and of a bundled mesh; the kernel of improvement on
//! each backend. Throughput in triangles (corners) per second.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use crossfield::field::Frames;
use crossfield::map::{MapOptions, Spacing, parameterize};
use crossfield::{FieldOptions, Options, cross_field, quadrangulate};
use geom_core::mesh::shapes;
use geom_core::surface::flow::{Corner, CornerBackend};
use geom_core::surface::laplace::EdgeWeights;
use geom_core::testing::gpu_or_skip;
use geom_core::{Cpu, Run, TriMesh, Vector3, io};

fn backends() -> Vec<Box<dyn CornerBackend>> {
    let mut all: Vec<Box<dyn CornerBackend>> = vec![Box::new(Cpu)];
    if let Some(gpu) = gpu_or_skip() {
        all.push(Box::new(gpu));
    }
    all
}

fn surfaces() -> [(&'static str, TriMesh); 2] {
    let spot = io::mesh::read(fixtures::path("spot.ply")).expect("a fixture");
    [
        ("spot", spot.mesh.into_triangles()),
        ("torus 20 k", shapes::torus(1.0, 0.4, 144, 70)),
    ]
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("crossfield/steps");
    group.sample_size(10);
    for (name, mesh) in surfaces() {
        group.throughput(Throughput::Elements(mesh.triangles().len() as u64));
        let side = (3.0 * mesh.area() / mesh.triangles().len() as f64).sqrt();
        let options = FieldOptions {
            smoothing: side,
            ..FieldOptions::default()
        };
        group.bench_function(BenchmarkId::new("field", name), |b| {
            b.iter(|| cross_field(&mesh, &[], &options, Run::on(&Cpu)).expect("a closed surface"));
        });
        let frames = Frames::of(&mesh, EdgeWeights::One).expect("a closed surface");
        let field = cross_field(&mesh, &[], &options, Run::on(&Cpu)).expect("a closed surface");
        let map = MapOptions {
            spacing: Spacing::Uniform(side),
            lines: Vec::new(),
        };
        group.bench_function(BenchmarkId::new("map", name), |b| {
            b.iter(|| parameterize(&mesh, &frames, &field, &map, Run::on(&Cpu)));
        });
        group.bench_function(BenchmarkId::new("whole", name), |b| {
            b.iter(|| quadrangulate(&mesh, &Options::default(), Run::on(&Cpu)).expect("a ladder"));
        });
    }
    group.finish();
}

fn kernels(c: &mut Criterion) {
    let mut group = c.benchmark_group("geom-core/corner_distortion");
    let corners: Vec<Corner> = (0..200_000)
        .map(|i| {
            let off = f64::from(i % 997) / 997.0;
            Corner {
                sides: [
                    Vector3::new(1.0, 0.3 * off, 0.0),
                    Vector3::new(-0.5 * off, 1.0, 0.1),
                ],
                normal: Vector3::z(),
            }
        })
        .collect();
    group.throughput(Throughput::Elements(corners.len() as u64));
    let mut out = Vec::new();
    for backend in backends() {
        group.bench_function(backend.name(), |b| {
            b.iter(|| {
                backend
                    .corner_distortion(&corners, 0.0, &mut out)
                    .expect("fits")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, steps, kernels);
criterion_main!(benches);
