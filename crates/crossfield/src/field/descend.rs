//! Period jumps that lower the energy: single edges, and pairs of singularities that meet.
//!
//! With the period jumps p given, the best angles are a linear solve whose matrix W does not depend on p
//! ([`Parallel`]). So what a change of p costs has a closed form: if p rises by d quarter turns (as an angle, d π/2) on
//! some edges of weight w and the angles follow, the energy of Eq. 4.9 changes by
//!
//! ```text
//! 2 Σ w d ρ + Σ w d² − bᵀ W⁻¹ b        ρ = −δ before the change,   b = Σ w d (e_j − e_i)
//! ```
//!
//! The first two terms are sums over the edges that change ([`Descent::direct`]); the third, the *compliance*, needs half a
//! substitution but depends neither on p nor on the sign of the change, so that it is kept once it is known. The formula holds
//! only while the angles are the best ones for the present p: hence [`Descent::apply`] lets them follow each change
//! before the next one is judged.
//!
//! Bommes, Zimmer and Kobbelt (*Mixed-integer quadrangulation*, 2009) round one p after the other and never look back.
//! Here all p start from the nearest arms of a diffused field, and single ones or whole paths of them may change as
//! long as that pays. Both end in local minima; what leaves most of them is that pairs of singularities may meet over a
//! distance.
//!
//! `p(a→b) + 1` carries a quarter of index from b to a and leaves all other vertices alone. So a change on one edge
//! moves a singularity by that edge, and one on a path moves a quarter from its end to its start. The sum of the
//! indices never changes.

use std::collections::{BTreeMap, BTreeSet};

use geom_core::TriMesh;
use geom_core::compute::parallel;
use geom_core::surface::distance::{Graph, Searches, shortest_paths};

use super::field::FieldReport;
use super::frames::{Frames, QUARTER};
use super::near::{Near, Taken};
use super::parallel::{Change, Parallel};
use super::singularity::{Lines, difference, interior_index};
use crate::Error;
use crate::backend::On;

/// Rounds of edge moves and annihilations.
const ROUNDS: usize = 6;
/// An energy falls when it falls by this, rad².
const FALLS: f64 = 1e-9;
/// How much farther than to the nearest opposite singularity partners are looked for.
const REACH: f64 = 2.0;
/// Partners are not looked for farther than so many sides of a quad: as many singularities as triangles allow would make that
/// a walk over the whole surface for each.
const FARTHEST: f64 = 20.0;
/// Pairs that are parted together are so many times farther from each other than they shall be: none of their ways meet.
const FAR: f64 = 6.0;
/// Partners tried per singularity.
const PARTNERS: usize = 4;
/// Changes made together are so many edges apart.
const RINGS: usize = 4;
/// They are worth this part of what they would be one by one, or fewer are made together.
const SHARE: f64 = 0.5;

/// What removing a pair of opposite singularities may cost.
#[derive(Clone, Copy)]
pub(super) struct Price {
    /// Of pairs far apart, rad².
    /// Pairs that cost less than this are removed, so that 0 removes those only whose end lowers the energy.
    pub(super) far: f64,
    /// The side of a quad, Å: pairs nearer than [`NEAR`] of these cost more.
    pub(super) near: f64,
}

impl Price {
    /// The energy of a dipole grows with the logarithm of its length, but what it does to a map with the inverse square:
    /// both singularities need integer points of their own.
    /// At [`NEAR`] sides and farther it is `far`; at a distance of one side four times as much, at half a side sixteen
    /// times.
    fn at(self, distance: f64) -> f64 {
        self.far * (NEAR * self.near / distance).max(1.0).powi(2)
    }
}

/// A change that may be made.
struct Judged {
    change: Change,
    /// What the energy rises by, the angles following, rad².
    cost: f64,
    /// What it may cost.
    price: f64,
}

impl Judged {
    /// Below 0 for changes that are to be made.
    fn worth(&self) -> f64 {
        self.cost - self.price
    }
}

/// Pairs nearer to each other than so many sides of a quad cost more.
pub(crate) const NEAR: f64 = 2.0;

