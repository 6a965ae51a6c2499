//! The worst elements, after the flow.
//!
//! Where the mean is good and single corners are not, vertices of the worst elements search for better places, as one after
//! the other. Four that can only move together are stuck so; they go down a high power of the corners' distortion, with all around them.
//! The same search raises the mean, if a place is judged by all elements around it.

use super::{Descent, Elements, Flow, Measure, Places, State, least};
use crate::compute::parallel;
use crate::surface::ground::Freedom;
use crate::{Point3, Vector3};

/// Below this, elements are bad: a search alone may be stuck.
pub(super) const LOW: f64 = 0.6;
/// Above that, where the goal is higher, a place must be better by this share of the step: what gains less is not worth the
/// many steps that it takes. A forcing function, as Kolda, Lewis and Torczon call it, but linear: the worst of several is not smooth, and
/// steps have a last length.
const FORCING: f64 = 0.03;
/// Rings around them that go down a power, and which.
const RINGS: usize = 3;
const STEEP: i32 = 12;
/// Again if the worst is better by so much.
const GAIN: f64 = 0.005;
/// A flow is given up for the worst when that was not better for so many steps.
const PATIENCE: usize = 20;
/// Where a search ends, in reaches of a vertex.
const SHORTEST: f64 = 0.003;
/// How far its directions turn from one try to the next, in eighths of a circle: those of any number of tries lie evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// How long vertices search for better places.
pub struct Search<E> {
    /// Those of elements for which this is below the goal do,
    pub by: Measure<E>,
    /// which is this.
    pub goal: f64,
    /// Rounds at most.
    pub rounds: usize,
    /// Where a search begins, in reaches of the vertex.
    pub first: f64,
}

/// What is done about elements for which a search is not enough.
pub struct Straightening<E> {
    /// Those for which this is below 0.6; the worst of it must rise.
    pub by: Measure<E>,
    /// They go down so, but for the power,
    pub descent: Descent,
    /// and back to where the worst of this was best,
    pub best: Measure<E>,
    /// which may be where they began.
    pub start_counts: bool,
    /// How often at most.
    pub again: usize,
}

/// What is better at a better place, of the elements around it.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Raise {
    /// The worst.
    Worst,
    /// Their mean, while the worst does not fall below this, nor at all where it is below.
    Mean(f64),
}

/// Of vertices that search.
struct Seekers {
    /// How far each looks next, in its reaches.
    steps: Vec<f64>,
    /// How often each has looked.
    tries: Vec<u32>,
    /// What the elements around each are worth, as long as nothing there moves.
    known: Vec<Option<f64>>,
}

