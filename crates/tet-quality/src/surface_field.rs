//! The isosurface that surface vertices lie on.

use geom_core::{ImplicitField, Point3, Vector3};

use crate::Error;

/// The level set of an implicit field.
pub(crate) struct Isosurface<'a> {
    pub(crate) field: &'a dyn ImplicitField,
    pub(crate) level: f64,
}

impl Isosurface<'_> {
    /// First-order signed distance to the isosurface, positive where the field is larger, and the
    /// unit gradient. Where the gradient is tiny (pinches) the distance is over-estimated: it is cut
    /// at `most`.
    pub(crate) fn distance(&self, x: &Point3, most: f64) -> (f64, Vector3) {
        let (value, gradient) = self.field.value_gradient(x);
        let slope = gradient.norm();
        let rise = value - self.level;
        if slope > 0.0 && slope.is_finite() && rise.is_finite() {
            ((rise / slope).clamp(-most, most), gradient / slope)
        } else {
            // No direction to go: as far as it can be.
            (most, Vector3::zeros())
        }
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