/// Angles and period jumps on their way down.
pub(super) struct Descent<'a> {
    /// Along its edges it is measured how far singularities are from each other.
    mesh: &'a TriMesh,
    frames: &'a Frames,
    parallel: &'a Parallel<'a>,
    lines: Lines,
    /// Always the best ones for `jump`, by the solver in `parallel`.
    pub(super) theta: Vec<f64>,
    /// Per half-edge and odd under exchange with the twin, as in a cross field.
    pub(super) jump: Vec<i32>,
    /// Four times the index of the vertices inside of the surface, which follows each change of `jump`.
    index: Vec<i32>,
    /// What one quarter turn on an edge gains by letting the angles follow.
    compliance: BTreeMap<usize, f64>,
    /// The side of a quad, Å; 0 if that shall not matter.
    apart: f64,
    /// The same of shortest paths, by their ends.
    of_paths: BTreeMap<(usize, usize), f64>,
}

impl<'a> Descent<'a> {
    /// The start of a descent; `theta` are the best angles for `jump`, and `apart` is how far singularities shall be
    /// from each other, Å, or 0.
    pub(super) fn new(
        mesh: &'a TriMesh,
        parallel: &'a Parallel<'a>,
        lines: Lines,
        (theta, jump): (Vec<f64>, Vec<i32>),
        apart: f64,
    ) -> Self {
        let frames = parallel.frames;
        let mut descent = Self {
            mesh,
            frames,
            parallel,
            lines,
            theta,
            jump,
            index: Vec::new(),
            compliance: BTreeMap::new(),
            apart,
            of_paths: BTreeMap::new(),
        };
        descent.count();
        descent
    }

    /// Interior indices; 0 on boundaries and lines, whose corners are not for trade.
    fn count(&mut self) {
        let frames = self.frames;
        self.index = (0..frames.edges().vertices())
            .map(|v| {
                let used = frames.edges().out(geom_core::VertexId(v as u32)).is_some();
                if used && !self.lines.hold(v) {
                    interior_index(frames, &self.jump, v)
                } else {
                    0
                }
            })
            .collect();
    }

    /// Alternates until nothing lowers the energy and the price of all pairs any more.
    pub(super) fn run(
        &mut self,
        price: Price,
        report: &mut FieldReport,
        run: On<'_>,
    ) -> Result<(), Error> {
        self.fit_lines()?;
        for round in 0..ROUNDS {
            run.progress("singularities", round as u64, ROUNDS as u64)?;
            let moved = self.move_edges(price)?;
            let met = self.annihilate(|distance| price.at(distance))?;
            report.edge_moves += moved;
            report.annihilated += met;
            // Moves go on until none is left.
            if met == 0 {
                break;
            }
        }
        self.split_extremes()?;
        self.part(price.near, report, run)?;
        if self.is_impossible() {
            report.annihilated += self.annihilate(|_| f64::INFINITY)?;
        }
        Ok(())
    }

    /// A torus of quads with one vertex of three and one of five and all others of four does not exist (Izmestiev et al.,
    /// *There is no triangulation of the torus with vertex degrees 5, 6, …, 6, 7 and related results*, 2013).
    fn is_impossible(&self) -> bool {
        let mut signs: Vec<i32> = self.index.iter().copied().filter(|&i| i != 0).collect();
        signs.sort_unstable();
        signs == [-1, 1] && self.frames.interior().count() * 2 == self.frames.edges().len()
    }

    /// As many quads between two lines at a vertex as their angle says, one at least; what that takes goes to a vertex between
    /// them, from where it may move. No map has an angle without quads.
    fn fit_lines(&mut self) -> Result<(), Error> {
        let frames = self.frames;
        let held: Vec<usize> = (0..self.index.len())
            .filter(|&v| self.lines.hold(v))
            .collect();
        for v in held {
            for sector in self.lines.sectors(frames, v) {
                let more = sector.wanted() - sector.quads(frames, &self.theta, &self.jump);
                let free: Vec<usize> = sector
                    .inside
                    .iter()
                    .copied()
                    .filter(|&h| !self.lines.hold(frames.from(h)))
                    .collect();
                if more != 0
                    && let Some(&h) = free.get(free.len() / 2)
                {
                    self.apply(&[(h, more)])?;
                }
            }
        }
        Ok(())
    }

