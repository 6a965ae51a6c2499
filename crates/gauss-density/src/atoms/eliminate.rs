//! Error-bounded elimination of atoms (Algorithm 1 with Eqs. 3.8 and 3.9 corrected).
//!
//! Atoms are tried in the order of how much they change the density near the surface. An atom goes when,
//! with it and all atoms removed before gone, the density at every sample still keeps `1 − ε_G` of the
//! *original* density. So the bound holds for the result, not only for each step.

use geom_core::compute::parallel;
use geom_core::options::{OutOfRange, require};
use geom_core::{BrickGrid, LatticeValues, Point3, Run};
use rayon::prelude::*;

use crate::atoms::samples::{self, Wanted};
use crate::backend::{DensityBackend, On, SampleCell, check_per_atom};
use crate::error::Error;
use crate::kernel::cells::{self, CellSums, ChangedRow};
use crate::kernel::prepared::Prepared;
use crate::model::Model;
use crate::options::{Cutoff, Options};
use crate::sample::band::sample_band;
use crate::sample::blocks::lattice_of;
use crate::sample::compare::{Comparison, NEAR, compare_bands};
use crate::sample::point::PointSampler;

/// When to stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Stop {
    /// Leave an atom that would break the bound, and try the next: removes more, keeps the same bound.
    #[default]
    SkipFailing,
    /// Stop at the first atom that would break the bound, as the thesis does.
    FirstFailure,
}

/// What happens to atoms below the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Interior {
    /// The body stays solid: lattice points of the interior must keep the density at the upper end of the band.
    #[default]
    KeepSolid,
    /// Only the surface counts, as in the thesis: buried atoms go first, and the body becomes hollow.
    Hollow,
}

/// What to eliminate.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Elimination {
    /// `ε_G`: the share of the density that a sample may lose; 0 keeps every atom.
    /// At most 0.5. A loss of that share moves the surface inwards by about `ε_G` over the slope of `ln G` there: by
    /// the default about a hundredth of an ångström, with usual decays. The larger it is, the fewer atoms are left.
    pub epsilon: f64,
    /// Distance between samples, Å.
    /// The bound holds at the samples; between them it may be exceeded a little, less so for finer ones. Time and
    /// memory grow as its inverse square near the surface, and as its inverse cube with a solid interior.
    pub spacing: f64,
    /// `(g_l, g_u)`: lattice points with a density in between are samples, and so is every crossing of a
    /// lattice edge with the surface. The upper end is raised to what `ε_G` needs: the new surface lies
    /// where the density was up to `1 / (1 − ε_G)`.
    pub band: [f64; 2],
    /// When to stop.
    pub stop: Stop,
    /// What happens to atoms below the surface.
    pub interior: Interior,
    /// Most bytes for the samples and their sums.
    /// For the bands too. 4 GiB by default; atoms with small powers, which reach far, need the most.
    pub max_memory: u64,
}

impl Default for Elimination {
    fn default() -> Self {
        Self {
            epsilon: 0.02,
            spacing: 0.5,
            band: [0.9, 1.1],
            stop: Stop::default(),
            interior: Interior::default(),
            max_memory: 4 << 30,
        }
    }
}

impl Elimination {
    /// The thesis's choices: stop at the first failure, hollow, samples 1 Å apart.
    pub fn thesis(epsilon: f64) -> Self {
        Self {
            epsilon,
            spacing: 1.0,
            stop: Stop::FirstFailure,
            interior: Interior::Hollow,
            ..Self::default()
        }
    }

    /// Is every field in its range?
    pub fn check(&self) -> Result<(), OutOfRange> {
        let fine = (0.0..=0.5).contains(&self.epsilon);
        require(fine, "epsilon", self.epsilon, "be in [0, 0.5]")?;
        self.sampling().check()
    }

    /// The band that is sampled.
    fn wide_band(&self) -> [f64; 2] {
        [self.band[0], self.band[1].max(1.01 / (1.0 - self.epsilon))]
    }

    pub(crate) fn sampling(&self) -> Options {
        Options {
            spacing: self.spacing,
            band: self.wide_band(),
            max_memory: self.max_memory,
            cutoff: Cutoff(1e-5),
            ..Options::default()
        }
    }
}

/// The remaining atoms.
#[derive(Clone, Debug, PartialEq)]
pub struct Eliminated {
    /// The model of the remaining atoms; nodes without atoms are gone.
    pub model: Model,
    /// The remaining atoms as indices into the original, ascending.
    pub kept: Vec<u32>,
    /// What happened.
    pub report: EliminationReport,
}

