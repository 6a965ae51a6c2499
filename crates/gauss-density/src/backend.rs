//! The hot kernels of this crate, what they are handed, and what agreement each owes to the specification
//! (`specification`, under the feature `testing`).
//!
//! [`Cpu`](geom_core::Cpu) and `Wgpu` implement them, and so can a type of yours: here one that counts what
//! the CPU sums, and refuses to eliminate.
//!
//! ```
//! use std::sync::atomic::{AtomicU64, Ordering};
//!
//! use gauss_density::backend::{Block, BlockValues, Job, Prepared, RefitSamples, SampleCell};
//! use gauss_density::{DensityBackend, Elimination, Error, Model, Options, eliminate, sample_band};
//! use geom_core::compute::BackendError;
//! use geom_core::{Backend, Cpu, Point3, Run};
//!
//! #[derive(Default)]
//! struct Counting {
//!     pairs: AtomicU64,
//! }
//!
//! impl Backend for Counting {
//!     fn name(&self) -> String {
//!         "counting".to_owned()
//!     }
//! }
//!
//! impl DensityBackend for Counting {
//!     fn sample_blocks(
//!         &self,
//!         model: &Prepared<'_>,
//!         job: &Job,
//!         blocks: &[Block],
//!         results: &mut Vec<BlockValues>,
//!     ) -> Result<(), Error> {
//!         Cpu.sample_blocks(model, job, blocks, results)?;
//!         let pairs = results.iter().map(|r| r.pairs).sum();
//!         self.pairs.fetch_add(pairs, Ordering::Relaxed);
//!         Ok(())
//!     }
//!     fn atom_errors(
//!         &self,
//!         _: &Prepared<'_>,
//!         _: &[SampleCell],
//!         _: &mut Vec<f64>,
//!     ) -> Result<(), Error> {
//!         Err(BackendError::new("no elimination here").into())
//!     }
//!     fn refit_samples<'a>(
//!         &'a self,
//!         model: &Prepared<'_>,
//!         cells: &'a [SampleCell],
//!     ) -> Result<Box<dyn RefitSamples + 'a>, Error> {
//!         Cpu.refit_samples(model, cells)
//!     }
//! }
//!
//! # fn main() -> Result<(), Error> {
//! let model = Model::new(vec![Point3::origin()], vec![1.7], vec![1.0], vec![])?;
//! let counting = Counting::default();
//! let band = sample_band(&model, &Options::default(), Run::on(&counting))?;
//! assert_eq!(band.report.backend, "counting");
//! assert_eq!(band.report.pairs, counting.pairs.into_inner());
//! let error = eliminate(&model, &Elimination::default(), Run::on(&Counting::default()));
//! assert_eq!(error.unwrap_err().to_string(), "no elimination here");
//! # Ok(())
//! # }
//! ```

use geom_core::compute::BackendError;
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Agreement, Backend, Lattice, Point3, Vector3};

use crate::error::Error;
pub use crate::kernel::prepared::Prepared;
use crate::model::{Level, Model};
use crate::options::Cutoff;

/// Bricks per side of a block.
pub const BLOCK: usize = 4;
/// Lattice points per side of a block.
pub const BLOCK_POINTS: usize = BLOCK * BRICK;

/// A block of 4 × 4 × 4 bricks and the atoms that can matter there.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// The brick at its lowest corner.
    pub brick: [usize; 3],
    /// Bricks per axis: 4, less at the far end of the lattice.
    pub bricks: [usize; 3],
    /// Which of its bricks are asked for: bit `i` is the `i`-th one, x fastest.
    pub mask: u64,
    /// Atoms, ascending.
    pub atoms: Vec<u32>,
}

