//! The sums of a refit: points, cells and trees go up once; then every trial sends its atoms and gets their sums.
//!
//! A trial is four passes: **settle** puts the atoms of the trial into the trees of the cells, **terms** evaluates the trees at
//! their points, **refit_sums** adds up per atom and cell what the objective of Eq. 3.11 changes by (five derivatives, for centre,
//! radius and decay, and the diagonal of its Gauss–Newton matrix), and **gather** adds these up per atom over all cells, in
//! their order, so that a sum has the same bits every time.

use geom_core::compute::gpu::{GpuBuffer, GpuError};
use geom_core::shaders::{GAUSS_DENSITY_GATHER, GAUSS_DENSITY_REFIT_SUMS, GAUSS_DENSITY_SETTLE};
use geom_core::{Point3, Wgpu};

use super::sites::{self, Sites};
use super::{LOG2E, Params, groups, split};
use crate::backend::{RefitSamples, RefitSums, SampleCell};
use crate::error::Error;
use crate::kernel::prepared::Prepared;
use crate::model::Model;

/// Numbers per atom: five derivatives, and five of the diagonal.
const SUMS: usize = 10;

/// The samples of a refit on the device.
pub(super) struct Resident<'a> {
    backend: &'a Wgpu,
    cells: &'a [SampleCell],
    parts: Vec<Part>,
    /// What atoms are relative to.
    center: Point3,
    atoms: usize,
    of_atoms: GpuBuffer,
    /// Room for the terms and sums of any part.
    terms: GpuBuffer,
    sums: GpuBuffer,
}

/// A run of cells.
struct Part {
    sites: Sites,
    /// Atom and cell of each slot, and the middle of each cell.
    homes: GpuBuffer,
    centers: GpuBuffer,
    /// The slots of each atom.
    starts: GpuBuffer,
    slots: GpuBuffer,
    density: GpuBuffer,
}

impl<'a> Resident<'a> {
    /// None of the arrays of a run of cells takes more than so many bytes.
    pub(super) fn new(
        bytes: usize,
        backend: &'a Wgpu,
        model: &Prepared<'_>,
        depth: u32,
        cells: &'a [SampleCell],
    ) -> Result<Self, Error> {
        let gpu = backend.gpu();
        let (center, atoms) = (
            model.model().center_bounds().center(),
            model.model().atoms(),
        );
        let parts = sites::ranges(bytes, cells).into_iter();
        let parts = parts.map(|range| Part::new(backend, model, depth, &center, &cells[range]));
        let parts: Vec<Part> = parts.collect::<Result<_, Error>>()?;
        let most = |count: fn(&Sites) -> usize| {
            let counts = parts.iter().map(|part| count(&part.sites));
            counts.max().unwrap_or(0)
        };
        Ok(Self {
            terms: gpu.output::<f32>("terms", most(|sites| sites.terms))?,
            sums: gpu.output::<f32>("sums", SUMS * most(|sites| sites.slot_count))?,
            of_atoms: gpu.uniform("params", &Params::new(depth, atoms))?,
            backend,
            cells,
            parts,
            center,
            atoms,
        })
    }

    /// Two rows of four per atom: the high parts of its place and the decay, the low parts and the lift.
    fn rows(&self, model: &Model) -> Vec<[f32; 4]> {
        let others = model.radii().iter().zip(model.decays());
        let atoms = model.centers().iter().zip(others);
        let rows = atoms.flat_map(|(x, (&radius, &decay))| {
            let [high, low] = split(&(x - self.center));
            let decay = decay * LOG2E;
            let lift = decay * radius * radius;
            [
                [high[0], high[1], high[2], decay as f32],
                [low[0], low[1], low[2], lift as f32],
            ]
        });
        rows.collect()
    }
}

impl Part {
    fn new(
        backend: &Wgpu,
        model: &Prepared<'_>,
        depth: u32,
        center: &Point3,
        cells: &[SampleCell],
    ) -> Result<Self, Error> {
        let gpu = backend.gpu();
        let sites = Sites::new(backend, model, depth, cells)?;
        let of_slots = cells
            .iter()
            .enumerate()
            .flat_map(|(cell, of)| of.atoms.iter().map(move |&atom| [atom, cell as u32]));
        let homes: Vec<[u32; 2]> = of_slots.collect();
        let centers = sites.centers.iter().flat_map(|x| {
            let parts = split(&(x - center));
            parts.map(|[x, y, z]| [x, y, z, 0.0])
        });
        let centers: Vec<[f32; 4]> = centers.collect();
        // Slots by atom, in order.
        let mut starts = vec![0u32; model.model().atoms() + 1];
        for [atom, _] in &homes {
            starts[*atom as usize + 1] += 1;
        }
        for atom in 1..starts.len() {
            starts[atom] += starts[atom - 1];
        }
        let mut at = starts.clone();
        let mut slots = vec![0u32; homes.len()];
        for (slot, [atom, _]) in homes.iter().enumerate() {
            let at = &mut at[*atom as usize];
            slots[*at as usize] = slot as u32;
            *at += 1;
        }
        Ok(Self {
            homes: gpu.upload("homes", &homes)?,
            centers: gpu.upload("centers", &centers)?,
            starts: gpu.upload("starts", &starts)?,
            slots: gpu.upload("slots", &slots)?,
            density: gpu.output::<f32>("density", sites.site_count)?,
            sites,
        })
    }
}

impl RefitSamples for Resident<'_> {
    fn sums(&mut self, model: &Model, sums: &mut RefitSums) -> Result<(), Error> {
        let gpu = self.backend.gpu();
        let atoms = gpu.upload("atoms", &self.rows(model))?;
        let totals = gpu.output::<f32>("totals", SUMS * self.atoms)?;
        for part in &self.parts {
            let sites = &part.sites;
            gpu.together("sums of a refit", |batch| {
                batch.dispatch(
                    &GAUSS_DENSITY_SETTLE,
                    &[
                        sites.slot_params(),
                        &sites.items,
                        &sites.slots,
                        &part.homes,
                        &part.centers,
                        &atoms,
                    ],
                    groups(sites.slot_count),
                )?;
                sites.find_terms(batch, &self.terms, &part.density)?;
                let rest = [&self.terms, &sites.slots, &part.density, &self.sums];
                sites.per_slot(batch, &GAUSS_DENSITY_REFIT_SUMS, &rest)?;
                batch.dispatch(
                    &GAUSS_DENSITY_GATHER,
                    &[
                        &self.of_atoms,
                        &part.starts,
                        &part.slots,
                        &self.sums,
                        &totals,
                    ],
                    groups(self.atoms),
                )?;
                Ok::<(), GpuError>(())
            })?;
        }
        let totals: Vec<[f32; SUMS]> = gpu.download(&totals)?;
        (sums.objective, sums.worst) = (0.0, 0.0);
        let mut exact = self.cells.iter().flat_map(|cell| &cell.exact);
        for part in &self.parts {
            let density: Vec<f32> = gpu.download(&part.density)?;
            for (g, exact) in density.into_iter().zip(&mut exact) {
                let off = (f64::from(g).exp2() - exact) / exact;
                sums.objective += 0.5 * off * off;
                sums.worst = sums.worst.max(off.abs());
            }
        }
        let five = |from: usize| {
            let five = move |of: &[f32; SUMS]| std::array::from_fn(|p| f64::from(of[from + p]));
            totals.iter().map(five).collect()
        };
        (sums.gradient, sums.curvature) = (five(0), five(5));
        Ok(())
    }
}
