//! The matrices of an operator on any surface.

use geom_core::Run;

use super::element::Element;
use super::pattern::Matrices;
use super::{bezier, quads, triangles};
use crate::backend::{On, OperatorBackend};
use crate::{Error, SpectrumOptions};

/// The matrices of [`SpectrumOptions::operator`] on a surface, in unit scale (the largest extent is 1).
///
/// # Errors
/// [`Error::NoExtent`] for a point or nothing, [`Error::DegeneratePatch`], weights of the wrong length.
/// [`Error::Flat`] where the operator is infinite, an option out of its range, what the backend refuses.
pub fn assemble<B: OperatorBackend + ?Sized>(
    element: &Element<'_>,
    options: &SpectrumOptions,
    run: Run<'_, B>,
) -> Result<Matrices, Error> {
    assemble_on(element, options, run.with(run.backend.as_operators()))
}

fn assemble_on(
    element: &Element<'_>,
    options: &SpectrumOptions,
    run: On<'_>,
) -> Result<Matrices, Error> {
    options.check()?;
    let prepared = |dofs: usize| {
        let operator = &options.operator;
        operator.prepared(dofs, options.bounds, options.regularization)
    };
    match *element {
        Element::Triangles(mesh, normals) => {
            triangles::matrices(mesh, normals, &options.operator, options, run)
        }
        Element::CatmullClark(surface) => {
            let (conductor, factors) = prepared(surface.control().positions().len())?;
            quads::matrices(surface, &conductor, &factors, options, run)
        }
        Element::Bezier(surface) => {
            let (conductor, factors) = prepared(surface.nodes())?;
            bezier::matrices(surface, &conductor, &factors, options)
        }
    }
}