    /// Single edges at singular vertices, the best first, as many together as are far from each other. A move that makes a pair
    /// pays its price, and one that lets a pair meet is paid it. No edge makes a second pair: one made on a long edge, for little,
    /// that is paid more on a short one would come and go for ever.
    fn move_edges(&mut self, price: Price) -> Result<usize, Error> {
        let (mut moves, mut made) = (0, BTreeSet::new());
        let most = 4 * self.index.iter().filter(|&&i| i != 0).count() + 50;
        while moves < most {
            let edges = self.edges_at_singularities();
            self.remember(&edges)?;
            let mut judged: Vec<Judged> = edges
                .iter()
                .flat_map(|&h| [(h, 1), (h, -1)])
                .filter(|&(h, s)| self.keeps_valences(h, s))
                .filter(|&(h, s)| self.pairs_made(h, s) <= 0 || !made.contains(&h))
                .map(|(h, s)| Judged {
                    change: vec![(h, s)],
                    cost: self.single(h, s),
                    price: -price.at(self.length(h)) * f64::from(self.pairs_made(h, s)),
                })
                .filter(|judged| judged.worth() < -FALLS)
                .collect();
            judged.sort_by(|a, b| {
                let by_worth = a.worth().total_cmp(&b.worth());
                by_worth.then_with(|| a.change.cmp(&b.change))
            });
            let mut taken = Taken::new(self.frames, RINGS);
            judged.retain(|judged| taken.take(&self.vertices(&judged.change)));
            if judged.is_empty() {
                break;
            }
            let moved = self.apply_together(&judged)?;
            moves += moved;
            // What pays makes a pair.
            let pays = judged[..moved].iter().filter(|j| j.price < 0.0);
            made.extend(pays.map(|j| j.change[0].0));
        }
        Ok(moves)
    }

    /// How many pairs of opposite quarters more there are after a move: −1, 0 or 1.
    fn pairs_made(&self, h: usize, s: i32) -> i32 {
        let more = |v: usize, s: i32| (self.index[v] + s).abs() - self.index[v].abs();
        (more(self.frames.from(h), s) + more(self.frames.to(h), -s)) / 2
    }

    /// Of an edge, Å.
    fn length(&self, h: usize) -> f64 {
        let at = |v: usize| self.mesh.positions()[v];
        (at(self.frames.to(h)) - at(self.frames.from(h))).norm()
    }

    /// All vertices of the edges of a change.
    fn vertices(&self, change: &[(usize, i32)]) -> Vec<usize> {
        let ends = |&(h, _): &(usize, i32)| [self.frames.from(h), self.frames.to(h)];
        change.iter().flat_map(ends).collect()
    }

