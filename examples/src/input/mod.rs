//! What a program works on: a file's structure or grid, its surface, two shapes, a T-mesh.

pub mod labels;
#[cfg(feature = "analysis")]
pub mod shapes;
pub mod source;
pub mod surface;
#[cfg(feature = "analysis")]
pub mod tmesh;
