//! How a map is unfolded: all at once, then place by place.

mod scope;
mod untangle;
mod wind;

use std::ops::RangeInclusive;

use self::scope::Scope;
pub(crate) use self::untangle::{Effort, LastUpright, Unfolding};
use self::untangle::{Moves, untangle};
use self::wind::wound;
use crate::Error;
use crate::backend::On;
use crate::field::CrossField;
use crate::field::frames::{Frames, next};
use crate::map::cones::has_wrong_angle;
use crate::map::system::{Solver, System, Weighted};

/// How many rings of triangles around what is folded move when only these do, one try after the other.
const SURROUNDINGS: RangeInclusive<usize> = 3..=18;

/// So many tries without fewer folds are enough.
const NO_BETTER: usize = 6;

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
    /// Tried from where it is, for all but a third of the effort that is left, or until a vertex is seen that it cannot help;
    /// from there with the stars of many quads laid out by hand ([`wound`]), since no energy that only turns triangles
    /// upright adds a full turn around a vertex; and last place by place.
    pub(super) fn untangled(
        &self,
        weighted: &Weighted,
        integers: Option<Solver<'_>>,
        y: &mut [f64],
    ) -> Result<bool, Error> {
        let effort = self.effort;
        let index = &self.field.index;
        let mut moves = Moves {
            scope: &Scope::whole(self.system, integers.is_some()),
            bend: &|gradient: &[f64]| weighted.inverse(gradient, integers),
            held: Vec::new(),
            effort,
            is_lost: &|corners: &[[[f64; 2]; 3]]| !self.stuck(corners).is_empty(),
        };
        let folded = y.to_vec();
        let reserve = effort.share(3);
        untangle(self.system, y, &moves, self.run)?;
        effort.give_back(&reserve);
        if self.is_valid(y) {
            return Ok(true);
        }
        y.copy_from_slice(&folded);
        let negative: Vec<usize> = (0..index.len()).filter(|&v| index[v] < 0).collect();
        moves.held = wound(self.system, self.frames, self.field, &negative, y);
        // What else is folded unfolds beside a vertex that is stuck.
        moves.is_lost = &|_: &[[[f64; 2]; 3]]| false;
        let reserve = effort.share(4);
        untangle(self.system, y, &moves, self.run)?;
        effort.give_back(&reserve);
        self.mended(y)
    }

    /// Unfolds what is left place by place, with vertices that are stuck laid out by hand, and all else held; is the map
    /// upright now?
    ///
    /// Where little is folded this is cheap, so that it is tried with ever wider surroundings.
    fn mended(&self, y: &mut [f64]) -> Result<bool, Error> {
        let frames = self.frames;
        let mut bad = self.bad(&self.system.corners(y));
        let (mut least, mut stalled) = (bad.len(), 0);
        for rings in SURROUNDINGS {
            if bad.is_empty() || self.effort.is_spent() {
                break;
            }
            let stuck = self.stuck(&self.system.corners(y));
            let held = wound(self.system, frames, self.field, &stuck, y);
            bad.extend(self.bad(&self.system.corners(y)));
            let scope = self.around(&bad, rings);
            let Some(factor) = scope.factored(self.system)? else {
                break;
            };
            let moves = Moves {
                scope: &scope,
                bend: &|gradient: &[f64]| {
                    let mut bent = gradient.to_vec();
                    factor.solve_in_place(&mut bent, 1)?;
                    Ok(bent)
                },
                held,
                effort: self.effort,
                is_lost: &|corners: &[[[f64; 2]; 3]]| !self.stuck(corners).is_empty(),
            };
            untangle(self.system, y, &moves, self.run)?;
            bad = self.bad(&self.system.corners(y));
            stalled += 1;
            if bad.len() < least {
                (least, stalled) = (bad.len(), 0);
            }
            if stalled == NO_BETTER {
                break;
            }
        }
        Ok(bad.is_empty())
    }

    /// The unknowns of some vertices and so many rings around them.
    fn around(&self, vertices: &[usize], rings: usize) -> Scope {
        let (frames, cut) = (self.frames, self.system.cut);
        let mut near = vec![false; frames.edges().vertices()];
        vertices.iter().for_each(|&v| near[v] = true);
        for _ in 0..rings {
            let before = near.clone();
            for h in 0..frames.edges().len() {
                let [a, b] = [h, next(h)].map(|h| frames.from(h));
                if before[a] || before[b] {
                    (near[a], near[b]) = (true, true);
                }
            }
        }
        let mut is_near = vec![false; self.system.seams.copies()];
        for (h, &copy) in cut.copy.iter().enumerate() {
            is_near[copy as usize] |= near[frames.from(h)];
        }
        Scope::of_copies(self.system, |copy| is_near[copy as usize])
    }

    /// Vertices with upright triangles alone that turn too far or not far enough around them. They would have to fold before they
    /// could turn right.
    fn stuck(&self, corners: &[[[f64; 2]; 3]]) -> Vec<usize> {
        self.vertices(corners, |turns_wrong, upright| turns_wrong && upright)
    }

    /// Vertices at a wrong angle or of triangles that are not upright.
    fn bad(&self, corners: &[[[f64; 2]; 3]]) -> Vec<usize> {
        self.vertices(corners, |turns_wrong, upright| turns_wrong || !upright)
    }

    /// Those wanted, by whether the angle around them is wrong, and whether all triangles there are upright.
    fn vertices(
        &self,
        corners: &[[[f64; 2]; 3]],
        is_wanted: impl Fn(bool, bool) -> bool,
    ) -> Vec<usize> {
        let is_upright = |h: usize| self.system.charts[h / 3].determinant(&corners[h / 3]) > 0.0;
        let frames = self.frames;
        let all = 0..frames.edges().vertices();
        all.filter(|&v| {
            let turns_wrong = has_wrong_angle(frames, self.field, corners, v);
            is_wanted(turns_wrong, frames.around(v).all(is_upright))
        })
        .collect()
    }

    pub(super) fn is_valid(&self, y: &[f64]) -> bool {
        self.invalid(&self.system.corners(y)) == (0, 0)
    }

    /// Triangles that are not upright, and vertices around which they turn too far or not far enough.
    pub(super) fn invalid(&self, corners: &[[[f64; 2]; 3]]) -> (usize, usize) {
        let all = self.system.charts.iter().zip(corners);
        let upright = all.filter(|(chart, uv)| chart.determinant(uv) > 0.0);
        let triangles = corners.len() - upright.count();
        let cones = (0..self.frames.edges().vertices())
            .filter(|&v| has_wrong_angle(self.frames, self.field, corners, v))
            .count();
        (triangles, cones)
    }
}
