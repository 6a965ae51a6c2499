//! The kernels on the GPU.

use geom_core::Wgpu;
use geom_core::shaders::DUAL_CONTOUR_DUAL_VERTICES;

use crate::Error;
use crate::backend::ContourBackend;

/// The cells with a surface of so many blocks at once: some hundred thousand.
const BLOCKS: usize = 4096;
/// Cells per dispatch: 128 MB of values.
const CELLS: usize = 1 << 22;
/// Cells per row of workgroups.
const ROW: usize = 1 << 20;

impl ContourBackend for Wgpu {
    fn blocks_per_call(&self) -> usize {
        BLOCKS
    }

    fn dual_vertices(
        &self,
        cells: &[[f32; 8]],
        steps: u32,
        out: &mut Vec<[f32; 3]>,
    ) -> Result<(), Error> {
        let gpu = self.gpu();
        out.clear();
        for batch in cells.chunks(CELLS) {
            let n = batch.len();
            let values = gpu.upload("values", batch)?;
            let uniform = gpu.uniform("steps", &[n as u32, steps, ROW as u32, 0])?;
            let points = gpu.output::<[f32; 3]>("points", n)?;
            let groups = [ROW.min(n).div_ceil(64) as u32, n.div_ceil(ROW) as u32, 1];
            gpu.dispatch(
                &DUAL_CONTOUR_DUAL_VERTICES,
                &[&values, &uniform, &points],
                groups,
            )?;
            out.extend(gpu.download::<[f32; 3]>(&points)?);
        }
        Ok(())
    }
}
