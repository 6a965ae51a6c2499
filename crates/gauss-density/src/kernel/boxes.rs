//! Boxes of lattice points, bricks and blocks.
//!
//! Everything that says "nothing matters here" is said of a closed box. Boxes of bricks and blocks overlap by a lattice
//! cell, so that no edge of the lattice falls between two of them. All lengths are Å.

use geom_core::grid::BRICK;
use geom_core::{Aabb, Lattice, Point3, Vector3};

/// A closed box as centre and half edges.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    pub(crate) center: Point3,
    pub(crate) half: Vector3,
}

impl From<&Aabb> for Cell {
    fn from(b: &Aabb) -> Self {
        // A hair wider, so that rounding does not leave the box's own corners outside.
        let half = (b.max - b.min) * 0.5;
        Self {
            center: b.min + half,
            half: half * (1.0 + 1e-12) + Vector3::repeat(1e-9),
        }
    }
}

/// The box of the lattice points `[low, high]` of a lattice, which may lie beyond it.
pub(crate) fn lattice_box(origin: &Point3, spacing: f64, low: [i64; 3], high: [i64; 3]) -> Aabb {
    let at = |p: [i64; 3]| Point3::from(std::array::from_fn(|k| origin[k] + spacing * p[k] as f64));
    Aabb::new(at(low), at(high))
}

/// The box of bricks `low..high`, and one cell more on the low sides: an edge of the lattice that changes
/// sign between two bricks lies in the boxes of both, so neither can be exterior.
pub(crate) fn bricks_box(lattice: &Lattice, low: [usize; 3], high: [usize; 3]) -> Aabb {
    lattice_box(
        &lattice.origin,
        lattice.spacing,
        low.map(|b| (b * BRICK) as i64 - 1),
        high.map(|b| (b * BRICK) as i64),
    )
}

/// The middle of a cube of points.
pub(crate) fn middle(lattice: &Lattice, first: [usize; 3], side: usize) -> Point3 {
    let half = 0.5 * lattice.spacing * (side as f64 - 1.0);
    lattice.point(first) + Vector3::repeat(half)
}

/// The squared distance between two closed boxes, Å²; 0 where they meet.
pub(crate) fn gap_squared(a: &Aabb, b: &Aabb) -> f64 {
    let gap = |k: usize| (a.min[k] - b.max[k]).max(b.min[k] - a.max[k]).max(0.0);
    (0..3).map(|k| gap(k) * gap(k)).sum()
}

/// The lattice points of a brick, x fastest.
/// Those only that the lattice has: a brick at its far end may hold fewer than 512.
pub(crate) fn for_points(lattice: &Lattice, brick: [usize; 3], mut f: impl FnMut([usize; 3])) {
    let first = brick.map(|b| b * BRICK);
    let last = [0, 1, 2].map(|k| (first[k] + BRICK).min(lattice.counts[k]));
    for z in first[2]..last[2] {
        for y in first[1]..last[1] {
            for x in first[0]..last[0] {
                f([x, y, z]);
            }
        }
    }
}
