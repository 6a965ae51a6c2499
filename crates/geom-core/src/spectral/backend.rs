//! The products of matrices with blocks: the hot kernels of the eigen-solver.

use super::Error;
use crate::linalg::SparseMatrix;
use crate::{Agreement, Backend, Cpu};

/// Where block products run.
pub trait SpectralBackend: Backend {
    /// `A X` for a block of `columns` vectors, row after row: `rows · columns` values.
    fn apply_block(
        &self,
        matrix: &SparseMatrix,
        block: &[f32],
        columns: usize,
    ) -> Result<Vec<f32>, Error>;
}

/// What a backend owes to [`SpectralBackend::apply_block`] on [`Cpu`], for matrices whose rows have
/// entries of size 1 and blocks of values up to 1: f32 sums of at most 64 terms.
pub const APPLY_BLOCK: Agreement = Agreement::Bounded {
    relative: 1e-5,
    absolute: 1e-5,
};

impl SpectralBackend for Cpu {
    fn apply_block(
        &self,
        matrix: &SparseMatrix,
        block: &[f32],
        columns: usize,
    ) -> Result<Vec<f32>, Error> {
        let wide: Vec<f64> = block.iter().map(|&x| f64::from(x)).collect();
        Ok(matrix
            .multiply(&wide, columns)
            .into_iter()
            .map(|y| y as f32)
            .collect())
    }
}
