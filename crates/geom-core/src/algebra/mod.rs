//! Sparse matrices, their Cholesky factors, graphs, and the smallest eigenpairs: feature `algebra`. The only folder
//! that knows faer.
//!
//! - [`sparse`]: matrices in compressed rows; [`Mass`], the second matrix of a pencil
//! - [`cholesky`]: supernodal factors of real and Hermitian matrices (order, shape and complex factors by faer; George and
//!   Liu 1981 for the theory), many right-hand sides at once, inertia by L D Lᵀ
//! - [`iterate`]: iterative refinement and preconditioned conjugate gradients (Hestenes and Stiefel 1952)
//! - [`graph`]: Laplacians of voxel sets, of any weights, and joint ones (Eqs. 6.1 and 6.2)
//! - [`Operator`]: what the solver multiplies with, matrix or graph
//! - [`quadrature`]: Gauss's rule
//! - [`eigen`]: shift–invert block Lanczos, and block Davidson over algebraic multigrid
//!
//! A **block** of `c` vectors of length `n` is a slice of `n · c` numbers, row after row: value `i`
//! of vector `j` is `block[i * c + j]`. Products with a sparse matrix then read whole rows.
//!
//! Read [`sparse`] first, then [`cholesky`] for systems that are solved once and for all, or [`eigen`] for modes. What
//! is symmetric is stored in both halves, since products read rows; a factor reads one half.

pub mod cholesky;
pub(crate) mod dense;
pub mod eigen;
pub mod graph;
pub mod iterate;
mod mass;
mod operator;
pub mod quadrature;
pub mod sparse;
mod tall;

#[cfg(feature = "testing")]
#[doc(hidden)]
pub use cholesky::substitution;
pub use cholesky::{Cholesky, SignedFactor, SingleFactor, Symbolic};
pub use iterate::{Jacobi, LinearMap, Preconditioner, Solution, conjugate_gradients, refine};
pub use mass::Mass;
pub use operator::Operator;
pub use sparse::{Scalar, SparseMatrix};

use crate::options::OutOfRange;

/// Why a matrix cannot be made, factored or solved with.
///
/// Rows and columns are in the numbering of the matrix that was given, also where a factor has an order of its own.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An entry is NaN or infinite.
    #[error("the entry in row {row}, column {column} is not a finite number")]
    NotFinite {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
    },
    /// An entry lies outside of the matrix.
    #[error("an entry in row {row}, column {column} of a matrix of {rows} × {columns}")]
    OutOfRange {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// Rows of the matrix.
        rows: usize,
        /// Columns of the matrix.
        columns: usize,
    },
    /// The matrix has more rows or entries than its indices can name.
    #[error("a matrix of {rows} rows and {entries} entries is too large for 32-bit indices")]
    TooLarge {
        /// Rows.
        rows: usize,
        /// Entries, of the matrix or of its factor.
        entries: u128,
    },
    /// The matrix is not square, or another size is asked for.
    #[error("{what} has {found} rows, {expected} are needed")]
    Shape {
        /// What has the wrong size.
        what: &'static str,
        /// Its size.
        found: usize,
        /// The size it should have.
        expected: usize,
    },
    /// Row and column differ from column and row.
    #[error(
        "the matrix is not symmetric (Hermitian) in row {row}, column {column}; \
         a Cholesky factor needs that"
    )]
    NotSymmetric {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
    },
    /// A pivot is not positive.
    #[error(
        "the matrix is not positive definite: the pivot of row {row} is not positive; \
         add a positive multiple of the mass, or fix one value per component"
    )]
    NotPositiveDefinite {
        /// The row, in the numbering of the matrix.
        row: usize,
    },
    /// The matrix has another pattern than the one that was analysed.
    #[error("the pattern of entries differs from the analysed one; analyse this matrix anew")]
    OtherPattern,
    /// No memory for the factor.
    #[error("no memory for a factor of {entries} entries")]
    OutOfMemory {
        /// Entries of the factor, 0 when not even their number is known.
        entries: usize,
    },
    /// An option makes no sense.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// A right-hand side has the wrong length.
    #[error("a right-hand side of {found} values, {expected} are needed")]
    RightHandSide {
        /// Number of values given.
        found: usize,
        /// Rows × columns.
        expected: usize,
    },
    /// The norm of a right-hand side is beyond the largest number.
    #[error(
        "the right-hand side in column {column} is so large that its norm is no finite number; \
         divide it by a power of two, and the solution is divided too"
    )]
    RightHandSideTooLarge {
        /// The column.
        column: usize,
    },
}
