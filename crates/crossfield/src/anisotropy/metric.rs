//! The spacing of lines per triangle and direction (Eq. 4.13).

use geom_core::surface::laplace;
use geom_core::{TriMesh, Vector3};

use super::Anisotropy;
use crate::Error;
use crate::field::frames::{Frames, modulo_quarter};
use crate::field::{CrossField, Guide, Toward};
use crate::map::Spacing;

/// The largest |∇F| of a function, but for a hundredth of the area: slivers and kinks do not decide what is steep.
///
/// 0 for a constant function and for a surface without triangles. Of any unit per Å, with one gradient per triangle.
pub fn steepest(mesh: &TriMesh, gradient: &[Vector3]) -> f64 {
    let area = |face: usize| mesh.doubled_area_normal(face).norm();
    let steep = gradient.iter().enumerate();
    within(steep.map(|(f, g)| (g.norm(), area(f))).collect(), 0.99)
}

/// What values, each with an area, do not exceed on this share of it.
fn within(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let whole: f64 = values.iter().map(|v| v.1).sum();
    let mut area = 0.0;
    let reached = values.iter().find(|v| {
        area += v.1;
        area >= share * whole
    });
    reached.map_or(0.0, |v| v.0)
}

/// The field follows ∇F where |∇F| is above this share of its largest.
const GUIDED: f64 = 0.5;
/// Below this share the field is left alone, too, when it is adapted.
const FAR: f64 = 0.45;

/// In each triangle the direction of ∇F and how much narrower quads are along it.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    grains: Vec<Grain>,
    weight: f64,
}

/// What the metric is like in one triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Grain {
    /// Of ∇F, in the triangle's frame.
    angle: f64,
    /// |∇F| over its largest.
    steepness: f64,
    /// r: the side of a quad along ∇F over that across.
    ratio: f64,
}

/// How far crosses are from the gradient where they are to follow it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Misalignment {
    /// Triangles where |∇F| is above half its largest.
    pub triangles: usize,
    /// On half of their area crosses are off by at most this, degrees.
    pub median: f64,
    /// On 95 % of their area.
    pub percentile_95: f64,
}

impl Metric {
    /// Of a function with one value per vertex; `steepest` is the largest |∇F| of the whole surface: see [`steepest`].
    ///
    /// A function without slope gives ratio 1 everywhere, which is no anisotropy.
    ///
    /// # Errors
    /// [`Error::Operator`] for another number of values than vertices.
    pub fn of(
        mesh: &TriMesh,
        frames: &Frames,
        values: &[f64],
        steepest: f64,
        options: &Anisotropy,
    ) -> Result<Self, Error> {
        let gradient = laplace::gradient(mesh, values)?;
        let grains = gradient.iter().enumerate().map(|(face, gradient)| {
            let steepness = if steepest > 0.0 {
                gradient.norm() / steepest
            } else {
                0.0
            };
            Grain {
                angle: frames.angle(face, gradient),
                steepness,
                ratio: ratio_at(steepness, options),
            }
        });
        Ok(Self {
            grains: grains.collect(),
            weight: options.weight,
        })
    }

    /// The metric with the square roots of its ratios.
    /// What is tried where a map folds: 0.2 becomes 0.45, then 0.67.
    pub(crate) fn milder(&self) -> Self {
        let mut grains = self.grains.clone();
        for grain in &mut grains {
            grain.ratio = grain.ratio.sqrt();
        }
        Self {
            grains,
            weight: self.weight,
        }
    }

    /// The metric in pieces of its triangles: the parent of each, and by how much angles are smaller in its frame.
    pub(crate) fn in_pieces(&self, parents: &[u32], turns: &[f64]) -> Self {
        let of = |(&parent, turn): (&u32, &f64)| {
            let grain = self.grains[parent as usize];
            Grain {
                angle: grain.angle - turn,
                ..grain
            }
        };
        Self {
            grains: parents.iter().zip(turns).map(of).collect(),
            weight: self.weight,
        }
    }

    /// Distances of neighbouring lines along the arm θ and across it, where they are 1 without a gradient.
    ///
    /// Along the gradient it is r, across it 1, between them Eq. 4.13. `theta` is an angle in the frame of the
    /// triangle.
    pub fn spacing(&self, face: usize, theta: f64) -> [f64; 2] {
        let Grain { angle, ratio, .. } = self.grains[face];
        let (sine, cosine) = (theta - angle).sin_cos();
        [narrowed(ratio, cosine), narrowed(ratio, sine)]
    }

    /// The same for all crosses of a field, where they are `side` without a gradient, Å.
    pub fn spacings(&self, field: &CrossField, side: f64) -> Spacing {
        let of = |(face, &theta)| self.spacing(face, theta).map(|h| side * h);
        Spacing::PerFace(field.theta.iter().enumerate().map(of).collect())
    }

    /// Quads of side 1 in a triangle of area 1 where lines lie so.
    pub(crate) fn density(&self, face: usize, theta: f64) -> f64 {
        let [along, across] = self.spacing(face, theta);
        1.0 / (along * across)
    }

    /// The same where lines follow the gradient.
    pub(crate) fn aligned_density(&self, face: usize) -> f64 {
        1.0 / self.grains[face].ratio
    }

    /// The field along ∇F where that is steep.
    ///
    /// Steep is above half of the steepest |∇F|. All have the weight of [`Anisotropy::weight`].
    pub fn guides(&self) -> impl Iterator<Item = Guide> + '_ {
        self.steep().map(|face| Guide {
            face: face as u32,
            toward: Toward::Angle(self.grains[face].angle),
            weight: self.weight,
        })
    }

    fn steep(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.grains.len()).filter(|&f| self.grains[f].steepness > GUIDED)
    }

    /// The triangles between where the field follows ∇F and where F is flat, without those of hard guides.
    pub(crate) fn transition(&self, guides: &[Guide]) -> Vec<usize> {
        let mut free: Vec<bool> = self
            .grains
            .iter()
            .map(|g| (FAR..=GUIDED).contains(&g.steepness))
            .collect();
        for guide in guides.iter().filter(|g| g.is_hard()) {
            free[guide.face as usize] = false;
        }
        (0..free.len()).filter(|&f| free[f]).collect()
    }

    /// How far a field is from ∇F where that is steep.
    ///
    /// Angles are up to quarter turns, so that none is above 45 degrees. All 0 if no triangle is steep.
    pub fn misalignment(&self, frames: &Frames, field: &CrossField) -> Misalignment {
        let off: Vec<(f64, f64)> = self
            .steep()
            .map(|f| {
                let angle = modulo_quarter(field.theta[f] - self.grains[f].angle).abs();
                (angle.to_degrees(), frames.areas()[f])
            })
            .collect();
        Misalignment {
            triangles: off.len(),
            median: within(off.clone(), 0.5),
            percentile_95: within(off, 0.95),
        }
    }
}

/// r where |∇F| is this share of its largest.
pub(crate) fn ratio_at(steepness: f64, options: &Anisotropy) -> f64 {
    let [low, high] = options.ramp;
    let part = if steepness <= low {
        0.0
    } else if steepness >= high {
        1.0
    } else {
        (steepness - low) / (high - low)
    };
    options.ratio.powf(part)
}

/// The spacing along a direction with this cosine to ∇F.
/// `ratio` for a cosine of ±1 and 1 for a cosine of 0: the length at which a metric with 1/r² along the gradient gives
/// 1.
pub(crate) fn narrowed(ratio: f64, cosine: f64) -> f64 {
    1.0 / (1.0 + (1.0 / (ratio * ratio) - 1.0) * cosine * cosine).sqrt()
}
