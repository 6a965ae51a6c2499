//! The kernels on the GPU. It proposes; [`improve`](crate::improve()) accepts in f64 on the CPU.
//!
//! A GPU computes in f32. What would lose digits is done before: a position is a sum of two f32, so that the
//! differences of neighbours keep theirs. Tasks go in calls of bounded size; the calls of a sweep run in the order of
//! the colours, since each reads what the ones before have moved.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use geom_core::compute::gpu::{GpuBuffer, GpuContext, GpuError};
use geom_core::compute::parallel;
use geom_core::shaders::{TET_QUALITY_MEASURE, TET_QUALITY_RELAX};
use geom_core::{Point3, Vector3, Wgpu};

use crate::backend::{QualityBackend, Relaxation};
use crate::error::Error;
use crate::measure::metrics::Measures;

/// Tetrahedra per dispatch.
/// 16 MiB of corners and as much of results.
const TETS: usize = 1 << 20;
/// Vertices per dispatch: their faces need 64 bytes each of scratch.
const VERTICES: usize = 1 << 16;
/// Vertices per workgroup: sixteen threads each.
/// Each of them has one candidate: the mean or one of the 14 directions.
const VERTICES_PER_GROUP: usize = 4;

/// What a call of the kernel of relaxation is told, laid out like its uniform `Batch`: the first vertex and how many,
/// the rounds of the search, the first face in `faces`, whether means are given, and how far a vertex may go, in mean
/// edges.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Batch {
    first: u32,
    count: u32,
    rounds: u32,
    offset: u32,
    slides: u32,
    reach: f32,
    pad: [u32; 2],
}

/// Each coordinate as a sum of two f32, relative to the first vertex.
/// The first f32 holds 24 bits of the difference, the second the next 24: together 48 of the 53 of f64. Nothing for no
/// positions.
fn split(gpu: &GpuContext, positions: &[Point3]) -> Result<GpuBuffer, GpuError> {
    let origin = positions.first().copied().unwrap_or_default();
    gpu.upload_each("positions", positions.len(), |i| {
        let d: [f64; 3] = (positions[i] - origin).into();
        let high = d.map(|c| c as f32);
        let low = [0, 1, 2].map(|k| (d[k] - f64::from(high[k])) as f32);
        [high, low].map(|[x, y, z]| [x, y, z, 0.0])
    })
}

impl QualityBackend for Wgpu {
    fn measure(
        &self,
        positions: &[Point3],
        tets: &[[u32; 4]],
        out: &mut Vec<Measures>,
    ) -> Result<(), Error> {
        let gpu = self.gpu();
        let positions = split(gpu, positions)?;
        out.clear();
        out.reserve(tets.len());
        for part in tets.chunks(TETS) {
            let count = part.len();
            let part = gpu.upload("tets", part)?;
            let angles = gpu.output::<[f32; 4]>("angles", count)?;
            let volumes = gpu.output::<f32>("volumes", count)?;
            let groups = count.div_ceil(64) as u32;
            gpu.dispatch(
                &TET_QUALITY_MEASURE,
                &[&positions, &part, &angles, &volumes],
                [groups, 1, 1],
            )?;
            let volumes = gpu.download::<f32>(&volumes)?;
            gpu.read(&angles, |angles: &[[f32; 4]]| {
                parallel::extend(out, count, |i| {
                    let [joe_liu, edge_ratio, min_dihedral, max_dihedral] =
                        angles[i].map(f64::from);
                    Measures {
                        six_volume: volumes[i].into(),
                        joe_liu,
                        // WGSL knows no infinity.
                        edge_ratio: if edge_ratio > 1e38 {
                            f64::INFINITY
                        } else {
                            edge_ratio
                        },
                        min_dihedral,
                        max_dihedral,
                    }
                });
            })?;
        }
        Ok(())
    }

    fn slides(&self) -> bool {
        true
    }

    fn relax(&self, task: &Relaxation<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
        let gpu = self.gpu();
        out.clear();
        if task.vertices.is_empty() {
            return Ok(());
        }
        // Vertices that neither move nor stand around one that does stay here.
        let near = Neighbourhood::of(task);
        let positions = split(gpu, &near.positions)?;
        let moved = gpu.output::<[f32; 4]>("moved", near.positions.len())?;
        let axes = gpu.upload_each("axes", task.axes.len(), |i| {
            task.axes[i].map(|a| [a.x as f32, a.y as f32, a.z as f32, 0.0])
        })?;
        let starts = gpu.upload("starts", &task.starts)?;
        let faces = gpu.upload("faces", &near.faces)?;
        let slide = task.slide.as_ref();
        let means: &[Option<Vector3>] = slide.map_or(&[], |slide| &slide.means[..]);
        let means = gpu.upload_each("means", means.len(), |i| {
            means[i].map_or([0.0; 4], |d| [d.x as f32, d.y as f32, d.z as f32, 1.0])
        })?;
        let calls: Vec<Range<usize>> = task
            .colours
            .iter()
            .flat_map(|colour| {
                let firsts = colour.clone().step_by(VERTICES);
                firsts.map(|first| first..(first + VERTICES).min(colour.end))
            })
            .collect();
        let faces_of = |call: &Range<usize>| task.starts[call.end] - task.starts[call.start];
        let most = calls.iter().map(faces_of).max().unwrap_or(0);
        // Calls run one after another, so that one has room where the last one had.
        let scratch = gpu.output::<[[f32; 4]; 4]>("scratch", most as usize)?;
        gpu.together("relax", |all| {
            for call in calls {
                let batch = gpu.uniform(
                    "batch",
                    &Batch {
                        first: call.start as u32,
                        count: call.len() as u32,
                        rounds: task.rounds,
                        offset: task.starts[call.start],
                        slides: u32::from(slide.is_some()),
                        // Its square is still a number.
                        reach: slide.map_or(1e18, |slide| slide.reach as f32),
                        pad: [0; 2],
                    },
                )?;
                all.dispatch(
                    &TET_QUALITY_RELAX,
                    &[
                        &batch, &positions, &moved, &axes, &starts, &faces, &scratch, &means,
                    ],
                    [call.len().div_ceil(VERTICES_PER_GROUP) as u32, 1, 1],
                )?;
            }
            Ok::<(), GpuError>(())
        })?;
        let moved = gpu.download_first::<[f32; 4]>(&moved, task.vertices.len())?;
        out.extend(moved.into_iter().map(|moved| {
            let [x, y, z, _] = moved.map(f64::from);
            Vector3::new(x, y, z)
        }));
        Ok(())
    }
}

/// The vertices that a task is about, numbered anew: first those that move, in order.
/// A task on a few vertices of a large mesh thus uploads only what it touches.
struct Neighbourhood {
    positions: Vec<Point3>,
    faces: Vec<[u32; 3]>,
}

impl Neighbourhood {
    /// In the order in which they are met, the same for every run.
    fn of(task: &Relaxation<'_>) -> Self {
        const NONE: u32 = u32::MAX;
        let mut number = vec![NONE; task.positions.len()];
        let mut positions = Vec::with_capacity(2 * task.vertices.len());
        let mut name = |v: u32| {
            let own = &mut number[v as usize];
            if *own == NONE {
                *own = positions.len() as u32;
                positions.push(task.positions[v as usize]);
            }
            *own
        };
        for &v in &task.vertices {
            name(v);
        }
        let faces = task.faces.iter().map(|face| face.map(&mut name)).collect();
        Self { positions, faces }
    }
}
