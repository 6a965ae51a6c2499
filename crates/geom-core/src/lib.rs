#![doc = include_str!("../README.md")]

pub use nalgebra;

pub mod bounds;
pub mod bvh;
pub mod compute;
pub mod curvature;
pub mod distance;
pub mod field;
pub mod graph;
pub mod grid;
pub mod id;
pub mod isoline;
pub mod laplace;
pub mod lattice;
pub mod linalg;
pub mod mesh;
pub mod nearest;
pub mod options;
pub mod repair;
pub mod spectral;
pub mod structure;

#[cfg(feature = "io")]
pub mod io;
#[cfg(feature = "testing")]
pub mod testing;

#[cfg(feature = "wgpu")]
pub use geom_shaders as shaders;

// temporary: the old paths, until all users have the new ones
#[cfg(feature = "wgpu")]
pub use compute::gpu;
pub use compute::{backend, coloring, lanes, parallel, run, sets};

pub use bounds::Aabb;
pub use compute::backend::{Agreement, Backend, Break, Cpu};
#[cfg(feature = "wgpu")]
pub use compute::gpu::{GpuContext, GpuError, Wgpu};
pub use compute::run::{Cancelled, Monitor, Run, Silent};
pub use field::ImplicitField;
pub use grid::{BrickGrid, GridError, LatticeValues, ScalarGrid};
pub use id::{AtomId, CellId, FaceId, HalfedgeId, Per, VertexId};
pub use lattice::Lattice;
pub use mesh::{MeshError, QuadMesh, TetMesh, TriMesh};
pub use structure::Structure;

/// A position in Å.
pub type Point3 = nalgebra::Point3<f64>;
/// A direction or a difference of positions in Å.
pub type Vector3 = nalgebra::Vector3<f64>;
