//! Surfaces: closest points, neighbours, distances, curvature, isolines, repair and remeshing, in
//! queries, vertices or triangles per second.

use std::hint::black_box;

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geom_core::compute::coloring::Coloring;
use geom_core::mesh::TriangleReport;
use geom_core::mesh::shapes;
use geom_core::search::bvh::TriangleTree;
use geom_core::search::nearest::PointTree;
use geom_core::surface::curvature;
use geom_core::surface::distance::{Graph, Heat, HeatOptions, shortest_paths};
use geom_core::surface::isoline;
use geom_core::surface::remesh::{Options, Sizing, remesh};
use geom_core::surface::repair;
use geom_core::{Cpu, Point3, Run, TriMesh};

/// A sphere with bumps of about ten edges, so that nothing is as regular as on a sphere.
fn bumpy(levels: u32) -> TriMesh {
    let (mut positions, triangles) = shapes::icosphere(10.0, levels).into_parts();
    for p in &mut positions {
        let bump = (0.9 * p.x).sin() * (1.1 * p.y).sin() * (1.3 * p.z).cos();
        p.coords *= 1.0 + 0.05 * bump;
    }
    TriMesh::new(positions, triangles).expect("finite")
}

/// Points around the mesh, near and far.
fn queries(mesh: &TriMesh, count: usize) -> Vec<Point3> {
    let p = mesh.positions();
    (0..count)
        .map(|i| {
            let t = i as f64;
            p[i * 7919 % p.len()] * (1.0 + 0.3 * (0.7 * t).sin() * (0.013 * t).cos())
        })
        .collect()
}

fn points(c: &mut Criterion) {
    let mesh = bumpy(6);
    let queries = queries(&mesh, 100_000);
    let coordinates: Vec<[f64; 3]> = queries.iter().map(|p| [p.x, p.y, p.z]).collect();
    let mut group = c.benchmark_group("surfaces/points");
    group.sample_size(10);
    group.throughput(Throughput::Elements(mesh.triangles().len() as u64));
    group.bench_function("triangle tree", |b| {
        b.iter(|| TriangleTree::new(black_box(&mesh)).expect("triangles"));
    });
    group.throughput(Throughput::Elements(mesh.positions().len() as u64));
    group.bench_function("point tree", |b| {
        b.iter(|| PointTree::of_positions(black_box(mesh.positions())).expect("points"));
    });
    group.throughput(Throughput::Elements(queries.len() as u64));
    let tree = TriangleTree::new(&mesh).expect("triangles");
    group.bench_function("closest points", |b| {
        b.iter(|| tree.closest_to_all(black_box(&queries)).expect("finite"));
    });
    let tree = PointTree::of_positions(mesh.positions()).expect("points");
    for count in [1, 8] {
        let near = || tree.nearest_to_all(black_box(&coordinates), count);
        group.bench_function(BenchmarkId::new("neighbours", count), |b| b.iter(near));
    }
    group.finish();
}

fn fields(c: &mut Criterion) {
    let mesh = bumpy(6);
    let mut group = c.benchmark_group("surfaces/vertices");
    group.sample_size(10);
    group.throughput(Throughput::Elements(mesh.positions().len() as u64));
    group.bench_function("principal curvatures", |b| {
        b.iter(|| curvature::principal(black_box(&mesh), 2));
    });
    group.bench_function("angle defects", |b| {
        b.iter(|| curvature::angle_defects(black_box(&mesh)));
    });
    let graph = Graph::of_edges(&mesh).expect("finite");
    group.bench_function("shortest paths", |b| {
        b.iter(|| shortest_paths(black_box(&graph), &[(0, 0.0)], f64::INFINITY).expect("a node"));
    });
    group.bench_function("coloring", |b| {
        b.iter(|| Coloring::greedy(graph.len(), |v| graph.links(v).iter().map(|link| link.0)));
    });
    let options = HeatOptions::default();
    group.bench_function("heat, factors", |b| {
        b.iter(|| Heat::new(black_box(&mesh), &options).expect("good triangles"));
    });
    let heat = Heat::new(&mesh, &options).expect("good triangles");
    for count in [1, 16] {
        let sets: Vec<[u32; 1]> = (0..count).map(|i| [100 * i]).collect();
        group.throughput(Throughput::Elements(
            mesh.positions().len() as u64 * u64::from(count),
        ));
        let distances = || heat.from_each(black_box(&sets));
        group.bench_function(BenchmarkId::new("heat, sources", count), |b| {
            b.iter(distances)
        });
    }
    let values: Vec<f64> = mesh.positions().iter().map(|p| p.z).collect();
    let levels: Vec<f64> = (-9..10).map(f64::from).collect();
    group.throughput(Throughput::Elements(
        mesh.triangles().len() as u64 * levels.len() as u64,
    ));
    group.bench_function("isolines, 19 levels", |b| {
        b.iter(|| isoline::isolines(black_box(&mesh), &values, &levels).expect("finite"));
    });
    group.finish();
}

fn meshes(c: &mut Criterion) {
    let mesh = bumpy(6);
    let mut group = c.benchmark_group("surfaces/triangles");
    group.sample_size(10);
    group.throughput(Throughput::Elements(mesh.triangles().len() as u64));
    group.bench_function("quality report", |b| {
        b.iter(|| TriangleReport::of(black_box(&mesh)));
    });
    // As an STL file would hold it.
    let corners = (0..mesh.triangles().len())
        .flat_map(|t| mesh.corners(t))
        .collect();
    let loose = (0..mesh.triangles().len() as u32)
        .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
        .collect();
    let soup = TriMesh::new(corners, loose).expect("finite");
    let options = repair::Options::default();
    group.bench_function("repair", |b| {
        b.iter_batched(
            || soup.clone(),
            |soup| repair::repair(soup, &options).expect("two sides"),
            BatchSize::LargeInput,
        );
    });
    let mean = TriangleReport::of(&mesh).mean_edge;
    let uniform = |factor: f64| Sizing::Uniform {
        edge_length: Some(factor * mean),
    };
    let sizings = [
        ("same edges", uniform(1.0)),
        ("half as long", uniform(0.5)),
        ("twice as long", uniform(2.0)),
        (
            "by curvature",
            Sizing::Curvature {
                tolerance: 0.01,
                min_edge: 0.5 * mean,
                max_edge: 4.0 * mean,
                gradation: 0.3,
            },
        ),
    ];
    for (name, sizing) in sizings {
        let options = Options {
            sizing,
            ..Options::default()
        };
        let run = Run::on(&Cpu);
        let made = remesh(mesh.clone(), None, &options, run).expect("a manifold");
        group.throughput(Throughput::Elements(made.mesh.triangles().len() as u64));
        group.bench_function(BenchmarkId::new("remesh", name), |b| {
            b.iter_batched(
                || mesh.clone(),
                |mesh| remesh(mesh, None, &options, run).expect("a manifold"),
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

criterion_group!(benches, points, fields, meshes);
criterion_main!(benches);