/// What an elimination did.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct EliminationReport {
    /// Name of the backend.
    pub backend: String,
    /// Atoms before.
    pub atoms: usize,
    /// Atoms after.
    pub remaining: usize,
    /// Protected atoms, which were not tried.
    pub protected: usize,
    /// The first atom, in the order of trial, that would have broken the bound.
    pub first_failure: Option<u32>,
    /// Atoms that went and came back, since the interior had holes between its samples without them.
    pub put_back: usize,
    /// Samples, interior ones included.
    pub samples: usize,
    /// The band that was sampled.
    pub band: [f64; 2],
    /// The largest share of its density that a sample lost; at most `ε_G`.
    pub worst_loss: f64,
    /// The new surface beside the old one; `surface_max` is `e_G^M` (Eq. 3.10).
    pub comparison: Comparison,
}

/// The share of the density that may be lost by leaving out far atoms in the sums of samples, as a share of
/// `ε_G`.
const SAMPLE_EPS: f64 = 0.005;

/// Removes atoms while every sample keeps the share `1 − ε_G` of its original density. Protected atoms
/// ([`Model::protect`]) stay.
///
/// The bands and the errors per atom are summed on the backend; the samples, their roots on lattice edges and the
/// loop itself stay on the CPU.
///
/// ```
/// use gauss_density::{Elimination, Model, eliminate};
/// use geom_core::{Cpu, Point3, Run};
/// # fn main() -> Result<(), gauss_density::Error> {
/// // One atom buried by another.
/// let places = vec![Point3::origin(), Point3::new(0.1, 0.0, 0.0)];
/// let model = Model::new(places, vec![2.0, 0.5], vec![1.0; 2], vec![])?;
/// let done = eliminate(&model, &Elimination { epsilon: 0.1, ..Elimination::default() }, Run::on(&Cpu))?;
/// assert_eq!(done.kept, [0]);
/// assert!(done.report.worst_loss <= 0.1);
/// # Ok(())
/// # }
/// ```
///
/// The order is that of the change each atom makes to the original density at the samples, taken once. The choice is
/// greedy: not the fewest atoms that would do, but the same ones in every run.
///
/// # Errors
/// An option out of range; [`Error::TooManySamples`] or [`Error::GridTooLarge`] where memory does not suffice;
/// [`Error::NothingLeft`] if no sample sees a surface; [`Error::Cancelled`]; what the backend refuses.
pub fn eliminate<B: DensityBackend + ?Sized>(
    model: &Model,
    options: &Elimination,
    run: Run<'_, B>,
) -> Result<Eliminated, Error> {
    eliminate_on(model, options, run.with(run.backend.as_density()))
}

fn eliminate_on(model: &Model, options: &Elimination, run: On<'_>) -> Result<Eliminated, Error> {
    options.check()?;
    let sample_eps = (SAMPLE_EPS * options.epsilon).clamp(1e-7, 1e-4);
    let sampler = PointSampler::above(NEAR, model, Cutoff(sample_eps))?;
    let sampling = Options {
        bounds: Some(lattice_of(sampler.prepared(), &options.sampling())?.bounds()),
        ..options.sampling()
    };
    let atoms = model.atoms();
    let protected = (0..atoms).filter(|&a| model.is_protected(a)).count();
    let mut report = EliminationReport {
        backend: run.backend.name(),
        atoms,
        remaining: atoms,
        protected,
        first_failure: None,
        put_back: 0,
        samples: 0,
        band: sampling.band,
        worst_loss: 0.0,
        comparison: Comparison::default(),
    };
    let mut kept = vec![true; atoms];
    if options.epsilon > 0.0 {
        let old = sample_band(model, &sampling, run)?.grid;
        let cells = samples_of(&sampler, &old, &sampling, options, sample_eps)?;
        report.samples = cells.iter().map(|c| c.points.len()).sum();
        let order = order_of_trial(&sampler, &cells, run)?;
        let state = State::new(sampler.prepared(), &cells, options.max_memory)?;
        let trial = Trial {
            order: &order,
            // Far atoms and rounding take their part.
            epsilon: options.epsilon - 4.0 * sample_eps - 1e-6,
            stop: options.stop,
        };
        trial.run(state, &mut kept, &mut report, run)?;
        // The samples are the largest of what is held, and have done their work.
        drop(cells);
        let body = Body {
            sampler: &sampler,
            band: &old,
            sampling: &sampling,
        };
        let gone = kept.iter().filter(|&&k| !k).count();
        report.comparison = body.settle(options, &mut kept, run)?;
        report.put_back = gone - kept.iter().filter(|&&k| !k).count();
    }
    let kept = indices(&kept);
    report.remaining = kept.len();
    Ok(Eliminated {
        model: model.subset(&kept),
        kept,
        report,
    })
}

fn indices(kept: &[bool]) -> Vec<u32> {
    (0..kept.len() as u32)
        .filter(|&a| kept[a as usize])
        .collect()
}

/// The model before, and its density around the surface.
struct Body<'a> {
    sampler: &'a PointSampler<'a>,
    band: &'a BrickGrid,
    sampling: &'a Options,
}

