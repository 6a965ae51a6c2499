//! The worst elements, after the flow.
//!
//! Where the mean is good and single corners are not, vertices of the worst elements search for better places one by one. Four that
//! can only move together are stuck so; they go down a high power of the sines' inverses, with all around them.

use geom_core::surface::ground::Freedom;
use rayon::prelude::*;

use super::flow::Flow;
use super::jacobian;
use crate::Error;

/// Elements below this are worked on one by one after the flow.
pub(super) const GOAL: f64 = 0.9;
/// Elements below this are bad: beside the flow for all, there is one for them alone.
const LOW: f64 = 0.6;
/// Of so many rings around them.
const RINGS: usize = 3;
/// How often at most.
const MENDINGS: usize = 4;
/// Again if the worst is better by so much.
const GAIN: f64 = 0.005;
/// With this power.
const STEEP: i32 = 12;
/// Where a search for a better place begins and where it ends, in the elements' size.
const COMPASS: [f64; 2] = [0.5, 0.003];
/// Sides below this share of their first length are bad however straight their corners are.
const SHORT: f64 = 0.4;
/// How far its directions turn from one try to the next, in eighths of a circle: those of any number of tries lie evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;

impl Flow<'_> {
    /// Around elements that are still bad, steps down a high power of 1 / sin of their corners, whatever their sides: of a bad
    /// quad, these are no proportions to keep. Then their vertices one by one, as long as the worst becomes better. How many
    /// of those moved.
    pub(super) fn mend(&mut self) -> Result<usize, Error> {
        let mut lifted = 0;
        // Without a search there is nothing but the flow for all.
        let rounds = MENDINGS.min(self.options.rounds);
        for round in 0..rounds {
            let merits = self.merits();
            let worst = least(&merits);
            if worst >= LOW {
                break;
            }
            let start = (self.positions.clone(), self.normals.clone());
            let free = self.freedom.clone();
            self.hold_all_but(&merits);
            let steps = self.straighten();
            self.freedom = free;
            steps?;
            let moved = self.lift_the_worst(if round == 0 { GOAL } else { LOW })?;
            let after = least(&self.merits());
            if after <= worst {
                (self.positions, self.normals) = start;
                break;
            }
            lifted += moved;
            if after < worst + GAIN {
                break;
            }
        }
        Ok(lifted)
    }

    /// Fixes all vertices farther than some rings from a bad element.
    fn hold_all_but(&mut self, merits: &[f64]) {
        let mut near: Vec<bool> = merits.iter().map(|&m| m < LOW).collect();
        for _ in 0..RINGS {
            let mut next = near.clone();
            for e in (0..near.len()).filter(|&e| near[e]) {
                for v in self.rim(e) {
                    for &other in self.cells.around(v as usize) {
                        next[other as usize] = true;
                    }
                }
            }
            near = next;
        }
        for v in 0..self.freedom.len() {
            if !self.cells.around(v).iter().all(|&e| near[e as usize]) {
                self.freedom[v] = Freedom::Fixed;
            }
        }
    }

    /// Steps down the highest power, the lengths of sides being what they are.
    fn straighten(&mut self) -> Result<(), Error> {
        let mut tau = 0.2;
        let mut best = (f64::NEG_INFINITY, None);
        let most = self.options.steps as u64;
        for step in 0..most {
            self.run.progress("bad elements", step, most)?;
            let nodes = self.cells.nodes(&self.positions);
            self.cells.renew(&nodes);
            self.look();
            self.distortions(0.0)?;
            let epsilon = self.epsilon();
            if epsilon > 0.0 {
                self.distortions(epsilon)?;
            }
            let before = self.energy(STEEP);
            let Some(after) = self.step(STEEP, before, epsilon, &mut tau)? else {
                break;
            };
            let worst = least(&self.merits());
            if worst > best.0 {
                best = (worst, Some((self.positions.clone(), self.normals.clone())));
            }
            if epsilon == 0.0 && before - after < self.options.tolerance * before {
                break;
            }
        }
        if let Some(best) = best.1 {
            (self.positions, self.normals) = best;
        }
        Ok(())
    }

    fn merits(&self) -> Vec<f64> {
        let elements = 0..self.cells.elements();
        let of = |e| jacobian::merit(&self.cells, e, &self.positions, &self.normals);
        elements.into_par_iter().with_min_len(256).map(of).collect()
    }

    fn jacobian(&self, e: usize) -> f64 {
        jacobian::of_element(&self.cells, e, &self.positions, &self.normals)
    }

    pub(super) fn jacobians(&self) -> Vec<f64> {
        let elements = 0..self.cells.elements();
        let of = |e| self.jacobian(e);
        elements.into_par_iter().with_min_len(256).map(of).collect()
    }

    pub(super) fn smallest_jacobian(&self) -> f64 {
        least(&self.jacobians())
    }

    /// The worst merit of the elements around a vertex. Sines say nothing of lengths: a side shorter than [`SHORT`] counts as
    /// bad as it is short.
    fn worst_around(&self, v: usize) -> f64 {
        let of = |&e: &u32| {
            let e = e as usize;
            let merit = jacobian::merit(&self.cells, e, &self.positions, &self.normals);
            merit.min(self.cells.shortest(e, &self.positions) / SHORT)
        };
        let all = self.cells.around(v).iter();
        all.map(of).fold(f64::INFINITY, f64::min)
    }

    /// Vertices of bad elements search the directions of a compass for a place where the worst element around them is
    /// better, nearer and nearer until something around them moves. How many moved.
    pub(super) fn lift_the_worst(&mut self, goal: f64) -> Result<usize, Error> {
        let [longest, least] = COMPASS;
        let mut steps = vec![longest; self.positions.len()];
        let mut lifted = vec![false; self.positions.len()];
        let mut tries = vec![0; self.positions.len()];
        for round in 0..self.options.rounds {
            let rounds = self.options.rounds as u64;
            self.run.progress("worst elements", round as u64, rounds)?;
            let jacobians = self.jacobians();
            let mut bad: Vec<usize> = (0..jacobians.len())
                .filter(|&e| jacobians[e] < goal)
                .collect();
            bad.sort_by(|&a, &b| jacobians[a].total_cmp(&jacobians[b]).then(a.cmp(&b)));
            let mut searched = false;
            for e in bad {
                for v in self.rim(e) {
                    let (v, step) = (v as usize, steps[v as usize]);
                    if step < least {
                        continue;
                    }
                    searched = true;
                    tries[v] += 1;
                    if !self.search(v, step, tries[v]) {
                        steps[v] = 0.5 * step;
                        continue;
                    }
                    lifted[v] = true;
                    for &near in self.cells.around(v) {
                        for w in self.rim(near as usize) {
                            steps[w as usize] = step.max(steps[w as usize]);
                        }
                    }
                }
            }
            if !searched {
                break;
            }
        }
        Ok(lifted.iter().filter(|&&l| l).count())
    }

    /// The vertices of an element, ascending.
    fn rim(&self, e: usize) -> Vec<u32> {
        let mut rim: Vec<u32> = self.cells.of_element(e).concat();
        rim.retain(|&n| (n as usize) < self.positions.len());
        rim.sort_unstable();
        rim.dedup();
        rim
    }

    /// Moves a vertex to the best of eight places `step` away, if one is better; the directions turn with the tries, since
    /// those in which the worst of several elements becomes better may be few.
    fn search(&mut self, v: usize, step: f64, tries: u32) -> bool {
        if self.freedom[v] == Freedom::Fixed {
            return false;
        }
        let start = (self.positions[v], self.normals[v]);
        let before = self.worst_around(v);
        let length = step * self.cells.scale[v].sqrt();
        let turn = GOLDEN * f64::from(tries);
        let (ground, freedom) = (self.ground, self.freedom[v]);
        let found = ground.best_around(start, [length, turn], freedom, before, |&place| {
            (self.positions[v], self.normals[v]) = place;
            self.worst_around(v)
        });
        (self.positions[v], self.normals[v]) = found.unwrap_or(start);
        found.is_some()
    }
}

fn least(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}
