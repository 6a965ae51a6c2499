//! What triangle surfaces say and how they are made better; all but [`curvature`] and [`isoline`] with the feature `surface`.
//!
//! - [`laplace`]: cotangent stiffness, mass, gradient and divergence, the robust operator, the connection
//! - [`curvature`]: principal curvatures by fitted quadrics
//! - [`isoline`]: the lines where a function of the vertices has a value
//! - [`distance`]: shortest ways along edges, and geodesic distances by heat flow
//! - [`ground`]: a surface that the vertices of another mesh stay on
//! - [`flow`]: quads that move on it until their corners are right angles
//! - [`repair`]: any triangles made an oriented manifold
//! - [`remesh`]: triangles near equilateral, of a wanted edge length
//!
//! Start with [`laplace`] for operators, with [`remesh`] for a mesh that is to be made better; [`repair`] comes before
//! both where a file is not to be trusted. All take a [`TriMesh`](crate::TriMesh) and say by name what is wrong with
//! one that does not suit.

pub mod curvature;
#[cfg(feature = "surface")]
pub mod distance;
#[cfg(feature = "surface")]
pub mod flow;
#[cfg(feature = "surface")]
pub mod ground;
pub mod isoline;
#[cfg(feature = "surface")]
pub mod laplace;
#[cfg(feature = "surface")]
pub mod remesh;
#[cfg(feature = "surface")]
pub mod repair;
