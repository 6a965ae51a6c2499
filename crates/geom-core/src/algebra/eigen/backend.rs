//! The seam of the eigen-solver: V-cycles of a multigrid hierarchy, wherever they run.
//!
//! A backend is handed a [`Multigrid`] and gets ready for its V-cycles; all that a cycle needs can be read from the
//! [`Level`]s. What it gives are directions, in f32: what becomes of them is decided in f64 on the CPU, so that a
//! poor cycle costs steps, never digits. Shift–invert, the method for surfaces, runs on the CPU whatever the backend.
//!
//! A backend from outside, which takes the diagonal of the finest level for the whole operator (Jacobi), so that it
//! needs more steps than a cycle:
//!
//! ```
//! use geom_core::algebra::eigen::backend::{Cycle, Multigrid, SpectralBackend};
//! use geom_core::algebra::eigen::{Error, Options, eigenpairs};
//! use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
//! use geom_core::compute::BackendError;
//! use geom_core::{Backend, Run};
//!
//! struct Jacobi;
//! impl Backend for Jacobi {
//!     fn name(&self) -> String {
//!         "Jacobi".into()
//!     }
//! }
//! impl SpectralBackend for Jacobi {
//!     fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, Error> {
//!         let finest = hierarchy.levels().first();
//!         let level = finest.ok_or_else(|| BackendError::new("a part too small for levels"))?;
//!         Ok(Box::new(Diagonal(&level.inverse_diagonal)))
//!     }
//! }
//! struct Diagonal<'a>(&'a [f32]);
//! impl Cycle for Diagonal<'_> {
//!     fn run(&self, block: &[f32], columns: usize, out: &mut Vec<f32>) -> Result<(), Error> {
//!         out.clear();
//!         for (row, inverse) in block.chunks(columns).zip(self.0) {
//!             out.extend(row.iter().map(|x| x * inverse));
//!         }
//!         Ok(())
//!     }
//! }
//!
//! // A rod of 4 × 4 × 40 voxels; its slowest mode runs along it.
//! let rod = VoxelGraph::new([4, 4, 40], &[true; 640], Neighbours::Six, [1.0; 3])?;
//! let laplacian = Laplacian::of_voxels(rod);
//! let options = Options { tolerance: 1e-6, ..Options::default() };
//! let pairs = eigenpairs(&laplacian, &laplacian.mass(), 2, &options, Run::on(&Jacobi))?;
//! assert_eq!(pairs.report.backend, "Jacobi");
//! let exact = 2.0 - 2.0 * (std::f64::consts::PI / 40.0).cos();
//! assert!((pairs.values[1] / exact - 1.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::Error;
use crate::algebra::Error as MatrixError;
use crate::{Agreement, Backend, Cpu};

pub use super::multigrid::{CompressedRows, Level, Multigrid, RoundedOperator};

/// Where the V-cycles of the eigen-solver run.
pub trait SpectralBackend: Backend + SpectralObject {
    /// Gets ready for V-cycles of a hierarchy, whose matrices stay where the cycles run.
    fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, Error>;
}

crate::backend_object!(SpectralObject, as_spectral -> SpectralBackend);

/// A run on any of them.
pub(super) type On<'a> = crate::Run<'a, dyn SpectralBackend + 'a>;

/// V-cycles of one [`Multigrid`] hierarchy.
pub trait Cycle {
    /// One V-cycle from zero for a block of right-hand sides, row after row of `columns` values: an approximation of
    /// `A⁻¹ B` of the same size. `out` is replaced, its memory used again.
    fn run(&self, block: &[f32], columns: usize, out: &mut Vec<f32>) -> Result<(), Error>;
}

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
    fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, Error> {
        Ok(Box::new(hierarchy))
    }
}

/// In f32 on the CPU.
impl Cycle for &Multigrid<'_> {
    fn run(&self, block: &[f32], columns: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        check_block(self.rows(), block.len(), columns)?;
        self.cycle(block, columns, out);
        Ok(())
    }
}
