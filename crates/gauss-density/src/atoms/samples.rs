//! Points near the surface where a change of the atoms is measured, in cells that share the atoms that
//! matter there.

use geom_core::grid::Brick;
use geom_core::{Aabb, BrickGrid, LatticeValues, Point3};
use rayon::prelude::*;

use crate::backend::SiteCell;
use crate::error::Error;
use crate::kernel::boxes::for_points;
use crate::kernel::cells;
use crate::kernel::cull::{self, Members};
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
pub(crate) fn collect(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    wanted: &Wanted,
) -> Result<Vec<SiteCell>, Error> {
    let prepared = sampler.prepared();
    let lattice = *grid.lattice();
    let points = points_of(sampler, grid, wanted);
    let lists = points.len() as u128 * 600;
    if lists > u128::from(wanted.max_memory) {
        return Err(Error::TooManySites {
            sites: points.len(),
            bytes: lists,
            limit: wanted.max_memory,
        });
    }
    let origin = lattice.origin;
    let cell_of = |x: &Point3| -> [i64; 3] {
        std::array::from_fn(|k| ((x[k] - origin[k]) / CELL).floor() as i64)
    };
    let mut keyed: Vec<([i64; 3], [i64; 3], usize)> = points
        .iter()
        .enumerate()
        .map(|(i, x)| {
            let cell = cell_of(x);
            (cell.map(|c| c.div_euclid(GROUP)), cell, i)
        })
        .collect();
    keyed.par_sort_unstable();
    let groups: Vec<_> = keyed.chunk_by(|a, b| a.0 == b.0).collect();
    let floor = 0.5 * wanted.band[0];
    let reach = prepared.reach.radius(wanted.eps / 4.0, floor);
    let clusters = prepared.clusters();
    let cells: Vec<Vec<SiteCell>> = groups
        .par_iter()
        .map_init(cull::Scratch::default, |scratch, group| {
            let cells: Vec<_> = group.chunk_by(|a, b| a.1 == b.1).collect();
            let around = Aabb::of_points(group.iter().map(|k| &points[k.2]));
            let near = prepared.near(&clusters, &around, reach);
            let all = Members::gather(&prepared.tree, &prepared.atoms_near(&near, &around, reach));
            let mut kept = Members::default();
            cells
                .into_iter()
                .map(|cell| {
                    let points: Vec<Point3> = cell.iter().map(|k| points[k.2]).collect();
                    let around = Aabb::of_points(&points);
                    let eps = 0.75 * wanted.eps;
                    all.cull_into(&(&around).into(), eps, floor, scratch, &mut kept);
                    SiteCell::new(kept.atom.clone(), kept.levels.clone(), points)
                })
                .collect()
        })
        .collect();
    let mut cells: Vec<SiteCell> = cells.into_iter().flatten().collect();
    let model = prepared.model();
    let cap = match wanted.interior {
        Some(_) => wanted.band[1],
        None => f64::INFINITY,
    };
    cells
        .par_iter_mut()
        .for_each_init(cells::Scratch::default, |scratch, cell| {
            cell.exact = cells::values_of_cell(cell, model, scratch);
            cell.target = cell.exact.iter().map(|g| g.min(cap)).collect();
        });
    Ok(cells)
}

fn points_of(sampler: &PointSampler<'_>, grid: &BrickGrid, wanted: &Wanted) -> Vec<Point3> {
    let lattice = *grid.lattice();
    let [nx, ny, nz] = grid.bricks();
    let [low, high] = wanted.band;
    let lists: Vec<Vec<Point3>> = (0..nx * ny * nz)
        .into_par_iter()
        .map(|b| {
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
        })
        .collect();
    lists.concat()
}
