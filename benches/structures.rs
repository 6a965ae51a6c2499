//! Structure files: what reading and copying them costs, in bytes and in atoms per second.

use std::hint::black_box;
use std::path::PathBuf;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use geom_core::io::structure::{Format, ReadOptions, parse, read};
use geom_core::io::{pqr, read_bytes};
use geom_core::structure::Selector;

/// Everything that stands in the file.
fn everything() -> ReadOptions {
    ReadOptions {
        waters: true,
        ..Default::default()
    }
}

/// Fixtures, and the largest entry of each format where the larger data set is at hand.
fn inputs() -> Vec<PathBuf> {
    let fixtures = ["1hvr.pdb", "1A8O.cif"].map(fixtures::path);
    let large = ["large/4v8r_h36.pdb.gz", "large/6zu5.cif.gz"].map(fixtures::shared_or_skip);
    fixtures
        .into_iter()
        .chain(large.into_iter().flatten())
        .collect()
}

/// Parsing decompressed bytes: once measured in bytes, once in atoms.
fn parsing(c: &mut Criterion) {
    let mut contents = Vec::new();
    for path in inputs() {
        let content = read_bytes(&path).expect("a file");
        let format = Format::detect(&content, Some(&path)).expect("a structure");
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        contents.push((name.into_owned(), format, content));
    }
    let (_, format, pdb) = &contents[0];
    let structure = parse(pdb, *format, &everything())
        .expect("a structure")
        .structure;
    let mut text = Vec::new();
    pqr::write(&structure, &mut text).expect("memory");
    contents.push(("1hvr.pqr".to_owned(), Format::Pqr, text));

    let options = everything();
    for (unit, by_bytes) in [("bytes", true), ("atoms", false)] {
        let mut group = c.benchmark_group(format!("structures/parse/{unit}"));
        group.sample_size(10);
        for (name, format, content) in &contents {
            let read = parse(content, *format, &options).expect("a structure");
            group.throughput(match by_bytes {
                true => Throughput::Bytes(content.len() as u64),
                false => Throughput::Elements(read.report.atoms_read as u64),
            });
            group.bench_function(name, |b| {
                b.iter(|| parse(black_box(content), *format, &options).expect("a structure"));
            });
        }
        group.finish();
    }
}

/// Copies by operators and selections among them.
fn assemblies(c: &mut Criterion) {
    let mut group = c.benchmark_group("structures/assembly");
    group.sample_size(10);
    let one = ReadOptions {
        assembly: Some("1".to_owned()),
        ..Default::default()
    };
    let small = [fixtures::path("1A8O.cif"), fixtures::path("5i55.cif")];
    let large = ["large/2buk.pdb", "large/7cth.cif.gz"].map(fixtures::shared_or_skip);
    for path in small.into_iter().chain(large.into_iter().flatten()) {
        let whole = read(&path, &one).expect("an assembly").structure;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        group.throughput(Throughput::Elements(whole.atoms().len() as u64));
        group.bench_function(format!("read/{name}"), |b| {
            b.iter(|| read(&path, &one).expect("an assembly"));
        });
        let part = Selector::parse("polymer/copy:2").expect("a selector");
        group.bench_function(format!("select/{name}"), |b| {
            b.iter(|| whole.select(black_box(&part)).expect("a second copy"));
        });
    }
    group.finish();
}

/// Writing PQR.
fn writing(c: &mut Criterion) {
    let structure = read(fixtures::path("1hvr.pdb"), &everything())
        .expect("a structure")
        .structure;
    let mut group = c.benchmark_group("structures/write");
    group.throughput(Throughput::Elements(structure.atoms().len() as u64));
    group.bench_function("pqr", |b| {
        b.iter_batched_ref(
            Vec::new,
            |text| pqr::write(black_box(&structure), text).expect("memory"),
            BatchSize::SmallInput,
        );
    });
    group.finish();
}

criterion_group!(benches, parsing, assemblies, writing);
criterion_main!(benches);
