//! The search for the best position of one vertex.
//!
//! A compass search (pattern search) needs values only: the smallest of some functions has no gradient where two of
//! them meet, which is exactly where the best places lie. It takes up to 15 candidates a round, judged side by side in
//! the lanes of a vector, for a fixed number of rounds.

use geom_core::Vector3;

use crate::smoothing::star::{Candidates, Star};

/// First step, in mean edge lengths.
pub(crate) const STEP: f64 = 0.25;
/// Factor of the step when no direction is better.
pub(crate) const SHRINK: f64 = 0.4;

/// The directions of a search: the positive and negative axes, then the diagonals.
pub(crate) struct Compass {
    directions: [Vector3; 14],
    count: usize,
    axes: [Vector3; 3],
}

impl Compass {
    /// The compass of these orthogonal axes; zero axes are left out. Three axes have 14 directions,
    /// two have 8, one has 2.
    pub(crate) fn along(axes: &[Vector3; 3]) -> Self {
        let mut directions = [Vector3::zeros(); 14];
        let mut count = 0;
        let mut put = |d: Vector3| {
            directions[count] = d;
            count += 1;
        };
        let mut free = [Vector3::zeros(); 3];
        let mut n = 0;
        for a in axes.iter().filter(|a| **a != Vector3::zeros()) {
            free[n] = *a;
            n += 1;
            put(*a);
            put(-a);
        }
        match n {
            2 => {
                for (s, t) in SIGNS {
                    put((free[0] * s + free[1] * t) * std::f64::consts::FRAC_1_SQRT_2);
                }
            }
            3 => {
                for (s, t) in SIGNS {
                    for u in [1.0, -1.0] {
                        put((free[0] * s + free[1] * t + free[2] * u) / 3f64.sqrt());
                    }
                }
            }
            _ => {}
        }
        Self {
            directions,
            count,
            axes: *axes,
        }
    }

    fn directions(&self) -> &[Vector3] {
        &self.directions[..self.count]
    }

    /// The part of a displacement along the axes.
    fn project(&self, d: Vector3) -> Vector3 {
        self.axes
            .iter()
            .fold(Vector3::zeros(), |s, a| s + a * a.dot(&d))
    }
}

/// Of the first two axes in a diagonal.
const SIGNS: [(f64, f64); 4] = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];

/// The best position found from `x`. Each round takes the best of all directions; the first one also
/// looks at the mean of the neighbours.
pub(crate) fn search(star: &mut Star, start: Vector3, compass: &Compass, rounds: u32) -> Vector3 {
    let mean = star.centroid();
    let value = star.value(&start);
    let start = Start { at: start, value };
    search_within(star, start, Some(mean), compass, rounds, |_| true)
}

/// Where a search starts.
#[derive(Clone, Copy)]
pub(crate) struct Start {
    /// The position.
    pub(crate) at: Vector3,
    /// The smallest value there.
    pub(crate) value: f64,
}

/// The same for another mean or none, within a part of space.
///
/// Never gives a place that is worse than the start: if no candidate is better in any round, it is the start itself,
/// bit by bit, which callers take as "stays". A mean counts only by its part along the axes.
pub(crate) fn search_within(
    star: &mut Star,
    start: Start,
    mean: Option<Vector3>,
    compass: &Compass,
    rounds: u32,
    within: impl Fn(&Vector3) -> bool,
) -> Vector3 {
    let (mut x, mut best) = (start.at, start.value);
    let mut step = STEP * star.mean_edge(&x);
    for round in 0..rounds {
        let mut tries = Candidates::none(&x);
        let mean = mean.filter(|_| round == 0);
        let mean = mean.map(|mean| x + compass.project(mean - x));
        let around = compass.directions().iter().map(|d| x + d * step);
        for candidate in mean.into_iter().chain(around).filter(&within) {
            tries.push(&candidate);
        }
        match star.best_of(&tries, best) {
            Some(found) => (x, best) = (tries.at(found.number), found.value),
            None => step *= SHRINK,
        }
    }
    x
}
