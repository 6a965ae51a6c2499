//! Points near the surface where a change of the atoms is measured, in cells that share the atoms that
//! matter there.
//!
//! The surface is where the density is 1, and what moves it by less than asked is allowed. So the change is watched at points
//! near it: lattice points whose density lies in a band around 1, and the crossings of lattice edges with the surface itself, which
//! catch what passes between points. Points of a cell of a few Å share their atoms, so that the tree of these is gathered once per
//! cell and evaluated at all its points side by side.

use geom_core::compute::parallel;
use geom_core::grid::Brick;
use geom_core::{Aabb, BrickGrid, LatticeValues, Point3};
use rayon::prelude::*;

use crate::backend::SampleCell;
use crate::error::Error;
use crate::kernel::boxes::for_points;
use crate::kernel::cells;
use crate::kernel::cull::{self, ActiveSet};
use crate::kernel::prepared::Prepared;
use crate::sample::point::{PointSampler, root_on_edge};

/// Which points are wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wanted {
    /// Lattice points with a density in this band (open).
    pub(crate) band: [f64; 2],
    /// Both ends of the lattice edges that cross the surface.
    pub(crate) ends: bool,
    /// Every `n`-th lattice point, per axis, of the interior, with the upper end of the band as the target.
    pub(crate) interior: Option<usize>,
    /// The share of the density that the atoms left out may amount to.
    pub(crate) eps: f64,
    /// Most bytes that the cells may take.
    pub(crate) max_memory: u64,
}

/// Side of a cell, Å: small enough that most of its atoms matter at each of its points.
const CELL: f64 = 3.0;
/// Cells per side of a group that shares a first cull.
const GROUP: i64 = 6;

/// The wanted points of a sampled band, crossings of lattice edges included, in cells.
/// Sorted by group, cell and order of discovery, so that the cells and their points are the same for any number of
/// threads. The estimate of 600 bytes per point comes before any list of atoms is made.
pub(crate) fn collect(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    wanted: &Wanted,
) -> Result<Vec<SampleCell>, Error> {
    let prepared = sampler.prepared();
    let points = points_of(sampler, grid, wanted);
    let lists = points.len() as u128 * 600;
    if lists > u128::from(wanted.max_memory) {
        return Err(Error::TooManySamples {
            samples: points.len(),
            bytes: lists,
            limit: wanted.max_memory,
        });
    }
    // Points of a group, and of a cell of it, side by side: sorted by both, and by their order where these agree.
    let mut keyed: Vec<Keyed> = points
        .iter()
        .enumerate()
        .map(|(point, x)| Keyed::new(x, point, &grid.lattice().origin))
        .collect();
    keyed.par_sort_unstable();
    let groups: Vec<_> = keyed.chunk_by(|a, b| a.group == b.group).collect();
    let cells: Vec<Vec<SampleCell>> =
        parallel::map_each_init(&groups, cull::Scratch::default, |scratch, group| {
            cells_of_group(prepared, &points, group, wanted, scratch)
        });
    let mut cells: Vec<SampleCell> = cells.into_iter().flatten().collect();
    let model = prepared.model();
    // In the interior the density may fall to the upper end of the band before the body is no longer solid.
    let cap = match wanted.interior {
        Some(_) => wanted.band[1],
        None => f64::INFINITY,
    };
    parallel::for_each_init(&mut cells, cells::Scratch::default, |scratch, _, cell| {
        cell.exact = cells::values_of_cell(cell, model, scratch);
        cell.target = cell.exact.iter().map(|g| g.min(cap)).collect();
    });
    Ok(cells)
}

/// A point by the group and the cell that it lies in.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Keyed {
    group: [i64; 3],
    cell: [i64; 3],
    point: usize,
}

impl Keyed {
    fn new(x: &Point3, point: usize, origin: &Point3) -> Self {
        let cell: [i64; 3] = std::array::from_fn(|k| ((x[k] - origin[k]) / CELL).floor() as i64);
        Self {
            group: cell.map(|c| c.div_euclid(GROUP)),
            cell,
            point,
        }
    }
}

/// The cells of a group: the atoms that can reach the group are gathered once, and culled for each cell.
fn cells_of_group(
    model: &Prepared<'_>,
    points: &[Point3],
    group: &[Keyed],
    wanted: &Wanted,
    scratch: &mut cull::Scratch,
) -> Vec<SampleCell> {
    // Ends of edges that cross the surface may lie below the band.
    let floor = 0.5 * wanted.band[0];
    // A quarter of what may be lost goes with the group, the rest with the cell.
    let reach = model.reach.radius(wanted.eps / 4.0, floor);
    let around = Aabb::of_points(group.iter().map(|k| &points[k.point]));
    let near = model.near(&model.clusters(), &around, reach);
    let all = ActiveSet::gather(model, &model.atoms_near(&near, &around, reach));
    let mut kept = ActiveSet::default();
    group
        .chunk_by(|a, b| a.cell == b.cell)
        .map(|cell| {
            let points: Vec<Point3> = cell.iter().map(|k| points[k.point]).collect();
            let around = Aabb::of_points(&points);
            let eps = 0.75 * wanted.eps;
            all.cull_into(&(&around).into(), eps, floor, scratch, &mut kept);
            SampleCell::new(kept.atom.clone(), kept.levels.clone(), points)
        })
        .collect()
}

/// Brick by brick, in their order. A crossed edge is taken at its lower end, so each once.
fn points_of(sampler: &PointSampler<'_>, grid: &BrickGrid, wanted: &Wanted) -> Vec<Point3> {
    let lattice = *grid.lattice();
    let [nx, ny, nz] = grid.bricks();
    let [low, high] = wanted.band;
    let lists: Vec<Vec<Point3>> = parallel::map(nx * ny * nz, |b| {
        let brick = grid.brick_coordinates(b);
        let mut found = Vec::new();
        let kind = grid.brick(brick);
        if kind == Brick::Exterior {
            return found;
        }
        if kind == Brick::Interior && wanted.interior.is_none() && !wanted.ends {
            return found;
        }
        for_points(&lattice, brick, |p| {
            let g = f64::from(grid.at(p));
            let stride = |n: usize| p.iter().all(|c| c % n == 0);
            let inside = wanted.interior.is_some_and(|n| g >= high && stride(n));
            let mut take = (g > low && g < high) || inside;
            for axis in 0..3 {
                let mut q = p;
                q[axis] += 1;
                let crosses = |q: [usize; 3]| (f64::from(grid.at(q)) >= 1.0) != (g >= 1.0);
                if q[axis] < lattice.counts[axis] && crosses(q) {
                    found.push(root_on_edge(sampler, grid, p, q));
                    take |= wanted.ends;
                }
                if wanted.ends && p[axis] > 0 {
                    q[axis] -= 2;
                    take |= crosses(q);
                }
            }
            if take {
                found.push(lattice.point(p));
            }
        });
        found
    });
    lists.concat()
}
