//! How good the elements of a T-mesh are.

use geom_core::{Point3, Vector3};

use super::cells::Cells;
use crate::TMesh;
use crate::options::Method;

/// Signed scaled Jacobians of all elements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Jacobians {
    /// The smallest.
    pub min: f64,
    /// One in twenty is smaller.
    pub percentile_5: f64,
    /// The mean.
    pub mean: f64,
    /// Elements below 0.3.
    pub below_0_3: usize,
    /// The smallest if inverted corners counted as upright ones: what tables of the literature may mean.
    pub unsigned_min: f64,
}

impl Jacobians {
    /// Of these values.
    pub fn of(values: &[f64]) -> Self {
        if values.is_empty() {
            return Self::default();
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self {
            min: sorted[0],
            percentile_5: sorted[(sorted.len() - 1) / 20],
            mean: values.iter().sum::<f64>() / values.len() as f64,
            below_0_3: values.iter().filter(|&&j| j < 0.3).count(),
            unsigned_min: values.iter().fold(f64::INFINITY, |a, j| a.min(j.abs())),
        }
    }
}

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
    let quads = cells.of_element(e);
    let vertices = quads
        .iter()
        .flatten()
        .filter(|&&n| (n as usize) < normals.len());
    let normal: Vector3 = vertices.map(|&n| normals[n as usize]).sum();
    let of = |quad: &[u32; 4]| of_quad(&quad.map(|n| cells.node(n, positions)), &normal);
    quads.iter().map(of).fold(f64::INFINITY, f64::min)
}

/// Corners are seen along the quad's vector area, whose sign is that of the surface's normal.
fn of_quad(corners: &[Point3; 4], surface_normal: &Vector3) -> f64 {
    let area = (corners[2] - corners[0]).cross(&(corners[3] - corners[1]));
    let Some(normal) = area.try_normalize(0.0) else {
        return -1.0;
    };
    let sine = |k: usize| {
        let next = corners[(k + 1) % 4] - corners[k];
        let previous = corners[(k + 3) % 4] - corners[k];
        let lengths = next.norm() * previous.norm();
        if lengths > 0.0 {
            next.cross(&previous).dot(&normal) / lengths
        } else {
            -1.0
        }
    };
    let worst = (0..4).map(sine).fold(f64::INFINITY, f64::min);
    if normal.dot(surface_normal) < 0.0 {
        -worst.abs()
    } else {
        worst
    }
}
