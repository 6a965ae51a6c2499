//! Scalar fields with values and gradients at any point, and the ways to their level sets: to a root on a
//! segment ([`crossing`]) and along the gradient ([`project`]), one at a time or many ([`crossings`],
//! [`projections`]).
//!
//! Files: `crossing.rs` has the search on a segment, `project.rs` the walk to the level; both are written as machines
//! that are told values, so that one loop serves single points and batches on a device alike.

use std::ops::Range;

use crate::compute::{BackendError, parallel};
use crate::{Point3, Vector3};

mod crossing;
mod project;

pub use crossing::{Precision, crossing, crossings};
pub use project::{End, Guard, Projection, project, projections};

/// A scalar field whose level set is a surface; large inside.
///
/// Implemented by [`ScalarGrid`](crate::ScalarGrid) and [`BrickGrid`](crate::BrickGrid) (trilinear)
/// and by the point sampler of `gauss-density` (analytic). `dual-contour` uses it for roots and
/// projection, `tet-quality` for the motion of surface vertices.
///
/// Values may be kinked, as trilinear ones are between cells, but not jump. The gradient is that of the value where it
/// has one; its sign convention makes `−gradient` the outward normal of the level set.
pub trait ImplicitField: Sync {
    /// The value at `x`. Must be given for every point, also outside of a grid.
    fn value(&self, x: &Point3) -> f64;

    /// The value and the gradient (per Å) at `x`.
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3);

    /// The field where it takes many points with one call: on a device one costs as much as thousands, and on vectors of
    /// a processor as much as those beside it. `None`, as by default: a point at a time is as good.
    fn at_many(&self) -> Option<&dyn FieldAtMany> {
        None
    }
}

/// An [`ImplicitField`] that takes many points with one call. Values of a device are off by what its backend owes.
///
/// Whoever walks on it asks by [`in_batches`], which knows how much a call should bring.
pub trait FieldAtMany: Sync {
    /// The value and the gradient (per Å) at each point, in place of what was in `out`.
    ///
    /// # Errors
    /// That of the device; whoever walks on the field then stops and hands it on.
    fn values_gradients(
        &self,
        points: &[Point3],
        out: &mut Vec<(f64, Vector3)>,
    ) -> Result<(), BackendError>;

    /// The values alone, in place of what was in `out`; by default those of [`FieldAtMany::values_gradients`].
    ///
    /// # Errors
    /// The same.
    fn values(&self, points: &[Point3], out: &mut Vec<f64>) -> Result<(), BackendError> {
        let mut both = Vec::new();
        self.values_gradients(points, &mut both)?;
        out.clear();
        out.extend(both.into_iter().map(|(value, _)| value));
        Ok(())
    }

    /// How many points a call should bring where threads may ask side by side; `None`, as by default, where one call
    /// for all of them is best, as on a device.
    fn batch(&self) -> Option<usize> {
        None
    }
}

/// What `f` makes of the ranges of `0..n`, one after the other, each as long as the field would have a call: all at once
/// for a device, pieces of a batch side by side for threads. What `f` gives must not depend on the ranges.
///
/// # Errors
/// The first that `f` gives, by the order of the ranges.
pub fn in_batches<T: Send, E: Send>(
    field: &dyn FieldAtMany,
    n: usize,
    f: impl Fn(Range<usize>) -> Result<Vec<T>, E> + Sync,
) -> Result<Vec<T>, E> {
    let size = field.batch().unwrap_or(n).max(1);
    if n <= size {
        return f(0..n);
    }
    let piece = |i: usize| f(i * size..((i + 1) * size).min(n));
    let mut all = Vec::with_capacity(n);
    for made in parallel::map(n.div_ceil(size), piece) {
        all.extend(made?);
    }
    Ok(all)
}

impl<F: ImplicitField + ?Sized> ImplicitField for &F {
    fn value(&self, x: &Point3) -> f64 {
        (**self).value(x)
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        (**self).value_gradient(x)
    }
    fn at_many(&self) -> Option<&dyn FieldAtMany> {
        (**self).at_many()
    }
}

/// A field at a point to first order: its height above a level and its gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangent {
    /// The point.
    pub at: Point3,
    /// The value less the level.
    pub height: f64,
    /// The gradient.
    pub gradient: Vector3,
}

impl Tangent {
    /// The field at `x` against a level. One question of the field.
    pub fn new(field: &(impl ImplicitField + ?Sized), level: f64, x: Point3) -> Self {
        let (value, gradient) = field.value_gradient(&x);
        Self {
            at: x,
            height: value - level,
            gradient,
        }
    }

    /// First-order signed distance to the level set, positive where the field is above the level; infinite where
    /// there is no direction to go. Where the gradient is tiny (at saddles) it is far too large.
    pub fn distance(&self) -> f64 {
        let slope = self.gradient.norm();
        if self.has_direction() {
            self.height / slope
        } else {
            f64::INFINITY
        }
    }

    /// The unit gradient, into the inside; zero where there is none.
    pub fn normal(&self) -> Vector3 {
        if self.has_direction() {
            self.gradient / self.gradient.norm()
        } else {
            Vector3::zeros()
        }
    }

    /// Newton's step along the gradient, to the level set to first order; `None` where there is no direction.
    pub fn step(&self) -> Option<Vector3> {
        self.has_direction()
            .then(|| self.gradient * (-self.height / self.gradient.norm_squared()))
    }

    /// The point after that step, or this one where there is none.
    pub fn foot(&self) -> Point3 {
        self.step().map_or(self.at, |step| self.at + step)
    }

    /// Not at extrema and saddles, in flat outskirts whose gradient has become zero, nor where something is not finite.
    fn has_direction(&self) -> bool {
        let square = self.gradient.norm_squared();
        square > 0.0 && square.is_finite() && self.height.is_finite()
    }
}
