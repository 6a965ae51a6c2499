//! `spectral-corresp`: a shape, its modes, a whole match.

use criterion::{Criterion, criterion_group, criterion_main};
use gauss_density::{Levels, Model, Options, sample};
use geom_core::io::structure;
use geom_core::{Cpu, Run};
use spectral_corresp::{MatchOptions, ShapeOptions, VoxelShape, correspond};

fn matching(c: &mut Criterion) {
    let mut group = c.benchmark_group("spectral-corresp");
    group.sample_size(10);
    let read = structure::read(
        fixtures::path("1hvr.pdb"),
        &structure::ReadOptions::default(),
    );
    let levels = Levels {
        decay: 0.3,
        ..Levels::default()
    };
    let model = Model::uniform(&read.expect("a fixture").structure, &levels).expect("a model");
    let options = Options {
        spacing: 1.5,
        ..Options::default()
    };
    let grid = sample(&model, &options, Run::on(&Cpu))
        .expect("a density")
        .grid;
    let make = || {
        VoxelShape::of_grid(&grid, 1.0, &ShapeOptions::default(), Run::on(&Cpu)).expect("a shape")
    };
    group.bench_function("shape, 1hvr at 1.5 Å", |b| b.iter(make));
    let shape = make();
    group.bench_function("8 modes", |b| {
        b.iter(|| shape.modes(8, Run::on(&Cpu)).expect("modes"));
    });
    let asked = MatchOptions::default();
    group.bench_function("whole match with itself", |b| {
        b.iter(|| correspond(&shape, &shape, &asked, Run::on(&Cpu)).expect("a match"));
    });
    group.finish();
}

criterion_group!(benches, matching);
criterion_main!(benches);
