//! A part as field and map see it.

use geom_core::TriMesh;
use geom_core::surface::laplace::EdgeWeights;

use super::parts::{Cuts, Part};
use crate::Error;
use crate::anisotropy::Metric;
use crate::field::smooth::{Operators, flowed};
use crate::field::{CrossField, Frames};
use crate::map::Spacing;

/// Where sides become shorter than this part of what they were, the flow is slowed down.
const THIN: f64 = 0.5;
/// How often, by four each time.
const SLOWER: usize = 4;
/// No side counts as shorter than this part of what it was.
const LEAST: f64 = 1e-6;
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
        let operators = Operators::of(&part.mesh)?;
        let mut last = None;
        for step in 0..=SHORTER {
            let length = length * 0.5f64.powf(0.5 * f64::from(step));
            if length < least {
                break;
            }
            let (mesh, shrunk) = if length > 0.0 {
                evened(&operators, length, |v| on_lines[v].is_some())?
            } else {
                (part.mesh.clone(), vec![1.0; part.mesh.triangles().len()])
            };
            match Frames::of(&mesh, weights) {
                Ok(frames) => {
                    return Ok(Self {
                        mesh,
                        frames,
                        length,
                        shrunk,
                    });
                }
                Err(error) => last = Some(error),
            }
        }
        Err(last.expect("the whole length was tried"))
    }

    /// The same places, with triangles cut.
    pub(super) fn cut(&self, cuts: &Cuts, weights: EdgeWeights) -> Result<Self, Error> {
        let mesh = cuts.of_mesh(&self.mesh)?;
        let of_parent = |&parent: &u32| self.shrunk[parent as usize];
        Ok(Self {
            frames: Frames::of(&mesh, weights)?,
            mesh,
            length: self.length,
            shrunk: cuts.parents.iter().map(of_parent).collect(),
        })
    }

    /// The spacing that makes quads of this side on the surface before: the flow draws tips together, and singular vertices
    /// there with them. `closer` times as large in each triangle, and as the metric wants it along the arms of the field.
    pub(super) fn spacing(
        &self,
        side: f64,
        closer: &[f64],
        metric: Option<&Metric>,
        field: &CrossField,
    ) -> Spacing {
        let of = |(face, (s, c)): (usize, (&f64, &f64))| {
            let narrowed = metric.map_or([1.0; 2], |m| m.spacing(face, field.theta[face]));
            narrowed.map(|h| side * s * c * h)
        };
        let all = self.shrunk.iter().zip(closer).enumerate();
        Spacing::PerFace(all.map(of).collect())
    }
}

/// The surface after the flow, and how many times shorter the sides of each triangle have become: the square root of its area
/// after over that before, its logarithm diffused over the surface before for a time of `length² / 4`, so that bumps, which are
/// to go, do not count. A limb thinner than `length` would become a thread, with a field of its own making: where sides are
/// shorter than [`THIN`] of what they were, the flow takes a shorter time.
fn evened(
    operators: &Operators<'_>,
    length: f64,
    held: impl Fn(usize) -> bool,
) -> Result<(TriMesh, Vec<f64>), Error> {
    let Operators {
        mesh: before,
        stiffness,
        symbolic,
        mass,
    } = operators;
    let time = 0.25 * length * length;
    let matrix = stiffness.map(|i, j, k| time * k + if i == j { mass[i] } else { 0.0 });
    let factor = symbolic.factor(&matrix)?;
    let mut times = vec![length * length; mass.len()];
    let mut round = 0;
    loop {
        let after = flowed(operators, &times, &held)?;
        let mut log = vec![0.0; mass.len()];
        for (t, corners) in before.triangles().iter().enumerate() {
            let area = |mesh: &TriMesh| mesh.doubled_area_normal(t).norm();
            let ratio = (area(&after) / area(before)).sqrt().max(LEAST).ln();
            for &v in corners {
                log[v as usize] += area(before) / 6.0 * ratio;
            }
        }
        factor.solve_in_place(&mut log, 1)?;
        let thin: Vec<usize> = (0..log.len()).filter(|&v| log[v] < THIN.ln()).collect();
        if thin.is_empty() || round == SLOWER {
            let mean =
                |corners: &[u32; 3]| corners.iter().map(|&v| log[v as usize]).sum::<f64>() / 3.0;
            let shrunk = before.triangles().iter().map(|c| mean(c).exp()).collect();
            return Ok((after, shrunk));
        }
        for v in thin {
            times[v] *= 0.25;
        }
        round += 1;
    }
}
