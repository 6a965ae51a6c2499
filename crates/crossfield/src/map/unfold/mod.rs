//! How a map is unfolded: all at once, then place by place.

mod align;
mod effort;
mod energy;
mod lbfgs;
mod monotone;
mod places;
mod scope;
mod untangle;
mod wind;

use std::ops::RangeInclusive;

use geom_core::compute::parallel;

use self::align::align;
pub(crate) use self::effort::{Effort, Ends, Folded, Unfolding};
use self::scope::Scope;
use self::untangle::{Judge, Moves, untangle};
use self::wind::wound;
use crate::Error;
#[cfg(feature = "testing")]
use crate::backend::ChartDistortion;
use crate::backend::On;
use crate::field::CrossField;
use crate::field::frames::Frames;
use crate::map::cones::has_wrong_angle;
#[cfg(feature = "testing")]
use crate::map::spacing::Chart;
use crate::map::system::{System, Weighted};

/// How many rings of triangles around what is folded move when only these do, one try after the other.
const SURROUNDINGS: RangeInclusive<usize> = 3..=18;

/// A map with so many vertices of five or more quads is not unfolded before their stars are laid out by hand: one in a hundred stays
/// wound too little.
const MANY_STARS: usize = 100;

/// So many tries without fewer folds are enough.
const NO_BETTER: usize = 6;

/// Which vertices are meant, by whether the angle around them is wrong, and whether all triangles there are upright.
type Wanted = fn(bool, bool) -> bool;
const STUCK: Wanted = |turns_wrong, upright| turns_wrong && upright;
const BAD: Wanted = |turns_wrong, upright| turns_wrong || !upright;

/// What unfolds the map of a field.
#[derive(Clone, Copy)]
pub(super) struct Unfolder<'a> {
    pub(super) system: &'a System<'a>,
    pub(super) frames: &'a Frames,
    pub(super) field: &'a CrossField,
    pub(super) effort: &'a Effort,
    pub(super) run: On<'a>,
}

