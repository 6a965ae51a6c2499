//! The isosurface that surface vertices lie on.
//!
//! Fields are asked for value and gradient, from which the first-order distance follows, `(f − level) / |∇f|`. It is
//! exact for a signed distance, good near any level set, and too large where the gradient nearly vanishes: where it
//! decides how far a vertex goes, it is cut.

use geom_core::compute::{BackendError, parallel};
use geom_core::field::{Tangent, in_batches};
use geom_core::{ImplicitField, Point3, Vector3};

use crate::boundary::plane::Plane;
use crate::error::Error;

/// The level set of an implicit field, or the curve in which a plane cuts it.
#[derive(Clone, Copy)]
pub(crate) struct Isosurface<'a> {
    pub(crate) field: &'a dyn ImplicitField,
    pub(crate) level: f64,
    /// The field is the distance to the mesh's own surfaces, plane parts and sharp edges of which stay.
    pub(crate) own: bool,
    /// Of the level set only what lies in this plane.
    pub(crate) plane: Option<Plane>,
}

/// Of no point: nothing is known there.
pub(crate) const UNKNOWN: Tangent = Tangent {
    at: Point3::new(f64::NAN, f64::NAN, f64::NAN),
    height: f64::INFINITY,
    gradient: Vector3::new(0.0, 0.0, 0.0),
};

/// The first-order distance to the isosurface, cut at `most`. Where the gradient is tiny (pinches) it is
/// over-estimated.
pub(crate) fn distance_within(tangent: &Tangent, most: f64) -> f64 {
    tangent.distance().clamp(-most, most)
}

impl Isosurface<'_> {
    /// The field at `x`, to first order; for a curve within its plane, or the one beside it that `x` lies in.
    pub(crate) fn tangent(&self, x: &Point3) -> Tangent {
        let tangent = Tangent::new(self.field, self.level, *x);
        self.plane.map_or(tangent, |plane| plane.restrict(tangent))
    }

    /// Is a place no farther from the isosurface than `tolerance`, and in the plane of a curve?
    pub(crate) fn reached(&self, tangent: &Tangent, tolerance: f64) -> bool {
        let in_plane = self.plane.is_none_or(|plane| plane.holds(&tangent.at));
        in_plane && tangent.distance().abs() <= tolerance
    }

    /// The same at many points; a field that takes them with one call is asked once.
    ///
    /// # Errors
    ///
    /// Those of the field, and another number of answers than points.
    pub(crate) fn tangents(&self, at: &[Point3]) -> Result<Vec<Tangent>, Error> {
        let Some(field) = self.field.at_many() else {
            return Ok(parallel::map_each(at, |x| self.tangent(x)));
        };
        in_batches(field, at.len(), |some| {
            let at = &at[some];
            let mut found = Vec::with_capacity(at.len());
            field.values_gradients(at, &mut found)?;
            let (answers, asked) = (found.len(), at.len());
            BackendError::unless(answers == asked, "the field", || {
                format!("{answers} answers at {asked} points")
            })?;
            let tangents = at
                .iter()
                .zip(found)
                .map(|(&at, (value, gradient))| Tangent {
                    at,
                    height: value - self.level,
                    gradient,
                });
            Ok(tangents.collect())
        })
    }

    /// First-order distance to the isosurface.
    pub(crate) fn distance(&self, x: &Point3) -> f64 {
        self.tangent(x).distance().abs()
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
