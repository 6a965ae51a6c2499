//! The kernels on the GPU.

use bytemuck::{Pod, Zeroable};
use geom_core::shaders::{SECONDFUND_OPS_DISTANCES, SECONDFUND_OPS_TRIANGLE_MATRICES};
use geom_core::{Vector3, Wgpu};

use crate::Error;
use crate::backend::{OperatorBackend, TriangleTask};
use crate::forms::{Law, TriangleMatrix};

/// Triangles per dispatch.
const TRIANGLES: usize = 1 << 20;
/// Distances per dispatch.
const DISTANCES: usize = 1 << 24;
/// Rows of threads in a group of the kernel of distances.
const TILE: usize = 16;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct TriangleHead {
    law: u32,
    count: u32,
    fields: u32,
    unused: u32,
    gauss: f32,
    mean: f32,
    low: f32,
    high: f32,
    regularization: f32,
    limit: f32,
    pad: [f32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct DistanceHead {
    rows: u32,
    width: u32,
    first: u32,
    unused: u32,
}

/// Each coordinate as a sum of two f32.
fn split<'a>(vectors: impl Iterator<Item = &'a Vector3>) -> Vec<[f32; 4]> {
    vectors
        .flat_map(|v| {
            let d: [f64; 3] = (*v).into();
            let high = d.map(|c| c as f32);
            let low = [0, 1, 2].map(|k| (d[k] - f64::from(high[k])) as f32);
            [high, low].map(|[x, y, z]| [x, y, z, 0.0])
        })
        .collect()
}

fn number(law: Law) -> u32 {
    match law {
        Law::Metric => 0,
        Law::Adjugate => 1,
        Law::GaussImage => 2,
        Law::Generalized => 3,
        Law::Diffusing => 4,
        Law::Sharpening => 5,
        Law::Concave => 6,
    }
}

impl OperatorBackend for Wgpu {
    fn triangle_matrices(
        &self,
        task: &TriangleTask<'_>,
        out: &mut Vec<TriangleMatrix>,
    ) -> Result<(), Error> {
        let gpu = self.gpu();
        let positions = split(task.positions.iter().map(|p| &p.coords));
        let positions = gpu.upload("positions", &positions)?;
        let normals = gpu.upload("normals", &split(task.normals.iter()))?;
        let factors: Vec<f32> = task.factors.iter().map(|&f| f as f32).collect();
        let factors = gpu.upload("factors", &factors)?;
        let conductor = &task.conductor;
        out.clear();
        out.reserve(task.triangles.len());
        for part in task.triangles.chunks(TRIANGLES) {
            let head = TriangleHead {
                law: number(conductor.law),
                count: part.len() as u32,
                fields: u32::from(!task.factors.is_empty()),
                unused: 0,
                gauss: conductor.gauss as f32,
                mean: conductor.mean as f32,
                low: conductor.bounds[0] as f32,
                high: conductor.bounds[1] as f32,
                regularization: conductor.regularization as f32,
                // WGSL knows no infinity.
                limit: if conductor.limit.is_finite() {
                    conductor.limit as f32
                } else {
                    0.0
                },
                pad: [0.0; 2],
            };
            let head = gpu.uniform("task", &head)?;
            let triangles = gpu.upload("triangles", part.as_flattened())?;
            let matrices = gpu.output::<[[f32; 4]; 3]>("matrices", part.len())?;
            gpu.dispatch(
                &SECONDFUND_OPS_TRIANGLE_MATRICES,
                &[&head, &positions, &normals, &triangles, &factors, &matrices],
                [part.len().div_ceil(64) as u32, 1, 1],
            )?;
            let rows = gpu.download::<[[f32; 4]; 3]>(&matrices)?;
            out.extend(rows.into_iter().map(|[a, b, c]| TriangleMatrix {
                stiffness: [a[0], a[1], a[2], a[3], b[0], b[1]].map(f64::from),
                mass: b[2].into(),
                mean: b[3].into(),
                gauss: c[0].into(),
            }));
        }
        Ok(())
    }

    fn distances(&self, rows: &[f32], width: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        let n = rows.len().checked_div(width).unwrap_or(0);
        out.clear();
        out.reserve(n * n);
        if n == 0 {
            return Ok(());
        }
        let gpu = self.gpu();
        let uploaded = gpu.upload("rows", rows)?;
        let most = (DISTANCES / n).max(TILE) / TILE * TILE;
        for first in (0..n).step_by(most) {
            let count = most.min(n - first);
            let head = DistanceHead {
                rows: n as u32,
                width: width as u32,
                first: first as u32,
                unused: 0,
            };
            let head = gpu.uniform("task", &head)?;
            let distances = gpu.output::<f32>("distances", count.next_multiple_of(TILE) * n)?;
            let groups = [n.div_ceil(TILE) as u32, count.div_ceil(TILE) as u32, 1];
            gpu.dispatch(
                &SECONDFUND_OPS_DISTANCES,
                &[&head, &uploaded, &distances],
                groups,
            )?;
            let part = gpu.download::<f32>(&distances)?;
            out.extend_from_slice(&part[..count * n]);
        }
        Ok(())
    }
}
