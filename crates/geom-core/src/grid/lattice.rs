//! Cubic lattices of points: index ↔ point.
//!
//! The convention of all grids, samples and cells: x runs fastest, then y, then z, and [`Lattice::index`] is the place
//! in memory. A cell has the coordinates of its lowest corner.

use crate::{Aabb, Point3, Vector3};

/// Points `origin + spacing · (i, j, k)` with `0 ≤ i < counts[0]`, …; x fastest in memory.
///
/// Nothing is checked here; grids refuse a lattice whose origin is not finite or whose spacing is not positive and
/// finite.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Lattice {
    /// Point (0, 0, 0), Å.
    pub origin: Point3,
    /// Distance between neighbours, Å; the same on each axis.
    pub spacing: f64,
    /// Points per axis.
    /// A count of 1 gives a plane without cells, 0 no point at all.
    pub counts: [usize; 3],
}

impl Lattice {
    /// The lattice whose points cover `bounds`: the first point at its lowest corner, the last at or
    /// just beyond its highest.
    ///
    /// At least one point per axis, whatever the spacing, and also for an empty box, whose corner is not finite. Counts
    /// saturate, so ask [`Lattice::points`] before anything is allocated for them.
    pub fn covering(bounds: &Aabb, spacing: f64) -> Self {
        let extent = bounds.extent();
        let count = |k: usize| ((extent[k] / spacing).ceil().max(0.0) as usize).saturating_add(1);
        Self {
            origin: bounds.min,
            spacing,
            counts: [count(0), count(1), count(2)],
        }
    }

    /// Number of points, in u128 because `counts` may come from a user; saturates.
    pub fn points(&self) -> u128 {
        let counts = self.counts.map(|n| n as u128);
        counts.into_iter().fold(1, u128::saturating_mul)
    }

    /// Number of points as `usize`; saturates on overflow.
    ///
    /// `usize::MAX` stands for that many or more, which nothing can hold.
    pub fn len(&self) -> usize {
        usize::try_from(self.points()).unwrap_or(usize::MAX)
    }

    /// Does the lattice have no point?
    pub fn is_empty(&self) -> bool {
        self.points() == 0
    }

    /// Cells per axis: one less than points.
    ///
    /// 0 for an axis of one point or none.
    pub fn cells(&self) -> [usize; 3] {
        self.counts.map(|n| n.saturating_sub(1))
    }

    /// Position of a point.
    ///
    /// Also beyond the lattice. One product and one sum per coordinate, so that the same index has the same bits
    /// wherever it is asked for; a sum over steps would not.
    pub fn point(&self, [i, j, k]: [usize; 3]) -> Point3 {
        self.origin + Vector3::new(i as f64, j as f64, k as f64) * self.spacing
    }

    /// Place of a point in memory: x fastest.
    ///
    /// Not checked: a point beyond an axis has the place of another one.
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.counts[1] + j) * self.counts[0] + i
    }

    /// The point at a place in memory: the inverse of [`Lattice::index`].
    ///
    /// Panics if there are no points along x or y.
    pub fn coordinates(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.counts;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// Position in units of the spacing, relative to the origin.
    ///
    /// The whole part of each coordinate is the number of the cell, the rest the place in it. Outside of the lattice it
    /// is negative or beyond [`Lattice::cells`].
    pub fn local(&self, p: &Point3) -> Vector3 {
        (p - self.origin) / self.spacing
    }

    /// The box from the first to the last point.
    ///
    /// For a lattice without points along an axis it is flat there.
    pub fn bounds(&self) -> Aabb {
        let last = self.counts.map(|n| n.saturating_sub(1));
        Aabb::new(self.origin, self.point(last))
    }
}

/// A box of points of a lattice that is too large to be held as a whole.
///
/// `low` counts points of the whole, so that a window names points without rounding: what is computed from whole
/// indices by [`Lattice::point`] of the whole has the same bits in every window.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Window {
    /// All of the lattice.
    pub whole: Lattice,
    /// The first point.
    pub low: [usize; 3],
    /// Points per axis.
    pub counts: [usize; 3],
}

impl Window {
    /// The points of some cells of a lattice (`low..high` per axis) and of `halo` more on every side, as far as there
    /// are any.
    ///
    /// ```
    /// use geom_core::grid::lattice::Window;
    /// use geom_core::{Lattice, Point3};
    /// let whole = Lattice { origin: Point3::origin(), spacing: 1.0, counts: [101; 3] };
    /// let window = Window::around(whole, [0, 32, 96], [32, 64, 128], 8);
    /// assert_eq!((window.low, window.counts), ([0, 24, 88], [41, 49, 13]));
    /// ```
    ///
    /// One point more than cells. A window of no cells (`low == high`, no halo) has one point per axis.
    pub fn around(whole: Lattice, low: [usize; 3], high: [usize; 3], halo: usize) -> Self {
        let cells = whole.cells();
        let low = [0, 1, 2].map(|k| low[k].saturating_sub(halo).min(cells[k]));
        let counts = [0, 1, 2].map(|k| (high[k] + halo).clamp(low[k], cells[k]) - low[k] + 1);
        Self { whole, low, counts }
    }

    /// The points of the window as a lattice of their own. Its points may differ from those of the whole in the last
    /// bit.
    pub fn lattice(&self) -> Lattice {
        Lattice {
            origin: self.whole.point(self.low),
            counts: self.counts,
            ..self.whole
        }
    }

    /// Does the window end where the lattice does, on the low and the high side of each axis?
    ///
    /// There samples end for good; elsewhere more can be had from the whole.
    pub fn ends(&self) -> [[bool; 2]; 3] {
        std::array::from_fn(|k| {
            let high = self.low[k] + self.counts[k] >= self.whole.counts[k];
            [self.low[k] == 0, high]
        })
    }
}
