//! The kernels on the CPU.

use geom_core::Cpu;
use rayon::prelude::*;

use crate::backend::{BLOCK_CELLS, BLOCK_POINTS, ContourBackend};
use crate::{Error, kernel};

/// Blocks, and cells, that a thread takes at a time.
const BLOCKS: usize = 64;
const CELLS: usize = 1024;

impl ContourBackend for Cpu {
    fn min_max(&self, blocks: &[f32], out: &mut Vec<[f32; 2]>) -> Result<(), Error> {
        out.resize(blocks.len() / BLOCK_POINTS, [0.0; 2]);
        out.par_chunks_mut(BLOCKS)
            .zip(blocks.par_chunks(BLOCKS * BLOCK_POINTS))
            .for_each(|(out, blocks)| kernel::min_max(blocks, BLOCK_POINTS, out));
        Ok(())
    }

    fn crossings(&self, blocks: &[f32], level: f32, out: &mut Vec<u8>) -> Result<(), Error> {
        out.resize(blocks.len() / BLOCK_POINTS * BLOCK_CELLS, 0);
        out.par_chunks_mut(BLOCKS * BLOCK_CELLS)
            .zip(blocks.par_chunks(BLOCKS * BLOCK_POINTS))
            .for_each(|(masks, blocks)| kernel::crossings(blocks, level, masks));
        Ok(())
    }

    fn dual_vertices(
        &self,
        cells: &[[f32; 8]],
        steps: u32,
        out: &mut Vec<[f32; 3]>,
    ) -> Result<(), Error> {
        out.resize(cells.len(), [0.0; 3]);
        out.par_chunks_mut(CELLS)
            .zip(cells.par_chunks(CELLS))
            .for_each(|(out, cells)| kernel::dual_vertices(cells, steps, out));
        Ok(())
    }
}
