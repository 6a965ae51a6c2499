//! Operators on a surface: their matrices and their smallest eigenpairs.
//!
//! The way is the same for all three kinds of surface: elements give small dense matrices (`triangles`, `quads`,
//! `bezier`, the last two by `patch`), `pattern` adds them up in a fixed order, and `spectrum` finds the smallest
//! eigenpairs of the sum.

mod assemble;
mod bezier;
mod element;
pub(crate) mod patch;
mod pattern;
mod quads;
mod scale;
mod spectrum;
mod triangles;

pub use assemble::assemble;
pub use bezier::{BezierElement, BezierSurface};
pub use element::Element;
pub use pattern::Matrices;
pub use spectrum::{Spectrum, spectrum};

pub(crate) use pattern::Pattern;
pub(crate) use quads::{Integrand, Quads};
pub(crate) use scale::UnitScale;
pub(crate) use spectrum::modes_of;
pub(crate) use triangles::{triangle_elements, vertex_normals};
