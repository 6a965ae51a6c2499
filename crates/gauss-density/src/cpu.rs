//! The kernels on the CPU: culls in f64, sums in f32 with as many lanes as the processor has.
//!
//! A block goes down in halves: what matters in the block, in each eighth of it, in each brick, and for wide spacings in each eighth
//! of a brick. Each step culls what the one before has left, with a share of the ε that may be lost, and a box that cannot reach
//! the floor ends the way there. Memory is that of the thread and used again.
//!
//! Blocks, and the cells of elimination and refit, are the pieces of work: each is one thread's, none looks at
//! another's, and what is added up over them is added in their order afterwards. So the bits are the same for any
//! number of threads.

use geom_core::compute::parallel;
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Cpu, Lattice};

use crate::backend::{
    BLOCK, Block, BlockValues, DensityBackend, Job, RefitSamples, RefitSums, SampleCell, scatter,
    scatter_into,
};
use crate::error::Error;
use crate::kernel::boxes::{Cell, bricks_box, lattice_box, middle};
use crate::kernel::cells;
use crate::kernel::cull::{self, ActiveSet};
use crate::kernel::direct;
use crate::kernel::plain::plain_cube;
use crate::kernel::prepared::Prepared;
use crate::kernel::relative::{self, Cube};
use crate::model::Model;

impl DensityBackend for Cpu {
    fn sample_blocks(
        &self,
        model: &Prepared<'_>,
        job: &Job,
        blocks: &[Block],
        results: &mut Vec<BlockValues>,
    ) -> Result<(), Error> {
        results.resize_with(blocks.len(), BlockValues::default);
        parallel::for_each_init(results, Workspace::default, |work, i, out| {
            // Straight from the kernels where f32 holds them, else relative to a reference atom per node.
            if !direct::sample_block(model, job, &blocks[i], &mut work.direct, out) {
                work.sample_block(model, job, &blocks[i], out);
            }
        });
        Ok(())
    }

    fn atom_errors(
        &self,
        model: &Prepared<'_>,
        cells: &[SampleCell],
        errors: &mut Vec<f64>,
    ) -> Result<(), Error> {
        let model = model.model();
        let parts: Vec<Vec<f64>> =
            parallel::map_each_init(cells, cells::Scratch::default, |scratch, cell| {
                cells::errors_of_cell(cell, model, scratch)
            });
        scatter_into(cells, &parts, model.atoms(), |part, i| part[i], errors);
        Ok(())
    }

    fn refit_samples<'a>(
        &'a self,
        _: &Prepared<'_>,
        cells: &'a [SampleCell],
    ) -> Result<Box<dyn RefitSamples + 'a>, Error> {
        Ok(Box::new(AtHand(cells)))
    }
}

/// The samples of a refit where they are.
/// Nothing is kept from trial to trial but the points: the trees of the cells are evaluated anew with the atoms of
/// each.
struct AtHand<'a>(&'a [SampleCell]);

impl RefitSamples for AtHand<'_> {
    fn sums(&mut self, model: &Model, sums: &mut RefitSums) -> Result<(), Error> {
        let cells = self.0;
        let parts: Vec<RefitSums> =
            parallel::map_each_init(cells, cells::Scratch::default, |scratch, cell| {
                cells::refit_of_cell(cell, model, scratch)
            });
        let atoms = model.atoms();
        *sums = RefitSums {
            objective: parts.iter().map(|p| p.objective).sum(),
            worst: parts.iter().map(|p| p.worst).fold(0.0, f64::max),
            gradient: scatter(cells, &parts, atoms, |p, i| p.gradient[i]),
            curvature: scatter(cells, &parts, atoms, |p, i| p.curvature[i]),
        };
        Ok(())
    }
}

/// Reusable arrays of one thread.
/// The set of one step is culled into that of the next, which is smaller, so four of them are all that a descent needs.
#[derive(Default)]
struct Workspace {
    cull: cull::Scratch,
    sums: relative::Scratch,
    direct: direct::Scratch,
    /// What matters in the block, in an eighth of it, in a brick, in an eighth of a brick.
    of_block: ActiveSet,
    of_eighth: ActiveSet,
    of_brick: ActiveSet,
    of_part: ActiveSet,
    values: Vec<f32>,
}

/// Above this spacing times √κ, bricks are culled and summed by eighths: a whole brick is so large that
/// most of its atoms matter for a few of its points only.
const COARSE: f64 = 0.7;

