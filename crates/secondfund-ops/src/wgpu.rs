//! The kernels on the GPU.
//!
//! All is computed in f32, from differences that are taken before anything becomes f32: a position of a triangle mesh
//! is a sum of two f32, a point of a patch is taken from the middle of its patch. Work goes in calls of bounded size,
//! one after the other, each with its own small uniform; what is not finite comes back as it is, for the caller to
//! name.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use geom_core::compute::gpu::GpuBuffer;
use geom_core::compute::parallel;
use geom_core::shaders::{
    SECONDFUND_OPS_DISTANCES, SECONDFUND_OPS_PATCH_FORCES, SECONDFUND_OPS_PATCH_MATRICES,
    SECONDFUND_OPS_TRIANGLE_MATRICES, Shader,
};

use geom_core::{GpuContext, GpuError, Vector3, Wgpu};
use rayon::prelude::*;

use crate::Error;
use crate::backend::{OperatorBackend, PatchMatrices, PatchTask, TriangleTask};
use crate::forms::{Conductor, Law, TriangleMatrix};

/// Triangles per dispatch.
const TRIANGLES: usize = 1 << 20;
/// Numbers that a dispatch of patches gives.
/// 32 MiB of matrices.
const NUMBERS: usize = 1 << 23;
/// Most groups of a dispatch in a row.
/// What every device allows along one axis; a patch is a group.
const GROUPS: usize = 65_535;
/// Distances per dispatch.
/// 64 MiB; whole tiles of rows, so that the last one may run over the end.
const DISTANCES: usize = 1 << 24;
/// Rows of threads in a group of the kernel of distances.
const TILE: usize = 16;

/// What `common/conductivity.wgsl` reads of every task.
/// The first eight words of each task, as the shader declares them.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ConductorHead {
    law: u32,
    fields: u32,
    gauss: f32,
    mean: f32,
    low: f32,
    high: f32,
    regularization: f32,
    limit: f32,
    sharpen: f32,
}

impl ConductorHead {
    /// `fields` says whether factors are given: their buffer is bound in any case.
    fn of(conductor: &Conductor, factors: &[f64]) -> Self {
        Self {
            law: number(conductor.law),
            fields: u32::from(!factors.is_empty()),
            gauss: conductor.gauss as f32,
            mean: conductor.mean as f32,
            low: conductor.bounds[0] as f32,
            high: conductor.bounds[1] as f32,
            regularization: conductor.regularization as f32,
            // WGSL knows no infinity; 0 is no limit.
            limit: if conductor.limit.is_finite() {
                conductor.limit as f32
            } else {
                0.0
            },
            sharpen: conductor.sharpen as f32,
        }
    }
}

/// The task of a call on triangles.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct TriangleHead {
    conductor: ConductorHead,
    count: u32,
    pad: [u32; 2],
}

/// The task of a call on patches, all of which share `functions`, `points` and the basis.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PatchHead {
    conductor: ConductorHead,
    functions: u32,
    points: u32,
    patches: u32,
    mass: u32,
    least: f32,
    pad: [f32; 2],
}

/// The task of a call on distances: `rows` in all, of `width` numbers, from row `first` on.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct DistanceHead {
    rows: u32,
    width: u32,
    first: u32,
    unused: u32,
}

/// Each coordinate of so many vectors as a sum of two f32.
/// Differences of such sums keep about twice the digits of f32.
fn split(
    gpu: &GpuContext,
    label: &str,
    len: usize,
    vector: impl Fn(usize) -> Vector3 + Sync,
) -> Result<GpuBuffer, GpuError> {
    gpu.upload_each(label, len, |i| {
        let d: [f64; 3] = vector(i).into();
        let high = d.map(|c| c as f32);
        let low = [0, 1, 2].map(|k| (d[k] - f64::from(high[k])) as f32);
        [high, low].map(|[x, y, z]| [x, y, z, 0.0])
    })
}

fn in_f32(gpu: &GpuContext, label: &str, values: &[f64]) -> Result<GpuBuffer, GpuError> {
    gpu.upload_each(label, values.len(), |i| values[i] as f32)
}

/// The numbers of `out`.
fn fill(out: &mut [f64], values: &[f32]) {
    out.iter_mut().zip(values).for_each(|(o, &x)| *o = x.into());
}

/// The numbers of the laws in `common/conductivity.wgsl`.
fn number(law: Law) -> u32 {
    match law {
        Law::Metric => 0,
        Law::Adjugate => 1,
        Law::GaussImage => 2,
        Law::Generalized => 3,
        Law::Flow => 4,
        Law::Concave => 5,
    }
}

/// The coefficients of a patch's functions from their middle, each with the value of the weight's fields.
/// The middle is that of the control points, in f64; derivatives do not see it, and no kernel gives a position back.
fn from_their_middle(
    gpu: &GpuContext,
    task: &PatchTask<'_>,
    patches: Range<usize>,
) -> Result<GpuBuffer, GpuError> {
    let n = task.functions;
    let middles = parallel::map(patches.len(), |k| {
        let points = &task.points[(patches.start + k) * n..][..n];
        points.iter().map(|p| p.coords).sum::<Vector3>() / n as f64
    });
    gpu.upload_each("places", patches.len() * n, |i| {
        let at = patches.start * n + i;
        let [x, y, z]: [f64; 3] = (task.points[at].coords - middles[i / n]).into();
        let factor = task.factors.get(at).copied().unwrap_or(1.0);
        [x, y, z, factor].map(|c| c as f32)
    })
}

