//! The isosurface that surface vertices lie on.

use geom_core::{ImplicitField, Point3, Vector3};

use crate::error::Error;

/// The level set of an implicit field.
pub(crate) struct Isosurface<'a> {
    pub(crate) field: &'a dyn ImplicitField,
    pub(crate) level: f64,
    /// The field is the distance to the mesh's own surfaces, plane parts and sharp edges of which stay.
    pub(crate) own: bool,
}

/// The field at a point, to first order: what a vertex needs to know of the isosurface around it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tangent {
    /// The point.
    pub(crate) at: Point3,
    /// First-order signed distance to the isosurface, positive where the field is larger; infinite
    /// where there is no direction to go. Where the gradient is tiny (pinches) it is over-estimated.
    pub(crate) distance: f64,
    /// The unit gradient; zero where there is none.
    pub(crate) normal: Vector3,
}

impl Tangent {
    /// Of no point.
    pub(crate) const UNKNOWN: Self = Self {
        at: Point3::new(f64::NAN, f64::NAN, f64::NAN),
        distance: f64::INFINITY,
        normal: Vector3::new(0.0, 0.0, 0.0),
    };

    /// The distance, cut at `most`.
    pub(crate) fn within(&self, most: f64) -> f64 {
        self.distance.clamp(-most, most)
    }
}

impl Isosurface<'_> {
    /// The field at `x`, to first order.
    pub(crate) fn tangent(&self, x: &Point3) -> Tangent {
        let (value, gradient) = self.field.value_gradient(x);
        let slope = gradient.norm();
        let rise = value - self.level;
        let known = slope > 0.0 && slope.is_finite() && rise.is_finite();
        Tangent {
            at: *x,
            distance: if known { rise / slope } else { f64::INFINITY },
            normal: if known {
                gradient / slope
            } else {
                Vector3::zeros()
            },
        }
    }

    /// First-order distance to the isosurface.
    pub(crate) fn distance(&self, x: &Point3) -> f64 {
        self.tangent(x).distance.abs()
    }

    /// Does the vertex belong to this isosurface? A surface vertex far from it lies on some other
    /// interface, e.g. a membrane's.
    pub(crate) fn holds(&self, vertex: u32, x: &Point3, edge: f64) -> Result<bool, Error> {
        let (value, gradient) = self.field.value_gradient(x);
        if !value.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            let vertex = vertex as usize;
            return Err(Error::FieldNotFinite { vertex });
        }
        let rise = (value - self.level).abs();
        Ok(rise <= gradient.norm() * edge || rise <= 0.5 * self.level.abs())
    }
}
