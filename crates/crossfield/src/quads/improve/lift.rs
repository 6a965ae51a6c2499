//! The worst quads, after the flow.
//!
//! Where the mean is good and single corners are not, vertices of the worst quads search for better places one by one. Four that
//! can only move together are stuck so; they go down a high power of the corners' distortion, with all around them.

use geom_core::surface::ground::Freedom;

use super::GOAL;
use super::flow::Flow;
use crate::Error;

/// Rounds of a search.
const ROUNDS: usize = 24;
/// Where it begins and where it ends, in sides of a quad.
const COMPASS: [f64; 2] = [0.25, 0.003];
/// How far its directions turn from one try to the next, in eighths of a circle: those of any number of tries lie evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// With this power.
const STEEP: i32 = 12;
/// Of so many rings around bad quads.
const RINGS: usize = 3;
/// So many steps.
const STEPS: usize = 60;
/// How often at most.
const AGAIN: usize = 3;
/// Again if the worst is better by so much.
const GAIN: f64 = 0.005;

impl Flow<'_> {
    /// Vertices of bad quads search the directions of a compass for a place where the worst quad around them is better, nearer
    /// and nearer until something around them moves.
    pub(super) fn lift_the_worst(&mut self) {
        let [longest, least] = COMPASS;
        let mut steps = vec![longest; self.positions.len()];
        let mut tries = vec![0u32; self.positions.len()];
        for _ in 0..ROUNDS {
            let merits = self.merits();
            let mut bad: Vec<usize> = (0..merits.len()).filter(|&q| merits[q] < GOAL).collect();
            bad.sort_by(|&a, &b| merits[a].total_cmp(&merits[b]).then(a.cmp(&b)));
            let mut searched = false;
            for q in bad {
                for v in self.quads[q].map(|v| v as usize) {
                    let step = steps[v];
                    if step < least {
                        continue;
                    }
                    searched = true;
                    tries[v] += 1;
                    if !self.search(v, step, tries[v]) {
                        steps[v] = 0.5 * step;
                        continue;
                    }
                    for &near in &self.around[v] {
                        for w in self.quads[near as usize] {
                            steps[w as usize] = step.max(steps[w as usize]);
                        }
                    }
                }
            }
            if !searched {
                break;
            }
        }
    }

    /// Moves a vertex to the best of eight places `step` away, if one is better; the directions turn with the tries, since
    /// those in which the worst of several quads becomes better may be few.
    fn search(&mut self, v: usize, step: f64, tries: u32) -> bool {
        if self.freedom[v] == Freedom::Fixed {
            return false;
        }
        let start = (self.positions[v], self.normals[v]);
        let before = self.worst_around(v);
        let way = [step * self.side_at(v), GOLDEN * f64::from(tries)];
        let (ground, freedom) = (self.ground, self.freedom[v]);
        let found = ground.best_around(start, way, freedom, before, |&place| {
            (self.positions[v], self.normals[v]) = place;
            self.worst_around(v)
        });
        (self.positions[v], self.normals[v]) = found.unwrap_or(start);
        found.is_some()
    }

    /// Around quads that are still bad, steps down a high power of the corners' distortion, whatever their sides: those of a bad
    /// quad are none to keep. Then their vertices one by one, as long as the worst becomes better.
    pub(super) fn straighten(&mut self) -> Result<(), Error> {
        for _ in 0..AGAIN {
            let merits = self.merits();
            let worst = least(&merits);
            if worst >= GOAL {
                break;
            }
            let start = (self.positions.clone(), self.normals.clone());
            let free = self.freedom.clone();
            self.hold_all_but(&merits);
            let best = self.descend(STEEP, STEPS, true);
            self.freedom = free;
            (self.positions, self.normals) = best?.1;
            self.lift_the_worst();
            let after = least(&self.merits());
            if after <= worst {
                (self.positions, self.normals) = start;
                self.measure();
                break;
            }
            if after < worst + GAIN {
                break;
            }
        }
        Ok(())
    }

    /// Fixes all vertices farther than some rings from a bad quad.
    fn hold_all_but(&mut self, merits: &[f64]) {
        let mut near: Vec<bool> = merits.iter().map(|&m| m < GOAL).collect();
        for _ in 0..RINGS {
            let mut next = near.clone();
            for q in (0..near.len()).filter(|&q| near[q]) {
                for v in self.quads[q] {
                    for &other in &self.around[v as usize] {
                        next[other as usize] = true;
                    }
                }
            }
            near = next;
        }
        for v in 0..self.freedom.len() {
            if !self.around[v].iter().all(|&q| near[q as usize]) {
                self.freedom[v] = Freedom::Fixed;
            }
        }
    }
}

pub(super) fn least(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}
