//! The hot kernels, and what each backend owes.

use geom_core::{Agreement, Backend};

use crate::Error;

/// Points per side of a block: 8 finest cells, closed.
pub const BLOCK_SIDE: usize = 9;
/// Values per block, x fastest.
pub const BLOCK_POINTS: usize = BLOCK_SIDE * BLOCK_SIDE * BLOCK_SIDE;
/// Finest cells per block, x fastest.
pub const BLOCK_CELLS: usize = 512;

/// Where the kernels of this crate run.
pub trait ContourBackend: Backend {
    /// How many blocks, or the cells with a surface of how many, one call gets where there are more.
    /// Calls come from several threads.
    fn blocks_per_call(&self) -> usize;

    /// The lowest and the highest of each block's [`BLOCK_POINTS`] values. Owes [`MIN_MAX`].
    fn min_max(&self, blocks: &[f32]) -> Result<Vec<[f32; 2]>, Error>;

    /// For each of the [`BLOCK_CELLS`] cells of each block: bit `x + 2y + 4z` is set if that corner's
    /// value is at least `level`. Owes [`CROSSINGS`].
    fn crossings(&self, blocks: &[f32], level: f32) -> Result<Vec<u8>, Error>;

    /// The dual vertex of each cell from its corner values *minus the level* (corner `x + 2y + 4z`),
    /// in units of the cell: the mean of the crossings, then `steps` regularized Newton steps onto the
    /// level set of the trilinear interpolant. Owes [`DUAL_VERTICES`].
    fn dual_vertices(&self, cells: &[[f32; 8]], steps: u32) -> Result<Vec<[f32; 3]>, Error>;
}

/// Comparisons alone: the same bits.
pub const MIN_MAX: Agreement = Agreement::Exact;
/// Comparisons alone: the same bits.
pub const CROSSINGS: Agreement = Agreement::Exact;
/// In cells. Confirmed on lavapipe with random corner values; four Newton steps amplify the rounding
/// of f32, most where the interpolant is nearly flat.
pub const DUAL_VERTICES: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 1e-4,
};
