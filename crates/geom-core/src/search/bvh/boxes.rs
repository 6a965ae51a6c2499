//! Four boxes side by side, in single precision: one question to all of them takes as many instructions as one to one.
//!
//! They are rounded outwards, and what is asked of them is rounded so that they seem nearer: nothing that a box holds can be
//! farther away than the box says. Coordinates beyond single precision make boxes that reach to infinity, and are found.

use crate::{Aabb, Point3};

/// Boxes of a node.
pub(super) const WIDTH: usize = 4;
/// What rounding takes off a squared distance at most: four roundings of sums and products, and a margin.
const ROUNDING: f64 = 1.0 + 1e-6;

/// Up to four boxes, coordinate by coordinate. Those that a node does not have are not to be asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Boxes {
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
}

/// A point, rounded down and up.
#[derive(Clone, Copy)]
pub(super) struct Rounded {
    low: [f32; 3],
    high: [f32; 3],
}

impl Rounded {
    pub(super) fn of(p: &Point3) -> Self {
        Self {
            low: [0, 1, 2].map(|k| down(p[k])),
            high: [0, 1, 2].map(|k| up(p[k])),
        }
    }
}

impl Boxes {
    /// Of at most four boxes.
    pub(super) fn of(boxes: impl IntoIterator<Item = Aabb>) -> Self {
        let mut all = Self {
            low: [[f32::INFINITY; WIDTH]; 3],
            high: [[f32::NEG_INFINITY; WIDTH]; 3],
        };
        for (lane, b) in boxes.into_iter().enumerate() {
            for k in 0..3 {
                (all.low[k][lane], all.high[k][lane]) = (down(b.min[k]), up(b.max[k]));
            }
        }
        all
    }

    /// One of them, a little larger than what it was made of.
    pub(super) fn lane(&self, lane: usize) -> Aabb {
        let at = |corner: &[[f32; WIDTH]; 3]| Point3::from(corner.map(|c| f64::from(c[lane])));
        Aabb {
            min: at(&self.low),
            max: at(&self.high),
        }
    }

    /// What holds all of the first `count`.
    pub(super) fn union(&self, count: usize) -> Aabb {
        (0..count).fold(Aabb::EMPTY, |all, lane| all.union(&self.lane(lane)))
    }

    /// No more than the squared distance of a point from each, and which are at most `most`. Comparisons stand in for `max`,
    /// which looks for NaN; a branch for each box would be guessed wrong too often.
    #[inline]
    pub(super) fn near(&self, p: &Rounded, most: f32) -> Near {
        let mut distances = [0.0f32; WIDTH];
        for k in 0..3 {
            let (low, high) = (&self.low[k], &self.high[k]);
            for (lane, sum) in distances.iter_mut().enumerate() {
                let (below, above) = (low[lane] - p.high[k], p.low[k] - high[lane]);
                let outside = if below > above { below } else { above };
                let outside = if outside > 0.0 { outside } else { 0.0 };
                *sum += outside * outside;
            }
        }
        let bit = |lane: usize| u32::from(distances[lane] <= most) << lane;
        Near {
            distances,
            bits: (0..WIDTH).fold(0, |bits, lane| bits | bit(lane)),
        }
    }

    /// Which of them may have a point in common with a box.
    #[inline]
    pub(super) fn meet(&self, other: &Aabb) -> [bool; WIDTH] {
        let mut all = [true; WIDTH];
        for k in 0..3 {
            let (low, high) = (down(other.min[k]), up(other.max[k]));
            for (lane, meets) in all.iter_mut().enumerate() {
                *meets &= self.low[k][lane] <= high && self.high[k][lane] >= low;
            }
        }
        all
    }
}

/// How near boxes are, and a bit for each that is near enough.
#[derive(Clone, Copy)]
pub(super) struct Near {
    pub(super) distances: [f32; WIDTH],
    bits: u32,
}

impl Near {
    /// Those of the first `count` that are near enough, in ascending order.
    #[inline]
    pub(super) fn lanes(&self, count: usize) -> impl Iterator<Item = usize> + use<> {
        let mut bits = self.bits & ((1 << count) - 1);
        std::iter::from_fn(move || {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits.wrapping_sub(1);
            (lane < WIDTH).then_some(lane)
        })
    }
}

/// The largest value of [`Boxes::near`] that a squared distance of at most `squared` can have.
pub(super) fn bound(squared: f64) -> f32 {
    up(squared * ROUNDING)
}

/// The largest number of single precision that is not above `x`.
fn down(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x {
        near.next_down()
    } else {
        near
    }
}

/// The smallest that is not below.
fn up(x: f64) -> f32 {
    -down(-x)
}
