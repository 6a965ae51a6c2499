//! Axis-aligned boxes.

use crate::{Point3, Vector3};

/// A closed axis-aligned box, Å. The empty box has `min > max` on every axis.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Aabb {
    /// Lowest corner.
    pub min: Point3,
    /// Highest corner.
    pub max: Point3,
}

impl Aabb {
    /// The box that holds nothing; the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self {
        min: Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        max: Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// The box between two corners.
    pub fn new(min: Point3, max: Point3) -> Self {
        Self { min, max }
    }

    /// The smallest box that holds all points; [`Aabb::EMPTY`] for none.
    pub fn of_points<'a>(points: impl IntoIterator<Item = &'a Point3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |mut b, p| {
            b.include(*p);
            b
        })
    }

    /// Grows the box so that it holds `p`.
    pub fn include(&mut self, p: Point3) {
        self.min = self.min.inf(&p);
        self.max = self.max.sup(&p);
    }

    /// The smallest box that holds both.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: self.min.inf(&other.min),
            max: self.max.sup(&other.max),
        }
    }

    /// The box grown by `margin` on every side.
    pub fn inflated(&self, margin: f64) -> Self {
        let m = Vector3::repeat(margin);
        Self {
            min: self.min - m,
            max: self.max + m,
        }
    }

    /// Does the box hold no point?
    pub fn is_empty(&self) -> bool {
        (0..3).any(|k| self.min[k] > self.max[k])
    }

    /// Does the closed box hold `p`?
    pub fn contains(&self, p: &Point3) -> bool {
        (0..3).all(|k| self.min[k] <= p[k] && p[k] <= self.max[k])
    }

    /// Do the closed boxes share a point?
    pub fn intersects(&self, other: &Self) -> bool {
        (0..3).all(|k| self.min[k] <= other.max[k] && other.min[k] <= self.max[k])
    }

    /// Edge lengths.
    pub fn extent(&self) -> Vector3 {
        self.max - self.min
    }

    /// The middle.
    pub fn center(&self) -> Point3 {
        nalgebra::center(&self.min, &self.max)
    }

    /// Length of the diagonal.
    pub fn diagonal(&self) -> f64 {
        self.extent().norm()
    }

    /// Squared distance from `p` to the nearest point of the box; 0 inside.
    pub fn distance_squared(&self, p: &Point3) -> f64 {
        (0..3)
            .map(|k| {
                let d = (self.min[k] - p[k]).max(p[k] - self.max[k]).max(0.0);
                d * d
            })
            .sum()
    }
}
