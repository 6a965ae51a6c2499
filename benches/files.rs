//! Mesh and grid files: bytes written and read per second, in memory.

use std::hint::black_box;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use geom_core::io::{Encoding, Error, View, dx, glb, mrc, msh, obj, off, ply, stl, vtu};
use geom_core::mesh::shapes;
use geom_core::{Lattice, Point3, ScalarGrid};

/// How a view becomes a file in memory, and back.
type Write = fn(&mut Vec<u8>, &View<'_>) -> Result<(), Error>;
type Parse = fn(&[u8]) -> Result<View<'static>, Error>;

const V41: msh::Options = msh::Options {
    version: msh::Version::V41,
    encoding: Encoding::Binary,
};
const V22: msh::Options = msh::Options {
    version: msh::Version::V22,
    encoding: Encoding::Ascii,
};

/// Writing and reading of one file, by its size.
fn both(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: &str,
    write: impl Fn(&mut Vec<u8>),
    read: impl Fn(&[u8]),
) {
    let mut file = Vec::new();
    write(&mut file);
    group.throughput(Throughput::Bytes(file.len() as u64));
    let mut buffer = Vec::with_capacity(file.len());
    group.bench_function(format!("write/{name}"), |b| {
        b.iter(|| {
            buffer.clear();
            write(&mut buffer);
            black_box(buffer.len())
        });
    });
    group.bench_function(format!("read/{name}"), |b| {
        b.iter(|| read(black_box(&file)))
    });
}

fn meshes(c: &mut Criterion) {
    // 320 k triangles, and as many tetrahedra with their faces.
    let surface = shapes::torus(50.0, 20.0, 500, 320);
    let volume = shapes::ball_in_box(2.0, 4.0, 9);
    let surface = View::from(&surface);
    let volume = View::from(&volume);
    let surfaces: [(&str, Write, Parse); 8] = [
        ("ply", |w, v| ply::write(w, v, Encoding::Binary), ply::parse),
        (
            "ply as text",
            |w, v| ply::write(w, v, Encoding::Ascii),
            ply::parse,
        ),
        ("off", |w, v| off::write(w, v), off::parse),
        ("obj", |w, v| obj::write(w, v), obj::parse),
        ("stl", |w, v| stl::write(w, v), stl::parse),
        ("glb", |w, v| glb::write(w, v), glb::parse),
        ("vtu", |w, v| vtu::write(w, v), vtu::parse),
        ("msh", |w, v| msh::write(w, v, V41), msh::parse),
    ];
    let volumes: [(&str, Write, Parse); 3] = [
        ("vtu", |w, v| vtu::write(w, v), vtu::parse),
        ("msh", |w, v| msh::write(w, v, V41), msh::parse),
        ("msh 2.2 as text", |w, v| msh::write(w, v, V22), msh::parse),
    ];
    let inputs = [
        ("surface", &surface, &surfaces[..]),
        ("volume", &volume, &volumes[..]),
    ];
    for (kind, view, formats) in inputs {
        let mut group = c.benchmark_group(format!("files/{kind}"));
        group.sample_size(10);
        for &(name, write, parse) in formats {
            both(
                &mut group,
                name,
                |to| write(to, view).expect("memory"),
                |from| drop(black_box(parse(from).expect("our own file"))),
            );
        }
        group.finish();
    }
}

fn grids(c: &mut Criterion) {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 0.5,
        counts: [128, 128, 128],
    };
    let values = (0..lattice.len()).map(|i| (i as f32 * 1e-3).sin());
    let grid = ScalarGrid::new(lattice, values.collect()).expect("finite values");
    let mut group = c.benchmark_group("files/grid");
    group.sample_size(10);
    for mode in [mrc::Mode::Float32, mrc::Mode::Float16] {
        both(
            &mut group,
            &format!("mrc of {mode:?}"),
            |to| mrc::write(to, &grid, mode).expect("memory"),
            |from| {
                let file = mrc::parse(from).expect("our own file");
                drop(black_box(file.into_grid().expect("a cubic lattice")));
            },
        );
    }
    both(
        &mut group,
        "dx",
        |to| dx::write(to, &grid).expect("memory"),
        |from| {
            let file = dx::parse(from).expect("our own file");
            drop(black_box(file.into_grid().expect("a cubic lattice")));
        },
    );
    group.finish();
}

criterion_group!(benches, meshes, grids);
criterion_main!(benches);
