//! The matrices of an operator on any surface.

use geom_core::Run;

use super::element::Element;
use super::pattern::Matrices;
use super::{quads, triangles};
use crate::backend::OperatorBackend;
use crate::{Error, SpectrumOptions};

/// The matrices of [`SpectrumOptions::operator`] on a surface, in unit scale (the largest extent is 1).
///
/// # Errors
/// [`Error::NoExtent`] for a point or nothing, [`Error::DegeneratePatch`], weights of the wrong length.
pub fn assemble<B: OperatorBackend + ?Sized>(
    element: &Element<'_>,
    options: &SpectrumOptions,
    run: Run<'_, B>,
) -> Result<Matrices, Error> {
    let run = run.with(run.backend.as_operators());
    options.check()?;
    match *element {
        Element::Triangles(mesh, normals) => {
            triangles::matrices(mesh, normals, &options.operator, options, run)
        }
        Element::CatmullClark(surface) => {
            let vertices = surface.control().positions().len();
            let operator = &options.operator;
            let (conductor, factors) =
                operator.prepared(vertices, options.bounds, options.regularization)?;
            quads::matrices(surface, &conductor, &factors, options)
        }
    }
}
