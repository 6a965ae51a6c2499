//! Contouring: surface and volume, both methods, on grids of growing size; the kernels on each backend.
//!
//! Throughput is in lattice points for kernels, in elements for meshes.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use dual_contour::backend::ContourBackend;
use dual_contour::{Extent, FieldSamples, Method, Options, Resolution, surface, volume};
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Aabb, BrickGrid, Cpu, ImplicitField, LatticeValues, Point3, Run, Vector3, Wgpu};

/// A gyroid within a ball: much surface per volume, one component, many tunnels.
struct Gyroid {
    radius: f64,
    wave: f64,
}

impl ImplicitField for Gyroid {
    fn value(&self, x: &Point3) -> f64 {
        let [x, y, z] = [x.x, x.y, x.z].map(|c| c * self.wave);
        let gyroid = x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos();
        let ball = self.radius - Vector3::new(x, y, z).norm() / self.wave;
        1.0 + (gyroid + 0.3).min(ball)
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let d = 1e-5;
        let along = |k: usize| {
            let mut step = Vector3::zeros();
            step[k] = d;
            (self.value(&(x + step)) - self.value(&(x - step))) / (2.0 * d)
        };
        (self.value(x), Vector3::new(along(0), along(1), along(2)))
    }
}

/// The field in bricks near its surface, on `n` points per axis with spacing 1.
fn band(field: &Gyroid, n: usize) -> BrickGrid {
    let half = 0.5 * (n - 1) as f64;
    let bounds = Aabb::new(
        Point3::new(-half, -half, -half),
        Point3::new(half, half, half),
    );
    let samples = FieldSamples::new(field, &bounds, 1.0);
    let lattice = *samples.lattice();
    let bricks = lattice.counts.map(|n| n.div_ceil(BRICK));
    let (mut kinds, mut values, mut stored) = (Vec::new(), Vec::new(), 0);
    let (exterior, interior) = (0.0, 2.0);
    for b in 0..bricks.iter().product::<usize>() {
        let low = [
            b % bricks[0],
            b / bricks[0] % bricks[1],
            b / (bricks[0] * bricks[1]),
        ];
        let low = low.map(|c| c * BRICK);
        // One layer more, so that cells between bricks are seen.
        let side = BRICK + 1;
        let at = |i: usize, side: usize| {
            let p = [i % side, i / side % side, i / (side * side)];
            samples.at([0, 1, 2].map(|k| (low[k] + p[k]).min(lattice.counts[k] - 1)))
        };
        let first = at(0, side) >= 1.0;
        if (0..side * side * side).all(|i| (at(i, side) >= 1.0) == first) {
            kinds.push(if first {
                Brick::Interior
            } else {
                Brick::Exterior
            });
        } else {
            kinds.push(Brick::Stored(stored));
            stored += 1;
            values.extend((0..BRICK_POINTS).map(|i| at(i, BRICK)));
        }
    }
    BrickGrid::new(lattice, &kinds, values, exterior, interior).expect("a sparse grid")
}

fn meshes(c: &mut Criterion) {
    for n in [65usize, 129, 257, 513] {
        let field = Gyroid {
            radius: 0.42 * n as f64,
            // Fewer waves on larger grids keep the number of elements near a million.
            wave: 0.12 * (129.0 / n as f64).max(0.25),
        };
        let grid = band(&field, n);
        let run = Run::on(&Cpu);
        let mut group = c.benchmark_group(format!("dual_contour/{n}"));
        group.sample_size(10);
        let options = Options::default();
        let made = surface(&grid, None, &options, run).expect("a surface");
        group.throughput(Throughput::Elements(made.report.triangles as u64));
        group.bench_function("surface", |b| {
            b.iter(|| surface(&grid, None, &options, run).expect("a surface"));
        });
        for (name, method, region, tolerance) in [
            ("interior", Method::DualContour, Extent::Interior, 0.0),
            (
                "interior_adaptive",
                Method::DualContour,
                Extent::Interior,
                3.0,
            ),
            ("both", Method::DualContour, Extent::Both, 0.0),
            ("stuffing_interior", Method::Stuffing, Extent::Interior, 0.0),
        ] {
            if n == 513 && tolerance == 0.0 {
                // Meshes of ten million tetrahedra: the adaptive one is of the size of the thesis.
                continue;
            }
            let options = Options {
                method,
                region,
                tolerance,
                ..Options::default()
            };
            let made = volume(&grid, None, &options, run).expect("a volume");
            group.throughput(Throughput::Elements(made.report.tets as u64));
            group.bench_function(name, |b| {
                b.iter(|| volume(&grid, None, &options, run).expect("a volume"));
            });
        }
        if n == 129 {
            let options = Options {
                resolution: Resolution::Spacing(1.4),
                ..Options::default()
            };
            group.bench_function("resampled", |b| {
                b.iter(|| volume(&grid, Some(&field), &options, run).expect("a volume"));
            });
        }
        group.finish();
    }
}

fn kernels(c: &mut Criterion) {
    let value = |i: usize| (i as f32 * 0.37).sin() - 0.1;
    let cells: Vec<[f32; 8]> = (0..1 << 18)
        .map(|cell| std::array::from_fn(|c| value(8 * cell + c)))
        .collect();
    let gpu = Wgpu::new().ok();
    let backends: Vec<(&str, &dyn ContourBackend)> = std::iter::once(("cpu", &Cpu as _))
        .chain(gpu.as_ref().map(|g| ("wgpu", g as &dyn ContourBackend)))
        .collect();
    let mut group = c.benchmark_group("dual_contour/kernels");
    group.sample_size(10);
    for (name, backend) in backends {
        group.throughput(Throughput::Elements(cells.len() as u64));
        group.bench_function(format!("dual_vertices/{name}"), |b| {
            let mut out = Vec::new();
            b.iter(|| backend.dual_vertices(&cells, 4, &mut out).expect("points"));
        });
    }
    group.finish();
}

criterion_group!(benches, meshes, kernels);
criterion_main!(benches);
