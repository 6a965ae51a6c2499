//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod audits;
mod backends;
mod compute;
mod crossings;
mod fields;
mod files;
mod files_fuzz;
mod files_refused;
mod gpu;
mod graph;
mod grids;
mod lattices;
mod meshes;
mod operators;
mod remeshing;
mod remeshing_bounds;
mod solver;
mod spectral;
mod structures;
mod structures_data;
mod structures_fuzz;
mod structures_parts;
mod structures_words;
mod surfaces;
mod surfaces_shape;
mod tiles;
