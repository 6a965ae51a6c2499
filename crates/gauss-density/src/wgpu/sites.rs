//! The terms of trees at the points of cells, and what elimination wants of them.
//!
//! A *site* is a point of a cell, with room for the terms of the cell's tree; a *slot* is an atom of a cell. First a
//! thread per site fills the terms, then a thread per slot goes over the sites of its cell. Places are relative to the
//! middle of the cell, so that f32 resolves them.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use geom_core::compute::gpu::{Batch, GpuBuffer, GpuError};
use geom_core::shaders::{GAUSS_DENSITY_ATOM_ERRORS, GAUSS_DENSITY_TERMS, Shader};
use geom_core::{Aabb, Point3, Wgpu};

use super::{Items, MAX_GROUPS, Params, groups};
use crate::backend::SampleCell;
use crate::error::Error;
use crate::kernel::prepared::Prepared;

/// `inverse` is one over the exact density, `share` the target over it: what makes densities relative.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Site {
    at: [f32; 3],
    inverse: f32,
    share: f32,
    row: u32,
    terms: u32,
    pad: u32,
}

/// An atom among the items, and the sites `first..end` of its cell.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Slot {
    item: u32,
    first: u32,
    end: u32,
    pad: u32,
}

/// Runs of cells none of whose arrays takes more than so many bytes; a cell that is too large alone comes alone.
pub(super) fn ranges(bytes: usize, cells: &[SampleCell]) -> Vec<Range<usize>> {
    let mut ranges = Vec::new();
    let mut first = 0;
    while first < cells.len() {
        let (mut end, mut numbers, mut slots, mut points) = (first, 0, 0, 0);
        while end < cells.len() {
            let cell = &cells[end];
            let own = cell.points.len() * cell.nodes();
            let full = (numbers + own) * 4 > bytes
                || (slots + cell.atoms.len()).div_ceil(64) > MAX_GROUPS
                || (slots + cell.atoms.len()) * 40 > bytes
                || (points + cell.points.len()).div_ceil(64) > MAX_GROUPS;
            if end > first && full {
                break;
            }
            numbers += own;
            slots += cell.atoms.len();
            points += cell.points.len();
            end += 1;
        }
        ranges.push(first..end);
        first = end;
    }
    ranges
}

/// Some cells on the device: each a tree relative to the middle of its points, a slot per atom, and points that know
/// where their terms start.
pub(super) struct Sites {
    pub(super) items: GpuBuffer,
    pub(super) ranges: GpuBuffer,
    pub(super) sites: GpuBuffer,
    pub(super) slots: GpuBuffer,
    pub(super) site_count: usize,
    pub(super) slot_count: usize,
    /// Numbers that the terms at all points are.
    pub(super) terms: usize,
    /// What each cell is relative to.
    pub(super) centers: Vec<Point3>,
    of_sites: GpuBuffer,
    of_slots: GpuBuffer,
}

impl Sites {
    pub(super) fn new(
        backend: &Wgpu,
        model: &Prepared<'_>,
        depth: u32,
        cells: &[SampleCell],
    ) -> Result<Self, Error> {
        let gpu = backend.gpu();
        let mut items = Items::default();
        let (mut sites, mut slots) = (Vec::new(), Vec::new());
        let mut centers = Vec::with_capacity(cells.len());
        let mut terms = 0usize;
        for cell in cells {
            let center = Aabb::of_points(&cell.points).center();
            let row = items.add(model.model(), &cell.atoms, &cell.levels, &center);
            let base = items.ranges[row as usize];
            let first = sites.len() as u32;
            for ((x, &exact), &target) in cell.points.iter().zip(&cell.exact).zip(&cell.target) {
                let at = x - center;
                sites.push(Site {
                    at: [at.x as f32, at.y as f32, at.z as f32],
                    inverse: (1.0 / exact) as f32,
                    share: (target / exact) as f32,
                    row,
                    terms: terms as u32,
                    pad: 0,
                });
                terms += cell.nodes();
            }
            // A slot per atom of the cell: the kernels that follow run a thread for each.
            slots.extend((0..cell.atoms.len() as u32).map(|k| Slot {
                item: base + k,
                first,
                end: sites.len() as u32,
                pad: 0,
            }));
            centers.push(center);
        }
        Ok(Self {
            items: gpu.upload("items", &items.items)?,
            ranges: gpu.upload("ranges", &items.ranges)?,
            sites: gpu.upload("sites", &sites)?,
            slots: gpu.upload("slots", &slots)?,
            site_count: sites.len(),
            slot_count: slots.len(),
            terms,
            centers,
            of_sites: gpu.uniform("params", &Params::new(depth, sites.len()))?,
            of_slots: gpu.uniform("params", &Params::new(depth, slots.len()))?,
        })
    }

    /// The terms at all points, and the densities there, which the kernels per slot need.
    pub(super) fn find_terms(
        &self,
        batch: &mut Batch<'_>,
        terms: &GpuBuffer,
        density: &GpuBuffer,
    ) -> Result<(), GpuError> {
        batch.dispatch(
            &GAUSS_DENSITY_TERMS,
            &[
                &self.of_sites,
                &self.items,
                &self.ranges,
                &self.sites,
                terms,
                density,
            ],
            groups(self.site_count),
        )
    }

    /// One thread per atom of a cell.
    pub(super) fn per_slot(
        &self,
        batch: &mut Batch<'_>,
        shader: &Shader,
        rest: &[&GpuBuffer],
    ) -> Result<(), GpuError> {
        let mut bindings = vec![&self.of_slots, &self.items, &self.ranges, &self.sites];
        bindings.extend_from_slice(rest);
        batch.dispatch(shader, &bindings, groups(self.slot_count))
    }

    pub(super) fn slot_params(&self) -> &GpuBuffer {
        &self.of_slots
    }
}

/// The squared error without each atom of each cell.
/// Slot by slot, so cell by cell and in each by ascending atom.
pub(super) fn atom_errors(
    backend: &Wgpu,
    model: &Prepared<'_>,
    depth: u32,
    cells: &[SampleCell],
) -> Result<Vec<f32>, Error> {
    let gpu = backend.gpu();
    let sites = Sites::new(backend, model, depth, cells)?;
    let terms = gpu.output::<f32>("terms", sites.terms)?;
    let density = gpu.output::<f32>("density", sites.site_count)?;
    let errors = gpu.output::<f32>("errors", sites.slot_count)?;
    gpu.together("errors of atoms", |batch| {
        sites.find_terms(batch, &terms, &density)?;
        let rest = [&terms, &sites.slots, &errors];
        sites.per_slot(batch, &GAUSS_DENSITY_ATOM_ERRORS, &rest)
    })?;
    Ok(gpu.download(&errors)?)
}