impl Block {
    /// Number of bricks.
    pub fn len(&self) -> usize {
        self.bricks.iter().product()
    }
    /// Has the block no bricks?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Is the `i`-th brick asked for?
    pub fn wants(&self, i: usize) -> bool {
        self.mask >> i & 1 == 1
    }
    /// Brick coordinates in the lattice, of the `i`-th brick of the block (x fastest).
    pub fn brick_at(&self, i: usize) -> [usize; 3] {
        let [nx, ny, _] = self.bricks;
        let local = [i % nx, i / nx % ny, i / (nx * ny)];
        [0, 1, 2].map(|k| self.brick[k] + local[k])
    }
    /// Which brick of the block has these coordinates in the lattice: the inverse of [`Block::brick_at`].
    pub fn place_of(&self, brick: [usize; 3]) -> usize {
        place_in(self.bricks, [0, 1, 2].map(|k| brick[k] - self.brick[k]))
    }
}

/// The place of a brick among those of a block of so many per axis, x fastest.
pub(crate) fn place_in(bricks: [usize; 3], [x, y, z]: [usize; 3]) -> usize {
    (z * bricks[1] + y) * bricks[0] + x
}

/// What to compute in each brick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Job {
    /// The lattice.
    pub lattice: Lattice,
    /// What is left out.
    pub cutoff: Cutoff,
    /// Bricks whose density stays below are exterior.
    pub floor: f64,
    /// Bricks whose values all reach this are interior; infinite: none is.
    pub ceiling: f64,
}

/// The bricks of a block.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockValues {
    /// Kind per brick, x fastest; stored ones numbered from 0 within the block. What was not asked for is
    /// `Exterior`.
    pub kinds: Vec<Brick>,
    /// 512 values per stored brick, x fastest.
    pub values: Vec<f32>,
    /// Pairs of an atom and a point that were evaluated.
    pub pairs: u64,
}

impl BlockValues {
    /// No values, and no brick but exterior ones; the arrays stay allocated.
    pub fn clear(&mut self, block: &Block) {
        self.kinds.clear();
        self.kinds.resize(block.len(), Brick::Exterior);
        self.values.clear();
        self.pairs = 0;
    }
}

/// Points that share the atoms that matter around them.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleCell {
    /// Atoms, ascending.
    pub atoms: Vec<u32>,
    /// The tree above them, lowest level first.
    pub(crate) levels: Vec<Level>,
    /// Per level: the node above each atom (level 0) or node.
    pub(crate) parents: Vec<Vec<u32>>,
    /// The points.
    pub points: Vec<Point3>,
    /// The density of all original atoms at each point.
    pub exact: Vec<f64>,
    /// What counts as the full density at each point: the density, or less in the interior.
    pub target: Vec<f64>,
}

impl SampleCell {
    pub(crate) fn new(atoms: Vec<u32>, levels: Vec<Level>, points: Vec<Point3>) -> Self {
        let parents = levels.iter().map(Level::parents).collect();
        Self {
            atoms,
            levels,
            parents,
            exact: Vec::with_capacity(points.len()),
            target: Vec::with_capacity(points.len()),
            points,
        }
    }

    /// The points whose density is at least `floor`.
    pub(crate) fn at_least(mut self, floor: f64) -> Self {
        let kept: Vec<usize> = (0..self.points.len())
            .filter(|&i| self.exact[i] >= floor)
            .collect();
        self.points = kept.iter().map(|&i| self.points[i]).collect();
        self.target = kept.iter().map(|&i| self.target[i]).collect();
        self.exact = kept.iter().map(|&i| self.exact[i]).collect();
        self
    }

    /// Nodes of the topmost level, or atoms.
    pub(crate) fn children_of_root(&self) -> usize {
        self.levels.last().map_or(self.atoms.len(), Level::len)
    }

    /// Nodes of all levels and atoms.
    pub(crate) fn nodes(&self) -> usize {
        self.atoms.len() + self.levels.iter().map(Level::len).sum::<usize>()
    }
}

/// What a refit step needs from a set of points: see [`DensityBackend`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RefitSums {
    /// `½ Σ w (G − G0)²` with `w = 1 / G0²`.
    pub objective: f64,
    /// The largest `|G − G0| / G0`.
    pub worst: f64,
    /// Per atom: `Σ w (G − G0) ∂G/∂p` for p = x, y, z, r, κ.
    pub gradient: Vec<[f64; 5]>,
    /// Per atom: `Σ w (∂G/∂p)²`.
    pub curvature: Vec<[f64; 5]>,
}

