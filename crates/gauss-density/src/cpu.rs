//! The kernels on the CPU.

use geom_core::Cpu;
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use rayon::prelude::*;

use crate::backend::{Block, BlockValues, DensityBackend, Job};
use crate::error::Error;
use crate::members::{Members, Scratch};
use crate::options::Cutoff;
use crate::plain;
use crate::prepared::{Prepared, lattice_box};

impl DensityBackend for Cpu {
    fn sample_blocks(
        &self,
        model: &Prepared<'_>,
        job: &Job,
        blocks: &[Block],
    ) -> Result<Vec<BlockValues>, Error> {
        Ok(blocks
            .par_iter()
            .map_init(Scratch::default, |scratch, block| {
                sample_block(model, job, block, scratch)
            })
            .collect())
    }
}

fn sample_block(
    model: &Prepared<'_>,
    job: &Job,
    block: &Block,
    scratch: &mut Scratch,
) -> BlockValues {
    let mut out = BlockValues::default();
    let candidates = Members::gather(&model.tree, &block.atoms);
    let mut kept = Members::default();
    for i in 0..block.len() {
        if !block.wants(i) {
            out.kinds.push(Brick::Exterior);
            continue;
        }
        let brick = block.brick_at(i);
        // One cell more on the low side: an edge of the lattice that changes sign between two bricks lies
        // in the boxes of both, so neither can be exterior.
        let low = brick.map(|b| (b * BRICK) as i64 - 1);
        let region = lattice_box(
            &job.lattice.origin,
            job.lattice.spacing,
            low,
            low.map(|l| l + BRICK as i64 + 1),
        );
        let eps = match job.cutoff {
            Cutoff::AfterPowers(eps) => eps / 2.0,
            Cutoff::Bare(_) => 1e-9,
        };
        let up = candidates.cull_into(&(&region).into(), eps, job.floor, scratch, &mut kept);
        if up < job.floor.ln() {
            out.kinds.push(Brick::Exterior);
            continue;
        }
        let mut inside = true;
        let start = out.values.len();
        for p in 0..BRICK_POINTS {
            let local = [p % BRICK, p / BRICK % BRICK, p / (BRICK * BRICK)];
            let x = job
                .lattice
                .point([0, 1, 2].map(|k| brick[k] * BRICK + local[k]));
            let members = kept.atom.iter().copied();
            let value = match job.cutoff {
                Cutoff::AfterPowers(_) => plain::value(&model.tree, members, &x),
                Cutoff::Bare(eps) => {
                    let near = |&a: &u32| model.tree.ln_kernel(a as usize, &x) >= eps.ln();
                    plain::value(&model.tree, members.filter(near), &x)
                }
            };
            inside &= value >= job.ceiling;
            out.values.push((value as f32).min(f32::MAX));
        }
        out.pairs += (kept.len() * BRICK_POINTS) as u64;
        if inside {
            out.values.truncate(start);
            out.kinds.push(Brick::Interior);
        } else {
            out.kinds.push(Brick::Stored((start / BRICK_POINTS) as u32));
        }
    }
    out
}
