//! The kernels on the CPU: culls in f64, sums in f32 with as many lanes as the processor has.

use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Cpu, Lattice};
use rayon::prelude::*;

use crate::backend::{
    BLOCK, Block, BlockValues, DensityBackend, Job, RefitSums, SiteCell, scatter,
};
use crate::error::Error;
use crate::kernel::boxes::{Cell, bricks_box, lattice_box, middle};
use crate::kernel::cells;
use crate::kernel::cull::{self, Members};
use crate::kernel::direct;
use crate::kernel::plain;
use crate::kernel::prepared::Prepared;
use crate::kernel::relative::{self, Cube};
use crate::options::Cutoff;

impl DensityBackend for Cpu {
    fn sample_blocks(
        &self,
        model: &Prepared<'_>,
        job: &Job,
        blocks: &[Block],
        results: &mut Vec<BlockValues>,
    ) -> Result<(), Error> {
        results.resize_with(blocks.len(), BlockValues::default);
        let pairs = blocks.par_iter().zip(results);
        pairs.for_each_init(Workspace::default, |work, (block, out)| {
            let done = match job.cutoff {
                Cutoff::AfterPowers(eps) => {
                    direct::sample_block(model, job, eps, block, &mut work.direct, out)
                }
                Cutoff::Bare(_) => false,
            };
            if !done {
                work.sample_block(model, job, block, out);
            }
        });
        Ok(())
    }

    fn atom_errors(&self, model: &Prepared<'_>, cells: &[SiteCell]) -> Result<Vec<f64>, Error> {
        let model = model.model();
        let parts: Vec<Vec<f64>> = cells
            .par_iter()
            .map_init(cells::Scratch::default, |scratch, cell| {
                cells::errors_of_cell(cell, model, scratch)
            })
            .collect();
        let sums = scatter(cells, &parts, model.atoms(), |part, i| [part[i]]);
        Ok(sums.into_iter().map(|[sum]| sum).collect())
    }

    fn refit_sums(&self, model: &Prepared<'_>, cells: &[SiteCell]) -> Result<RefitSums, Error> {
        let model = model.model();
        let parts: Vec<RefitSums> = cells
            .par_iter()
            .map_init(cells::Scratch::default, |scratch, cell| {
                cells::refit_of_cell(cell, model, scratch)
            })
            .collect();
        let atoms = model.atoms();
        Ok(RefitSums {
            objective: parts.iter().map(|p| p.objective).sum(),
            worst: parts.iter().map(|p| p.worst).fold(0.0, f64::max),
            gradient: scatter(cells, &parts, atoms, |p, i| p.gradient[i]),
            curvature: scatter(cells, &parts, atoms, |p, i| p.curvature[i]),
        })
    }
}

/// Reusable arrays of one thread.
#[derive(Default)]
struct Workspace {
    cull: cull::Scratch,
    sums: relative::Scratch,
    direct: direct::Scratch,
    /// Members of the block, of an eighth of it, of a brick, of an eighth of a brick.
    kept: [Members; 4],
    values: Vec<f32>,
}

/// Above this spacing times √κ, bricks are culled and summed by eighths: a whole brick is so large that
/// most of its atoms matter for a few of its points only.
const COARSE: f64 = 0.7;