impl Unfolder<'_> {
    /// Untangles; is the map upright now?
    ///
    /// Tried from where it is, for all but a third of the effort that is left, or until a vertex is seen that it cannot help,
    /// which is not worth it with [`MANY_STARS`]; from there with the stars of many quads laid out by hand ([`wound`]), since no
    /// energy that only turns triangles upright adds a full turn around a vertex; and last place by place.
    pub(super) fn untangled(
        &self,
        weighted: &Weighted<'_>,
        with_integers: bool,
        w: &mut [f64],
    ) -> Result<bool, Error> {
        let index = &self.field.index;
        let negative: Vec<usize> = (0..index.len()).filter(|&v| index[v] < 0).collect();
        if negative.len() < MANY_STARS {
            let folded = w.to_vec();
            let is_lost = |w: &[f64]| !self.stuck(&self.system.corners(w)).is_empty();
            let reserve = self.effort.share(3);
            self.untangle_all(weighted, with_integers, Vec::new(), &is_lost, w)?;
            self.effort.give_back(&reserve);
            if self.is_valid(w) {
                return Ok(true);
            }
            w.copy_from_slice(&folded);
        }
        let held = wound(self.system, self.frames, self.field, &negative, w);
        let reserve = self.effort.share(4);
        // What else is folded unfolds beside a vertex that is stuck.
        self.untangle_all(weighted, with_integers, held, &|_| false, w)?;
        self.effort.give_back(&reserve);
        self.mended(weighted, with_integers, w)
    }

    /// Makes the map monotone as far as it can be, with all unknowns.
    pub(super) fn align(&self, weighted: &Weighted<'_>, w: &mut [f64]) -> Result<(), Error> {
        self.moving_all(weighted, true, |moves| {
            align(self.system, w, &moves, self.run)
        })
    }

    /// Untangles with all unknowns, or the reals among them.
    fn untangle_all(
        &self,
        weighted: &Weighted<'_>,
        with_integers: bool,
        held: Vec<usize>,
        is_lost: Judge<'_>,
        w: &mut [f64],
    ) -> Result<(), Error> {
        self.moving_all(weighted, with_integers, |moves| {
            let moves = Moves {
                held,
                is_lost,
                ..moves
            };
            untangle(self.system, w, &moves, self.run)
        })
    }

    /// Makes an upright map smoother, all of it; it stays upright.
    pub(super) fn settle(
        &self,
        weighted: &Weighted<'_>,
        with_integers: bool,
        w: &mut [f64],
    ) -> Result<(), Error> {
        let upright = w.to_vec();
        self.moving_all(weighted, with_integers, |moves| {
            let moves = Moves {
                may_fold: false,
                ..moves
            };
            untangle(self.system, w, &moves, self.run)
        })?;
        if !self.is_valid(w) {
            w.copy_from_slice(&upright);
        }
        Ok(())
    }

    /// Does something with all unknowns, or the reals among them.
    fn moving_all(
        &self,
        weighted: &Weighted<'_>,
        with_integers: bool,
        act: impl FnOnce(Moves<'_>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        act(Moves {
            scope: &Scope::whole(self.system, with_integers),
            bend: &|gradient: &[f64]| weighted.inverse(gradient, with_integers),
            held: Vec::new(),
            effort: self.effort,
            is_lost: &|_| false,
            may_fold: true,
        })
    }

    /// Unfolds what is left place by place, with vertices that are stuck laid out by hand, and all else held; is the map
    /// upright now?
    ///
    /// Where little is folded this is cheap, so that it is tried with ever wider surroundings, which grow together. A place that
    /// stays folded takes no other with it. A map that comes out upright settles as a whole.
    pub(super) fn mended(
        &self,
        weighted: &Weighted<'_>,
        with_integers: bool,
        w: &mut [f64],
    ) -> Result<bool, Error> {
        let mut bad = self.bad(&self.system.corners(w));
        let (mut least, mut stalled) = (bad.len(), 0);
        for rings in SURROUNDINGS {
            if bad.is_empty() || self.effort.is_spent() {
                break;
            }
            let stuck = self.stuck(&self.system.corners(w));
            let held = wound(self.system, self.frames, self.field, &stuck, w);
            bad.extend(self.bad(&self.system.corners(w)));
            self.unfold_places(&self.places(&bad, rings), &held, w)?;
            bad = self.bad(&self.system.corners(w));
            stalled += 1;
            if bad.len() < least {
                (least, stalled) = (bad.len(), 0);
            }
            if stalled == NO_BETTER {
                break;
            }
        }
        if !bad.is_empty() {
            return Ok(false);
        }
        // What was held while places unfolded makes room for them now.
        self.settle(weighted, with_integers, w)?;
        Ok(true)
    }

    /// Vertices with upright triangles alone that turn too far or not far enough around them. They would have to fold before they
    /// could turn right.
    fn stuck(&self, corners: &[[[f64; 2]; 3]]) -> Vec<usize> {
        self.vertices(|f| corners[f], &self.all_vertices(), STUCK)
    }

    /// Vertices at a wrong angle or of triangles that are not upright.
    pub(super) fn bad(&self, corners: &[[[f64; 2]; 3]]) -> Vec<usize> {
        self.vertices(|f| corners[f], &self.all_vertices(), BAD)
    }

    fn all_vertices(&self) -> Vec<usize> {
        (0..self.frames.edges().vertices()).collect()
    }

    /// Those wanted of some vertices.
    fn vertices(
        &self,
        corners: impl Fn(usize) -> [[f64; 2]; 3] + Copy + Sync,
        some: &[usize],
        is_wanted: Wanted,
    ) -> Vec<usize> {
        let (charts, frames, field) = (self.system.charts, self.frames, self.field);
        let is_upright = |h: usize| charts[h / 3].determinant(&corners(h / 3)) > 0.0;
        parallel::flat_map(some.len(), |i| {
            let v = some[i];
            let turns_wrong = has_wrong_angle(frames, field, corners, v);
            is_wanted(turns_wrong, frames.around(v).all(is_upright)).then_some(v)
        })
    }

    pub(super) fn is_valid(&self, w: &[f64]) -> bool {
        self.invalid(&self.system.corners(w)) == (0, 0)
    }

    /// Triangles that are not upright, and vertices around which they turn too far or not far enough.
    pub(super) fn invalid(&self, corners: &[[[f64; 2]; 3]]) -> (usize, usize) {
        let all = self.system.charts.iter().zip(corners);
        let upright = all.filter(|(chart, uv)| chart.determinant(uv) > 0.0);
        let triangles = corners.len() - upright.count();
        let wrong = self.vertices(|f| corners[f], &self.all_vertices(), |wrong, _| wrong);
        (triangles, wrong.len())
    }
}

/// See `testing::monotone`.
#[cfg(feature = "testing")]
pub(crate) fn monotone(chart: &Chart, uv: &[[f64; 2]; 3]) -> (f64, ChartDistortion) {
    (
        monotone::least_eigenvalue(chart, uv),
        monotone::shortage(chart, uv),
    )
}
