//! The fundamental forms, what the operators make of them, and the elements of a triangle mesh.

mod conduct;
mod operator;
mod polygon;
mod ring;
mod symmetric;
mod triangles;
mod weight;

pub use conduct::{Conductor, Law};
pub use operator::Operator;
pub use symmetric::{Forms, Principal, Symmetric};
pub use triangles::{Normals, TriangleMatrix};
pub use weight::Weight;

pub(crate) use polygon::{area_normal, centroid, sorted_sides};
pub(crate) use ring::Neighbors;
pub(crate) use triangles::{element, shape_tensor, smoothed_normals};