impl RefitSums {
    /// Are the lists those of a model of so many atoms?
    pub(crate) fn check_lengths(&self, name: &str, atoms: usize) -> Result<(), Error> {
        check_per_atom(name, "gradients", self.gradient.len(), atoms)?;
        check_per_atom(name, "curvatures", self.curvature.len(), atoms)
    }

    /// Is every number finite? A step from others would lead nowhere.
    pub(crate) fn check_finite(&self, name: &str) -> Result<(), Error> {
        let derivatives = [&self.gradient, &self.curvature];
        let mut derivatives = derivatives.into_iter().flat_map(|d| d.as_flattened());
        let (objective, worst) = (self.objective, self.worst);
        BackendError::unless(objective.is_finite() && worst.is_finite(), name, || {
            format!("an objective of {objective}, with a largest error of {worst}, for the refit")
        })?;
        Ok(BackendError::unless(
            derivatives.all(|d| d.is_finite()),
            name,
            || "derivatives that are not finite for the refit".to_owned(),
        )?)
    }
}

/// Do the answers to [`DensityBackend::sample_blocks`] fit the blocks? (Values that are not finite are refused by
/// the grid that they come into.)
pub(crate) fn check_blocks(
    name: &str,
    blocks: &[Block],
    results: &[BlockValues],
) -> Result<(), Error> {
    let (found, expected) = (results.len(), blocks.len());
    BackendError::unless(found == expected, name, || {
        format!("{found} results for {expected} blocks")
    })?;
    for (block, result) in blocks.iter().zip(results) {
        let (kinds, bricks) = (result.kinds.len(), block.len());
        BackendError::unless(kinds == bricks, name, || {
            format!("{kinds} kinds for a block of {bricks} bricks")
        })?;
        let values = result.values.len();
        BackendError::unless(values.is_multiple_of(BRICK_POINTS), name, || {
            format!("{values} values of a block, which must be {BRICK_POINTS} per stored brick")
        })?;
        let stored = values / BRICK_POINTS;
        for kind in &result.kinds {
            if let Brick::Stored(s) = *kind {
                BackendError::unless((s as usize) < stored, name, || {
                    format!("the number {s} to one of {stored} stored bricks")
                })?;
            }
        }
    }
    Ok(())
}

/// Is there one number per atom?
pub(crate) fn check_per_atom(
    name: &str,
    what: &str,
    found: usize,
    atoms: usize,
) -> Result<(), Error> {
    Ok(BackendError::unless(found == atoms, name, || {
        format!("{found} {what} for {atoms} atoms")
    })?)
}

/// Adds the sums of cells, in their order, to the sums per atom of the model.
pub(crate) fn scatter<T, const N: usize>(
    cells: &[SampleCell],
    parts: &[T],
    atoms: usize,
    values: impl Fn(&T, usize) -> [f64; N],
) -> Vec<[f64; N]> {
    let mut sums = vec![[0.0; N]; atoms];
    for (cell, part) in cells.iter().zip(parts) {
        for (i, &a) in cell.atoms.iter().enumerate() {
            for (sum, value) in sums[a as usize].iter_mut().zip(values(part, i)) {
                *sum += value;
            }
        }
    }
    sums
}

/// The same for one sum per atom; whatever `sums` held is lost.
pub(crate) fn scatter_into<T>(
    cells: &[SampleCell],
    parts: &[T],
    atoms: usize,
    value: impl Fn(&T, usize) -> f64,
    sums: &mut Vec<f64>,
) {
    sums.clear();
    sums.extend(scatter(cells, parts, atoms, |part, i| [value(part, i)]).into_flattened());
}

/// The hot kernels of this crate.
pub trait DensityBackend: Backend + DensityObject {
    /// Blocks that one call of [`DensityBackend::sample_blocks`] is given at most. Here as many that hardly a thread waits for
    /// the last one, and so few that their values, 128 KiB each at most, stay in the cache.
    fn blocks_per_call(&self) -> usize {
        256
    }

