// The page shows its picture as a file; here, where there are no files, the same as text. Of two meanings the first counts.
#![doc = concat!("[picture]: data:image/png;base64,", include_str!("../picture.b64"), "\n")]
#![doc = include_str!("../README.md")]

pub use nalgebra;

// The rooms, in the order in which data flow through the house.

// Atoms in residues, chains and domains, and parts of them by name.
pub mod structure;

// Values on a lattice, dense or in bricks near a surface.
pub mod grid;

// Triangles, quads and tetrahedra: half-edges, measures, quality, audits, shapes.
pub mod mesh;

// Files of all three.
#[cfg(feature = "io")]
pub mod io;

// What lies near a point.
pub mod search;

// Sparse matrices, graphs, and the smallest eigenpairs of both.
#[cfg(feature = "algebra")]
pub mod algebra;

// Bodies in tiles: what does not fit into one memory.
pub mod tiles;

// What triangle surfaces say, and how they are made better: most of it with the feature of that name.
pub mod surface;

// What all of them use: a field and its level sets, bounds, ids, the error of options, and how things are computed.

pub mod bounds;
pub mod compute;
pub mod field;
pub mod id;
pub mod options;

// For tests.

#[cfg(all(feature = "testing", feature = "algebra"))]
pub mod specification;
#[cfg(feature = "testing")]
pub mod testing;

#[cfg(feature = "wgpu")]
pub use geom_shaders as shaders;

pub use bounds::Aabb;
pub use compute::backend::{Agreement, Backend, Break, Cpu};
#[cfg(feature = "wgpu")]
pub use compute::gpu::{GpuContext, GpuError, Wgpu};
pub use compute::run::{Cancelled, Monitor, Run, Silent};
pub use field::{FieldAtMany, ImplicitField};
pub use grid::lattice::Lattice;
pub use grid::{BrickGrid, GridError, LatticeValues, ScalarGrid};
pub use id::{FaceId, HalfedgeId, VertexId};
pub use mesh::{MeshError, QuadMesh, TetMesh, TriMesh};
pub use structure::Structure;

/// A position in Å.
pub type Point3 = nalgebra::Point3<f64>;
/// A direction or a difference of positions in Å.
pub type Vector3 = nalgebra::Vector3<f64>;
