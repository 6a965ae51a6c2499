//! The kernels on the GPU: [`sample`], culls, densities and classification of bricks without a round trip of the
//! members in between; [`sites`], the terms at the points of cells and what elimination wants of them; [`refit`], whose
//! points stay on the device from trial to trial; [`points`], a model that stays there and is asked at any point.

use bytemuck::{Pod, Zeroable};
use geom_core::{Backend, Point3, Vector3, Wgpu};

use crate::backend::{
    Block, BlockValues, DensityBackend, Job, PointCells, PointKernel, RefitSamples, SampleCell,
    scatter_into,
};
use crate::error::Error;
use crate::kernel::prepared::Prepared;
use crate::model::{Level, Model};

#[cfg(feature = "testing")]
pub(crate) mod inside;
mod points;
mod refit;
mod sample;
mod sites;

/// Levels whose powers are not all 1, at most: the kernels keep one open sum per level.
/// More are refused with [`Error::Unsupported`], not computed elsewhere.
const MAX_DEPTH: usize = 8;
/// Most bytes of one array of a batch, below what every device allows for a binding.
const BATCH_BYTES: usize = 64 << 20;
/// Most workgroups along an axis.
const MAX_GROUPS: usize = 65_535;
/// Parent of what has none.
const ROOT: u32 = u32::MAX;
const LOG2E: f64 = std::f64::consts::LOG2_E;

/// What most kernels are told of their task.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Params {
    depth: u32,
    /// Threads that have something to do.
    count: u32,
    pad: [u32; 2],
}

impl Params {
    fn new(depth: u32, count: usize) -> Self {
        Self {
            depth,
            count: count as u32,
            pad: [0; 2],
        }
    }
}

/// Workgroups of 64 threads for so many.
fn groups(count: usize) -> [u32; 3] {
    [count.div_ceil(64) as u32, 1, 1]
}

/// A difference of places as a sum of two f32: f32 resolves the low part where the high one leaves off.
fn split(d: &Vector3) -> [[f32; 3]; 2] {
    let high: [f32; 3] = d.map(|c| c as f32).into();
    let low = [0, 1, 2].map(|k| (d[k] - f64::from(high[k])) as f32);
    [high, low]
}

/// An atom or a node of a tree.
/// Of an atom: place, decay (of powers of 2) in the fourth number, and as `lift` the logarithm of the kernel at its
/// centre. Of a node: its power in the first number, and the run of its children.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Item {
    at: [f32; 4],
    lift: f32,
    first: u32,
    end: u32,
    parent: u32,
}

/// Trees one after another, and where each one's levels start.
#[derive(Default)]
struct Items {
    items: Vec<Item>,
    ranges: Vec<u32>,
}

impl Items {
    /// Adds a tree with atoms relative to `center`; gives its row in `ranges`.
    fn add(&mut self, model: &Model, atoms: &[u32], levels: &[Level], center: &Point3) -> u32 {
        let row = self.ranges.len() as u32;
        let mut start = self.items.len() as u32;
        self.ranges.push(start);
        self.items.extend(atoms.iter().map(|&a| {
            let a = a as usize;
            // Subtracted in f64: f32 then resolves what is left.
            let offset = model.centers()[a] - center;
            let (decay, radius) = (model.decays()[a] * LOG2E, model.radii()[a]);
            Item {
                at: [
                    offset.x as f32,
                    offset.y as f32,
                    offset.z as f32,
                    decay as f32,
                ],
                lift: (decay * radius * radius) as f32,
                first: 0,
                end: 0,
                parent: ROOT,
            }
        }));
        for level in levels {
            let own = self.items.len() as u32;
            self.ranges.push(own);
            for v in 0..level.len() {
                let (first, end) = (
                    start + level.first_child[v],
                    start + level.first_child[v + 1],
                );
                for child in first..end {
                    self.items[child as usize].parent = own + v as u32;
                }
                self.items.push(Item {
                    at: [level.power[v] as f32, 0.0, 0.0, 0.0],
                    lift: 0.0,
                    first,
                    end,
                    parent: ROOT,
                });
            }
            start = own;
        }
        self.ranges.push(self.items.len() as u32);
        row
    }

    /// Number of items of a row.
    /// Atoms and nodes of all levels.
    fn len(&self, row: u32, depth: usize) -> usize {
        let row = row as usize;
        (self.ranges[row + depth + 1] - self.ranges[row]) as usize
    }
}

fn check_depth(name: &str, depth: usize) -> Result<u32, Error> {
    if depth > MAX_DEPTH {
        return Err(Error::Unsupported {
            what: format!(
                "{name} has room for {MAX_DEPTH} levels of powers, the model has {depth}"
            ),
            cure: "use the CPU",
        });
    }
    Ok(depth as u32)
}

impl DensityBackend for Wgpu {
    /// Several lots, so that some are under way while others are taken over.
    fn blocks_per_call(&self) -> usize {
        2048
    }

    fn sample_blocks(
        &self,
        model: &Prepared<'_>,
        job: &Job,
        blocks: &[Block],
        results: &mut Vec<BlockValues>,
    ) -> Result<(), Error> {
        results.clear();
        check_depth(&self.name(), model.levels.len())?;
        sample::sample_within(BATCH_BYTES, self, model, job, blocks, results)
    }

    fn atom_errors(
        &self,
        model: &Prepared<'_>,
        cells: &[SampleCell],
        errors: &mut Vec<f64>,
    ) -> Result<(), Error> {
        let depth = check_depth(&self.name(), model.levels.len())?;
        let mut parts = Vec::with_capacity(cells.len());
        for range in sites::ranges(BATCH_BYTES, cells) {
            let cells = &cells[range];
            let errors = sites::atom_errors(self, model, depth, cells)?;
            let mut rest = errors.as_slice();
            for cell in cells {
                let (own, others) = rest.split_at(cell.atoms.len());
                parts.push(own.to_vec());
                rest = others;
            }
        }
        let atoms = model.model().atoms();
        scatter_into(cells, &parts, atoms, |part, i| f64::from(part[i]), errors);
        Ok(())
    }

    fn refit_samples<'a>(
        &'a self,
        model: &Prepared<'_>,
        cells: &'a [SampleCell],
    ) -> Result<Box<dyn RefitSamples + 'a>, Error> {
        let depth = check_depth(&self.name(), model.levels.len())?;
        Ok(Box::new(refit::Resident::new(
            BATCH_BYTES,
            self,
            model,
            depth,
            cells,
        )?))
    }

    fn point_kernel(&self, cells: &PointCells<'_>) -> Result<Option<Box<dyn PointKernel>>, Error> {
        let depth = check_depth(&self.name(), cells.model.levels.len())?;
        Ok(Some(Box::new(points::Resident::new(self, depth, cells)?)))
    }
}
