//! The integers of an upright map, and those that hold its decimated map upright.

use std::mem::take;
use std::sync::Arc;

use geom_core::Point3;

use super::relaxed::Optimum;
use super::{Making, Narrow, Widening};
use crate::Error;
use crate::map::exact::{BITS, wrong_cones};
use crate::map::integers::{
    AtLeast, Decimated, Energy, Means, Quadratic, Regions, Spread, Upright, cube,
};
use crate::map::system::{System, Weighted};
use crate::map::transition::without_corners;

/// How often conditions for wider handles and necks are added.
const WIDENINGS: usize = 30;

/// Integers, and the real numbers that follow them.
pub(super) struct Rounded {
    /// All values.
    pub(super) w: Vec<f64>,
    /// What to say if the map folds.
    pub(super) stage: &'static str,
    /// The decimated map with them, where one was needed and turns right around all vertices.
    pub(super) spread: Option<Spread>,
    /// Are its quads no mesh?
    pub(super) is_narrow: bool,
}

/// Integers that make handles and necks wider.
struct Widened {
    z: Vec<f64>,
    spread: Option<Spread>,
    is_narrow: bool,
}

impl<'a> Making<'a> {
    /// Integers and the reals that follow them. Where rounding lays singular vertices onto each other, other integers are
    /// found, on a denser grid if need be and brought back, that hold the decimated map upright.
    ///
    /// Three outcomes: the rounded integers, where nothing folds, or the decimated map is upright with them, or there is no
    /// decimated map to judge them by; those found under the conditions of the decimated map; and an error, if there are
    /// none on denser grids either. The first two are made wider where quads would meet themselves, if asked for. `None` where
    /// the map cannot be decimated since a boundary has no corner, which pinning a vertex there mends. The corners of the best map
    /// are taken where it is decimated.
    pub(super) fn quantized(
        &mut self,
        relaxed: &mut Optimum<'a>,
        widening: Option<Widening<'_>>,
    ) -> Result<Option<Rounded>, Error> {
        let ends = self.unfolding.ends;
        // The other half is for closer lines.
        let effort = ends.integers.share(2);
        let means = Means {
            effort: &effort,
            run: self.run,
        };
        let rounded = self.quantized_by(means, relaxed, widening);
        ends.integers.give_back(&effort);
        rounded
    }

    /// The same with these means.
    fn quantized_by(
        &mut self,
        means: Means<'_>,
        relaxed: &mut Optimum<'a>,
        widening: Option<Widening<'_>>,
    ) -> Result<Option<Rounded>, Error> {
        let Optimum {
            weighted,
            w,
            corners,
        } = relaxed;
        let energy = self.energy_of_integers(weighted, w, means)?;
        let rounded = energy.rounded(self.run)?;
        let direct = Rounded {
            w: weighted.values_for(&rounded)?,
            stage: "rounding",
            spread: None,
            is_narrow: false,
        };
        if self.faults(&self.system.corners(&direct.w)).is_empty() {
            return Ok(Some(direct));
        }
        // The largest thing in memory, and quickly made again for the integers that are found.
        weighted.forget_held();
        // Whether integers can hold the map upright is said by the few triangles between singular vertices.
        let Some(decimated) = self.decimated(take(corners)) else {
            let may_pin = self.system.seams.pinned.is_empty();
            if may_pin && !without_corners(self.frames, self.field).is_empty() {
                return Ok(None);
            }
            let stage = "rounding without a decimated map";
            return Ok(Some(Rounded { stage, ..direct }));
        };
        // Those at hand may do, with the reals of other places; else others are looked for.
        let mut upright = decimated.upright();
        let mut z = rounded;
        let turned = |z: &[f64]| self.turned(&decimated, z);
        if !upright.holds(&z) || !turned(&z).is_empty() {
            let other = energy.rounded_within(&mut upright, &turned, means)?;
            let Some(other) = other else {
                // No real numbers can mend what the integers fold.
                let (triangles, cones) = self.unfolder().invalid(&self.system.corners(&direct.w));
                return Err(Error::Folded {
                    triangles,
                    cones,
                    stage: "rounding, on denser grids too",
                    relaxed: false,
                });
            };
            self.report.respaced = true;
            z = other;
        }
        // Only upright integers say around what quads would meet themselves.
        let narrow = widening.map(|w| w.narrow);
        let Widened {
            z: wider,
            mut spread,
            is_narrow,
        } = self.widened(&decimated, upright, &z, &*energy, narrow, means)?;
        drop((decimated, energy));
        self.report.respaced |= wider != z;
        if let Some(spread) = &mut spread {
            spread.map.report = self.report;
        }
        Ok(Some(Rounded {
            w: weighted.values_for(&wider)?,
            stage: match self.report.respaced {
                true => "rounding to other integers",
                false => "rounding",
            },
            spread,
            is_narrow,
        }))
    }

