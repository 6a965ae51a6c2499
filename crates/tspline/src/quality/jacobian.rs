//! How good the elements of a T-mesh are.

pub use geom_core::mesh::quality::JacobianSummary;
use geom_core::mesh::quality::{scaled_jacobian, upright_jacobian};
use geom_core::{Point3, Vector3};

use super::cells::Cells;
use crate::TMesh;
use crate::options::Method;

/// The scaled Jacobian of each element: the smallest signed sine between two edges that meet in a corner; 1 for a
/// rectangle, negative where a corner is turned inside out. Elements with T-junctions are cut there first. `normals` are
/// those of the surface at the vertices.
pub fn scaled_jacobians(mesh: &TMesh, normals: &[Vector3]) -> Vec<f64> {
    let cells = Cells::new(mesh, mesh.positions(), Method::Corners);
    (0..mesh.elements().len())
        .map(|e| of_element(&cells, e, mesh.positions(), normals))
        .collect()
}

/// The scaled Jacobian of one element.
pub(crate) fn of_element(
    cells: &Cells,
    e: usize,
    positions: &[Point3],
    normals: &[Vector3],
) -> f64 {
    over_quads(cells, e, positions, normals, scaled_jacobian)
}

/// As [`of_element`], by [`upright_jacobian`].
pub(crate) fn upright(cells: &Cells, e: usize, positions: &[Point3], normals: &[Vector3]) -> f64 {
    over_quads(cells, e, positions, normals, upright_jacobian)
}

/// The least of the quads of an element, each seen along the sum of the element's normals.
fn over_quads(
    cells: &Cells,
    e: usize,
    positions: &[Point3],
    normals: &[Vector3],
    of: impl Fn(&[Point3; 4], &Vector3) -> f64,
) -> f64 {
    let quads = cells.of_element(e);
    let vertices = quads
        .iter()
        .flatten()
        .filter(|&&n| (n as usize) < normals.len());
    let normal: Vector3 = vertices.map(|&n| normals[n as usize]).sum();
    let of = |quad: &[u32; 4]| of(&quad.map(|n| cells.node(n, positions)), &normal);
    quads.iter().map(of).fold(f64::INFINITY, f64::min)
}