impl Body<'_> {
    /// What is left beside this one. A solid body gets atoms back before, where its interior has holes between the samples,
    /// which lie two lattice steps apart: until all its lattice points keep what the samples keep. An atom that returns
    /// only raises the density, so the bound still holds.
    fn settle(
        &self,
        options: &Elimination,
        kept: &mut [bool],
        run: On<'_>,
    ) -> Result<Comparison, Error> {
        let model = self.sampler.prepared().model();
        let cap = self.sampling.band[1];
        // What lattice values may be off by, see `Elimination::sampling`.
        let least = ((1.0 - options.epsilon) * cap * (1.0 - 2e-5)) as f32;
        loop {
            let left = indices(kept);
            if left.is_empty() {
                return Err(Error::NothingLeft);
            }
            if left.len() == kept.len() {
                return Ok(Comparison::default());
            }
            let reduced = model.subset(&left);
            let new = sample_band(&reduced, self.sampling, run)?.grid;
            let holes = match options.interior {
                Interior::KeepSolid => holes(self.band, &new, cap as f32, least),
                Interior::Hollow => Vec::new(),
            };
            if holes.is_empty() {
                return compare_bands((&reduced, &new), (self.sampler, self.band), cap);
            }
            for atom in self.filling(&holes, kept) {
                kept[atom] = true;
            }
        }
    }

    /// For each hole the atom, of those that are gone, that gave it the most.
    /// By the bare kernel. Several holes may name the same atom; each round brings at least one back, so the rounds
    /// end.
    fn filling(&self, holes: &[Point3], kept: &[bool]) -> Vec<usize> {
        let gone: Vec<usize> = (0..kept.len()).filter(|&a| !kept[a]).collect();
        let most = |x: &Point3| {
            let given = |a: &usize| self.sampler.prepared().ln_kernel(*a, x);
            gone.iter()
                .copied()
                .max_by(|a, b| given(a).total_cmp(&given(b)))
        };
        parallel::flat_map(holes.len(), |i| most(&holes[i]))
    }
}

/// Lattice points whose density was at `cap` or above, and is below `least` now.
fn holes(old: &BrickGrid, new: &BrickGrid, cap: f32, least: f32) -> Vec<Point3> {
    let lattice = *old.lattice();
    parallel::flat_map(lattice.len(), |i| {
        let p = lattice.coordinates(i);
        (old.at(p) >= cap && new.at(p) < least).then(|| lattice.point(p))
    })
}

/// The samples that an elimination watches, in cells.
fn samples_of(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    sampling: &Options,
    options: &Elimination,
    eps: f64,
) -> Result<Vec<SampleCell>, Error> {
    let wanted = Wanted {
        band: sampling.band,
        ends: false,
        interior: (options.interior == Interior::KeepSolid).then_some(2),
        eps,
        max_memory: options.max_memory,
    };
    samples::collect(sampler, grid, &wanted)
}

/// The atoms that may go, those first that change the density least (Eq. 3.9); equal ones by index.
fn order_of_trial(
    sampler: &PointSampler<'_>,
    cells: &[SampleCell],
    run: On<'_>,
) -> Result<Vec<u32>, Error> {
    let model = sampler.prepared().model();
    run.progress("errors per atom", 0, 1)?;
    let mut errors = Vec::new();
    run.backend
        .atom_errors(sampler.prepared(), cells, &mut errors)?;
    check_per_atom(&run.backend.name(), "errors", errors.len(), model.atoms())?;
    let mut order: Vec<u32> = (0..model.atoms() as u32)
        .filter(|&a| !model.is_protected(a as usize))
        .collect();
    order.par_sort_by(|&a, &b| {
        let error = |a: u32| errors[a as usize];
        error(a).total_cmp(&error(b)).then(a.cmp(&b))
    });
    Ok(order)
}

/// The loop of Algorithm 1.
struct Trial<'a> {
    order: &'a [u32],
    epsilon: f64,
    stop: Stop,
}

impl Trial<'_> {
    /// Tries the atoms in their order, batch by batch, and removes those that may go.
    fn run(
        &self,
        mut state: State<'_>,
        kept: &mut [bool],
        report: &mut EliminationReport,
        run: On<'_>,
    ) -> Result<(), Error> {
        let total = self.order.len() as u64;
        for (batch, atoms) in self.order.chunks(BATCH).enumerate() {
            run.progress("elimination", (batch * BATCH) as u64, total)?;
            let losses = state.losses_without(atoms, self.epsilon);
            state.start_batch();
            for (&atom, loss) in atoms.iter().zip(losses) {
                // Atoms that went in the meantime only raise a loss, and only where they mattered.
                let loss = loss.and_then(|loss| state.loss_now(atom, loss, self.epsilon));
                let Some(loss) = loss else {
                    report.first_failure.get_or_insert(atom);
                    if self.stop == Stop::FirstFailure {
                        return Ok(());
                    }
                    continue;
                };
                state.remove(atom);
                kept[atom as usize] = false;
                report.worst_loss = report.worst_loss.max(loss);
            }
        }
        Ok(())
    }
}

