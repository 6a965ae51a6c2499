//! The kernels on the GPU. It proposes; what is accepted is decided in f64 on the CPU.
//!
//! One shader per kernel, all in f32, in dispatches of bounded size one after the other. What f32 cannot hold is kept
//! out of it: differences are taken in f64 before narrowing, of control points from the middle of all, of patches from
//! their first point. So errors are those of the extent of what is computed, not of where
//! in space it lies.

use bytemuck::{Pod, Zeroable};
use geom_core::compute::parallel;
use geom_core::shaders::{TSPLINE_BEZIER_POINTS, TSPLINE_BEZIER_SAMPLES};
use geom_core::{Aabb, Point3, Vector3, Wgpu};

use crate::Error;
use crate::backend::{PointsTask, SamplesTask, SplineBackend};
use crate::surface::bezier::bernstein;
use crate::surface::{PatchPoints, Sample};

/// Patches per dispatch of Bézier points, samples per dispatch of them.
/// What bounds the buffers: some twenty rows of 16 coefficients come with a patch, and a sample is 32 bytes.
const PATCHES: usize = 1 << 16;
const SAMPLES: usize = 1 << 21;

/// As both shaders of patches declare it; `items` are Bézier points or samples.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Counts {
    items: u32,
    parameters: u32,
    padding: [u32; 2],
}

fn single<const N: usize>(x: [f64; N]) -> [f32; N] {
    x.map(|c| c as f32)
}

impl SplineBackend for Wgpu {
    /// The rows of a patch are those of the extraction, in its order; starts are counted from the first patch of the
    /// dispatch. Sums of `C (P − m)` get the middle m back times the sum of C, which is 1 for polynomial bases.
    fn bezier_points(
        &self,
        task: &PointsTask<'_>,
        out: &mut Vec<PatchPoints>,
    ) -> Result<(), Error> {
        let gpu = self.gpu();
        let extraction = task.extraction;
        // Around the middle, so that digits go into differences.
        let middle = Aabb::of_points(task.controls).center();
        let controls: Vec<[f32; 4]> = (task.controls.iter())
            .map(|p| p - middle)
            .map(|v| [v.x as f32, v.y as f32, v.z as f32, 1.0])
            .collect();
        let controls = gpu.upload("controls", &controls)?;
        out.clear();
        out.reserve(extraction.patches().len());
        for bounds in extraction.starts()[..]
            .windows(2)
            .collect::<Vec<_>>()
            .chunks(PATCHES)
        {
            let (first, end) = (bounds[0][0], bounds[bounds.len() - 1][1]);
            let mut starts: Vec<u32> = bounds.iter().map(|b| (b[0] - first) as u32).collect();
            starts.push((end - first) as u32);
            let rows = &extraction.all_coefficients()[first..end];
            let counts = Counts {
                items: 16 * bounds.len() as u32,
                parameters: 0,
                padding: [0; 2],
            };
            let counts = gpu.uniform("counts", &counts)?;
            let starts = gpu.upload("starts", &starts)?;
            let functions = gpu.upload("functions", &extraction.all_functions()[first..end])?;
            let rows = gpu.upload_each("coefficients", rows.len(), |i| single(rows[i]))?;
            let made = gpu.output::<[f32; 4]>("points", 16 * bounds.len())?;
            gpu.dispatch(
                &TSPLINE_BEZIER_POINTS,
                &[&counts, &starts, &functions, &rows, &controls, &made],
                [(16 * bounds.len()).div_ceil(64) as u32, 1, 1],
            )?;
            gpu.read(&made, |points: &[[[f32; 4]; 16]]| {
                parallel::extend(out, points.len(), |i| {
                    points[i].map(|p| {
                        let [x, y, z, w] = p.map(f64::from);
                        let w = if extraction.is_rational() { w } else { 1.0 };
                        [x + middle.x * w, y + middle.y * w, z + middle.z * w, w]
                    })
                });
            })?;
        }
        Ok(())
    }

    /// Bernstein polynomials and their slopes come in a table, in f64 until they are narrowed, so that no shader raises
    /// powers.
    fn bezier_samples(&self, task: &SamplesTask<'_>, out: &mut Vec<Sample>) -> Result<(), Error> {
        let gpu = self.gpu();
        let table: Vec<[[f32; 4]; 2]> = (task.parameters.iter())
            .map(|&t| bernstein(t))
            .map(|[value, slope, _]| [single(value), single(slope)])
            .collect();
        let per = table.len() * table.len();
        out.clear();
        out.reserve(per * task.patches.len());
        if per == 0 {
            return Ok(());
        }
        let table = gpu.upload("table", &table)?;
        for part in task.patches.chunks((SAMPLES / per).max(1)) {
            // Seen from its first point.
            let origin = |patch: &PatchPoints| {
                let [x, y, z, w] = patch[0];
                Point3::new(x / w, y / w, z / w)
            };
            let count = per * part.len();
            let counts = Counts {
                items: count as u32,
                parameters: task.parameters.len() as u32,
                padding: [0; 2],
            };
            let counts = gpu.uniform("counts", &counts)?;
            let near = gpu.upload_each("patches", part.len(), |i| {
                let (patch, o) = (&part[i], origin(&part[i]));
                patch.map(|[x, y, z, w]| single([x - o.x * w, y - o.y * w, z - o.z * w, w]))
            })?;
            let made = gpu.output::<[[f32; 4]; 2]>("samples", count)?;
            gpu.dispatch(
                &TSPLINE_BEZIER_SAMPLES,
                &[&counts, &near, &table, &made],
                [count.div_ceil(64) as u32, 1, 1],
            )?;
            gpu.read(&made, |samples: &[[[f32; 4]; 2]]| {
                parallel::extend(out, samples.len(), |i| {
                    let [[x, y, z, area], n] = samples[i].map(|of| of.map(f64::from));
                    Sample {
                        point: origin(&part[i / per]) + Vector3::new(x, y, z),
                        normal: Vector3::new(n[0], n[1], n[2]),
                        area,
                    }
                });
            })?;
        }
        Ok(())
    }
}
