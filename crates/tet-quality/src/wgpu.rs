//! The kernels on the GPU. It proposes; [`improve`](crate::improve()) accepts in f64 on the CPU.

use bytemuck::{Pod, Zeroable};
use geom_core::shaders::{TET_QUALITY_MEASURE, TET_QUALITY_RELAX};
use geom_core::{Point3, Vector3, Wgpu};

use crate::backend::{QualityBackend, Relaxation};
use crate::error::Error;
use crate::measure::metrics::Measures;

/// Tetrahedra per dispatch.
const TETS: usize = 1 << 20;
/// Vertices per dispatch: their faces need 64 bytes each of scratch.
const VERTICES: usize = 1 << 15;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Batch {
    first: u32,
    count: u32,
    rounds: u32,
    offset: u32,
}

/// Each coordinate as a sum of two f32, relative to the first vertex.
fn split(positions: &[Point3]) -> Vec<[f32; 4]> {
    let Some(origin) = positions.first() else {
        return Vec::new();
    };
    positions
        .iter()
        .flat_map(|p| {
            let d: [f64; 3] = (p - origin).into();
            let high = d.map(|c| c as f32);
            let low = [0, 1, 2].map(|k| (d[k] - f64::from(high[k])) as f32);
            [high, low].map(|[x, y, z]| [x, y, z, 0.0])
        })
        .collect()
}

impl QualityBackend for Wgpu {
    fn measure(
        &self,
        positions: &[Point3],
        tets: &[[u32; 4]],
        out: &mut Vec<Measures>,
    ) -> Result<(), Error> {
        let gpu = self.gpu();
        let positions = gpu.upload("positions", &split(positions))?;
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
            let (angles, volumes) = (
                gpu.download::<[f32; 4]>(&angles)?,
                gpu.download::<f32>(&volumes)?,
            );
            out.extend(angles.into_iter().zip(volumes).map(|(a, v)| {
                let [joe_liu, edge_ratio, min_dihedral, max_dihedral] = a.map(f64::from);
                Measures {
                    six_volume: v.into(),
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
            }));
        }
        Ok(())
    }

    fn relax(&self, task: &Relaxation<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
        let gpu = self.gpu();
        let positions = gpu.upload("positions", &split(task.positions))?;
        let moved = gpu.output::<[f32; 4]>("moved", task.positions.len())?;
        let vertices = gpu.upload("vertices", &task.vertices)?;
        let axes: Vec<[f32; 4]> = task
            .axes
            .iter()
            .flatten()
            .map(|a| [a.x as f32, a.y as f32, a.z as f32, 0.0])
            .collect();
        let axes = gpu.upload("axes", &axes)?;
        let starts = gpu.upload("starts", &task.starts)?;
        let faces = gpu.upload("faces", &task.faces)?;
        for colour in &task.colours {
            for first in colour.clone().step_by(VERTICES) {
                let end = (first + VERTICES).min(colour.end);
                let (from, to) = (task.starts[first], task.starts[end]);
                let scratch = gpu.output::<[[f32; 4]; 4]>("scratch", (to - from) as usize)?;
                let batch = Batch {
                    first: first as u32,
                    count: (end - first) as u32,
                    rounds: task.rounds,
                    offset: from,
                };
                let batch = gpu.uniform("batch", &batch)?;
                gpu.dispatch(
                    &TET_QUALITY_RELAX,
                    &[
                        &batch, &positions, &moved, &vertices, &axes, &starts, &faces, &scratch,
                    ],
                    [((end - first) as u32).div_ceil(64), 1, 1],
                )?;
            }
        }
        let moved = gpu.download::<[f32; 4]>(&moved)?;
        out.clear();
        out.extend(task.vertices.iter().map(|&v| {
            let [x, y, z, _] = moved[v as usize].map(f64::from);
            Vector3::new(x, y, z)
        }));
        Ok(())
    }
}
