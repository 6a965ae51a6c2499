//! Lattice points of moved nodes.
//!
//! Nodes that have moved no longer lie on a lattice. Their images and points along the edges between them mark the
//! lattice points next to them, a low-pass closes what stretching has opened, and a level is taken at which the volume
//! is as wanted.

use geom_core::algebra::graph::VoxelGraph;
use geom_core::compute::parallel;
use geom_core::{Aabb, Lattice, Point3, ScalarGrid};

use super::FrameReport;
use crate::Error;
use crate::shape::check_memory;

/// Points on each edge, besides its ends. None of them is the middle, which lies between lattice points.
const ON_EDGES: [f64; 4] = [0.2, 0.4, 0.6, 0.8];
/// Free lattice points around the nodes.
const MARGIN: i64 = 5;
/// Nodes closer than one spacing that were this many spacings apart lie on each other.
const APART: f64 = 3.0;
/// Edges that are longer or shorter by more than this share count as strained.
const STRAINED: f64 = 0.3;
/// Bytes per lattice point: the marks, two passes of the low-pass, the ranks, the flags.
const BYTES_PER_POINT: u128 = 15;

/// A lattice in step with `lattice` that holds the positions with a margin.
///
/// # Errors
/// [`Error::TooLarge`] before it is allocated.
pub(super) fn lattice_of(
    lattice: &Lattice,
    positions: &[&[Point3]],
    limit: u64,
) -> Result<Lattice, Error> {
    let h = lattice.spacing;
    let bounds = Aabb::of_points(positions.iter().flat_map(|p| p.iter()));
    let local = |p: &Point3| (p - lattice.origin) / h;
    let (low, high) = (local(&bounds.min), local(&bounds.max));
    let low = low.map(|c| (c.round() as i64).saturating_sub(MARGIN));
    let high = high.map(|c| (c.round() as i64).saturating_add(MARGIN));
    let counts =
        [0, 1, 2].map(|a| high[a].saturating_sub(low[a]).saturating_add(1).max(1) as usize);
    let made = Lattice {
        origin: lattice.origin + low.map(|c| c as f64 * h),
        spacing: h,
        counts,
    };
    check_memory(&made, BYTES_PER_POINT, limit)?;
    Ok(made)
}

/// Adds `amount` at each lattice point that is nearest to a node or to a point on an edge between nodes.
/// A lattice point gets it once, however many meet it: crowding does not make a place more inside.
pub(super) fn mark(
    lattice: &Lattice,
    graph: &VoxelGraph,
    positions: &[Point3],
    amount: f64,
    marks: &mut [f32],
) {
    if amount <= 0.0 {
        return;
    }
    let mut met = vec![false; marks.len()];
    let mut mark = |p: &Point3| met[nearest(lattice, p)] = true;
    for (i, p) in positions.iter().enumerate() {
        mark(p);
        for (j, _) in graph.around(i).filter(|e| e.0 > i) {
            let along = positions[j] - p;
            ON_EDGES.iter().for_each(|s| mark(&(p + along * *s)));
        }
    }
    for (mark, _) in marks.iter_mut().zip(met).filter(|m| m.1) {
        *mark += amount as f32;
    }
}

/// The place in memory of the lattice point next to `p`, which must lie within the lattice.
fn nearest(lattice: &Lattice, p: &Point3) -> usize {
    let local = lattice.local(p);
    lattice.index([0, 1, 2].map(|a| local[a].round() as usize))
}

