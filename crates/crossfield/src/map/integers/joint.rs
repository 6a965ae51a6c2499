//! Moves of all integers of a triangle at once.
//!
//! Where several singular vertices have come to lie on one point, no triangle between them has an area before three or more
//! integers have moved: single ones and pairs lower no shortage, whatever it weighs. The integers of one triangle are so few that all their
//! moves by at most one can be looked at, a neighbourhood as large as it must be (Shaw, *Using constraint programming and local search
//! methods to solve vehicle routing problems*, 1998).

use geom_core::compute::parallel;

use super::upright::{Sides, Weighed, added, shortage};

/// Most integers that move together: 3⁸ moves take a millisecond.
const MOST: usize = 8;

/// What was looked at, and the best of it.
pub(super) struct Joint {
    /// So many moves were looked at.
    pub(super) tried: usize,
    /// Integers, and by how much they move; none if nothing brings triangles nearer to upright.
    pub(super) moves: Vec<(usize, f64)>,
}

/// Of the joint moves of each triangle that is not upright, the one that brings triangles nearest to upright; of equal ones one of
/// fewest integers, and of the first triangle.
pub(super) fn best_joint(weighed: Weighed<'_>) -> Joint {
    let is_short = |&t: &usize| shortage(&weighed.sides[t]) > 0;
    let short: Vec<usize> = (0..weighed.sides.len()).filter(is_short).collect();
    let found = parallel::map_each(&short, |&t| Star::of(weighed, t).map(Star::searched));
    let mut joint = Joint {
        tried: 0,
        moves: Vec::new(),
    };
    let mut least = (0, 0);
    for (tried, change, moves) in found.into_iter().flatten() {
        joint.tried += tried;
        if (change, moves.len()) < least {
            least = (change, moves.len());
            joint.moves = moves;
        }
    }
    joint
}

/// The integers of a triangle, and the triangles that depend on them.
struct Star<'a> {
    integers: &'a [u32],
    /// Of the triangles, as they are at the moment.
    sides: Vec<Sides>,
    weights: Vec<i128>,
    /// Per integer, the places of triangles among these, and what one more of it adds to their sides.
    changes: Vec<Vec<(usize, Sides)>>,
}

impl<'a> Star<'a> {
    /// `None` for a triangle of too many integers.
    fn of(weighed: Weighed<'a>, t: usize) -> Option<Self> {
        let integers = weighed.upright.on(t);
        if integers.len() > MOST {
            return None;
        }
        let lists = || integers.iter().map(|&k| weighed.upright.of(k as usize));
        let mut triangles: Vec<u32> = lists().flatten().map(|entry| entry.0).collect();
        triangles.sort_unstable();
        triangles.dedup();
        let place = |&(t, by): &(u32, Sides)| (triangles.partition_point(|&other| other < t), by);
        Some(Self {
            integers,
            changes: lists()
                .map(|list| list.iter().map(place).collect())
                .collect(),
            sides: triangles
                .iter()
                .map(|&t| weighed.sides[t as usize])
                .collect(),
            weights: triangles
                .iter()
                .map(|&t| weighed.weights[t as usize])
                .collect(),
        })
    }

    /// How many moves there are, what the best changes of the shortages, and itself; nothing and none if none lowers them.
    fn searched(mut self) -> (usize, i128, Vec<(usize, f64)>) {
        let before = self.shortages();
        let count = self.integers.len();
        let mut steps = vec![-1i64; count];
        for k in 0..count {
            self.shift(k, -1.0);
        }
        let (mut tried, mut least, mut best) = (0, (0, 0), vec![0; count]);
        // Counts in threes, from all steps back to all steps forward.
        loop {
            tried += 1;
            let moved = steps.iter().filter(|&&step| step != 0).count();
            let judged = (self.shortages() - before, moved);
            if judged < least {
                least = judged;
                best.clone_from(&steps);
            }
            let Some(next) = steps.iter().position(|&step| step < 1) else {
                break;
            };
            steps[..next].fill(-1);
            for k in 0..next {
                self.shift(k, -2.0);
            }
            steps[next] += 1;
            self.shift(next, 1.0);
        }
        let all = self.integers.iter().zip(best);
        let moves = all.filter(|(_, step)| *step != 0);
        let moves = moves.map(|(&k, step)| (k as usize, step as f64));
        (tried, least.0, moves.collect())
    }

    fn shift(&mut self, k: usize, by: f64) {
        for (at, sum) in &self.changes[k] {
            added(&mut self.sides[*at], sum, by);
        }
    }

    fn shortages(&self) -> i128 {
        let all = self.sides.iter().zip(&self.weights);
        all.map(|(sides, weight)| weight * shortage(sides)).sum()
    }
}