    /// Interior edges with a singular end, by their lower half-edge.
    /// A change on any other edge inside makes a new pair of singularities.
    fn edges_at_singularities(&self) -> Vec<usize> {
        let mut edges: Vec<usize> = (0..self.index.len())
            .filter(|&v| self.index[v] != 0)
            .flat_map(|v| self.frames.around(v))
            .filter_map(|h| self.frames.twin(h).map(|t| h.min(t)))
            .filter(|&h| self.is_inside(h))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Neither end on a boundary or line.
    fn is_inside(&self, h: usize) -> bool {
        !self.lines.hold(self.frames.from(h)) && !self.lines.hold(self.frames.to(h))
    }

    /// Does a move leave both ends with three to six quads?
    /// Index +2 would be a vertex of two quads, each with a corner of about half a turn, −3 one of seven: a map can have
    /// both, but such corners are too flat or too sharp to be of use.
    fn keeps_valences(&self, h: usize, s: i32) -> bool {
        let allowed = |i: i32| (-2..=1).contains(&i);
        let (a, b) = (self.frames.from(h), self.frames.to(h));
        // A move may also improve what is not allowed.
        let fine = |before: i32, after: i32| allowed(after) || after.abs() < before.abs();
        fine(self.index[a], self.index[a] + s) && fine(self.index[b], self.index[b] - s)
    }

    /// Solves for the compliances of those edges that have none yet, many right-hand sides at a time.
    fn remember(&mut self, edges: &[usize]) -> Result<(), Error> {
        let new: Vec<usize> = edges
            .iter()
            .copied()
            .filter(|h| !self.compliance.contains_key(h))
            .collect();
        let changes: Vec<Change> = new.iter().map(|&h| vec![(h, 1)]).collect();
        let values = self.parallel.compliances(&changes)?;
        self.compliance.extend(new.into_iter().zip(values));
        Ok(())
    }

    /// What one quarter turn on an edge costs, rad², once its compliance is remembered; `s` is ±1.
    fn single(&self, h: usize, s: i32) -> f64 {
        self.direct(&[(h, s)]) - self.compliance[&h]
    }

    /// What a change costs with the angles held: `2 Σ w d ρ + Σ w d²`, ρ = −δ.
    fn direct(&self, change: &[(usize, i32)]) -> f64 {
        change
            .iter()
            .map(|&(h, s)| {
                let d = QUARTER * f64::from(s);
                let rho = -difference(self.frames, &self.theta, &self.jump, h);
                self.frames.weight(h) * (2.0 * d * rho + d * d)
            })
            .sum()
    }

    /// Carries out a change and lets the angles follow: one solve.
    fn apply(&mut self, change: &[(usize, i32)]) -> Result<(), Error> {
        self.turn(change);
        let (response, _) = self.parallel.response(change)?;
        self.parallel.follow(&response, &mut self.theta);
        Ok(())
    }

    /// Carries out the first of some changes that are far from each other: all, or half of them and so on where they are worth
    /// much less together than one by one. Answers how many.
    fn apply_together(&mut self, judged: &[Judged]) -> Result<usize, Error> {
        let mut count = judged.len();
        loop {
            let some = &judged[..count];
            let change: Change = some.iter().flat_map(|j| j.change.iter().copied()).collect();
            let (response, gain) = self.parallel.response(&change)?;
            let price: f64 = some.iter().map(|j| j.price).sum();
            let worth: f64 = some.iter().map(Judged::worth).sum();
            if count <= 1 || self.direct(&change) - gain - price <= SHARE * worth {
                self.turn(&change);
                self.parallel.follow(&response, &mut self.theta);
                return Ok(count);
            }
            count /= 2;
        }
    }

    /// Changes the period jumps, and the indices at the ends of their edges: these are counted along and not anew.
    fn turn(&mut self, change: &[(usize, i32)]) {
        for &(h, s) in change {
            let twin = self.frames.twin(h).expect("an interior edge");
            self.jump[h] += s;
            self.jump[twin] -= s;
            // p(a→b) + 1 moves a quarter of index from b to a.
            let ends = [(self.frames.from(h), s), (self.frames.to(h), -s)];
            for (v, s) in ends.into_iter().filter(|end| !self.lines.hold(end.0)) {
                self.index[v] += s;
            }
        }
    }

    /// Pairs of opposite singularities that may meet along a shortest path, where that costs less than the price of their
    /// distance, rad².
    ///
    /// All candidates are judged at once, then taken from the cheapest on, those far from each other together; as these
    /// change the angles, and maybe the singularities at the ends of the others, the others are looked at again. Their
    /// compliances hold, as they do not depend on the jumps. Answers how many pairs have met.
    fn annihilate(&mut self, price: impl Fn(f64) -> f64) -> Result<usize, Error> {
        let pairs = self.pairs()?;
        let (distances, changes): (Vec<f64>, Vec<Change>) = pairs.into_iter().unzip();
        let gains = self.gains(&changes)?;
        let cost = |descent: &Self, k: usize| descent.direct(&changes[k]) - gains[k];
        let mut order: Vec<(f64, usize)> = (0..changes.len())
            .map(|k| (cost(self, k), k))
            .filter(|&(cost, k)| cost < price(distances[k]))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut open: Vec<usize> = order.into_iter().map(|(_, k)| k).collect();
        let mut met = 0;
        while !open.is_empty() {
            let mut taken = Taken::new(self.frames, RINGS);
            let (mut chosen, mut numbers, mut later) = (Vec::new(), Vec::new(), Vec::new());
            for k in open {
                let (first, last) = self.ends(&changes[k]);
                if self.index[first] >= 0 || self.index[last] <= 0 {
                    continue;
                }
                let judged = Judged {
                    change: changes[k].clone(),
                    cost: cost(self, k),
                    price: price(distances[k]),
                };
                if judged.worth() >= 0.0 {
                    // The field has changed since.
                    continue;
                }
                if taken.take(&self.vertices(&changes[k])) {
                    chosen.push(judged);
                    numbers.push(k);
                } else {
                    later.push(k);
                }
            }
            if chosen.is_empty() {
                break;
            }
            let made = self.apply_together(&chosen)?;
            met += made;
            open = numbers.split_off(made);
            open.extend(later);
        }
        Ok(met)
    }

    /// What the angles gain by following changes along shortest paths, which does not depend on the period jumps.
    fn gains(&mut self, changes: &[Change]) -> Result<Vec<f64>, Error> {
        let ends: Vec<(usize, usize)> = changes.iter().map(|c| self.ends(c)).collect();
        let new: Vec<usize> = (0..changes.len())
            .filter(|&k| !self.of_paths.contains_key(&ends[k]))
            .collect();
        let unknown: Vec<Change> = new.iter().map(|&k| changes[k].clone()).collect();
        let found = self.parallel.compliances(&unknown)?;
        self.of_paths
            .extend(new.iter().map(|&k| ends[k]).zip(found));
        Ok(ends.iter().map(|ends| self.of_paths[ends]).collect())
    }

    /// Where a path starts and where it ends.
    fn ends(&self, change: &[(usize, i32)]) -> (usize, usize) {
        let (first, last) = (change[0].0, change[change.len() - 1].0);
        (self.frames.from(first), self.frames.to(last))
    }

    /// Paths from each negative singularity to the nearest positive ones, with their lengths.
    ///
    /// By Dijkstra's algorithm along edges: once from all positive ones together, which says how far each negative one
    /// has to look, then from each negative one as far as [`REACH`] times that, to at most [`PARTNERS`] others. On a
    /// surface with boundaries, paths that touch one are left out.
    fn pairs(&self) -> Result<Vec<(f64, Change)>, Error> {
        let signed = |sign: i32| {
            (0..self.index.len() as u32).filter(move |&v| self.index[v as usize] * sign > 0)
        };
        let positive: Vec<(u32, f64)> = signed(1).map(|v| (v, 0.0)).collect();
        if positive.is_empty() {
            return Ok(Vec::new());
        }
        let graph = Graph::of_edges(self.mesh)?;
        let nearest = shortest_paths(&graph, &positive, f64::INFINITY)?.distance;
        let farthest = match self.apart {
            0.0 => f64::INFINITY,
            apart => FARTHEST * apart,
        };
        let negative: Vec<u32> = signed(-1).collect();
        let searches = Searches::of(&graph);
        let of_each: Vec<Result<_, Error>> = parallel::map_each(&negative, |&v| {
            let reach = (REACH * nearest[v as usize]).min(farthest);
            if !reach.is_finite() {
                return Ok(Vec::new());
            }
            searches.with(|search| {
                let (paths, reached) = search.paths_from(&[(v, 0.0)], reach)?;
                let positive = reached.iter().filter(|&&u| self.index[u as usize] > 0);
                let mut partners: Vec<(f64, u32)> =
                    positive.map(|&u| (paths.distance[u as usize], u)).collect();
                partners.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                partners.truncate(PARTNERS);
                let changes = partners.into_iter().filter_map(|(distance, u)| {
                    let change = self.along(&paths.to(u))?;
                    Some((distance, change))
                });
                Ok(changes.collect())
            })
        });
        let of_each: Result<Vec<Vec<(f64, Change)>>, Error> = of_each.into_iter().collect();
        Ok(of_each?.concat())
    }

    /// One quarter of index from the last vertex of a path to the first; `None` along a boundary or line.
    fn along(&self, path: &[u32]) -> Option<Change> {
        path.windows(2)
            .map(|pair| {
                let (a, b) = (pair[0] as usize, pair[1] as usize);
                let h = self.frames.around(a).find(|&h| self.frames.to(h) == b)?;
                self.frames.twin(h)?;
                self.is_inside(h).then_some((h, 1))
            })
            .collect()
    }

    /// Vertices of fewer than three or more than six quads give a quarter to a neighbour, where it costs
    /// least.
    /// It goes on until there is none left, or until no neighbour of one can take a quarter without becoming extreme
    /// itself.
    fn split_extremes(&mut self) -> Result<(), Error> {
        let most = 8 * self.index.iter().filter(|i| !(-2..=1).contains(*i)).count();
        for _ in 0..most {
            let Some(v) = (0..self.index.len()).find(|&v| !(-2..=1).contains(&self.index[v]))
            else {
                break;
            };
            let s = if self.index[v] > 0 { -1 } else { 1 };
            let edges: Vec<usize> = self
                .frames
                .around(v)
                .filter(|&h| self.frames.twin(h).is_some() && self.is_inside(h))
                .collect();
            let changes: Vec<Change> = edges.iter().map(|&h| vec![(h, s)]).collect();
            let gains = self.parallel.compliances(&changes)?;
            let best = changes
                .into_iter()
                .zip(gains)
                .filter(|(c, _)| {
                    let to = self.index[self.frames.to(c[0].0)] - s;
                    (-2..=1).contains(&to)
                })
                .min_by(|a, b| {
                    let cost = |(c, gain): &(Change, f64)| self.direct(c) - gain;
                    cost(a).total_cmp(&cost(b))
                });
            match best {
                Some((change, _)) => self.apply(&change)?,
                None => break,
            }
        }
        Ok(())
    }

    /// Singular vertices nearer to each other than `apart` give a quarter to one that is not near to any, or to each other,
    /// whatever costs least: all get integer points of their own in a map, and a map with room for them does not fold.
    ///
    /// The nearest pairs first, those far from each other together, and for each of all ways out of either vertex the cheapest.
    /// Both of a pair that finds none are marked as stuck and not asked again together. It ends when no pair is left, or after
    /// twice as many changes as there were singularities: what is moved away from one may come near to another.
    fn part(&mut self, apart: f64, report: &mut FieldReport, run: On<'_>) -> Result<(), Error> {
        if apart <= 0.0 {
            return Ok(());
        }
        let graph = Graph::of_edges(self.mesh)?;
        let mut stuck = vec![false; self.index.len()];
        let searches = Searches::of(&graph);
        let mut near = Near::default();
        let most = 2 * self.singular().count();
        let mut done = 0;
        while done < most {
            run.progress("singularities", done as u64, most as u64)?;
            let singular: Vec<u32> = self.singular().collect();
            let pairs = near.pairs(&searches, &singular, apart, &stuck)?;
            let pairs = self.far_from_each_other(&pairs, FAR * apart);
            if pairs.is_empty() {
                break;
            }
            done += pairs.len();
            let ways = parallel::map_each(&pairs, |&(a, b)| {
                let mut ways = self.ways_out(&searches, a, b, apart)?;
                ways.extend(self.ways_out(&searches, b, a, apart)?);
                Ok(ways)
            });
            let ways: Vec<Vec<Change>> = ways.into_iter().collect::<Result<_, Error>>()?;
            let all: Vec<Change> = ways.concat();
            let gains = self.parallel.compliances(&all)?;
            let mut judged = all.into_iter().zip(gains);
            let mut chosen: Change = Vec::new();
            for ((a, b), ways) in pairs.into_iter().zip(&ways) {
                let own = judged.by_ref().take(ways.len());
                let best = own.min_by(|(a, gain), (b, other)| {
                    (self.direct(a) - gain).total_cmp(&(self.direct(b) - other))
                });
                match best {
                    Some((change, _)) => {
                        let [before, after] = self.singular_ends(&change);
                        if after < before {
                            report.annihilated += 1;
                        } else {
                            report.moved_apart += 1;
                        }
                        chosen.extend(change);
                    }
                    None => (stuck[a as usize], stuck[b as usize]) = (true, true),
                }
            }
            self.apply(&chosen)?;
        }
        Ok(())
    }

    /// As many pairs, the first of them first, as have such a distance from each other, Å, through space.
    fn far_from_each_other(&self, pairs: &[(u32, u32)], distance: f64) -> Vec<(u32, u32)> {
        let at = |v: u32| self.mesh.positions()[v as usize];
        let mut far: Vec<(u32, u32)> = Vec::new();
        for &pair in pairs {
            let is_far = |other: &(u32, u32)| (at(pair.0) - at(other.0)).norm() >= distance;
            if far.iter().all(is_far) {
                far.push(pair);
            }
        }
        far
    }

    /// How many of the ends of a path are singular, before and after a change along it.
    fn singular_ends(&self, change: &[(usize, i32)]) -> [usize; 2] {
        let ((first, last), s) = (self.ends(change), change[0].1);
        let count = |ends: [i32; 2]| ends.iter().filter(|&&i| i != 0).count();
        let (a, b) = (self.index[first], self.index[last]);
        [count([a, b]), count([a + s, b - s])]
    }

    /// The singular vertices inside of the surface, ascending.
    fn singular(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.index.len() as u32).filter(|&v| self.index[v as usize] != 0)
    }

