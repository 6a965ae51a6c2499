//! The second matrix of a pencil.

use super::SparseMatrix;

/// The mass of the rows: the second matrix of `K x = λ M x`. Of a surface it is that of the vertices, Å²
/// ([`lumped_mass`](crate::surface::laplace::lumped_mass)); of a graph it is 1 or the degrees.
#[derive(Clone, Debug, PartialEq)]
pub enum Mass {
    /// A diagonal matrix: one value per row.
    Lumped(Vec<f64>),
    /// A sparse positive definite matrix.
    Consistent(SparseMatrix),
}
