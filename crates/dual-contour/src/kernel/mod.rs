//! The hot loops over cells, for eight cells at a time. Where a step is one loop over the lanes the compiler turns
//! it into the widest instructions at hand; longer chains, which it does not see through, name their vectors
//! ([`geom_core::compute::lanes`]). Bits do not depend on which instructions those are, nor on the number of lanes.

use geom_core::compute::lanes::{Lanes, Simd, Vectors, dot};

pub(crate) mod cells;
pub(crate) mod edge_tets;
pub(crate) mod fan;

pub(crate) use cells::{all_finite, crossings, dual_vertices, min_max};
pub(crate) use edge_tets::{EdgeTets, Rows};
pub(crate) use fan::{MOST, NO_FAN, Quads, best_fan, diagonal, diagonals};

/// Points per side of a block: 8 finest cells, closed.
pub(crate) const BLOCK_SIDE: usize = 9;
/// Values per block, x fastest.
pub(crate) const BLOCK_POINTS: usize = BLOCK_SIDE * BLOCK_SIDE * BLOCK_SIDE;
/// Finest cells per block, x fastest.
pub(crate) const BLOCK_CELLS: usize = 512;

/// Cells at a time.
pub(crate) const LANES: usize = 8;

/// A dual vertex of a kernel keeps this distance from the sides of its cell, in the mesh nineteen twentieths of it at least.
/// In edges of the cell, so that the points of two neighbours are never one.
pub(crate) const INSET: f64 = 0.01;
/// Newton steps behave as if the gradient were at least √REGULAR times the spread of the corner values
/// per cell: flat places move little instead of jumping.
pub(crate) const REGULAR: f64 = 0.01;

/// The vectors whose coordinates stand in three rows, from a place on.
#[inline(always)]
fn load<S: Simd, const N: usize>(simd: S, rows: &[[f64; N]; 3], at: usize) -> Vectors<S> {
    [
        Lanes::of(simd, &rows[0][at..]),
        Lanes::of(simd, &rows[1][at..]),
        Lanes::of(simd, &rows[2][at..]),
    ]
}

#[inline(always)]
fn square<S: Simd>(a: Vectors<S>) -> Lanes<S> {
    dot(a, a)
}