impl<E: Elements> Flow<'_, E> {
    /// Vertices of bad elements search the directions of a compass for a place where the worst element around them is better,
    /// nearer and nearer until something around them moves. How many moved.
    ///
    /// # Errors
    /// If the watcher asks to stop.
    pub fn lift_the_worst(&mut self, how: &Search<E>) -> Result<usize, E::Error> {
        self.lift(how, Raise::Worst)
    }

    /// The same for what is to be better at those places.
    pub(super) fn lift(&mut self, how: &Search<E>, raise: Raise) -> Result<usize, E::Error> {
        let count = self.vertices.positions.len();
        let mut seekers = Seekers {
            steps: vec![how.first; count],
            tries: vec![0; count],
            known: vec![None; count],
        };
        let mut lifted = vec![false; count];
        let forcing = if how.goal > LOW { FORCING } else { 0.0 };
        let mut values = self.values(how.by);
        for round in 0..how.rounds {
            (self.run).progress("worst elements", round as u64, how.rounds as u64)?;
            // The worst have the first turns.
            let mut bad: Vec<usize> = (0..values.len())
                .filter(|&e| values[e] < how.goal)
                .collect();
            bad.sort_by(|&a, &b| values[a].total_cmp(&values[b]).then(a.cmp(&b)));
            let (mut searched, mut changed) = (false, Vec::new());
            for mut turn in self.turns(&bad) {
                turn.retain(|&v| self.vertices.freedom[v as usize] != Freedom::Fixed);
                turn.retain(|&v| seekers.steps[v as usize] >= SHORTEST);
                searched |= !turn.is_empty();
                for v in self.turned(&turn, &mut seekers, raise, forcing) {
                    lifted[v] = true;
                    changed.extend_from_slice(self.elements.around(v));
                }
            }
            // All have come to their shortest steps.
            if !searched {
                break;
            }
            // Only what has moved is measured again.
            changed.sort_unstable();
            changed.dedup();
            let places = Places::of(&self.vertices);
            let now =
                parallel::map_each(&changed, |&e| (how.by)(&self.elements, e as usize, &places));
            for (e, value) in changed.into_iter().zip(now) {
                values[e as usize] = value;
            }
        }
        Ok(lifted.iter().filter(|&&l| l).count())
    }

    /// One turn of vertices that have no element in common: each searches, and those that find a place move there. Which did.
    fn turned(
        &mut self,
        turn: &[u32],
        seekers: &mut Seekers,
        raise: Raise,
        forcing: f64,
    ) -> Vec<usize> {
        turn.iter().for_each(|&v| seekers.tries[v as usize] += 1);
        let found = parallel::map_each(turn, |&v| {
            let v = v as usize;
            let before = seekers.known[v].unwrap_or_else(|| self.worth_now(v, raise));
            debug_assert!(before == self.worth_now(v, raise), "something moved there");
            let (step, tries) = (seekers.steps[v], seekers.tries[v]);
            // Where the worst is bad, anything better is welcome.
            let is_bad = raise == Raise::Worst && before < LOW;
            let least = before + if is_bad { 0.0 } else { forcing * step };
            (before, self.search(v, raise, step, tries, least))
        });
        let mut moved = Vec::new();
        for (&v, (before, found)) in turn.iter().zip(found) {
            let v = v as usize;
            let step = seekers.steps[v];
            let Some(place) = found else {
                seekers.known[v] = Some(before);
                seekers.steps[v] = 0.5 * step;
                continue;
            };
            (self.vertices.positions[v], self.vertices.normals[v]) = place;
            moved.push(v);
            // Those around have other elements now, and may look as far again.
            for &near in self.elements.around(v) {
                for w in self.elements.rim(near as usize) {
                    let w = w as usize;
                    seekers.steps[w] = step.max(seekers.steps[w]);
                    seekers.known[w] = None;
                }
            }
        }
        moved
    }

    /// The vertices of elements in turns whose vertices have no element in common. One after the other would come to the same: each
    /// has its turn after all neighbours that came before it.
    fn turns(&self, elements: &[usize]) -> Vec<Vec<u32>> {
        let mut turns: Vec<Vec<u32>> = Vec::new();
        // The first turn after the last of each vertex.
        let mut next = vec![0; self.vertices.positions.len()];
        for v in elements.iter().flat_map(|&e| self.elements.rim(e)) {
            let around = self.elements.around(v as usize).iter();
            let near = around.flat_map(|&e| self.elements.rim(e as usize));
            let turn = near.map(|w| next[w as usize]).max().unwrap_or(0);
            next[v as usize] = turn + 1;
            if turn == turns.len() {
                turns.push(Vec::new());
            }
            turns[turn].push(v);
        }
        turns
    }

    /// What the elements around a vertex are worth where all are.
    fn worth_now(&self, v: usize, raise: Raise) -> f64 {
        let places = Places::of(&self.vertices);
        match raise {
            Raise::Worst => self.worst_around(v, &places, f64::NEG_INFINITY, &mut 0),
            Raise::Mean(_) => self.mean_around(v, &places, f64::NEG_INFINITY),
        }
    }

    /// The best of eight places `step` away from a vertex, if one is worth more than `least`; the directions turn with the tries,
    /// since those in which the worst of several elements becomes better may be few.
    fn search(
        &self,
        v: usize,
        raise: Raise,
        step: f64,
        tries: u32,
        least: f64,
    ) -> Option<(Point3, Vector3)> {
        let places = Places::of(&self.vertices);
        let start = (self.vertices.positions[v], self.vertices.normals[v]);
        let mut refuser = 0;
        let way = [step * self.elements.reach(v), GOLDEN * f64::from(tries)];
        let (ground, freedom) = (self.vertices.ground(v), self.vertices.freedom[v]);
        let held = match raise {
            Raise::Worst => f64::NEG_INFINITY,
            Raise::Mean(held) => held.min(self.worth_now(v, Raise::Worst)),
        };
        ground.best_around(start, way, freedom, least, |&place, least| {
            let there = places.but(v, place);
            match raise {
                Raise::Worst => self.worst_around(v, &there, least, &mut refuser),
                Raise::Mean(_) if self.worst_around(v, &there, held, &mut refuser) <= held => least,
                Raise::Mean(_) => self.mean_around(v, &there, least),
            }
        })
    }

    /// The mean of the merits around a vertex, or any number that is not above `floor` if it is not.
    fn mean_around(&self, v: usize, places: &Places<'_>, floor: f64) -> f64 {
        let around = self.elements.around(v);
        let mean_of = |merit: &dyn Fn(usize) -> f64| -> f64 {
            around.iter().map(|&e| merit(e as usize)).sum::<f64>() / around.len() as f64
        };
        let most = mean_of(&|e| self.elements.merit_at_most(e, places));
        if most <= floor {
            return most;
        }
        mean_of(&|e| self.elements.merit(e, places))
    }

    /// The merit of the worst element around a vertex, or any number that is not above `floor` if it is not. The element that was so
    /// last is asked first.
    fn worst_around(&self, v: usize, places: &Places<'_>, floor: f64, refuser: &mut usize) -> f64 {
        let around = self.elements.around(v);
        let by_turns = |first: usize| (0..around.len()).map(move |k| (first + k) % around.len());
        let most = |at: usize| self.elements.merit_at_most(around[at] as usize, places);
        for at in by_turns(*refuser) {
            let most = most(at);
            if most <= floor {
                *refuser = at;
                return most;
            }
        }
        let mut worst = f64::INFINITY;
        for at in by_turns(*refuser) {
            let merit = self.elements.merit(around[at] as usize, places);
            debug_assert!(merit <= most(at), "{merit} is at most {}", most(at));
            worst = worst.min(merit);
            if worst <= floor {
                *refuser = at;
                break;
            }
        }
        worst
    }

    /// Around elements that are still bad, steps down a high power of the corners' distortion, whatever their sides: those of a
    /// bad element are none to keep. Then their vertices one by one, as long as the worst becomes better. How many of those moved.
    ///
    /// # Errors
    /// Of the backend, and if the watcher asks to stop.
    pub fn straighten(
        &mut self,
        how: &Straightening<E>,
        search: &Search<E>,
    ) -> Result<usize, E::Error> {
        let steep = Descent {
            power: STEEP,
            renew: true,
            ..how.descent
        };
        let mut lifted = 0;
        for round in 0..how.again {
            let values = self.values(how.by);
            let worst = least(values.iter().copied());
            if worst >= LOW {
                break;
            }
            let start = self.vertices.state();
            let (near, mut part) = self.around_bad(&values, how.best);
            let best = part.best_of(&steep, how.best, how.start_counts)?;
            self.vertices.put_some(&near, best.1);
            self.elements.renew(&self.vertices.positions);
            let goal = if round == 0 { search.goal } else { LOW };
            let moved = self.lift_the_worst(&Search { goal, ..*search })?;
            let after = self.worst(how.by);
            if after <= worst {
                self.vertices.put(start);
                self.elements.renew(&self.vertices.positions);
                break;
            }
            lifted += moved;
            if after < worst + GAIN {
                break;
            }
        }
        Ok(lifted)
    }

    /// Goes down, until the worst of a measure has not become better for twenty steps. What that was where it was best, after a
    /// step or at the start if that counts, and the state there.
    ///
    /// # Errors
    /// Of the backend, and if the watcher asks to stop.
    pub fn best_of(
        &mut self,
        how: &Descent,
        by: Measure<E>,
        start_counts: bool,
    ) -> Result<(f64, State), E::Error> {
        let first = if start_counts {
            self.worst(by)
        } else {
            f64::NEG_INFINITY
        };
        let (mut best, mut since) = ((first, self.vertices.state()), 0);
        let mut refuser = 0;
        self.descend(how, |flow| {
            since += 1;
            if let Some(worst) = flow.worst_above(best.0, by, &mut refuser) {
                (best, since) = ((worst, flow.vertices.state()), 0);
            }
            since < PATIENCE
        })?;
        Ok(best)
    }

    /// The least of a measure, if that is above `floor`. The element that it was last is asked first: mostly it still is.
    fn worst_above(&self, floor: f64, by: Measure<E>, refuser: &mut usize) -> Option<f64> {
        let places = Places::of(&self.vertices);
        if *refuser < self.elements.count() && by(&self.elements, *refuser, &places) <= floor {
            return None;
        }
        let values = self.values(by);
        let worst = least(values.iter().copied());
        *refuser = values.iter().position(|&v| v == worst).unwrap_or(0);
        (worst > floor).then_some(worst)
    }

    /// The elements within some rings of a bad one on their own, held at the rim, and their vertices here: what is far away would
    /// be most of the work.
    fn around_bad(&self, values: &[f64], by: Measure<E>) -> (Vec<u32>, Self) {
        let mut near: Vec<bool> = values.iter().map(|&value| value < LOW).collect();
        for _ in 0..RINGS {
            let mut next = near.clone();
            for e in (0..near.len()).filter(|&e| near[e]) {
                for v in self.elements.rim(e) {
                    for &other in self.elements.around(v as usize) {
                        next[other as usize] = true;
                    }
                }
            }
            near = next;
        }
        let elements: Vec<usize> = (0..near.len()).filter(|&e| near[e]).collect();
        let rims = elements.iter().flat_map(|&e| self.elements.rim(e));
        let mut vertices: Vec<u32> = rims.collect();
        vertices.sort_unstable();
        vertices.dedup();
        let mut places = self.vertices.some(&vertices);
        let own = (self.elements).part(&elements, &vertices, &places.positions);
        debug_assert!({
            let [all, some] = [&self.vertices, &places].map(Places::of);
            let mut pairs = elements.iter().enumerate();
            pairs.all(|(k, &e)| by(&own, k, &some) == by(&self.elements, e, &all))
        });
        for (&v, freedom) in vertices.iter().zip(&mut places.freedom) {
            let mut around = self.elements.around(v as usize).iter();
            if !around.all(|&e| near[e as usize]) {
                *freedom = Freedom::Fixed;
            }
        }
        (vertices, Flow::new(own, places, self.run))
    }
}