    /// The triangles between singular vertices and corners, of a map without integers.
    pub(super) fn decimated(&self, corners: Vec<[[f64; 2]; 3]>) -> Option<Arc<Decimated>> {
        let System { cut, seams, .. } = self.system;
        Decimated::of(self.frames, self.field, cut, seams, corners).map(Arc::new)
    }

    /// What is known of the energy over the integers alone, around its minimum: all of it by dense matrices, n² numbers and n³ operations
    /// for n integers, or what rounding region by region takes. They are about twice as many as the singular vertices, and four for each
    /// handle.
    fn energy_of_integers(
        &self,
        weighted: &mut Weighted<'_>,
        w: &[f64],
        means: Means<'_>,
    ) -> Result<Box<dyn Energy>, Error> {
        /// What a sparse factor costs, in evaluations of the energy of all triangles.
        const FACTOR: usize = 20;
        let integers = self.system.seams.integers;
        let most_dense = self.unfolding.most_dense;
        let regions = integers.div_ceil(most_dense.max(1));
        let is_dense = integers <= most_dense;
        let cost = match is_dense {
            true => cube(integers),
            false => regions * (cube(most_dense) + FACTOR * self.system.charts.len()),
        };
        // Asked for before it is begun.
        if !means.effort.spend(cost) {
            return Err(Error::Integers { integers });
        }
        if is_dense {
            let quadratic = self.quadratic(weighted, w)?;
            return Ok(Box::new(quadratic));
        }
        weighted.forget_free();
        let regions = Regions::of(weighted, &self.homes(), most_dense, self.run)?;
        Ok(Box::new(regions))
    }

    /// Where each integer is at home on the surface: of the places whose coordinates it is a part of, one with the fewest others.
    fn homes(&self) -> Vec<Point3> {
        let System { cut, seams, .. } = self.system;
        let positions = self.mesh.positions();
        let mut homes = vec![(usize::MAX, positions[0]); seams.integers];
        for (copy, &vertex) in cut.vertex.iter().enumerate() {
            for component in [0, 1] {
                let terms = seams.integers_of(copy as u32, component);
                let terms = seams.written_out(&terms);
                for &(k, _) in &terms {
                    if terms.len() < homes[k as usize].0 {
                        homes[k as usize] = (terms.len(), positions[vertex as usize]);
                    }
                }
            }
        }
        homes.into_iter().map(|home| home.1).collect()
    }

    /// The energy as a function of the integers alone, from its minimum.
    pub(super) fn quadratic(
        &self,
        weighted: &mut Weighted<'_>,
        w: &[f64],
    ) -> Result<Quadratic, Error> {
        let seams = self.system.seams;
        let relaxed = &w[seams.reals..seams.unknowns()];
        let indefinite = geom_core::algebra::Error::NotPositiveDefinite { row: 0 };
        let inverse = weighted.inverse_schur()?;
        // The factor in which they move is large, and has done its part.
        weighted.forget_free();
        Ok(Quadratic::new(inverse, relaxed).ok_or(indefinite)?)
    }

    /// Makes handles and necks wider where quads would meet themselves around them: each is a condition more on the integers.
    fn widened(
        &self,
        decimated: &Arc<Decimated>,
        mut upright: Upright,
        z: &[f64],
        energy: &dyn Energy,
        narrow: Option<&dyn Fn(&Spread) -> Narrow>,
        means: Means<'_>,
    ) -> Result<Widened, Error> {
        let mut now = Widened {
            z: z.to_vec(),
            spread: self.spread(decimated, z),
            is_narrow: false,
        };
        for round in 0..=WIDENINGS {
            let (Some(narrow), Some(last)) = (narrow, &now.spread) else {
                break;
            };
            let found = narrow(last);
            now.is_narrow = found.anywhere;
            if found.wider.is_empty() || round == WIDENINGS {
                break;
            }
            upright.add(&found.wider);
            let turned = |z: &[f64]| self.turned(decimated, z);
            let Some(z) = energy.mended(&now.z, &mut upright, &turned, means)? else {
                break;
            };
            let Some(wider) = self.spread(decimated, &z) else {
                break;
            };
            (now.z, now.spread) = (z, Some(wider));
        }
        Ok(now)
    }

    /// The decimated map with these integers; `None` where the angles around a vertex are wrong with them.
    fn spread(&self, decimated: &Arc<Decimated>, z: &[f64]) -> Option<Spread> {
        let (spread, wrong) = self.judged(decimated, z);
        wrong.is_empty().then_some(spread)
    }

    /// What would keep the triangles around vertices from turning as far as these integers turn them.
    fn turned(&self, decimated: &Arc<Decimated>, z: &[f64]) -> Vec<AtLeast> {
        decimated.unturned(&self.judged(decimated, z).1)
    }

    /// The decimated map with these integers, and the vertices around which it turns wrong.
    pub(super) fn judged(&self, decimated: &Arc<Decimated>, z: &[f64]) -> (Spread, Vec<usize>) {
        let spread = decimated.spread(z, BITS, self.report);
        let wrong = wrong_cones(spread.net(), &self.field.index, &spread.map);
        (spread, wrong)
    }
}
