//! Histograms of the diameters around each node. Nodes are lattice points and shares are counted in whole numbers, so that
//! every backend finds the same.
//!
//! A diameter belongs to a node and knows nothing of directions. How the diameters of the nodes within some distances of a node are
//! distributed tells a fingertip from a palm, whatever the pose.

use geom_core::compute::parallel::{self, sorted_by_number};
use geom_core::options::require;

use crate::Error;
use crate::backend::{HistogramTask, Kernels, On};
use crate::options::HistogramOptions;
use crate::shape::VoxelShape;

/// What a node counts, unless there are too many of them for 32 bits.
const UNIT: u32 = 1 << 16;
/// Spacings that a radius may have: its square has to be a number of 32 bits, and so have the squares of steps.
const LARGEST_REACH: f64 = 16_384.0;

/// Of each boundary node, the share of the nodes within the radius whose diameter falls into each bar; a diameter between the
/// middles of two bars counts for both. `diameters` are those of the boundary nodes, `range` that of both shapes, both like
/// `options` in `unit` (Å).
pub(crate) fn histograms(
    shape: &VoxelShape,
    diameters: &[f64],
    range: [f64; 2],
    unit: f64,
    options: &HistogramOptions,
    run: On<'_>,
) -> Result<Vec<f64>, Error> {
    let reach = options.radius * unit / shape.lattice().spacing;
    let (within, must) = (reach <= LARGEST_REACH, "be at most 16384 spacings");
    require(within, "histograms.radius", options.radius, must)?;
    let point = |&node: &u32| shape.graph().point(node as usize).map(|c| c as i32);
    let points: Vec<[i32; 3]> = shape.boundary().iter().map(point).collect();
    // A radius of exactly some spacings takes the points at its end.
    let reach = (reach * reach * (1.0 + 1e-12)).floor() as u32;
    let one = one(points.len());
    let (bars, width) = (options.bars, (range[1] - range[0]).max(f64::MIN_POSITIVE));
    let place = |d: &f64| {
        let at = ((d - range[0]) / width).clamp(0.0, 1.0) * (bars - 1) as f64;
        (at * f64::from(one)).round() as u32
    };
    let places: Vec<u32> = diameters.iter().map(place).collect();
    let task = HistogramTask {
        points: &points,
        reach,
        places: &places,
        bars,
        one,
    };
    let rows = run.histograms(&task)?;
    let rows = rows.chunks(bars.max(1)).flat_map(|row| {
        let all = row.iter().map(|&s| f64::from(s)).sum::<f64>().max(1.0);
        row.iter().map(move |&s| f64::from(s) / all)
    });
    Ok(rows.collect())
}

/// What a node counts: all of so many together are a number of 32 bits.
pub(crate) fn one(nodes: usize) -> u32 {
    let most = u32::MAX / nodes.clamp(1, u32::MAX as usize) as u32;
    (most.min(UNIT) + 1).next_power_of_two() >> 1
}

impl HistogramTask<'_> {
    /// The kernel on the CPU.
    pub(crate) fn counted(&self, out: &mut Vec<u32>) {
        let cells = Cells::of(self.points, self.reach);
        out.clear();
        out.resize(self.points.len() * self.bars, 0);
        parallel::for_chunks(out, self.bars, |i, row| {
            let p = self.points[i];
            let near = |q: [i32; 3]| {
                let step = |a: usize| u64::from(p[a].abs_diff(q[a])).pow(2);
                step(0) + step(1) + step(2) <= u64::from(self.reach)
            };
            for range in cells.around(p) {
                for &n in &cells.order[range] {
                    if near(self.points[n as usize]) {
                        let place = self.places[n as usize];
                        let low = ((place / self.one) as usize).min(self.bars - 2);
                        let high = place - low as u32 * self.one;
                        row[low] += self.one - high;
                        row[low + 1] += high;
                    }
                }
            }
        });
    }
}

/// Points by cubes of the lattice, as long as they have to look.
pub(crate) struct Cells {
    /// Spacings along a cube.
    pub(crate) side: i32,
    /// The corner of the first cube.
    pub(crate) low: [i32; 3],
    /// Cubes per axis, the first fastest.
    pub(crate) counts: [usize; 3],
    /// Where the points of each cube start in the order, and the total at the end.
    pub(crate) starts: Vec<u32>,
    /// The points, cube after cube.
    pub(crate) order: Vec<u32>,
}

impl Cells {
    pub(crate) fn of(points: &[[i32; 3]], reach: u32) -> Self {
        let bound = |axis: usize, of: fn(i32, i32) -> i32| {
            points.iter().map(|p| p[axis]).reduce(of).unwrap_or(0)
        };
        let (low, high) = (
            [0, 1, 2].map(|a| bound(a, i32::min)),
            [0, 1, 2].map(|a| bound(a, i32::max)),
        );
        // Never more cubes than points in a full lattice of their bounds: a cube is at least 1 long.
        let side = (f64::from(reach).sqrt().ceil() as i32).max(1);
        let counts = [0, 1, 2].map(|a| ((high[a] - low[a]) / side) as usize + 1);
        let cell = |i: usize| {
            let [x, y, z] = [0, 1, 2].map(|a| ((points[i][a] - low[a]) / side) as usize);
            x + counts[0] * (y + counts[1] * z)
        };
        let sorted = sorted_by_number(points.len(), |i| [cell(i) as u32, i as u32], |at| at[0]);
        let cubes = 0..=counts.iter().product::<usize>();
        let starts = cubes.map(|cube| sorted.partition_point(|at| (at[0] as usize) < cube) as u32);
        let starts = starts.collect();
        let order = sorted.into_iter().map(|[_, i]| i).collect();
        Self {
            side,
            low,
            counts,
            starts,
            order,
        }
    }

    /// Where the points of the cubes around a point stand in the order: rows of up to three cubes.
    /// Cubes of a row stand side by side in the order, so that up to three of them are one range.
    fn around(&self, p: [i32; 3]) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let near = move |a: usize| {
            let at = ((p[a] - self.low[a]) / self.side) as usize;
            at.saturating_sub(1)..(at + 2).min(self.counts[a])
        };
        near(2).flat_map(move |z| {
            near(1).map(move |y| {
                let row = self.counts[0] * (y + self.counts[1] * z);
                let of = |x: usize| self.starts[row + x] as usize;
                of(near(0).start)..of(near(0).end)
            })
        })
    }
}