    /// Cull, density and classification of every brick of the blocks, in one go; one result per block.
    /// Whatever `results` held is lost, but its memory may be used again.
    fn sample_blocks(
        &self,
        model: &Prepared<'_>,
        job: &Job,
        blocks: &[Block],
        results: &mut Vec<BlockValues>,
    ) -> Result<(), Error>;

    /// Per atom of the model: `Σ ((target − G without the atom) / target)²` over the points of the cells,
    /// terms below 0 left out (Eq. 3.9 squared, corrected). Whatever `errors` held is lost.
    fn atom_errors(
        &self,
        model: &Prepared<'_>,
        cells: &[SampleCell],
        errors: &mut Vec<f64>,
    ) -> Result<(), Error>;

    /// Takes the samples of a refit, in cells of the atoms and the tree of a model, to where they stay from trial to
    /// trial.
    fn refit_samples<'a>(
        &'a self,
        model: &Prepared<'_>,
        cells: &'a [SampleCell],
    ) -> Result<Box<dyn RefitSamples + 'a>, Error>;

    /// Takes a model to where it stays, to be asked at many points; `None`, as by default, where the sampler itself, on
    /// the vectors of the CPU, is as good.
    fn point_kernel(&self, _cells: &PointCells<'_>) -> Result<Option<Box<dyn PointKernel>>, Error> {
        Ok(None)
    }
}

/// The samples of a refit, where a backend keeps them.
pub trait RefitSamples {
    /// The objective of the refit (Eq. 3.11) over the samples, and its first derivatives and the diagonal of its
    /// Gauss–Newton matrix per atom (Eq. 3.13), of a model that differs from the one at the start in centres, radii and
    /// decays alone. Whatever `sums` held is lost. Owes [`REFIT_SUMS`].
    fn sums(&mut self, model: &Model, sums: &mut RefitSums) -> Result<(), Error>;
}

/// A model, and the atoms that matter in each cell of space.
#[derive(Clone, Copy, Debug)]
pub struct PointCells<'a> {
    /// The model.
    pub model: &'a Prepared<'a>,
    /// Per cell: where its atoms start, and their number at the end.
    pub starts: &'a [usize],
    /// Atoms, ascending in each cell.
    pub atoms: &'a [u32],
}

/// A point, and the cell that it lies in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellPoint {
    /// The point, Å.
    pub at: Point3,
    /// Number of the cell.
    pub cell: u32,
}

/// A model that a backend keeps, to be asked at many points.
pub trait PointKernel: Send + Sync {
    /// The density and its gradient (per Å) at each point, of the atoms of its cell, in place of what was in `out`.
    /// Owes [`AT_POINTS`].
    fn values_gradients(
        &self,
        points: &[CellPoint],
        out: &mut Vec<(f64, Vector3)>,
    ) -> Result<(), BackendError>;
}

geom_core::backend_object!(DensityObject, as_density -> DensityBackend);

/// A run on any of them.
pub(crate) type On<'a> = geom_core::Run<'a, dyn DensityBackend + 'a>;

/// What a backend owes to the nested sum of the specification, besides what the cut-off allows, where the
/// density is at least the floor: f32 sums of positive terms. Seen on llvmpipe; no hardware GPU was at hand.
pub const SAMPLE_BLOCKS: Agreement = Agreement::Bounded {
    relative: 2e-4,
    absolute: 1e-19,
};

/// What a backend owes for the squared errors per atom: a square of differences of f32 sums.
pub const ATOM_ERRORS: Agreement = Agreement::Bounded {
    relative: 2e-3,
    absolute: 1e-6,
};

/// What a backend owes for the sums of a refit, each relative to the largest of its kind.
pub const REFIT_SUMS: Agreement = Agreement::Bounded {
    relative: 2e-3,
    absolute: 2e-4,
};

/// What a backend owes at points: the value relative to itself, the gradient relative to its own length and the value
/// per Å, at densities below 10³⁰. Roots on the surface are off by as much of an Å at most where the slope is 1 per Å.
pub const AT_POINTS: Agreement = Agreement::Bounded {
    relative: 2e-5,
    absolute: 1e-30,
};
