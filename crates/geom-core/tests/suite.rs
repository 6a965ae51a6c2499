//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod backends;
mod files;
mod files_fuzz;
mod graph;
mod grids;
mod meshes;
mod operators;
mod solver;
mod spectral;
mod structures;
mod structures_data;
mod structures_fuzz;
mod surfaces;
mod surfaces_shape;
mod tiles;
