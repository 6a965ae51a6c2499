//! More integers than dense matrices should have: rounded region by region.
//!
//! Of the integers of a region alone, all others following as real numbers, the part of the inverse that belongs to them is small. They
//! are rounded by it, held from then on, and the next region is rounded with what they leave of the energy: one sparse
//! factor for each region, and memory that does not grow with the number of regions. What that costs in energy is the freedom to round
//! the easiest integer of all first.
//!
//! Moves that mend what rounding folds are judged by the triangles of the decimated map: how much more they differ from those of the
//! relaxed map. That is less than what the energy knows, which the reals between them make smaller.

use std::cell::OnceCell;

use geom_core::nalgebra::{DMatrix, DVector};
use geom_core::{Aabb, Cancelled, Point3};

use super::mend::{Cost, Energy, Means, strongest};
use super::round::greedy;
use super::upright::{Pair, Sides, Upright};
use crate::Error;
use crate::backend::On;
use crate::map::system::Weighted;
#[cfg(feature = "testing")]
use crate::map::{transition::Sum, unfold::Effort};

/// Integers whose energy is never known in full.
pub(crate) struct Regions {
    nearest: Vec<f64>,
}

impl Regions {
    /// Rounds region by region of so many integers at most, in the order of a bisection of the places where they are at home.
    ///
    /// # Errors
    /// Of a factor, and if the watcher asks to stop.
    pub(crate) fn of(
        weighted: &Weighted<'_>,
        homes: &[Point3],
        most: usize,
        run: On<'_>,
    ) -> Result<Self, Error> {
        let mut regions = Vec::new();
        let all = (0..homes.len()).collect();
        bisected(all, homes, homes.len().div_ceil(most.max(1)), &mut regions);
        let mut held = vec![None; homes.len()];
        for (number, region) in regions.iter().enumerate() {
            run.progress("integers", number as u64, regions.len() as u64)?;
            let rest = weighted.holding(&held)?;
            let count = region.len();
            let inverse = DMatrix::from_vec(count, count, rest.inverse_schur(region)?);
            let relaxed = region.iter().map(|&k| rest.integers[k]);
            let rounded = greedy(inverse, &DVector::from_iterator(count, relaxed));
            for (&k, rounded) in region.iter().zip(rounded) {
                held[k] = Some(rounded);
            }
        }
        Ok(Self {
            nearest: held.into_iter().flatten().collect(),
        })
    }
}

/// Cuts across the longest axis into so many parts of the same size.
fn bisected(mut all: Vec<usize>, homes: &[Point3], parts: usize, regions: &mut Vec<Vec<usize>>) {
    if parts <= 1 {
        regions.push(all);
        return;
    }
    let bounds = Aabb::of_points(all.iter().map(|&k| &homes[k]));
    let axis = bounds.extent().imax();
    all.sort_by(|&a, &b| homes[a][axis].total_cmp(&homes[b][axis]).then(a.cmp(&b)));
    let lower = parts / 2;
    let upper = all.split_off(all.len() * lower / parts);
    bisected(all, homes, lower, regions);
    bisected(upper, homes, parts - lower, regions);
}

impl Energy for Regions {
    fn nearest(&self) -> &[f64] {
        &self.nearest
    }

    /// There is no way back from a denser grid without the energy.
    fn denser(&self, _: i32, _: Means<'_>) -> Option<Vec<f64>> {
        None
    }

    /// What is not known is not lowered.
    fn descend(
        &self,
        _: &mut [f64],
        _: i32,
        _: Option<&Upright>,
        _: On<'_>,
    ) -> Result<(), Cancelled> {
        Ok(())
    }

    fn cost<'a>(&'a self, z: &[f64], _: i32, upright: &'a Upright) -> Box<dyn Cost + 'a> {
        Box::new(Strain {
            upright,
            coupled: vec![OnceCell::new(); z.len()],
        })
    }
}

/// What moves cost, by the triangles of the decimated map.
struct Strain<'a> {
    upright: &'a Upright,
    coupled: Vec<OnceCell<Vec<usize>>>,
}

impl Cost for Strain<'_> {
    fn of(&self, pair: &Pair, sides: &[Sides]) -> f64 {
        self.upright.strain(pair, sides)
    }

    fn follow(&mut self, _: usize, _: f64) {}

    fn coupled(&self, k: usize) -> &[usize] {
        self.coupled[k].get_or_init(|| {
            let others = strongest(self.upright.coupled(k, self.coupled.len()));
            others.into_iter().map(|other| other.0).collect()
        })
    }
}

/// See `testing::mended`.
#[cfg(feature = "testing")]
pub(crate) fn mended(
    triangles: &[[[Sum; 2]; 2]],
    relaxed: &[[[f64; 2]; 2]],
    z: &[f64],
    run: On<'_>,
) -> Result<Option<Vec<f64>>, Cancelled> {
    let means = Means {
        effort: &Effort::of(triangles.len()),
        run,
    };
    let energy: &dyn Energy = &Regions {
        nearest: z.to_vec(),
    };
    let mut upright = Upright::new(triangles, relaxed);
    energy.rounded_within(&mut upright, &|_| Vec::new(), means)
}
