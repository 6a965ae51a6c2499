//! Axis-aligned boxes.
//!
//! Boxes sort out by a few comparisons what need not be looked at: the trees of [`search`](crate::search) and the
//! borders of [`tiles`](crate::tiles) are made of them. They are closed, so that boxes which only touch do meet.

use crate::{Point3, Vector3};

/// A closed axis-aligned box, Å. It is empty if `min > max` on some axis; [`Aabb::EMPTY`] is so on all three.
///
/// A box of one plane or of one point is not empty: only `min > max` makes it so. Nothing here checks corners, and
/// nothing fails: what is asked of [`Aabb::EMPTY`] has an answer, which each function names.
///
/// ```
/// use geom_core::{Aabb, Point3};
/// let bounds = Aabb::of_points(&[Point3::origin(), Point3::new(1.0, 2.0, 2.0)]);
/// assert_eq!(bounds.diagonal(), 3.0);
/// assert_eq!(bounds.distance_squared(&Point3::new(0.5, 3.0, 1.0)), 1.0);
/// assert!(Aabb::EMPTY.is_empty());
/// ```
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
    ///
    /// They are taken as they are: where `min` is the greater on some axis, the box is empty.
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
    ///
    /// A negative margin shrinks it, to an empty box where an edge is shorter than twice that. [`Aabb::EMPTY`] stays
    /// empty.
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

    /// Does the closed box hold `p`? A point with a coordinate that is NaN lies in none.
    pub fn contains(&self, p: &Point3) -> bool {
        (0..3).all(|k| self.min[k] <= p[k] && p[k] <= self.max[k])
    }

    /// Do the closed boxes share a point? [`Aabb::EMPTY`] meets none; a box that is empty on one axis only may.
    pub fn intersects(&self, other: &Self) -> bool {
        (0..3).all(|k| self.min[k] <= other.max[k] && other.min[k] <= self.max[k])
    }

    /// Edge lengths. Those of [`Aabb::EMPTY`] are −∞.
    pub fn extent(&self) -> Vector3 {
        self.max - self.min
    }

    /// The middle. That of [`Aabb::EMPTY`] is not a number.
    pub fn center(&self) -> Point3 {
        nalgebra::center(&self.min, &self.max)
    }

    /// Length of the diagonal. It is infinite, not zero, for [`Aabb::EMPTY`].
    pub fn diagonal(&self) -> f64 {
        self.extent().norm()
    }

    /// Squared distance from `p` to the nearest point of the box; 0 inside. [`Aabb::EMPTY`] is infinitely far away.
    pub fn distance_squared(&self, p: &Point3) -> f64 {
        (0..3)
            .map(|k| {
                let d = (self.min[k] - p[k]).max(p[k] - self.max[k]).max(0.0);
                d * d
            })
            .sum()
    }
}
