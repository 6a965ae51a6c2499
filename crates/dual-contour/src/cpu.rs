//! The kernel on the CPU.
//!
//! In f64 inside, rounded to f32 at the end; each cell is computed by itself, so that neither chunks nor threads show.

use geom_core::Cpu;
use geom_core::compute::parallel;

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
        parallel::for_chunks(out, CELLS, |chunk, out| {
            let cells = &cells[chunk * CELLS..][..out.len()];
            kernel::dual_vertices(cells, steps, out);
        });
        Ok(())
    }
}
