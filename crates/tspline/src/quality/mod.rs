//! Better elements: vertices move on the surface until the elements' corners are what they should be.

mod cells;
mod components;
mod improve;
mod jacobian;
mod lines;

pub use jacobian::{JacobianSummary, scaled_jacobians};

use geom_core::{Run, TriMesh};

use crate::backend::SplineBackend;
use crate::{Error, QualityOptions, TMesh};

/// A T-mesh with better elements, and how much better.
#[derive(Clone, Debug, PartialEq)]
pub struct Improved {
    /// The T-mesh; the vertices of its fine mesh have moved along.
    pub mesh: TMesh,
    /// Scaled Jacobian per element.
    pub jacobians: Vec<f64>,
    /// What was done.
    pub report: QualityReport,
}

/// What [`improve`] did.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct QualityReport {
    /// Steps of the flow.
    pub steps: usize,
    /// Mean distortion of a corner before and after the flow; 1 is perfect. Its second part may raise it a little, for the sake
    /// of the worse corners.
    pub distortion: [f64; 2],
    /// Vertices that were moved one by one after the flow.
    pub lifted: usize,
    /// Elements that were cut into four, with those around them, because nothing else helped.
    pub cut: usize,
    /// Scaled Jacobians on the surface, before the first step.
    pub before: JacobianSummary,
    /// Scaled Jacobians of the result.
    pub after: JacobianSummary,
    /// Name of the backend.
    pub backend: String,
}

/// Puts the vertices of a T-mesh onto a surface and moves them down the gradient of the corners' distortion (Eqs.
/// 5.5–5.9, signed, with analytic derivatives), back onto the surface after each step; then those of the worst elements to
/// where these are best, and of those that are no rectangles to where these are better in the mean. Elements keep the
/// proportions of their sides. Vertices on the boundary of an open mesh stay
/// on the surface's boundary, those on sharp edges on them if `crease` asks for it, corners of both where they are. With [`Method::Corners`](crate::Method) the
/// smallest scaled Jacobian never falls below that of the mesh put onto the surface.
///
/// What stays below [`QualityOptions::least`] is too large for the surface there: it is cut into four, with the elements around
/// it, and the new elements are improved again. Where elements of the finest level are cut, the mesh's quads become finer
/// everywhere, but not its elements.
///
/// The worst elements are lifted on the CPU, whatever the backend.
///
/// # Errors
/// [`Error::Option`]; [`Error::Tree`] for a surface without triangles; [`Error::Mesh`] if vertices are to slide along lines of
/// a surface that is no manifold; [`Error::Backend`], [`Error::Cancelled`].
///
/// ```
/// use tspline::geom_core::{Cpu, Run, mesh::shapes};
/// use tspline::{QualityOptions, TMesh, TMeshOptions, improve};
/// let (fine, sphere) = (shapes::quad_sphere(1.0, 8), shapes::icosphere(1.0, 4));
/// let mesh = TMesh::build(&fine, &vec![0; fine.quads().len()], &TMeshOptions::default())?;
/// let better = improve(mesh, &sphere, &QualityOptions::default(), Run::on(&Cpu))?;
/// assert!(better.report.after.min > 0.75);
/// # Ok::<(), tspline::Error>(())
/// ```
pub fn improve<B: SplineBackend + ?Sized>(
    mesh: TMesh,
    surface: &TriMesh,
    options: &QualityOptions,
    run: Run<'_, B>,
) -> Result<Improved, Error> {
    options.check()?;
    improve::improve(mesh, surface, options, run.with(run.backend.as_spline()))
}