    /// Paths on which a singular vertex may give a quarter away: to another of opposite sign, or to regular ones a little
    /// farther than `apart` that are as far from all others.
    ///
    /// Of the ring of vertices between 1.05 and 1.5 times `apart` only every so many are tried, about 24 in all: costs
    /// vary slowly along the ring, and each way costs a solve.
    fn ways_out(
        &self,
        searches: &Searches<'_>,
        v: u32,
        other: u32,
        apart: f64,
    ) -> Result<Vec<Change>, Error> {
        const TARGETS: usize = 24;
        const RING: [f64; 2] = [1.05, 1.5];
        let reach = RING[1] * apart;
        let sign = self.index[v as usize].signum();
        let meets = self.index[other as usize].signum() == -sign;
        searches.with(|own| {
            // Those that are farther from the vertex are near to no target.
            let (paths, near) = own.paths_from(&[(v, 0.0)], 2.0 * reach)?;
            let others = near.iter().map(|&u| (u, 0.0));
            let others = others.filter(|&(u, _)| u != v && self.index[u as usize] != 0);
            let others: Vec<(u32, f64)> = others.collect();
            let mut ring: Vec<u32> = searches.with(|search| {
                let (free, _) = search.paths_from(&others, reach)?;
                let in_ring = |u: &u32| {
                    let [far, own] = [free, paths].map(|paths| paths.distance[*u as usize]);
                    own <= reach && far >= apart && own >= RING[0] * apart
                };
                Ok::<_, Error>(near.iter().copied().filter(in_ring).collect())
            })?;
            ring.sort_unstable();
            let every = ring.len().div_ceil(TARGETS).max(1);
            let targets = ring.into_iter().step_by(every);
            Ok(targets
                .chain(meets.then_some(other))
                .filter_map(|u| self.along(&paths.to(u)))
                .filter(|change| !change.is_empty())
                .map(|change| change.into_iter().map(|(h, _)| (h, -sign)).collect())
                .collect())
        })
    }
}

/// [`Price::at`], for tests.
#[cfg(feature = "testing")]
pub(crate) fn price(far: f64, near: f64, distance: f64) -> f64 {
    Price { far, near }.at(distance)
}
