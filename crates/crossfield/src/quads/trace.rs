//! Lines of integer coordinate through the triangles, in exact arithmetic.
//!
//! A line leaves a triangle through the side whose ends lie to its left and to its right. Both are signs of products of
//! integers of 64 bits, taken in 128, and a line through a vertex is told from one beside it: there it goes on in the sector
//! of the vertex that holds its direction.

use crate::Error;
use crate::field::frames::{next, previous};
use crate::map::exact::{axes_in, cross, dot, minus, rotated, sector};
use crate::map::{GridMap, Net};

/// Where a triangle is entered, and where the line leads, in the chart of the triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walker {
    pub(super) face: usize,
    pub(super) at: [i64; 2],
    pub(super) target: [i64; 2],
    /// Quarter turns from +u.
    pub(super) heading: u8,
}

/// How a line goes on.
enum Step {
    /// The target lies in this triangle.
    There,
    /// Over this half-edge.
    Over(usize),
    /// Through this corner of the triangle and on.
    Through(usize),
}

/// A map that can be walked.
pub(super) struct Paper<'a> {
    pub(super) net: &'a Net,
    pub(super) map: &'a GridMap,
    /// There are 2^finer lines to each of the map's.
    pub(super) finer: u32,
}

impl Paper<'_> {
    /// One unit.
    pub(super) fn unit(&self) -> i64 {
        1 << (self.map.bits - self.finer)
    }

    /// A point in the chart of the half-edge's triangle, in that of its twin's.
    ///
    /// Exactly: a turn by quarters about the shared end, of which both charts know where it lies.
    pub(super) fn across(&self, h: usize, twin: usize, point: [i64; 2]) -> [i64; 2] {
        let turn = (4 - self.map.turn[h]) % 4;
        let here = self.map.corners[h / 3][h % 3];
        let there = self.map.corners[twin / 3][next(twin) % 3];
        let offset = rotated(minus(point, here), turn);
        [there[0] + offset[0], there[1] + offset[1]]
    }

    /// A heading, likewise.
    pub(super) fn heading_across(&self, h: usize, heading: u8) -> u8 {
        (heading + 4 - self.map.turn[h]) % 4
    }

    /// Walks on to the triangle that holds the target; `None` at the rim of the surface.
    ///
    /// # Errors
    /// [`Error::Torn`] if no side lies ahead, or the walk takes more steps than there are triangles: neither happens in
    /// a map whose triangles are all upright.
    pub(super) fn follow(&self, walker: Walker) -> Result<Option<Walker>, Error> {
        self.crossed(walker, &mut Vec::new())
    }

    /// The same, and the half-edges that are crossed.
    pub(super) fn crossed(
        &self,
        mut walker: Walker,
        crossed: &mut Vec<usize>,
    ) -> Result<Option<Walker>, Error> {
        let start = walker.face;
        // Every triangle is crossed at most once per unit square of the map, and lines are one unit long.
        let most = self.net.faces() + 64;
        for _ in 0..most {
            match self.step(&walker) {
                Some(Step::There) => return Ok(Some(walker)),
                Some(Step::Over(h)) => {
                    let Some(twin) = self.net.twin(h) else {
                        return Ok(None);
                    };
                    walker = self.carried(walker, h, twin);
                    crossed.push(h);
                }
                Some(Step::Through(h)) => match self.turned_about(walker, h, crossed) {
                    Some(on) => walker = on,
                    None => return Ok(None),
                },
                None => {
                    let why = "no side of a triangle lies ahead";
                    return Err(Error::Torn { face: start, why });
                }
            }
        }
        let why = "it does not come to an end";
        Err(Error::Torn { face: start, why })
    }

    /// The same walker in the triangle across a side.
    fn carried(&self, walker: Walker, h: usize, twin: usize) -> Walker {
        Walker {
            face: twin / 3,
            at: self.across(h, twin, walker.at),
            target: self.across(h, twin, walker.target),
            heading: self.heading_across(h, walker.heading),
        }
    }

    /// What comes next in this triangle; `None` if the line points to no side of it.
    fn step(&self, walker: &Walker) -> Option<Step> {
        let uv = &self.map.corners[walker.face];
        let inside = (0..3).all(|k| {
            let (a, b) = (uv[k], uv[(k + 1) % 3]);
            cross(minus(b, a), minus(walker.target, a)) >= 0
        });
        if inside {
            return Some(Step::There);
        }
        let d = rotated([1, 0], walker.heading);
        let side: [i128; 3] = [0, 1, 2].map(|k| cross(d, minus(uv[k], walker.at)));
        for k in 0..3 {
            if side[k] == 0 && dot(d, minus(uv[k], walker.at)) > 0 {
                return Some(Step::Through(3 * walker.face + k));
            }
        }
        // The line leaves over the side that runs from its right to its left.
        let over = (0..3).find(|&k| side[k] < 0 && side[(k + 1) % 3] > 0)?;
        Some(Step::Over(3 * walker.face + over))
    }

    /// Turns about the vertex at the corner `h` until the line leads into the triangle.
    fn turned_about(&self, walker: Walker, h: usize, crossed: &mut Vec<usize>) -> Option<Walker> {
        let before = crossed.len();
        let (mut here, mut corner) = (walker, h);
        loop {
            here.at = self.map.corners[corner / 3][corner % 3];
            if self.leads_into(corner, here.heading) {
                return Some(here);
            }
            // Counter-clockwise.
            let over = previous(corner);
            match self.net.twin(over) {
                Some(twin) => {
                    here = self.carried(here, over, twin);
                    crossed.push(over);
                    corner = twin;
                }
                None => break,
            }
            if corner == h {
                return None;
            }
        }
        crossed.truncate(before);
        let (mut here, mut corner) = (walker, h);
        // Clockwise from the start, up to the rim on the other side.
        while let Some(twin) = self.net.twin(corner) {
            here = self.carried(here, corner, twin);
            crossed.push(corner);
            corner = next(twin);
            here.at = self.map.corners[corner / 3][corner % 3];
            if self.leads_into(corner, here.heading) {
                return Some(here);
            }
        }
        None
    }

    /// Does a heading point into the sector of a corner? Its first side is part of it, the second one at a rim only.
    fn leads_into(&self, corner: usize, heading: u8) -> bool {
        let [a, b] = sector(self.map, corner);
        let closed = self.net.twin(previous(corner)).is_none();
        axes_in(a, b, closed).any(|q| q == heading)
    }
}
