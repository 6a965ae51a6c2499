#![doc = include_str!("../README.md")]

pub use nalgebra;

pub mod backend;
pub mod bounds;
pub mod bvh;
pub mod coloring;
pub mod curvature;
pub mod distance;
pub mod field;
pub mod graph;
pub mod grid;
pub mod id;
pub mod isoline;
pub mod lanes;
pub mod laplace;
pub mod lattice;
pub mod linalg;
pub mod mesh;
pub mod nearest;
pub mod parallel;
pub mod repair;
pub mod run;
pub mod sets;
pub mod spectral;
pub mod structure;

#[cfg(feature = "wgpu")]
pub mod gpu;
#[cfg(feature = "io")]
pub mod io;
#[cfg(feature = "testing")]
pub mod testing;

#[cfg(feature = "wgpu")]
pub use geom_shaders as shaders;

pub use backend::{Agreement, Backend, Break, Cpu};
pub use bounds::Aabb;
pub use field::ImplicitField;
#[cfg(feature = "wgpu")]
pub use gpu::{GpuContext, GpuError, Wgpu};
pub use grid::{BrickGrid, GridError, LatticeValues, ScalarGrid};
pub use id::{AtomId, CellId, FaceId, HalfedgeId, Per, VertexId};
pub use lattice::Lattice;
pub use mesh::{MeshError, QuadMesh, TetMesh, TriMesh};
pub use run::{Cancelled, Monitor, Run, Silent};
pub use structure::Structure;

/// A position in Å.
pub type Point3 = nalgebra::Point3<f64>;
/// A direction or a difference of positions in Å.
pub type Vector3 = nalgebra::Vector3<f64>;
