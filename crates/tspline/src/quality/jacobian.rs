//! How good the elements of a T-mesh are.

use geom_core::Vector3;
pub use geom_core::mesh::quality::JacobianSummary;

use super::cells::Cells;
use crate::TMesh;
use crate::options::Method;

/// The scaled Jacobian of each element: the smallest signed sine between two edges that meet in a corner; 1 for a
/// rectangle, negative where a corner is turned inside out. Elements with T-junctions are cut there first. `normals` are
/// those of the surface at the vertices.
pub fn scaled_jacobians(mesh: &TMesh, normals: &[Vector3]) -> Vec<f64> {
    let cells = Cells::new(mesh, mesh.positions(), Method::Corners);
    (0..mesh.elements().len())
        .map(|e| cells.jacobian_at(e, mesh.positions(), normals))
        .collect()
}
