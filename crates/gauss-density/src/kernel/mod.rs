//! What the kernels are made of, the lowest first.
//!
//! - `math`: exponentials, logarithms and powers as vector instructions.
//! - `boxes`: boxes of lattice points, bricks and blocks.
//! - `prepared`: the model made ready: levels that matter, parents, clusters of atoms.
//! - `plain`: f64, one point: with second derivatives and shares of atoms.
//! - `point`: f64, one point, many exponentials at a time.
//! - `cull`: the atoms that matter in a box, with their tree.
//! - `relative`: f32, a brick, relative to a reference atom per node: for small powers that reach far.
//! - `direct`: f32, a block, straight from the kernels: for moderate powers.
//! - `cells`: f64, the points of a sample cell side by side: "without this atom", and derivatives.

pub(crate) mod boxes;
pub(crate) mod cells;
pub(crate) mod cull;
pub(crate) mod direct;
pub(crate) mod math;
pub(crate) mod plain;
pub(crate) mod point;
pub(crate) mod prepared;
pub(crate) mod relative;
