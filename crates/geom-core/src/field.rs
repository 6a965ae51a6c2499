//! Scalar fields with values and gradients at any point.

use crate::{Point3, Vector3};

/// A scalar field whose level set is a surface; large inside.
///
/// Implemented by [`ScalarGrid`](crate::ScalarGrid) and [`BrickGrid`](crate::BrickGrid) (trilinear)
/// and by the point sampler of `gauss-density` (analytic). `dual-contour` uses it for roots and
/// projection, `tet-quality` for the motion of surface vertices.
pub trait ImplicitField: Sync {
    /// The value at `x`.
    fn value(&self, x: &Point3) -> f64;

    /// The value and the gradient (per Å) at `x`.
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3);
}

impl<F: ImplicitField + ?Sized> ImplicitField for &F {
    fn value(&self, x: &Point3) -> f64 {
        (**self).value(x)
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        (**self).value_gradient(x)
    }
}