/// Runs a kernel on patches: `size` values each.
/// `take` is called with the values of consecutive patches, in order; basis and weights go to the device once.
fn on_patches<T: Pod + Send + Sync>(
    gpu: &GpuContext,
    kernel: &Shader,
    task: &PatchTask<'_>,
    size: usize,
    mut take: impl FnMut(&[T]),
) -> Result<(), Error> {
    if task.patches() == 0 {
        return Ok(());
    }
    let basis = in_f32(gpu, "basis", task.basis)?;
    let weights = in_f32(gpu, "weights", task.weights)?;
    let most = (NUMBERS / size).clamp(1, GROUPS);
    for first in (0..task.patches()).step_by(most) {
        let patches = most.min(task.patches() - first);
        let places = from_their_middle(gpu, task, first..first + patches)?;
        let head = PatchHead {
            conductor: ConductorHead::of(&task.conductor, task.factors),
            functions: task.functions as u32,
            points: task.weights.len() as u32,
            patches: patches as u32,
            mass: u32::from(task.mass),
            least: task.least as f32,
            pad: [0.0; 2],
        };
        let head = gpu.uniform("task", &head)?;
        let values = gpu.output::<T>("values", patches * size)?;
        let buffers = [&head, &basis, &weights, &places, &values];
        gpu.dispatch(kernel, &buffers, [patches as u32, 1, 1])?;
        gpu.read(&values, &mut take)?;
    }
    Ok(())
}

impl OperatorBackend for Wgpu {
    fn triangle_matrices(
        &self,
        task: &TriangleTask<'_>,
        out: &mut Vec<TriangleMatrix>,
    ) -> Result<(), Error> {
        let gpu = self.gpu();
        let positions = split(gpu, "positions", task.positions.len(), |i| {
            task.positions[i].coords
        })?;
        let normals = split(gpu, "normals", task.normals.len(), |i| task.normals[i])?;
        let factors = in_f32(gpu, "factors", task.factors)?;
        out.clear();
        out.reserve(task.triangles.len());
        for part in task.triangles.chunks(TRIANGLES) {
            let head = TriangleHead {
                conductor: ConductorHead::of(&task.conductor, task.factors),
                count: part.len() as u32,
                pad: [0; 2],
            };
            let head = gpu.uniform("task", &head)?;
            let triangles = gpu.upload("triangles", part.as_flattened())?;
            let matrices = gpu.output::<[[f32; 4]; 3]>("matrices", part.len())?;
            gpu.dispatch(
                &SECONDFUND_OPS_TRIANGLE_MATRICES,
                &[&head, &positions, &normals, &triangles, &factors, &matrices],
                [part.len().div_ceil(64) as u32, 1, 1],
            )?;
            gpu.read(&matrices, |rows: &[[[f32; 4]; 3]]| {
                parallel::extend(out, rows.len(), |i| {
                    let [a, b, c] = rows[i];
                    TriangleMatrix {
                        stiffness: [a[0], a[1], a[2], a[3], b[0], b[1]].map(f64::from),
                        mass: b[2].into(),
                        mean: b[3].into(),
                        gauss: c[0].into(),
                    }
                });
            })?;
        }
        Ok(())
    }

    fn patch_matrices(&self, task: &PatchTask<'_>, out: &mut PatchMatrices) -> Result<(), Error> {
        let n = task.functions;
        let entries = n * (n + 1) / 2;
        let of_mass = if task.mass { entries } else { 0 };
        let size = entries + of_mass + 3 * n + 1;
        out.reset(task);
        let mut done = 0;
        on_patches(
            self.gpu(),
            &SECONDFUND_OPS_PATCH_MATRICES,
            task,
            size,
            |values: &[f32]| {
                let slots = out.slots(task).skip(done);
                let values = values.par_chunks_exact(size);
                done += values.len();
                slots
                    .zip(values)
                    .with_min_len(64)
                    .for_each(|(out, values)| {
                        let (stiffness, values) = values.split_at(entries);
                        let (mass, values) = values.split_at(of_mass);
                        let (sums, skipped) = values.split_at(3 * n);
                        fill(out.stiffness, stiffness);
                        fill(out.mass, mass);
                        fill(out.sums.as_flattened_mut(), sums);
                        *out.skipped = skipped[0] as u32;
                    });
            },
        )
    }

    fn patch_forces(&self, task: &PatchTask<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
        out.clear();
        out.reserve(task.points.len());
        let (kernel, n) = (&SECONDFUND_OPS_PATCH_FORCES, task.functions);
        on_patches(self.gpu(), kernel, task, n, |forces: &[[f32; 4]]| {
            let wide = |f: &[f32; 4]| Vector3::new(f[0].into(), f[1].into(), f[2].into());
            parallel::extend(out, forces.len(), |i| wide(&forces[i]));
        })
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
            gpu.read(&distances, |part: &[f32]| {
                parallel::extend(out, count * n, |i| part[i]);
            })?;
        }
        Ok(())
    }
}
