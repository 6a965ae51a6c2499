//! Quality: measuring, one smoothing sweep, one pass with its operations, and the whole improvement of
//! meshes of 10⁵ and 10⁶ tetrahedra by both meshers; on 1, 2 and 4 threads, and on the GPU where there
//! is one. Throughput in tetrahedra per second.

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dual_contour::{Method, volume};
use gauss_density::{Cutoff, Model, PointSampler, sample};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::testing::gpu_or_skip;
use geom_core::{Cpu, Run, TetMesh};
use tet_quality::testing::{lattice, relaxation, shaken};
use tet_quality::{Options, QualityBackend, improve};

/// Runs on a pool of that many threads.
fn on<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a thread pool")
        .install(f)
}

fn backends() -> Vec<Box<dyn QualityBackend>> {
    let mut all: Vec<Box<dyn QualityBackend>> = vec![Box::new(Cpu)];
    if let Some(gpu) = gpu_or_skip() {
        all.push(Box::new(gpu));
    }
    all
}

/// 6 n³ tetrahedra, none of them good.
fn noisy(n: usize) -> TetMesh {
    shaken(lattice([n; 3], 1.0, |_| 1), 0.25, 1)
}

fn measuring(c: &mut Criterion) {
    let mut group = c.benchmark_group("tet-quality/measure");
    group.sample_size(20);
    let mesh = noisy(55);
    group.throughput(Throughput::Elements(mesh.tets().len() as u64));
    for backend in backends() {
        let name = backend.name();
        group.bench_function(BenchmarkId::new(name, "1 M"), |b| {
            b.iter(|| {
                backend
                    .measure(mesh.positions(), mesh.tets())
                    .expect("fits")
            });
        });
    }
    group.bench_function("cpu, 1 thread/1 M", |b| {
        on(1, || {
            b.iter(|| Cpu.measure(mesh.positions(), mesh.tets()).expect("fits"));
        });
    });
    group.bench_function("cpu, 1 thread, memory used again/1 M", |b| {
        let mut out = Vec::new();
        on(1, || {
            b.iter(|| {
                Cpu.measure_into(mesh.positions(), mesh.tets(), &mut out)
                    .expect("fits");
                out.len()
            });
        });
    });
}

fn smoothing(c: &mut Criterion) {
    let mut group = c.benchmark_group("tet-quality/relax, 7 rounds");
    group.sample_size(10);
    let mesh = noisy(26);
    let task = relaxation(&mesh, 7);
    group.throughput(Throughput::Elements(mesh.tets().len() as u64));
    for backend in backends() {
        let name = backend.name();
        group.bench_function(BenchmarkId::new(name, "0.1 M"), |b| {
            b.iter(|| backend.relax(&task).expect("fits"));
        });
    }
    for threads in [1, 2, 4] {
        group.bench_function(format!("cpu, {threads} threads/0.1 M"), |b| {
            on(threads, || b.iter(|| Cpu.relax(&task).expect("fits")));
        });
    }
}

fn improving(c: &mut Criterion) {
    let structure = read(fixtures::path("1hvr.pdb"), &ReadOptions::default())
        .expect("a bundled file")
        .structure;
    let model = Model::uniform(&structure, &Default::default()).expect("a sound structure");
    let field = PointSampler::new(&model, Cutoff::default()).expect("a sound model");
    let mut group = c.benchmark_group("tet-quality/improve");
    group.sample_size(10);
    for (method, spacings) in [
        (Method::Stuffing, [1.2, 0.55]),
        (Method::DualContour, [1.0, 0.45]),
    ] {
        for spacing in spacings {
            let density = gauss_density::Options {
                spacing,
                ..Default::default()
            };
            let grid = sample(&model, &density, Run::on(&Cpu)).expect("fits").grid;
            let contour = dual_contour::Options {
                method,
                ..Default::default()
            };
            let mesh = volume(&grid, Some(&field), &contour, Run::on(&Cpu))
                .expect("a surface")
                .mesh;
            let tets = mesh.tets().len();
            group.throughput(Throughput::Elements(tets as u64));
            for (what, passes) in [("one pass", 1), ("whole", Options::default().passes)] {
                let options = Options {
                    passes,
                    spacing: Some(spacing),
                    ..Options::default()
                };
                let id = BenchmarkId::new(format!("{method:?}, {what}"), tets);
                group.bench_function(id, |b| {
                    b.iter_batched(
                        || mesh.clone(),
                        |mesh| improve(mesh, Some(&field), &options, Run::on(&Cpu)).expect("sound"),
                        BatchSize::LargeInput,
                    );
                });
            }
        }
    }
}

criterion_group!(benches, measuring, smoothing, improving);
criterion_main!(benches);
