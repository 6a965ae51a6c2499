#![doc = include_str!("../README.md")]

pub use nalgebra;

// Things, in the order in which data flow: atoms, values on a lattice, meshes; files of all of them.
pub mod grid;
#[cfg(feature = "io")]
pub mod io;
pub mod mesh;
pub mod structure;
// What is near a point; sparse matrices, graphs and eigenpairs; what surfaces say and how they are made better.
#[cfg(feature = "algebra")]
pub mod algebra;
pub mod search;
#[cfg(feature = "surface")]
pub mod surface;
// How things are computed.
pub mod compute;
// Small things that all need.
pub mod bounds;
pub mod field;
pub mod id;
pub mod options;
#[cfg(all(feature = "testing", feature = "algebra"))]
pub mod specification;
#[cfg(feature = "testing")]
pub mod testing;

#[cfg(feature = "wgpu")]
pub use geom_shaders as shaders;

// temporary: the old paths, until all users have the new ones
#[cfg(feature = "algebra")]
pub use algebra::{self as linalg, eigen as spectral, graph};
#[cfg(feature = "wgpu")]
pub use compute::gpu;
pub use compute::{backend, coloring, lanes, parallel, run, sets};
pub use grid::lattice;
pub use search::bvh;
#[cfg(feature = "search")]
pub use search::nearest;
#[cfg(feature = "surface")]
pub use surface::{curvature, distance, isoline, laplace, repair};
// temporary: end

pub use bounds::Aabb;
pub use compute::backend::{Agreement, Backend, Break, Cpu};
#[cfg(feature = "wgpu")]
pub use compute::gpu::{GpuContext, GpuError, Wgpu};
pub use compute::run::{Cancelled, Monitor, Run, Silent};
pub use field::ImplicitField;
pub use grid::lattice::Lattice;
pub use grid::{BrickGrid, GridError, LatticeValues, ScalarGrid};
pub use id::{FaceId, HalfedgeId, VertexId};
pub use mesh::{MeshError, QuadMesh, TetMesh, TriMesh};
pub use structure::Structure;

/// A position in Å.
pub type Point3 = nalgebra::Point3<f64>;
/// A direction or a difference of positions in Å.
pub type Vector3 = nalgebra::Vector3<f64>;