/// The shares of ε that the culls of a block take, one after the other; the descent to blocks took a quarter.
/// Each cull keeps `(1 − its share · ε)` of what it was given, so with that quarter the shares of a way down must sum
/// to 1 at most: `1/4 + 1/8 + 1/8 + 1/2`, and for coarse lattices `1/4 + 1/8 + 1/8 + 1/8 + 3/8`. The last cull gets the
/// most, since its atoms are the ones that are summed.
struct Shares {
    /// For the culls of whole blocks, as of the other fields for the boxes they are named after.
    block: f64,
    eighth: f64,
    /// What is left, unless the brick is culled by eighths too.
    brick: f64,
    part: f64,
}

const SHARES: Shares = Shares {
    block: 1.0 / 8.0,
    eighth: 1.0 / 8.0,
    brick: 4.0 / 8.0,
    part: 0.0,
};
const COARSE_SHARES: Shares = Shares {
    brick: 1.0 / 8.0,
    part: 3.0 / 8.0,
    ..SHARES
};

/// A range of bricks, `low..high` per axis.
#[derive(Clone, Copy)]
struct Bricks {
    low: [usize; 3],
    high: [usize; 3],
}

impl Bricks {
    fn of_block(block: &Block) -> Self {
        Self {
            low: block.brick,
            high: [0, 1, 2].map(|k| block.brick[k] + block.bricks[k]),
        }
    }

    fn one(brick: [usize; 3]) -> Self {
        Self {
            low: brick,
            high: brick.map(|b| b + 1),
        }
    }

    /// The eighths of a block, fewer where it is narrow.
    fn eighths(self) -> impl Iterator<Item = Self> {
        const HALF: usize = BLOCK / 2;
        let halves = [0, 1, 2].map(|k| (self.high[k] - self.low[k]).div_ceil(HALF));
        (0..halves.iter().product::<usize>()).map(move |i| {
            let at = [
                i % halves[0],
                i / halves[0] % halves[1],
                i / (halves[0] * halves[1]),
            ];
            let low = [0, 1, 2].map(|k| self.low[k] + at[k] * HALF);
            let high = [0, 1, 2].map(|k| (low[k] + HALF).min(self.high[k]));
            Self { low, high }
        })
    }

    /// One by one, x fastest.
    fn each(self) -> impl Iterator<Item = [usize; 3]> {
        let Self { low, high } = self;
        (low[2]..high[2]).flat_map(move |c| {
            (low[1]..high[1]).flat_map(move |b| (low[0]..high[0]).map(move |a| [a, b, c]))
        })
    }
}

impl Workspace {
    /// Culls a block, each eighth of it and each brick of that in turn, and samples the bricks that may reach
    /// the floor.
    /// Three nested loops, each over what the cull before has left: many bricks share the work on the same far atoms,
    /// and a brick that no atom can lift to the floor is never summed.
    fn sample_block(
        &mut self,
        model: &Prepared<'_>,
        job: &Job,
        block: &Block,
        out: &mut BlockValues,
    ) {
        out.clear(block);
        let coarse = job.lattice.spacing * model.reach.fastest_decay().sqrt() > COARSE;
        let shares = if coarse { COARSE_SHARES } else { SHARES };
        let all = ActiveSet::gather(model, &block.atoms);
        let mut of_block = std::mem::take(&mut self.of_block);
        let mut of_eighth = std::mem::take(&mut self.of_eighth);
        let mut of_brick = std::mem::take(&mut self.of_brick);
        let whole = Bricks::of_block(block);
        if self.keeps(job, shares.block, &all, whole, &mut of_block) {
            // Bricks come in the order of the eighths they lie in; values must come x fastest.
            let mut values = vec![None; block.len()];
            for eighth in whole.eighths() {
                if !self.keeps(job, shares.eighth, &of_block, eighth, &mut of_eighth) {
                    continue;
                }
                for brick in eighth.each() {
                    let (i, own) = (block.place_of(brick), Bricks::one(brick));
                    if block.wants(i)
                        && self.keeps(job, shares.brick, &of_eighth, own, &mut of_brick)
                    {
                        self.values.resize(BRICK_POINTS, 0.0);
                        out.pairs += match coarse {
                            false => self.sample_brick(model, job, brick, &of_brick),
                            true => self.sample_parts(model, job, brick, shares.part, &of_brick),
                        };
                        values[i] = Some(self.values.clone());
                    }
                }
            }
            store(values, job.ceiling, out);
        }
        (self.of_block, self.of_eighth, self.of_brick) = (of_block, of_eighth, of_brick);
    }

