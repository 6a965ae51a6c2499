//! From the model to values: on a lattice, near the surface, anywhere.
//!
//! - `blocks`: the way to the blocks of bricks that some atom can reach, batch after batch.
//! - `dense`: every lattice point.
//! - `band`: bricks near the surface.
//! - `window`: bricks near the surface in a part of the lattice.
//! - `point`: any point, with derivatives.
//! - `root`: straighter between lattice points.
//! - `compare`: one surface beside another (Eq. 3.10).
//! - `low_pass`: the shape without its short waves (§5.2.1).

pub(crate) mod band;
pub(crate) mod blocks;
pub(crate) mod compare;
pub(crate) mod dense;
pub(crate) mod low_pass;
pub(crate) mod point;
pub(crate) mod root;
pub(crate) mod window;
