//! What an operator lives on, and in which scale.

use geom_core::{Aabb, Point3, TriMesh, Vector3};

use super::bezier::BezierSurface;
use crate::Error;
use crate::catmull::Surface;
use crate::forms::Normals;

/// What carries the functions.
#[derive(Clone, Copy, Debug)]
pub enum Element<'a> {
    /// The limit surface of a quad mesh, bicubic: functions are C¹, curvature is that of the surface.
    CatmullClark(&'a Surface),
    /// A triangle mesh with linear functions; curvature from the normals of its vertices.
    Triangles(&'a TriMesh, &'a Normals),
    /// Bézier elements of a spline: functions by the coefficients of its nodes, curvature of the surface.
    Bezier(&'a BezierSurface),
}

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

    pub(crate) fn undo(&self, x: &Vector3) -> Point3 {
        self.center + x * self.length
    }
}