impl Workspace {
    fn sample_block(
        &mut self,
        model: &Prepared<'_>,
        job: &Job,
        block: &Block,
        out: &mut BlockValues,
    ) {
        out.clear(block);
        let all = Members::gather(&model.tree, &block.atoms);
        let low = block.brick;
        let high = [0, 1, 2].map(|k| low[k] + block.bricks[k]);
        let [mut of_block, mut of_eighth, mut of_brick, _] = std::mem::take(&mut self.kept);
        // The descent to blocks took a quarter of ε; block and eighth take one eighth each, the brick the
        // half that is left, or an eighth of it and three for its own eighths.
        let coarse = job.lattice.spacing * model.reach.fastest_decay().sqrt() > COARSE;
        let of_eps = [1.0, 1.0, if coarse { 1.0 } else { 4.0 }].map(|e| e / 8.0);
        let up = |work: &mut Self, stage: usize, from: &Members, low, high, to: &mut Members| {
            let cell = (&bricks_box(&job.lattice, low, high)).into();
            let up = work.cull(job, of_eps[stage], from, &cell, to);
            up >= job.floor.ln()
        };
        if up(self, 0, &all, low, high, &mut of_block) {
            const HALF: usize = BLOCK / 2;
            let halves = block.bricks.map(|n| n.div_ceil(HALF));
            // Bricks in the order of the eighths they lie in; values must come x fastest.
            let mut values = vec![None; block.len()];
            for eighth in 0..halves.iter().product::<usize>() {
                let at = [
                    eighth % halves[0],
                    eighth / halves[0] % halves[1],
                    eighth / (halves[0] * halves[1]),
                ];
                let first = [0, 1, 2].map(|k| low[k] + at[k] * HALF);
                let last = [0, 1, 2].map(|k| (first[k] + HALF).min(high[k]));
                if !up(self, 1, &of_block, first, last, &mut of_eighth) {
                    continue;
                }
                for c in first[2]..last[2] {
                    for b in first[1]..last[1] {
                        for a in first[0]..last[0] {
                            let i = ((c - low[2]) * block.bricks[1] + b - low[1]) * block.bricks[0]
                                + a
                                - low[0];
                            let brick = [a, b, c];
                            let end = brick.map(|b| b + 1);
                            if block.wants(i) && up(self, 2, &of_eighth, brick, end, &mut of_brick)
                            {
                                self.values.resize(BRICK_POINTS, 0.0);
                                out.pairs +=
                                    self.sample_brick(model, job, brick, coarse, &of_brick);
                                values[i] = Some(self.values.clone());
                            }
                        }
                    }
                }
            }
            for (kind, found) in out.kinds.iter_mut().zip(values) {
                let Some(found) = found else { continue };
                let inside = found.iter().all(|&v| f64::from(v) >= job.ceiling);
                if inside {
                    *kind = Brick::Interior;
                } else {
                    *kind = Brick::Stored((out.values.len() / BRICK_POINTS) as u32);
                    out.values.extend_from_slice(&found);
                }
            }
        }
        self.kept = [of_block, of_eighth, of_brick, Members::default()];
    }

    /// Culls as the job says; `ln` of an upper bound of the density in the cell.
    fn cull(
        &mut self,
        job: &Job,
        of_eps: f64,
        from: &Members,
        cell: &Cell,
        to: &mut Members,
    ) -> f64 {
        match job.cutoff {
            Cutoff::AfterPowers(eps) => {
                from.cull_into(cell, eps * of_eps, job.floor, &mut self.cull, to)
            }
            Cutoff::Bare(eps) => from.within_into(cell, eps, &mut self.cull, to),
        }
    }

