//! The kernels on the GPU.

use geom_core::Wgpu;
use geom_core::shaders::{
    DUAL_CONTOUR_CROSSINGS, DUAL_CONTOUR_DUAL_VERTICES, DUAL_CONTOUR_MIN_MAX,
};

use crate::Error;
use crate::backend::{BLOCK_CELLS, BLOCK_POINTS, ContourBackend};

/// Blocks per dispatch: 12 MB of values, within the limits of every device.
const BLOCKS: usize = 4096;
/// Cells per dispatch: 128 MB of values.
const CELLS: usize = 1 << 22;
/// Cells per row of workgroups.
const ROW: usize = 1 << 20;

impl ContourBackend for Wgpu {
    fn blocks_per_call(&self) -> usize {
        BLOCKS
    }

    fn min_max(&self, blocks: &[f32], out: &mut Vec<[f32; 2]>) -> Result<(), Error> {
        let gpu = self.gpu();
        out.clear();
        for batch in blocks.chunks(BLOCKS * BLOCK_POINTS) {
            let n = batch.len() / BLOCK_POINTS;
            let values = gpu.upload("values", batch)?;
            let range = gpu.output::<[f32; 2]>("range", n)?;
            gpu.dispatch(&DUAL_CONTOUR_MIN_MAX, &[&values, &range], [n as u32, 1, 1])?;
            out.extend(gpu.download::<[f32; 2]>(&range)?);
        }
        Ok(())
    }

    fn crossings(&self, blocks: &[f32], level: f32, out: &mut Vec<u8>) -> Result<(), Error> {
        let gpu = self.gpu();
        let level = gpu.uniform("level", &[level, 0.0, 0.0, 0.0])?;
        out.clear();
        for batch in blocks.chunks(BLOCKS * BLOCK_POINTS) {
            let n = batch.len() / BLOCK_POINTS;
            let values = gpu.upload("values", batch)?;
            let masks = gpu.output::<u8>("masks", n * BLOCK_CELLS)?;
            gpu.dispatch(
                &DUAL_CONTOUR_CROSSINGS,
                &[&values, &level, &masks],
                [n as u32, 1, 1],
            )?;
            out.extend(gpu.download::<u8>(&masks)?);
        }
        Ok(())
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
