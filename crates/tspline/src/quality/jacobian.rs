//! How good the elements of a T-mesh are.

use geom_core::TriMesh;
pub use geom_core::mesh::quality::JacobianSummary;
use geom_core::surface::flow::{Places, Vertices};
use geom_core::surface::ground::Freedom;

use super::cells::Cells;
use super::components::Surface;
use crate::options::Method;
use crate::{Error, TMesh};

/// The scaled Jacobian of each element: the smallest signed sine between two edges that meet in a corner; 1 for a
/// rectangle, negative where a corner is turned inside out, as seen along the normals of the surface that the mesh is on.
/// Elements with T-junctions are cut there first.
///
/// # Errors
/// [`Error::Tree`] for a surface without triangles.
pub fn scaled_jacobians(mesh: &TMesh, surface: &TriMesh) -> Result<Vec<f64>, Error> {
    let components = surface.components();
    let surface = Surface::of(&components, None, false)?;
    let part = surface.parts(mesh.fine())?;
    let positions = mesh.positions();
    let vertices = Vertices::on_parts(
        positions.to_vec(),
        vec![Freedom::Fixed; positions.len()],
        &surface.grounds,
        (0..positions.len())
            .map(|v| part[mesh.fine_of_vertex(v) as usize])
            .collect(),
    );
    let cells = Cells::new(mesh, positions, Method::Corners);
    let places = Places::of(&vertices);
    let elements = 0..mesh.elements().len();
    Ok(elements.map(|e| cells.jacobian(e, &places)).collect())
}