    /// The densities of a brick, into `self.values`; gives the number of pairs.
    fn sample_brick(
        &mut self,
        model: &Prepared<'_>,
        job: &Job,
        brick: [usize; 3],
        coarse: bool,
        members: &Members,
    ) -> u64 {
        let lattice = &job.lattice;
        let corner = brick.map(|b| b * BRICK);
        if let Cutoff::Bare(eps) = job.cutoff {
            for (p, value) in self.values.iter_mut().enumerate() {
                let local = [p % BRICK, p / BRICK % BRICK, p / (BRICK * BRICK)];
                let x = lattice.point([0, 1, 2].map(|k| corner[k] + local[k]));
                let near = |&a: &u32| model.tree.ln_kernel(a as usize, &x) >= eps.ln();
                *value = narrow(plain::value(
                    &model.tree,
                    members.atom.iter().copied().filter(near),
                    &x,
                ));
            }
            return (members.len() * BRICK_POINTS) as u64;
        }
        if !coarse {
            let cube = Cube {
                center: middle(lattice, corner, BRICK),
                spacing: lattice.spacing,
                separable: true,
            };
            let Self { sums, values, .. } = self;
            let fits = relative::density::<8, 64>(members, &cube, sums, values);
            if !fits {
                plain_cube(model, lattice, corner, BRICK, members, |p, value| {
                    values[p] = value;
                });
            }
            return (members.len() * BRICK_POINTS) as u64;
        }
        const SIDE: usize = BRICK / 2;
        let mut pairs = 0;
        let mut kept = std::mem::take(&mut self.kept[3]);
        let mut part = [0.0f32; SIDE * SIDE * SIDE];
        for eighth in 0..8 {
            let offset = [eighth & 1, eighth >> 1 & 1, eighth >> 2].map(|b| b * SIDE);
            let first = [0, 1, 2].map(|k| corner[k] + offset[k]);
            let region = lattice_box(
                &lattice.origin,
                lattice.spacing,
                first.map(|f| f as i64),
                first.map(|f| (f + SIDE - 1) as i64),
            );
            self.cull(job, 3.0 / 8.0, members, &(&region).into(), &mut kept);
            let cube = Cube {
                center: middle(lattice, first, SIDE),
                spacing: lattice.spacing,
                separable: true,
            };
            let sums = &mut self.sums;
            let fits = relative::density::<4, 16>(&kept, &cube, sums, &mut part);
            if !fits {
                plain_cube(model, lattice, first, SIDE, &kept, |p, value| {
                    part[p] = value;
                });
            }
            let values = &mut self.values;
            for (line, x_line) in part.chunks_exact(SIDE).enumerate() {
                let y = offset[1] + line % SIDE;
                let z = offset[2] + line / SIDE;
                values[(z * BRICK + y) * BRICK + offset[0]..][..SIDE].copy_from_slice(x_line);
            }
            pairs += (kept.len() * SIDE * SIDE * SIDE) as u64;
        }
        self.kept[3] = kept;
        pairs
    }
}

/// The specification at the points of a cube, where f32 would leave its range.
fn plain_cube(
    model: &Prepared<'_>,
    lattice: &Lattice,
    first: [usize; 3],
    side: usize,
    members: &Members,
    mut put: impl FnMut(usize, f32),
) {
    for p in 0..side * side * side {
        let local = [p % side, p / side % side, p / (side * side)];
        let x = lattice.point([0, 1, 2].map(|k| first[k] + local[k]));
        let g = plain::value(&model.tree, members.atom.iter().copied(), &x);
        put(p, narrow(g));
    }
}

/// To f32, finite.
fn narrow(value: f64) -> f32 {
    (value as f32).min(f32::MAX)
}

/// Every atom at every point: brute force in f32, as many lanes as the processor has, one exponential per
/// pair. Gives the densities and the number of pairs.
pub(crate) fn all_atoms(model: &Prepared<'_>, lattice: &Lattice) -> (Vec<f32>, u64) {
    let atoms: Vec<u32> = (0..model.model().atoms() as u32).collect();
    let all = Members::gather(&model.tree, &atoms);
    let bricks = lattice.counts.map(|n| n.div_ceil(BRICK));
    let [nx, ny, _] = lattice.counts;
    let mut values = vec![0.0f32; lattice.len()];
    values
        .par_chunks_mut(nx * ny * BRICK)
        .enumerate()
        .for_each_init(relative::Scratch::default, |sums, (c, slab)| {
            let mut brick = vec![0.0f32; BRICK_POINTS];
            for (b, a) in (0..bricks[1]).flat_map(|b| (0..bricks[0]).map(move |a| (b, a))) {
                let first = [a, b, c].map(|b| b * BRICK);
                let cube = Cube {
                    center: middle(lattice, first, BRICK),
                    spacing: lattice.spacing,
                    separable: false,
                };
                if !relative::density::<8, 64>(&all, &cube, sums, &mut brick) {
                    plain_cube(model, lattice, first, BRICK, &all, |p, g| brick[p] = g);
                }
                for (row, line) in brick.chunks_exact(BRICK).enumerate() {
                    let (y, z) = (first[1] + row % BRICK, row / BRICK);
                    let start = (z * ny + y) * nx + first[0];
                    if y < ny && start < slab.len() {
                        let width = BRICK.min(nx - first[0]);
                        slab[start..][..width].copy_from_slice(&line[..width]);
                    }
                }
            }
        });
    (values, lattice.points() as u64 * atoms.len() as u64)
}
