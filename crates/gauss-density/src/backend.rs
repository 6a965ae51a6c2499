//! The hot kernels of this crate, and what agreement each owes to the specification.

use geom_core::grid::{BRICK, Brick};
use geom_core::{Agreement, Backend, Lattice};

use crate::error::Error;
use crate::options::Cutoff;
use crate::prepared::Prepared;
use crate::sites::SiteCell;
use crate::terms::RefitSums;

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
    pub(crate) fn clear(&mut self, block: &Block) {
        self.kinds.clear();
        self.kinds.resize(block.len(), Brick::Exterior);
        self.values.clear();
        self.pairs = 0;
    }
}

/// The hot kernels of this crate. [`Cpu`](geom_core::Cpu) follows the plain function
/// [`nested_sum`](crate::nested_sum).
pub trait DensityBackend: Backend {
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
    /// terms below 0 left out (Eq. 3.9 squared, corrected).
    fn atom_errors(&self, model: &Prepared<'_>, cells: &[SiteCell]) -> Result<Vec<f64>, Error>;

    /// The objective of the refit (Eq. 3.11) over the points of the cells, and its first derivatives and
    /// the diagonal of its Gauss–Newton matrix per atom of the model (Eq. 3.13).
    fn refit_sums(&self, model: &Prepared<'_>, cells: &[SiteCell]) -> Result<RefitSums, Error>;
}

/// What a backend owes to [`nested_sum`](crate::nested_sum), besides what the cut-off allows, where the
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
