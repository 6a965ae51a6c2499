//! How far apart the lines shall be, what the map should hence be like in each triangle, and how far a map is
//! from that.

use geom_core::TriMesh;
use geom_core::compute::parallel;
use geom_core::options::require;

use super::cut::Cut;
use crate::Error;
use crate::field::CrossField;
use crate::field::frames::{Frames, QUARTER};

/// Distances of neighbouring lines, Å: h of Eq. 4.10, the sides of the quads.
///
/// A surface of area A gets about A / h² quads. Lines cannot be closer in one place and wider in another without singular
/// vertices between, so that values per triangle are a wish that the map meets in the mean; [`Anisotropy`](crate::Anisotropy)
/// computes such values from a function.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Spacing {
    /// The same everywhere.
    Uniform(f64),
    /// Per triangle, along the field's arm θ and across it.
    PerFace(Vec<[f64; 2]>),
}

impl Spacing {
    /// Refuses what is not a positive number, and the wrong number of them.
    pub(crate) fn check(&self, faces: usize) -> Result<(), Error> {
        let fine = |h: f64| h > 0.0 && h.is_finite();
        match self {
            Self::Uniform(h) => require(fine(*h), "spacing", h, "be above 0 and finite")?,
            Self::PerFace(all) => {
                let count = all.len();
                require(
                    count == faces,
                    "spacing",
                    count,
                    "have one value per triangle",
                )?;
                if let Some(h) = all.as_flattened().iter().find(|&&h| !fine(h)) {
                    require(false, "spacing", h, "be above 0 and finite")?;
                }
            }
        }
        Ok(())
    }

    /// Along the first arm after `comb` quarter turns, and along the second.
    pub(crate) fn of_face(&self, face: usize, comb: u8) -> [f64; 2] {
        match self {
            Self::Uniform(h) => [*h, *h],
            Self::PerFace(spacings) => {
                let [along, across] = spacings[face];
                if comb.is_multiple_of(2) {
                    [along, across]
                } else {
                    [across, along]
                }
            }
        }
    }
}

/// A triangle as the map sees it: the gradients of its hat functions along the field's two arms, multiplied by the
/// spacing there. The Jacobian `J = [h_u ∇u; h_v ∇v]` in the basis of the arms is `Σ (u_k, v_k) ⊗ hat_k`; the wanted one
/// is the identity (Eq. 4.10).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chart {
    /// Per corner: what one unit of u adds to the first row of J.
    pub along_u: [[f64; 2]; 3],
    /// Per corner: what one unit of v adds to the second row of J.
    pub along_v: [[f64; 2]; 3],
    /// Area over that of the quads wanted there, in units of the mean.
    pub area: f64,
}

impl Chart {
    /// The Jacobian for these coordinates of the corners.
    pub fn jacobian(&self, uv: &[[f64; 2]; 3]) -> [[f64; 2]; 2] {
        let row = |axis: usize, along: &[[f64; 2]; 3]| {
            let sum = |c: usize| {
                uv.iter()
                    .zip(along)
                    .map(|(at, hat)| at[axis] * hat[c])
                    .sum()
            };
            [sum(0), sum(1)]
        };
        [row(0, &self.along_u), row(1, &self.along_v)]
    }

    /// The two sides from a corner as the field would have them in the map, `[du, dv]` in units of lines: to the next corner
    /// and to the previous one.
    pub(crate) fn sides(&self, corner: usize) -> [[f64; 2]; 2] {
        let (k, l) = ((corner + 1) % 3, (corner + 2) % 3);
        // The gradients of the hats at the far ends, and the sides, are inverse matrices.
        let inverse = |hats: &[[f64; 2]; 3]| {
            let ([a, b], [c, d]) = (hats[k], hats[l]);
            let determinant = a * d - b * c;
            [[d, -b], [-c, a]].map(|row| row.map(|x| x / determinant))
        };
        let (u, v) = (inverse(&self.along_u), inverse(&self.along_v));
        [[u[0][0], v[1][0]], [u[0][1], v[1][1]]]
    }

    /// What `|J|²` is in the coordinates of the corners, of u and of v: they do not know of each other in a triangle.
    pub(crate) fn stiffness(&self) -> [[[f64; 3]; 3]; 2] {
        let of = |along: &[[f64; 2]; 3]| {
            let product = |a: &[f64; 2], b: &[f64; 2]| a[0] * b[0] + a[1] * b[1];
            along.map(|a| along.map(|b| product(&a, &b)))
        };
        [of(&self.along_u), of(&self.along_v)]
    }

    /// The determinant of the Jacobian: above 0 where the triangle is upright.
    pub fn determinant(&self, uv: &[[f64; 2]; 3]) -> f64 {
        determinant(&self.jacobian(uv))
    }

    /// Is the triangle inverted, or turned away from the field by more than a quarter?
    /// A Jacobian with a number that is none is bad as well.
    pub fn is_bad(&self, uv: &[[f64; 2]; 3]) -> bool {
        let j = self.jacobian(uv);
        !(determinant(&j) > 0.0 && j[0][0] + j[1][1] > 0.0)
    }
}

pub(crate) fn determinant(j: &[[f64; 2]; 2]) -> f64 {
    j[0][0] * j[1][1] - j[0][1] * j[1][0]
}

/// The charts of all triangles.
pub(crate) fn charts(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    cut: &Cut,
    spacing: &Spacing,
) -> Vec<Chart> {
    let quads = |f: usize| {
        let [u, v] = spacing.of_face(f, 0);
        frames.areas()[f] / (u * v)
    };
    let mean = (0..frames.faces()).map(quads).sum::<f64>() / frames.faces() as f64;
    parallel::map(frames.faces(), |f| {
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
            area: quads(f) / mean,
        }
    })
}
