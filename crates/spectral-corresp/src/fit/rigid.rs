//! The rigid motion that takes points nearest to others.

use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, Vector3};

use super::nearest_rotation;

/// A proper rigid motion, `x ↦ R x + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// R, a proper rotation.
    pub rotation: Matrix3<f64>,
    /// t, Å.
    pub shift: Vector3,
}

impl Motion {
    /// Where a point goes.
    pub fn of(&self, p: &Point3) -> Point3 {
        Point3::from(self.rotation * p.coords + self.shift)
    }
}

/// The rigid motion with the smallest sum of squares between the images of the first points and the second ones (Kabsch,
/// *A solution for the best rotation to relate two sets of vectors*, 1976). The identity without points.
///
/// ```
/// use spectral_corresp::fit::superpose;
/// use spectral_corresp::geom_core::Point3;
/// // A quarter turn about z and a shift, found again from three points.
/// let turned = |p: Point3| Point3::new(5.0 - p.y, p.x, p.z + 1.0);
/// let points = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 1.0]].map(Point3::from);
/// let motion = superpose(&points.map(|p| (p, turned(p))));
/// let other = Point3::new(-4.0, 1.0, 7.0);
/// assert!((motion.of(&other) - turned(other)).norm() < 1e-12);
/// ```
pub fn superpose(pairs: &[(Point3, Point3)]) -> Motion {
    let count = pairs.len().max(1) as f64;
    let from = pairs.iter().map(|(a, _)| a.coords).sum::<Vector3>() / count;
    let to = pairs.iter().map(|(_, b)| b.coords).sum::<Vector3>() / count;
    let s: Matrix3<f64> = pairs
        .iter()
        .map(|(a, b)| (b.coords - to) * (a.coords - from).transpose())
        .sum();
    let rotation = nearest_rotation(&s);
    Motion {
        rotation,
        shift: to - rotation * from,
    }
}
