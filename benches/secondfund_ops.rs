//! `secondfund-ops`: assembly, modes, groups, pockets and a step of the flow.

use criterion::{Criterion, criterion_group, criterion_main};
use geom_core::io::structure;
use geom_core::mesh::shapes;
use geom_core::{Cpu, Run, Wgpu};
use secondfund_ops::operators::assemble;
use secondfund_ops::{
    Element, Faces, FlowOptions, Groups, Normals, OperatorBackend, PocketOptions, SegmentOptions,
    SpectrumOptions, Surface, pockets, segment, smooth_quads, spectrum,
};

fn backends() -> Vec<Box<dyn OperatorBackend>> {
    let mut all: Vec<Box<dyn OperatorBackend>> = vec![Box::new(Cpu)];
    all.extend(Wgpu::new().ok().map(|gpu| Box::new(gpu) as _));
    all
}

fn operators(c: &mut Criterion) {
    let mut group = c.benchmark_group("secondfund-ops");
    group.sample_size(10);
    let options = SpectrumOptions::default();
    let triangles = shapes::torus(1.0, 0.4, 160, 64);
    let normals = Normals::default();
    let element = Element::Triangles(&triangles, &normals);
    group.bench_function("assembly, 20k triangles", |b| {
        b.iter(|| assemble(&element, &options, Run::on(&Cpu)).expect("matrices"));
    });
    let surface = Surface::new(shapes::quad_torus(1.0, 0.4, 160, 64)).expect("a surface");
    let quads = Element::CatmullClark(&surface);
    for backend in backends() {
        let name = format!("assembly, 10k quads, {}", backend.name());
        group.bench_function(name, |b| {
            b.iter(|| assemble(&quads, &options, Run::on(&*backend)).expect("matrices"));
        });
    }
    group.bench_function("10 modes, 10k quads", |b| {
        b.iter(|| spectrum(&quads, &options, Run::on(&Cpu)).expect("modes"));
    });
    let modes = spectrum(&element, &options, Run::on(&Cpu)).expect("modes");
    let faces = Faces::from(&triangles);
    let asked = SegmentOptions {
        groups: Groups::DaviesBouldin { most: 12 },
        ..SegmentOptions::default()
    };
    group.bench_function("2 to 12 groups of 2,000 vertices", |b| {
        b.iter(|| segment(&modes, &faces, &asked, Run::on(&Cpu)).expect("segments"));
    });
    let flow = FlowOptions {
        iterations: 1,
        ..FlowOptions::default()
    };
    group.bench_function("one step of the flow, 10k quads", |b| {
        b.iter(|| smooth_quads(surface.control(), &flow, Run::on(&Cpu)).expect("a step"));
    });
    let read = structure::read(
        fixtures::path("1hvr.pdb"),
        &structure::ReadOptions::default(),
    );
    let structure = read.expect("a fixture").structure;
    group.bench_function("pockets, 1hvr", |b| {
        b.iter(|| pockets::find(&structure, &PocketOptions::default()).expect("pockets"));
    });
    group.finish();
}

criterion_group!(benches, operators);
criterion_main!(benches);
