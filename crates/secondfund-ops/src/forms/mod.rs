//! The fundamental forms, what the operators make of them, and the elements of a triangle mesh; how thick a body is.
//!
//! At a point with tangents x₁, x₂ and the outward normal n, the first form `g_ab = x_a · x_b` measures lengths on the surface and
//! the second, `b_ab = −n · x_ab`, how fast the normal turns. Their eigenvalues relative to each other are the principal curvatures
//! κ₁ ≥ κ₂ (positive where convex), with `H = (κ₁ + κ₂) / 2` and `K = κ₁ κ₂`. The third form `III = b g⁻¹ b` measures lengths on
//! the sphere of normals. An operator is what it makes of these in Dirichlet's energy; [`Law`] has all of them in one place.

mod conduct;
mod operator;
mod polygon;
mod ring;
mod symmetric;
mod thickness;
mod triangles;
mod weight;

pub use conduct::{Conductor, Law};
pub use operator::Operator;
pub use symmetric::{Forms, Principal, Symmetric};
pub use thickness::shape_diameter;
pub use triangles::{Normals, TriangleMatrix};
pub use weight::Weight;

pub(crate) use polygon::{area_normal, centroid, sorted_sides};
pub(crate) use ring::Neighbors;
pub(crate) use thickness::at_vertices;
pub(crate) use triangles::{element, shape_tensor, smoothed_normals};