/// Atoms that are tried side by side before they are tried in order. A fixed number, so that the result does
/// not depend on the threads.
const BATCH: usize = 64;

/// Where an atom stands: in which cell, and as which of its atoms.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    cell: u32,
    atom: u32,
}

/// The current sums at all samples.
struct State<'a> {
    cells: &'a [SampleCell],
    sums: Vec<CellSums<f32>>,
    /// Has an atom of this batch been removed from the cell?
    changed: Vec<bool>,
    /// Where each atom's places start.
    starts: Vec<usize>,
    /// Atom by atom.
    places: Vec<Place>,
    left: Vec<f64>,
    rows: Vec<ChangedRow>,
}

impl<'a> State<'a> {
    fn new(model: &Prepared<'_>, cells: &'a [SampleCell], max_memory: u64) -> Result<Self, Error> {
        let model = model.model();
        let numbers: u128 = cells
            .iter()
            .map(|c| {
                c.points.len().next_multiple_of(8) as u128 * (2 * c.nodes() - c.atoms.len()) as u128
            })
            .sum();
        if numbers * 4 > u128::from(max_memory) {
            return Err(Error::TooManySamples {
                samples: cells.iter().map(|c| c.points.len()).sum(),
                bytes: numbers * 4,
                limit: max_memory,
            });
        }
        let sums = parallel::map_each_init(cells, cells::Scratch::default, |scratch, cell| {
            cells::sums_of_cell(cell, model, scratch)
        });
        let mut counts = vec![0u32; model.atoms()];
        for &a in cells.iter().flat_map(|c| &c.atoms) {
            counts[a as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut places = vec![Place::default(); starts[model.atoms()]];
        for (c, cell) in cells.iter().enumerate() {
            for (k, &a) in cell.atoms.iter().enumerate() {
                places[next[a as usize]] = Place {
                    cell: c as u32,
                    atom: k as u32,
                };
                next[a as usize] += 1;
            }
        }
        Ok(Self {
            changed: vec![false; cells.len()],
            cells,
            sums,
            starts,
            places,
            left: Vec::new(),
            rows: Vec::new(),
        })
    }

    fn places(&self, atom: u32) -> &[Place] {
        &self.places[self.starts[atom as usize]..self.starts[atom as usize + 1]]
    }

    /// For each atom the largest share of its density that a sample loses without it, if all are within
    /// `epsilon`.
    /// Side by side, from the sums as they stand at the start of a batch: [`State::loss_now`] mends what the batch
    /// itself has changed since.
    fn losses_without(&self, atoms: &[u32], epsilon: f64) -> Vec<Option<f64>> {
        parallel::map_each_init(atoms, Vec::new, |left, &atom| {
            let mut worst = 0.0;
            for &place in self.places(atom) {
                worst = self.loss_at(place, epsilon, left)?.max(worst);
            }
            Some(worst)
        })
    }

    /// Forgets which cells have changed.
    fn start_batch(&mut self) {
        self.changed.fill(false);
    }

    /// The same for one atom, given the loss from before the cells changed that have changed.
    fn loss_now(&mut self, atom: u32, before: f64, epsilon: f64) -> Option<f64> {
        let mut left = std::mem::take(&mut self.left);
        let mut worst = Some(before);
        for &place in self.places(atom) {
            if self.changed[place.cell as usize] {
                let loss = self.loss_at(place, epsilon, &mut left);
                worst = worst.zip(loss).map(|(a, b)| a.max(b));
                if worst.is_none() {
                    break;
                }
            }
        }
        self.left = left;
        worst
    }

    /// The largest loss in a cell without one of its atoms, if it is within `epsilon`.
    fn loss_at(&self, place: Place, epsilon: f64, left: &mut Vec<f64>) -> Option<f64> {
        let c = place.cell as usize;
        let (cell, sums) = (&self.cells[c], &self.sums[c]);
        let worst = sums.loss_without(cell, place.atom as usize, left);
        (worst <= epsilon).then_some(worst)
    }

    /// Removes an atom from every cell that it matters in, and marks these as changed.
    fn remove(&mut self, atom: u32) {
        for at in self.starts[atom as usize]..self.starts[atom as usize + 1] {
            let Place { cell: c, atom } = self.places[at];
            let (cell, sums) = (&self.cells[c as usize], &mut self.sums[c as usize]);
            sums.remove(cell, atom as usize, &mut self.left, &mut self.rows);
            self.changed[c as usize] = true;
        }
    }
}
