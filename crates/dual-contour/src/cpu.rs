//! The kernels on the CPU.

use geom_core::Cpu;
use rayon::prelude::*;

use crate::backend::{BLOCK_CELLS, BLOCK_POINTS, ContourBackend};
use crate::{Error, kernel};

impl ContourBackend for Cpu {
    /// As many as stay in the cache of a core.
    fn blocks_per_call(&self) -> usize {
        64
    }

    fn min_max(&self, blocks: &[f32]) -> Result<Vec<[f32; 2]>, Error> {
        let mut out = vec![[0.0; 2]; blocks.len() / BLOCK_POINTS];
        out.par_chunks_mut(64)
            .zip(blocks.par_chunks(64 * BLOCK_POINTS))
            .for_each(|(out, blocks)| kernel::min_max(blocks, BLOCK_POINTS, out));
        Ok(out)
    }

    fn crossings(&self, blocks: &[f32], level: f32) -> Result<Vec<u8>, Error> {
        let mut masks = vec![0; blocks.len() / BLOCK_POINTS * BLOCK_CELLS];
        masks
            .par_chunks_mut(64 * BLOCK_CELLS)
            .zip(blocks.par_chunks(64 * BLOCK_POINTS))
            .for_each(|(masks, blocks)| kernel::crossings(blocks, level, masks));
        Ok(masks)
    }

    fn dual_vertices(&self, cells: &[[f32; 8]], steps: u32) -> Result<Vec<[f32; 3]>, Error> {
        let mut out = vec![[0.0; 3]; cells.len()];
        out.par_chunks_mut(1024)
            .zip(cells.par_chunks(1024))
            .for_each(|(out, cells)| kernel::dual_vertices(cells, steps, out));
        Ok(out)
    }
}
