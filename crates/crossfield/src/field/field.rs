//! The cross field: an angle per triangle, a period jump per edge.

use geom_core::Vector3;
use geom_core::options::require;

use super::frames::Frames;
use super::singularity::{self, difference};
use crate::Error;

/// A direction that the field should have in a triangle, up to quarter turns.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Guide {
    /// The triangle.
    pub face: u32,
    /// The direction.
    pub toward: Toward,
    /// λ̄ of Eq. 4.9, in units of the smoothness energy of one edge; infinite: the field has exactly this
    /// direction.
    /// 0 is no guide at all. Of several guides of one triangle the heaviest holds it, of equal ones the first.
    pub weight: f64,
}

/// How a [`Guide`] names its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Toward {
    /// An angle in the triangle's frame: [`Frames`].
    Angle(f64),
    /// Along a side of the triangle, 0…2: sharp edges and boundaries, whatever the smoothing does to the
    /// geometry.
    Side(u8),
}

impl Guide {
    /// The angle in a triangle's frame.
    pub fn angle(&self, frames: &Frames) -> f64 {
        match self.toward {
            Toward::Angle(angle) => angle,
            Toward::Side(k) => frames.side_angle(3 * self.face as usize + k as usize),
        }
    }

    /// Refuses triangles and sides that there are none of, and values that are no numbers.
    pub(crate) fn check(&self, faces: usize) -> Result<(), Error> {
        let face = self.face;
        let known = (face as usize) < faces;
        require(known, "guide.face", face, "be a triangle of the mesh")?;
        match self.toward {
            Toward::Angle(angle) => {
                require(angle.is_finite(), "guide.toward", angle, "be finite")?;
            }
            Toward::Side(side) => require(side < 3, "guide.toward", side, "be a side: 0, 1 or 2")?,
        }
        let weight = self.weight;
        Ok(require(
            weight >= 0.0,
            "guide.weight",
            weight,
            "be at least 0",
        )?)
    }

    /// Does the field have to follow exactly?
    pub fn is_hard(&self) -> bool {
        self.weight == f64::INFINITY
    }
}

/// A cross per triangle: four directions a quarter turn apart.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossField {
    /// The angle θ of one arm in each triangle's frame.
    /// Radians, and not reduced: quarter turns more or less in one triangle need other jumps around it.
    pub theta: Vec<f64>,
    /// The period jump p of each half-edge, odd under exchange with the twin; 0 on a boundary.
    /// Half-edge `3 f + k` leads from corner k of triangle f to the next one.
    pub jump: Vec<i32>,
    /// Four times the index of each vertex: see [`singularity::indices`].
    /// 0 at vertices of no triangle.
    pub index: Vec<i32>,
    /// How it came about.
    pub report: FieldReport,
}

/// What a cross field is like.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FieldReport {
    /// Singular vertices inside of the surface.
    pub singularities: usize,
    /// Of those, with positive index (three quads or fewer).
    pub positive: usize,
    /// The smoothness energy Σ δ² with unit weights, rad² (Eq. 4.9 without guidance).
    pub energy: f64,
    /// Triangles with guidance.
    pub guided: usize,
    /// Guides left out because another one held the triangle.
    /// It counts those of another direction only: what agrees with the guide that holds the triangle contradicts
    /// nothing.
    pub conflicts: usize,
    /// Edges whose period jump was changed because that lowered the energy.
    pub edge_moves: usize,
    /// Pairs of opposite singularities that were made to meet.
    pub annihilated: usize,
    /// Singularities that were moved because another one was nearer than the smoothing.
    pub moved_apart: usize,
    /// The length over which the surface was smoothed to decide where the field turns, Å; 0 when the
    /// smoothing was off, or could not be carried back.
    pub smoothing: f64,
}

impl CrossField {
    /// The four arms of a triangle's cross, counter-clockwise.
    ///
    /// Unit vectors in the plane of the triangle; the first is that of the angle θ.
    pub fn arms(&self, frames: &Frames, face: usize) -> [Vector3; 4] {
        let first = frames.direction(face, self.theta[face]);
        let second = frames.direction(face, self.theta[face] + super::frames::QUARTER);
        [first, second, -first, -second]
    }

    /// The vertices inside of the surface where the field turns.
    pub fn singular_vertices<'a>(&'a self, frames: &'a Frames) -> impl Iterator<Item = usize> + 'a {
        (0..self.index.len()).filter(|&v| self.index[v] != 0 && !frames.on_boundary(v))
    }

    /// The same crosses in pieces of the triangles of `before`: the parent of each, by how much angles are smaller in its frame,
    /// and the half-edge that each side is a piece of, if of any. Its singular vertices are the same.
    pub(crate) fn in_pieces(
        &self,
        before: &Frames,
        after: &Frames,
        parents: &[u32],
        turns: &[f64],
        sides: &[Option<usize>],
    ) -> Self {
        let theta: Vec<f64> = parents
            .iter()
            .zip(turns)
            .map(|(&parent, turn)| self.theta[parent as usize] - turn)
            .collect();
        let mut jump = vec![0; sides.len()];
        for (h, twin) in after.interior() {
            let wanted = sides[h].map_or(0.0, |side| {
                difference(before, &self.theta, &self.jump, side)
            });
            // Angles between frames are those of before, but for whole turns.
            let turns = (difference(after, &theta, &jump, h) - wanted) / super::frames::QUARTER;
            (jump[h], jump[twin]) = (turns.round() as i32, -turns.round() as i32);
        }
        Self::measured(after, theta, jump, self.report.clone())
    }

    /// Fills in indices, energy and counts.
    pub(crate) fn measured(
        frames: &Frames,
        theta: Vec<f64>,
        jump: Vec<i32>,
        report: FieldReport,
    ) -> Self {
        let index = singularity::indices(frames, &theta, &jump);
        let mut field = Self {
            theta,
            jump,
            index,
            report,
        };
        let singular: Vec<usize> = field.singular_vertices(frames).collect();
        field.report.positive = singular.iter().filter(|&&v| field.index[v] > 0).count();
        field.report.singularities = singular.len();
        field.report.energy = frames
            .interior()
            .map(|(h, _)| difference(frames, &field.theta, &field.jump, h).powi(2))
            .sum();
        field
    }
}
