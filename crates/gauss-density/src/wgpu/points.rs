//! A model that stays on the device, and is asked at any points.
//!
//! All atoms are sent once, relative to the middle of the model, and lists say which of them matter in which cell; a
//! call sends points and gets four numbers for each. The kernel sums logarithms, as on the processor, in f32.

use bytemuck::{Pod, Zeroable};
use geom_core::compute::gpu::GpuBuffer;
use geom_core::compute::{BackendError, parallel};
use geom_core::shaders::GAUSS_DENSITY_POINTS;
use geom_core::{Point3, Vector3, Wgpu};

use super::{Items, Params, groups, split};
use crate::backend::{CellPoint, PointCells, PointKernel};
use crate::error::Error;

/// Points per dispatch: 32 MB of places.
const POINTS: usize = 1 << 20;

/// A point as the sum of two f32 per coordinate, so that the difference to an atom keeps 48 bits, and the cell it lies in.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Place {
    high: [f32; 3],
    cell: u32,
    low: [f32; 3],
    pad: u32,
}

/// The atoms, their tree, and which of them matter where.
pub(super) struct Resident {
    backend: Wgpu,
    depth: u32,
    /// What places are relative to.
    center: Point3,
    items: GpuBuffer,
    low: GpuBuffer,
    /// Where the atoms of each cell start among the members.
    starts: GpuBuffer,
    members: GpuBuffer,
}

impl Resident {
    pub(super) fn new(backend: &Wgpu, depth: u32, cells: &PointCells<'_>) -> Result<Self, Error> {
        let (gpu, model) = (backend.gpu(), cells.model.model());
        let center = model.center_bounds().center();
        let mut items = Items::default();
        let all: Vec<u32> = (0..model.atoms() as u32).collect();
        items.add(model, &all, &cells.model.levels, &center);
        let low = model.centers().iter().map(|x| {
            let [_, [x, y, z]] = split(&(x - center));
            [x, y, z, 0.0]
        });
        let low: Vec<[f32; 4]> = low.collect();
        let starts: Vec<u32> = cells.starts.iter().map(|&s| s as u32).collect();
        Ok(Self {
            depth,
            center,
            items: gpu.upload("items", &items.items)?,
            low: gpu.upload("low", &low)?,
            members: gpu.upload("members", cells.atoms)?,
            starts: gpu.upload("starts", &starts)?,
            backend: backend.clone(),
        })
    }
}

impl PointKernel for Resident {
    fn values_gradients(
        &self,
        points: &[CellPoint],
        out: &mut Vec<(f64, Vector3)>,
    ) -> Result<(), BackendError> {
        let gpu = self.backend.gpu();
        out.clear();
        out.reserve(points.len());
        for points in points.chunks(POINTS) {
            let params = gpu.uniform("params", &Params::new(self.depth, points.len()))?;
            let places = gpu.upload_each("places", points.len(), |i| {
                let point = &points[i];
                let [high, low] = split(&(point.at - self.center));
                Place {
                    high,
                    cell: point.cell,
                    low,
                    pad: 0,
                }
            })?;
            let results = gpu.output::<[f32; 4]>("results", points.len())?;
            gpu.dispatch(
                &GAUSS_DENSITY_POINTS,
                &[
                    &params,
                    &self.items,
                    &self.low,
                    &self.starts,
                    &self.members,
                    &places,
                    &results,
                ],
                groups(points.len()),
            )?;
            gpu.read(&results, |results: &[[f32; 4]]| {
                parallel::extend(out, results.len(), |i| {
                    let [value, x, y, z] = results[i].map(f64::from);
                    (value, Vector3::new(x, y, z))
                });
            })?;
        }
        Ok(())
    }
}
