//! What the map should be like in each triangle, and how far a map is from that.

use geom_core::TriMesh;
use rayon::prelude::*;

use super::cut::Cut;
use super::spacing::Spacing;
use crate::field::CrossField;
use crate::field::frames::{Frames, QUARTER};

/// A triangle as the map sees it: the gradients of its hat functions along the field's two arms, multiplied by the
/// spacing there. The Jacobian `J = [h_u ∇u; h_v ∇v]` in the basis of the arms is `Σ (u_k, v_k) ⊗ hat_k`; the wanted one
/// is the identity (Eq. 4.10).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chart {
    /// Per corner: what one unit of u adds to the first row of J.
    pub along_u: [[f64; 2]; 3],
    /// Per corner: what one unit of v adds to the second row of J.
    pub along_v: [[f64; 2]; 3],
    /// Area, in units of the mean.
    pub area: f64,
}

impl Chart {
    /// The Jacobian for these coordinates of the corners.
    pub fn jacobian(&self, uv: &[[f64; 2]; 3]) -> [[f64; 2]; 2] {
        let mut j = [[0.0; 2]; 2];
        for k in 0..3 {
            for c in 0..2 {
                j[0][c] += uv[k][0] * self.along_u[k][c];
                j[1][c] += uv[k][1] * self.along_v[k][c];
            }
        }
        j
    }

    /// Is the triangle inverted, or turned away from the field by more than a quarter?
    pub fn is_bad(&self, uv: &[[f64; 2]; 3]) -> bool {
        let j = self.jacobian(uv);
        let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        !(determinant > 0.0 && j[0][0] + j[1][1] > 0.0)
    }
}

/// The charts of all triangles.
pub(crate) fn charts(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    cut: &Cut,
    spacing: &Spacing,
) -> Vec<Chart> {
    let mean = frames.areas().iter().sum::<f64>() / frames.faces() as f64;
    (0..frames.faces())
        .into_par_iter()
        .map(|f| {
            let arm = field.theta[f] + QUARTER * f64::from(cut.comb[f]);
            let (u, v) = (frames.direction(f, arm), frames.direction(f, arm + QUARTER));
            let p = mesh.corners(f);
            let normal = mesh.doubled_area_normal(f);
            let scaled = normal / normal.norm_squared();
            let hats = [0, 1, 2].map(|k| {
                let g = scaled.cross(&(p[(k + 2) % 3] - p[(k + 1) % 3]));
                [g.dot(&u), g.dot(&v)]
            });
            let [h_u, h_v] = spacing.of_face(f, cut.comb[f]);
            Chart {
                along_u: hats.map(|g| g.map(|x| h_u * x)),
                along_v: hats.map(|g| g.map(|x| h_v * x)),
                area: frames.areas()[f] / mean,
            }
        })
        .collect()
}
