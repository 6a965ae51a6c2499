//! The unit of length.

use geom_core::{Aabb, Point3, Vector3};

use crate::Error;

/// The map to unit scale: the largest extent becomes 1, the centre of the box the origin. Ψ, ε and δ
/// count in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct UnitScale {
    pub(crate) center: Point3,
    /// Å per unit.
    pub(crate) length: f64,
}

impl UnitScale {
    /// Of points that are in unit scale.
    pub(crate) const IDENTITY: Self = Self {
        center: Point3::new(0.0, 0.0, 0.0),
        length: 1.0,
    };

    /// [`Error::NoExtent`] for no points or one place.
    pub(crate) fn of(points: &[Point3]) -> Result<Self, Error> {
        let bounds = Aabb::of_points(points);
        let length = if bounds.is_empty() {
            0.0
        } else {
            bounds.extent().max()
        };
        if !(length > 0.0 && length.is_finite()) {
            return Err(Error::NoExtent);
        }
        let center = bounds.center();
        Ok(Self { center, length })
    }

    pub(crate) fn apply(&self, p: &Point3) -> Point3 {
        Point3::from((p - self.center) / self.length)
    }

    /// The inverse of `apply`, up to rounding.
    pub(crate) fn undo(&self, x: &Vector3) -> Point3 {
        self.center + x * self.length
    }
}
