//! Density: sampling for three sets of powers and three spacings beside brute force, the culls alone,
//! elimination, refit and low-pass filter; on the CPU, and on the GPU where there is one.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use gauss_density::testing::globule;
use gauss_density::thesis::{self, Cut};
use gauss_density::{
    DensityBackend, Elimination, Levels, LowPass, Model, Options, PointSampler, Refit, Sampled,
    eliminate, low_pass, refit, sample, sample_band,
};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::testing::gpu_or_skip;
use geom_core::{Backend, Cpu, ImplicitField, Run, ScalarGrid};

/// The powers of the thesis: residues and chains.
const SETS: [(f64, f64); 3] = [(0.5, 1.0), (0.25, 1.0), (0.05, 0.5)];

fn protein(residue_power: f64, chain_power: f64) -> Model {
    let structure = read(fixtures::path("1hvr.pdb"), &ReadOptions::default())
        .expect("a bundled file")
        .structure;
    let levels = Levels {
        residue_power,
        chain_power,
        ..Levels::default()
    };
    Model::uniform(&structure, &levels).expect("a sound structure")
}

fn backends() -> Vec<Box<dyn DensityBackend>> {
    let mut all: Vec<Box<dyn DensityBackend>> = vec![Box::new(Cpu)];
    if let Some(gpu) = gpu_or_skip() {
        all.push(Box::new(gpu));
    }
    all
}

fn sampling(c: &mut Criterion) {
    let mut group = c.benchmark_group("gauss-density/sample_band");
    group.sample_size(10);
    for (pr, pc) in SETS {
        let model = protein(pr, pc);
        for spacing in [0.25, 0.5, 1.0] {
            let options = Options {
                spacing,
                ..Options::default()
            };
            let first = sample_band(&model, &options, Run::on(&Cpu)).expect("fits");
            group.throughput(Throughput::Elements(first.report.points));
            for backend in backends() {
                // Software GPUs are for correctness; one spacing of theirs is enough.
                if backend.name() != Cpu.name() && spacing < 1.0 {
                    continue;
                }
                let id = BenchmarkId::new(backend.name(), format!("P {pr}/{pc}, {spacing} Å"));
                group.bench_function(id, |b| {
                    b.iter(|| sample_band(&model, &options, Run::on(&*backend)).expect("fits"));
                });
            }
        }
    }
    group.finish();
}

/// Every search on the same lattice, the thesis's beside ours; elements are pairs of brute force, so rates are comparable.
fn methods(c: &mut Criterion) {
    let model = protein(0.5, 1.0);
    let mut group = c.benchmark_group("gauss-density/methods");
    group.sample_size(10);
    type Search = fn(&Model, &Options) -> Result<Sampled<ScalarGrid>, gauss_density::Error>;
    let searches: [(&str, Search); 5] = [
        ("all atoms", thesis::all_atoms),
        ("single seed", |m, o| {
            thesis::single_seed(m, o, Cut::AfterPowers)
        }),
        ("k-d tree", |m, o| thesis::kd_tree(m, o, Cut::AfterPowers)),
        ("hierarchy", |m, o| {
            thesis::hierarchy(m, o, Cut::AfterPowers)
        }),
        ("blocks", |m, o| sample(m, o, Run::on(&Cpu))),
    ];
    let options = Options {
        spacing: 1.0,
        ..Options::default()
    };
    for (name, search) in searches {
        let first = search(&model, &options).expect("fits");
        group.throughput(Throughput::Elements(first.report.brute_force_pairs as u64));
        group.bench_function(name, |b| {
            b.iter(|| search(&model, &options).expect("fits"));
        });
    }
    group.finish();
}

/// The culls of a point sampler, and points.
fn points(c: &mut Criterion) {
    let model = protein(0.5, 1.0);
    let mut group = c.benchmark_group("gauss-density/points");
    group.sample_size(10);
    group.throughput(Throughput::Elements(model.atoms() as u64));
    group.bench_function("cull", |b| {
        b.iter(|| PointSampler::new(&model, gauss_density::Cutoff::default()).expect("sound"));
    });
    let sampler = PointSampler::new(&model, gauss_density::Cutoff::default()).expect("sound");
    let centers = model.centers();
    group.throughput(Throughput::Elements(centers.len() as u64));
    group.bench_function("value and gradient", |b| {
        b.iter(|| {
            centers
                .iter()
                .map(|x| sampler.value_gradient(x).0)
                .sum::<f64>()
        });
    });
    group.finish();
}

fn reduction(c: &mut Criterion) {
    let model = protein(0.5, 1.0);
    let mut group = c.benchmark_group("gauss-density/reduction");
    group.sample_size(10);
    group.throughput(Throughput::Elements(model.atoms() as u64));
    let elimination = Elimination {
        spacing: 1.0,
        ..Elimination::default()
    };
    let done = eliminate(&model, &elimination, Run::on(&Cpu)).expect("atoms remain");
    let fit = Refit {
        spacing: 1.0,
        iterations: 10,
        ..Refit::default()
    };
    for backend in backends() {
        group.bench_function(BenchmarkId::new("eliminate", backend.name()), |b| {
            b.iter(|| eliminate(&model, &elimination, Run::on(&*backend)).expect("atoms remain"));
        });
        group.bench_function(BenchmarkId::new("refit, 10 steps", backend.name()), |b| {
            b.iter(|| refit(&done.model, &model, &fit, Run::on(&*backend)).expect("sound"));
        });
    }
    let options = Options {
        spacing: 0.5,
        margin: Some(8.0),
        ..Options::default()
    };
    let grid = sample(&model, &options, Run::on(&Cpu)).expect("fits").grid;
    group.throughput(Throughput::Elements(grid.values().len() as u64));
    group.bench_function("low-pass", |b| {
        b.iter(|| low_pass(&grid, &LowPass::default()).expect("fits"));
    });
    group.finish();
}

/// From 1 to 4 threads, on a generated structure of 35,000 atoms.
fn threads(c: &mut Criterion) {
    let structure = globule(10, 500, 1);
    let model = Model::uniform(&structure, &Levels::default()).expect("sound");
    let options = Options {
        spacing: 0.6,
        ..Options::default()
    };
    let mut group = c.benchmark_group("gauss-density/threads");
    group.sample_size(10);
    for threads in [1, 2, 4] {
        let pool = rayon_pool(threads);
        group.bench_function(format!("{threads}"), |b| {
            b.iter(|| pool.install(|| sample_band(&model, &options, Run::on(&Cpu)).expect("fits")));
        });
    }
    group.finish();
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads")
}

criterion_group!(benches, sampling, methods, points, reduction, threads);
criterion_main!(benches);
