//! Down in rounds, without what a round spoils.
//!
//! The sum of all distortions falls also where single corners become worse, and these hold up all others: steps become short for their
//! sake. A few elements taken back after a round cost little, and with what is left all others go on.

use super::search::{LOW, Raise};
use super::{Descent, Elements, Flow, Measure, Places, Search, State, mean};
use crate::compute::parallel;
use crate::surface::ground::{Freedom, Ground};
use crate::{Point3, Vector3};

/// Steps of a round.
const ROUND: usize = 20;
/// A round that leaves more than this share of the sum is the last.
const ENOUGH: f64 = 0.99;
/// A round that raises the mean by this much has begun far from any good places, and nothing in it is taken back.
const FAR: f64 = 0.05;
/// No element goes farther from the surface than this, in reasonable steps, unless it was there.
const OFF: f64 = 0.25;
/// Nor than this when many search: with less, half of what they gain on surfaces of atoms as large as the elements is taken back.
const FARTHER_OFF: f64 = 0.4;

impl<E: Elements> Flow<'_, E> {
    /// Goes down in rounds of twenty steps. After each, vertices go back to where it began if one of their elements has become worse
    /// than there and than a goal (what was inverted may become worse before it turns over), or has left the surface, as where
    /// vertices slide off a tip; not so far from any good places, where the mean still rises by a twentieth in a round. Ends
    /// after a round that has lowered the sum by less than a hundredth. How many steps there were.
    ///
    /// # Errors
    /// Of the backend, and if the watcher asks to stop.
    pub fn descend_in_rounds(
        &mut self,
        how: &Descent,
        by: Measure<E>,
        goal: f64,
    ) -> Result<usize, E::Error> {
        let mut steps = 0;
        let mut sum = self.sum(how.power)?;
        while steps < how.steps {
            let start = self.vertices.state();
            let (before, were_off) = (self.values(by), self.values(off));
            let round = Descent {
                steps: ROUND.min(how.steps - steps),
                ..*how
            };
            let made = self.descend(&round, |_| true)?;
            if self.mean(by) < mean(&before) + FAR {
                self.take_back(&start, |elements, e, places| {
                    let is_worse = before[e] > 0.0 && by(elements, e, places) < before[e].min(goal);
                    is_worse || off(elements, e, places) > were_off[e].max(OFF)
                });
            }
            steps += made;
            if how.renew {
                self.elements.renew(&self.vertices.positions);
            }
            let last = std::mem::replace(&mut sum, self.sum(how.power)?);
            if made < round.steps || sum > ENOUGH * last {
                break;
            }
        }
        Ok(steps)
    }

    /// [`lift_the_worst`](Self::lift_the_worst) for a goal that many elements miss. They give and take: what was better than the
    /// worst around a vertex may become as bad. So vertices go back to where they began if what is measured of one of their
    /// elements has become worse than there and below 0.6, or if one has left the surface by more than 0.4 reasonable steps. How
    /// many had moved, those that went back among them.
    ///
    /// # Errors
    /// If the watcher asks to stop.
    pub fn lift_many(&mut self, how: &Search<E>) -> Result<usize, E::Error> {
        self.lift_with_care(how, Raise::Worst)
    }

    /// The same, with places judged by the mean of the elements around a vertex in place of the worst: that of all rises with
    /// every move, where the sum of all distortions would rather have even sides. The worst around a vertex does not fall below
    /// `held` for it, nor at all where it is below.
    ///
    /// # Errors
    /// If the watcher asks to stop.
    pub fn lift_the_mean(&mut self, how: &Search<E>, held: f64) -> Result<usize, E::Error> {
        self.lift_with_care(how, Raise::Mean(held))
    }

    fn lift_with_care(&mut self, how: &Search<E>, raise: Raise) -> Result<usize, E::Error> {
        let start = self.vertices.state();
        let (before, were_off) = (self.values(how.by), self.values(off));
        let lifted = self.lift(how, raise)?;
        self.take_back(&start, |elements, e, places| {
            let is_worse = (how.by)(elements, e, places) < before[e].min(LOW);
            is_worse || off(elements, e, places) > were_off[e].max(FARTHER_OFF)
        });
        Ok(lifted)
    }

    /// Takes the vertices of spoiled elements back to an earlier state, until there are none.
    fn take_back(
        &mut self,
        (positions, normals): &State,
        is_spoiled: impl Fn(&E, usize, &Places<'_>) -> bool + Sync,
    ) {
        let mut changed: Vec<usize> = (0..self.elements.count()).collect();
        while !changed.is_empty() {
            let places = Places::of(&self.vertices);
            let spoiled = parallel::map_each(&changed, |&e| is_spoiled(&self.elements, e, &places));
            let spoiled = changed
                .iter()
                .zip(spoiled)
                .filter(|(_, is_spoiled)| *is_spoiled);
            let mut back: Vec<u32> = spoiled.flat_map(|(&e, _)| self.elements.rim(e)).collect();
            back.retain(|&v| self.vertices.positions[v as usize] != positions[v as usize]);
            let near = back.iter().flat_map(|&v| self.elements.around(v as usize));
            changed = near.map(|&e| e as usize).collect();
            changed.sort_unstable();
            changed.dedup();
            for v in back.into_iter().map(|v| v as usize) {
                (self.vertices.positions[v], self.vertices.normals[v]) = (positions[v], normals[v]);
            }
        }
    }
}

/// How far the middle of an element is from the surface, in reasonable steps.
fn off<E: Elements>(elements: &E, e: usize, places: &Places<'_>) -> f64 {
    let (mut sum, mut area, mut count, mut ground) = (Vector3::zeros(), 0.0, 0.0, None);
    for v in elements.rim(e) {
        sum += places.position(v).coords;
        area += elements.scale(v as usize);
        count += 1.0;
        ground = Some(places.ground(v));
    }
    let middle = Point3::from(sum / count);
    let distance = |ground: &Ground<'_>| {
        let (near, _) = ground.pulled(&middle, Freedom::Surface);
        (near - middle).norm() / (area / count).sqrt()
    };
    ground.map_or(0.0, distance)
}
