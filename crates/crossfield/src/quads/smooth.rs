//! A part as field and map see it.

use geom_core::TriMesh;
use geom_core::algebra::Cholesky;
use geom_core::surface::laplace::{self, EdgeWeights, Mass};

use super::parts::Part;
use crate::Error;
use crate::field::Frames;
use crate::field::smooth::flowed;
use crate::map::Spacing;

/// How often a smoothing that makes triangles flat is shortened by √2.
const SHORTER: i32 = 4;

/// A part of a surface without bumps smaller than a quad, the same triangles in other places. A bump earns singularities nearer
/// to each other than a quad's side, which no quad mesh can hold, and a map of it folds; but a map of the smoothed
/// triangles, upright in each, is as good a map of those they were.
pub(super) struct Smooth {
    pub(super) mesh: TriMesh,
    pub(super) frames: Frames,
    /// Over which it was smoothed, Å.
    pub(super) length: f64,
    /// How many times shorter each triangle's sides have become, evened out over neighbours.
    shrunk: Vec<f64>,
}

impl Smooth {
    /// After mean curvature flow for a time of `length²`, or of as much of it, but not less than `least²`, as leaves every
    /// triangle an area. Boundaries and sharp edges stay.
    pub(super) fn of(
        part: &Part,
        length: f64,
        least: f64,
        weights: EdgeWeights,
    ) -> Result<Self, Error> {
        let on_lines = part.corners()?;
        let mut last = None;
        for step in 0..=SHORTER {
            let length = length * 0.5f64.powf(0.5 * f64::from(step));
            if length < least {
                break;
            }
            let mesh = if length > 0.0 {
                flowed(&part.mesh, length * length, |v| on_lines[v].is_some())?
            } else {
                part.mesh.clone()
            };
            match Frames::of(&mesh, weights) {
                Ok(frames) => {
                    return Ok(Self {
                        shrunk: shrunk(&part.mesh, &mesh, length)?,
                        mesh,
                        frames,
                        length,
                    });
                }
                Err(error) => last = Some(error),
            }
        }
        Err(last.expect("the whole length was tried"))
    }

    /// The spacing that makes quads of this side on the surface before: the flow draws tips together, and singular vertices
    /// there with them.
    pub(super) fn spacing(&self, side: f64) -> Spacing {
        Spacing::PerFace(self.shrunk.iter().map(|s| [side * s; 2]).collect())
    }
}

/// Per triangle, the square root of its area after over that before: its logarithm diffused over the surface before for a time
/// of `length² / 4`, so that bumps, which are to go, do not count.
fn shrunk(before: &TriMesh, after: &TriMesh, length: f64) -> Result<Vec<f64>, Error> {
    if length <= 0.0 {
        return Ok(vec![1.0; before.triangles().len()]);
    }
    let stiffness = laplace::stiffness(before)?;
    let Mass::Lumped(mass) = laplace::lumped_mass(before) else {
        unreachable!("the lumped mass is lumped")
    };
    let time = 0.25 * length * length;
    let matrix = stiffness.map(|i, j, k| time * k + if i == j { mass[i] } else { 0.0 });
    let mut right = vec![0.0; before.positions().len()];
    for (t, corners) in before.triangles().iter().enumerate() {
        let area = |mesh: &TriMesh| mesh.doubled_area_normal(t).norm();
        let ratio = (area(after) / area(before)).sqrt().ln();
        for &v in corners {
            right[v as usize] += area(before) / 6.0 * ratio;
        }
    }
    let log = Cholesky::of(&matrix)?.solve(&right)?;
    let mean = |corners: &[u32; 3]| corners.iter().map(|&v| log[v as usize]).sum::<f64>() / 3.0;
    Ok(before.triangles().iter().map(|c| mean(c).exp()).collect())
}
