//! The second matrix of a pencil.

use super::SparseMatrix;

/// The mass of the rows: the second matrix of `K x = λ M x`. Of a surface it is that of the vertices, Å²
/// ([`lumped_mass`](crate::surface::laplace::lumped_mass)); of a graph it is 1 or the degrees. All masses are positive;
/// 0 is allowed where the stiffness has no entry either, and takes that row out of the pencil.
#[derive(Clone, Debug, PartialEq)]
pub enum Mass {
    /// A diagonal matrix: one value per row. Shift–invert takes its roots onto both sides and has an ordinary
    /// symmetric problem.
    Lumped(Vec<f64>),
    /// A sparse positive definite matrix. Every step of a solver pays for one product more.
    Consistent(SparseMatrix),
}
