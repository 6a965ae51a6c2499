//! Products of operators with blocks of vectors: the hot kernels of the eigen-solver.

use super::multigrid::Rounded;
use super::{Error, Multigrid, Operator};
use crate::algebra::Error as MatrixError;
use crate::{Agreement, Backend, Cpu};

/// Where block products run. They work in f32 and propose directions; what becomes of them is decided
/// in f64 on the CPU.
pub trait SpectralBackend: Backend {
    /// `A X` for a block of `columns` vectors, row after row: `rows · columns` values.
    fn apply_block(
        &self,
        operator: Operator<'_>,
        block: &[f32],
        columns: usize,
    ) -> Result<Vec<f32>, Error>;

    /// Gets ready for V-cycles of a hierarchy, whose matrices stay where the cycles run.
    fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, Error>;
}

/// V-cycles of one [`Multigrid`] hierarchy.
pub trait Cycle {
    /// One V-cycle from zero for a block of right-hand sides: an approximation of `A⁻¹ B`.
    fn run(&self, block: &[f32], columns: usize) -> Result<Vec<f32>, Error>;
}

/// What a backend owes to [`SpectralBackend::apply_block`] in f64, for rows with absolute sums up to 1
/// and blocks of values up to 1: f32 sums of at most 100 terms. Confirmed on llvmpipe.
pub const APPLY_BLOCK: Agreement = Agreement::Bounded {
    relative: 1e-5,
    absolute: 1e-5,
};

/// What a backend owes to a [`Cycle`] in f64, in units of the largest value of the result: some tens
/// of products one after the other. Confirmed on llvmpipe.
pub const CYCLE: Agreement = Agreement::Bounded {
    relative: 1e-3,
    absolute: 1e-4,
};

/// A block of other size than the operator is an error.
pub(super) fn check_block(rows: usize, found: usize, columns: usize) -> Result<(), Error> {
    let expected = rows * columns;
    if found != expected {
        return Err(MatrixError::RightHandSide { found, expected }.into());
    }
    Ok(())
}

impl SpectralBackend for Cpu {
    fn apply_block(
        &self,
        operator: Operator<'_>,
        block: &[f32],
        columns: usize,
    ) -> Result<Vec<f32>, Error> {
        check_block(operator.rows(), block.len(), columns)?;
        Ok(Rounded::of(operator).multiply(block, columns))
    }

    fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, Error> {
        Ok(Box::new(hierarchy))
    }
}

/// In f32 on the CPU.
impl Cycle for &Multigrid<'_> {
    fn run(&self, block: &[f32], columns: usize) -> Result<Vec<f32>, Error> {
        check_block(self.rows(), block.len(), columns)?;
        Ok(self.cycle(block, columns))
    }
}