/// A Gaussian of `sigma` spacings, cut off at four of them, along one axis after the other; what lies beyond the lattice
/// is 0.
/// The kernel sums to 1.
pub(super) fn low_passed(lattice: &Lattice, mut values: Vec<f32>, sigma: f64) -> Vec<f32> {
    if sigma <= 0.0 {
        return values;
    }
    let reach = (4.0 * sigma).ceil() as usize;
    let weight = |d: usize| (-0.5 * (d as f64 / sigma).powi(2)).exp();
    let total = 1.0 + 2.0 * (1..=reach).map(weight).sum::<f64>();
    let kernel: Vec<f32> = (0..=reach).map(|d| (weight(d) / total) as f32).collect();
    let [nx, ny, nz] = lattice.counts;
    for (count, stride) in [(nx, 1), (ny, nx), (nz, nx * ny)] {
        let from = &values;
        let at = |index: usize| {
            let place = index / stride % count;
            let mut sum = from[index] * kernel[0];
            for (d, w) in kernel.iter().enumerate().skip(1) {
                let before = if place >= d {
                    from[index - d * stride]
                } else {
                    0.0
                };
                let after = if place + d < count {
                    from[index + d * stride]
                } else {
                    0.0
                };
                sum += (before + after) * w;
            }
            sum
        };
        values = parallel::map(from.len(), at);
    }
    values
}

/// The flags of so many points of the largest values, of equal ones the first; and a level between them and the others.
/// Half-way between the smallest value inside and the largest outside. Fewer than `count` where fewer are above 0.
pub(super) fn largest(grid: &ScalarGrid, count: usize) -> (Vec<bool>, f64) {
    let values = grid.values();
    let count = count.min(values.len());
    let mut ranked: Vec<u32> = (0..values.len() as u32)
        .filter(|&i| values[i as usize] > 0.0)
        .collect();
    let order = |a: &u32, b: &u32| {
        let (x, y) = (values[*a as usize], values[*b as usize]);
        y.total_cmp(&x).then(a.cmp(b))
    };
    let count = count.min(ranked.len());
    let mut flags = vec![false; values.len()];
    let mut outer = 0.0;
    if count < ranked.len() {
        let (_, first_out, _) = ranked.select_nth_unstable_by(count, order);
        outer = f64::from(values[*first_out as usize]);
    }
    let mut inner = f64::INFINITY;
    for &i in &ranked[..count] {
        flags[i as usize] = true;
        inner = inner.min(values[i as usize].into());
    }
    let level = if inner.is_finite() {
        0.5 * (inner + outer)
    } else {
        outer.next_up()
    };
    (flags, level)
}

/// How the nodes of a frame lie to each other.
/// Volumes and time are left for the caller.
pub(super) fn measured(
    lattice: &Lattice,
    graph: &VoxelGraph,
    rest: &[Point3],
    now: &[Point3],
) -> FrameReport {
    let stretch = |i: usize| {
        let edges = graph.around(i).filter(|e| e.0 > i);
        let ratios = edges.map(|(j, _)| (now[i] - now[j]).norm() / (rest[i] - rest[j]).norm());
        ratios.fold(
            (1.0f64, 1.0f64, [0u64; 2]),
            |(low, high, [strained, all]), r| {
                let more = u64::from((r - 1.0).abs() > STRAINED);
                (low.min(r), high.max(r), [strained + more, all + 1])
            },
        )
    };
    let stretches = parallel::map(rest.len(), stretch);
    let (smallest_stretch, largest_stretch, [strained, edges]) =
        stretches
            .into_iter()
            .fold((1.0f64, 1.0f64, [0; 2]), |a, b| {
                let sum = [a.2[0] + b.2[0], a.2[1] + b.2[1]];
                (a.0.min(b.0), a.1.max(b.1), sum)
            });
    // Nodes at one lattice point that were far apart.
    let mut placed: Vec<(usize, u32)> = now
        .iter()
        .zip(0u32..)
        .map(|(p, i)| (nearest(lattice, p), i))
        .collect();
    placed.sort_unstable();
    let far = APART * lattice.spacing;
    let on_others = |group: &[(usize, u32)]| {
        let place = |n: &(usize, u32)| rest[n.1 as usize];
        let meets = |n: &&(usize, u32)| group.iter().any(|m| (place(n) - place(m)).norm() > far);
        group.iter().filter(meets).count()
    };
    let overlapping: usize = placed.chunk_by(|a, b| a.0 == b.0).map(on_others).sum();
    FrameReport {
        largest_stretch,
        smallest_stretch,
        strained: strained as f64 / edges.max(1) as f64,
        self_overlap: overlapping as f64 / rest.len().max(1) as f64,
        ..FrameReport::default()
    }
}
