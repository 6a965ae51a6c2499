//! The kernels on the GPU.
//!
//! A lot of cells goes up, eight values each, and their points come back: 32 bytes and 12. Values come minus the level,
//! taken in f64, so that f32 has all its digits for the difference.

use geom_core::Wgpu;
use geom_core::compute::parallel;
use geom_core::shaders::DUAL_CONTOUR_DUAL_VERTICES;

use crate::Error;
use crate::backend::ContourBackend;

/// The cells with a surface of so many blocks at once: some hundred thousand.
/// A dispatch then takes longer than the call.
const BLOCKS: usize = 4096;
/// Cells per dispatch: 128 MB of values.
const CELLS: usize = 1 << 22;
/// Cells per row of workgroups.
/// Of 64 cells each: a device has at most 65,535 of them along an axis.
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
            gpu.read(&points, |points: &[[f32; 3]]| {
                parallel::extend(out, n, |i| points[i]);
            })?;
        }
        Ok(())
    }
}
