//! What an operator lives on.

use geom_core::TriMesh;

use super::bezier::BezierSurface;
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