    /// Keeps in `to` what matters in some bricks; may the density reach the floor there?
    /// The box has one lattice cell more on the low sides (`bricks_box`), so that both ends of an edge that crosses the
    /// surface are kept.
    fn keeps(
        &mut self,
        job: &Job,
        share: f64,
        from: &ActiveSet,
        bricks: Bricks,
        to: &mut ActiveSet,
    ) -> bool {
        let cell = (&bricks_box(&job.lattice, bricks.low, bricks.high)).into();
        self.cull(job, share, from, &cell, to) >= job.floor.ln()
    }

    /// Keeps in `to` what matters in a box; gives `ln` of an upper bound of the density there.
    fn cull(
        &mut self,
        job: &Job,
        share: f64,
        from: &ActiveSet,
        cell: &Cell,
        to: &mut ActiveSet,
    ) -> f64 {
        from.cull_into(cell, job.cutoff.0 * share, job.floor, &mut self.cull, to)
    }

    /// The densities of a brick, into `self.values`; gives the number of pairs.
    fn sample_brick(
        &mut self,
        model: &Prepared<'_>,
        job: &Job,
        brick: [usize; 3],
        active: &ActiveSet,
    ) -> u64 {
        let first = brick.map(|b| b * BRICK);
        let Self { sums, values, .. } = self;
        fill_cube::<BRICK, { BRICK * BRICK }>(model, &job.lattice, first, active, sums, values);
        (active.len() * BRICK_POINTS) as u64
    }

    /// The same, culled and summed by eighths.
    /// With points far apart, an atom that matters in a corner of the brick would otherwise be summed at all 512.
    fn sample_parts(
        &mut self,
        model: &Prepared<'_>,
        job: &Job,
        brick: [usize; 3],
        share: f64,
        active: &ActiveSet,
    ) -> u64 {
        const SIDE: usize = BRICK / 2;
        let lattice = &job.lattice;
        let mut pairs = 0;
        let mut kept = std::mem::take(&mut self.of_part);
        let mut part = [0.0f32; SIDE * SIDE * SIDE];
        for eighth in 0..8 {
            let offset = [eighth & 1, eighth >> 1 & 1, eighth >> 2].map(|b| b * SIDE);
            let first = [0, 1, 2].map(|k| brick[k] * BRICK + offset[k]);
            // The points alone: no other brick needs what lies between this part and the next.
            let region = lattice_box(
                &lattice.origin,
                lattice.spacing,
                first.map(|f| f as i64),
                first.map(|f| (f + SIDE - 1) as i64),
            );
            self.cull(job, share, active, &(&region).into(), &mut kept);
            let sums = &mut self.sums;
            fill_cube::<SIDE, { SIDE * SIDE }>(model, lattice, first, &kept, sums, &mut part);
            for (line, x_line) in part.chunks_exact(SIDE).enumerate() {
                let y = offset[1] + line % SIDE;
                let z = offset[2] + line / SIDE;
                let start = (z * BRICK + y) * BRICK + offset[0];
                self.values[start..][..SIDE].copy_from_slice(x_line);
            }
            pairs += (kept.len() * SIDE * SIDE * SIDE) as u64;
        }
        self.of_part = kept;
        pairs
    }
}

/// The densities of a cube of points: in f32, or by the plain function where f32 would leave its range.
/// `SIDE` points per axis, `PLANE` is its square; both are constants so that loops over them have a known length.
fn fill_cube<const SIDE: usize, const PLANE: usize>(
    model: &Prepared<'_>,
    lattice: &Lattice,
    first: [usize; 3],
    active: &ActiveSet,
    sums: &mut relative::Scratch,
    out: &mut [f32],
) {
    let cube = Cube {
        center: middle(lattice, first, SIDE),
        spacing: lattice.spacing,
        separable: true,
    };
    if !relative::density::<SIDE, PLANE>(active, &cube, sums, out) {
        plain_cube(model, lattice, first, SIDE, &active.atom, out);
    }
}

/// Bricks of which every value reaches the ceiling are interior, the others are stored, x fastest.
/// `None` stands for a brick that was not wanted or not reached, which stays exterior. Stored ones are numbered in the
/// order of the block.
fn store(values: Vec<Option<Vec<f32>>>, ceiling: f64, out: &mut BlockValues) {
    for (kind, found) in out.kinds.iter_mut().zip(values) {
        let Some(found) = found else { continue };
        let inside = found.iter().all(|&v| f64::from(v) >= ceiling);
        if inside {
            *kind = Brick::Interior;
        } else {
            *kind = Brick::Stored((out.values.len() / BRICK_POINTS) as u32);
            out.values.extend_from_slice(&found);
        }
    }
}
