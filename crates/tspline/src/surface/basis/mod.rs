//! Bases on a T-mesh, each as its Bézier extraction.
//!
//! A basis gives a function to some vertices of the T-mesh. What every other file needs of it is the same: per element, which
//! functions are not zero there, and each of them as a bicubic polynomial with 16 Bernstein coefficients. That is its Bézier
//! extraction, a matrix of 16 columns per element; evaluation, fitting, analysis, files and the GPU see nothing else, so that
//! a basis can be exchanged for another without any of them.

mod extraction;
mod gram;
mod hierarchical;
mod knots;
mod rational;
mod stars;
pub mod suitable;

pub use extraction::{Extraction, POINTS, Patch};
pub(crate) use gram::Local;
pub use knots::bezier_coefficients;

use geom_core::Point3;

use crate::{Error, TMesh};

/// Which functions carry the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Basis {
    /// Truncated hierarchical functions: polynomial, not negative, of sum one, and nested: refinement adds to the space
    /// and takes nothing away.
    #[default]
    Hierarchical,
    /// Bicubic T-spline functions at every vertex by their local knots, divided by their sum (the thesis's). Across a
    /// change of level they do not reproduce cubics, so that local refinement may make the error larger. Closed surfaces
    /// only.
    Rational,
    /// The same functions on a T-mesh on which they sum to one, so that nothing is divided and cubics are reproduced:
    /// analysis-suitable T-splines. Few T-meshes are, and [`suitable`](suitable::suitable) cuts others until they are. Closed
    /// surfaces only.
    Suitable,
}

impl Extraction {
    /// The extraction of a basis on a T-mesh.
    ///
    /// # Errors
    /// [`Error::Ring`] if blocks of an element's level are missing around it: build the T-mesh with more rings.
    /// [`Error::Open`] for T-splines on an open surface; [`Error::NotSuitable`] for [`Basis::Suitable`] where
    /// [`meetings`](suitable::meetings) are left.
    pub fn of(mesh: &TMesh, basis: Basis) -> Result<Self, Error> {
        match basis {
            Basis::Hierarchical => hierarchical::extraction(mesh),
            Basis::Rational => rational::extraction(mesh, true),
            Basis::Suitable => {
                suitable::check(mesh)?;
                rational::extraction(mesh, false)
            }
        }
    }

    /// The control points by which the basis of a cut T-mesh carries the same surface.
    pub(super) fn carried(
        &self,
        mesh: &TMesh,
        controls: &[Point3],
        after: &Self,
    ) -> Result<Vec<Point3>, Error> {
        hierarchical::carried(mesh, self, controls, after)
    }
}
