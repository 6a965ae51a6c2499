//! The kernel on the CPU.
//!
//! In f64 inside, rounded to f32 at the end; each cell is computed by itself, so that neither chunks nor threads show.

use geom_core::Cpu;
use rayon::prelude::*;

use crate::backend::ContourBackend;
use crate::{Error, kernel};

/// Cells that a thread takes at a time.
const CELLS: usize = 1024;

impl ContourBackend for Cpu {
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
