//! Parting walls that have come through each other. Where the other side of the boundary is not meshed, the walls of narrow
//! gaps may cross in valid steps. They are few: to part them afterwards costs less than to watch every step.
//!
//! What is parted must also keep its quality, and both pull in opposite directions. So each round is a bargain: corners
//! go down to a poor objective to get apart, passes mend the tetrahedra, and where they do not, all is taken back.

use geom_core::search::crossing::BoxedTriangle;
use geom_core::{Point3, Vector3};

use super::crossed::Pair;
use super::passes::Passes;
use crate::backend::On;
use crate::boundary::guard::GuardedMesh;
use crate::error::Error;
use crate::measure::block::measures;
use crate::measure::metrics::quality;
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::operations::operate::round_of_projections;
use crate::operations::patch::project_with_neighbours;
use crate::outcome::Pass;
use crate::smoothing::smooth::{SurfaceRules, load, sweep};
use crate::smoothing::star::Star;

/// Most rounds of parting.
const ROUNDS: u32 = 12;
/// The first ones keep the goals; the later ones give up what passes mend afterwards.
const GENTLE: u32 = 2;
/// Pulls in a row.
const PULLS: usize = 10;
/// Shares of a pull that are tried: short ones, so that nothing goes farther than it has to, and long ones.
const SHORT: [f64; 2] = [0.3, 0.1];
const LONG: [f64; 4] = [1.0, 0.6, 0.3, 0.1];
/// Passes after them.
const MENDING: u32 = 3;
/// Objective down to which elements may fall until they are mended.
const LEAST: f64 = 0.05;
/// Room between walls that have been parted, in spacings.
const ROOM: f64 = 1e-3;

/// Where a vertex would have to go, from where it is.
/// Lists of wishes are sorted by vertex, one per vertex, so that a sweep finds them by bisection.
type Wish = (u32, Vector3);

/// Where the corners of crossing triangles are pulled to.
#[derive(Clone, Copy)]
enum Pull {
    /// Each to its own side of the middle between the triangles: walls part.
    Apart,
    /// To the middle of its neighbours on the boundary: folds around a vertex open.
    Fair,
}

/// How corners are pulled.
#[derive(Clone, Copy, PartialEq, Eq)]
enum How {
    /// While no step lets more triangles cross.
    Alone,
    /// The same, and neighbours make way.
    WithNeighbours,
    /// The same without looking at what else crosses on the way: knots only open so. Where no fewer cross in the end, all is
    /// as it was.
    ThroughOthers,
}

/// Each for as many rounds as there are kinds, the last one to the end.
const HOW: [How; 3] = [How::Alone, How::WithNeighbours, How::ThroughOthers];

/// What is pulled in turn in a round: one kind brings about what stops another.
const KINDS: [&[Pull]; 3] = [&[Pull::Apart, Pull::Fair], &[Pull::Fair], &[Pull::Apart]];

impl Passes<'_> {
    /// The pairs of boundary triangles that cross.
    pub(super) fn crossing(&mut self) -> Vec<Pair> {
        self.crossed.search(&mut self.guarded.mesh)
    }

    /// Pulls triangles that cross apart, so that no more of them cross, and mends what that costs: in the end all
    /// elements meet the goals, or none is worse than the worst one was. Gives how many pairs still cross.
    ///
    /// The first rounds are gentle: no star falls below the goals and below what its worst tetrahedron was. What they
    /// do not part is pulled in harder and harder ways: see `How`. Vertices that may not move stay, and pairs of which
    /// no corner may move are left.
    pub(super) fn part(
        &mut self,
        mut pairs: Vec<Pair>,
        passes: &mut Vec<Pass>,
        run: On<'_>,
    ) -> Result<usize, Error> {
        for round in 0..ROUNDS {
            if !self.can_part(&pairs) {
                break;
            }
            run.progress("part", round.into(), ROUNDS.into())?;
            self.watched = true;
            if round < GENTLE {
                self.find_gaps_near(&pairs);
                let (goals, target) = (self.options.goals, self.target);
                let good = |corners| quality(corners) >= target || goals.met_by(&measures(corners));
                self.pull_on(&mut pairs, &[Pull::Apart], &SHORT, good);
            } else {
                let kinds = KINDS[round as usize % KINDS.len()];
                let how = HOW[((round - GENTLE) as usize / KINDS.len()).min(HOW.len() - 1)];
                self.pull_and_mend(&mut pairs, kinds, how, passes, run)?;
            }
            // The isosurface does not cross itself: back to it as far as that goes.
            if pairs.is_empty() && self.settle_again(MENDING, passes, run)? {
                pairs = self.crossing();
            }
        }
        Ok(pairs.len())
    }

    /// Is there a corner of these triangles that may move?
    /// Fixed walls of the input that cross stay as they are.
    fn can_part(&self, pairs: &[Pair]) -> bool {
        let freedom = &self.guarded.mesh.freedom;
        let mut corners = pairs.as_flattened().as_flattened().iter();
        corners.any(|&v| freedom[v as usize] == Freedom::Field)
    }

    /// Looks for gaps where these triangles are, which is all that is about to change.
    fn find_gaps_near(&mut self, pairs: &[Pair]) {
        let corners = pairs.as_flattened().as_flattened();
        let corners: Vec<Point3> = corners
            .iter()
            .map(|&v| self.guarded.mesh.x[v as usize])
            .collect();
        self.guarded.find_gaps(self.spacing, Some(&corners));
    }

    /// Pulls down to [`LEAST`], then passes. Where elements stay below the goals and the worst one before, all is as it was.
    /// Leaves the pairs that cross then.
    fn pull_and_mend(
        &mut self,
        pairs: &mut Vec<Pair>,
        kinds: &[Pull],
        how: How,
        passes: &mut Vec<Pass>,
        run: On<'_>,
    ) -> Result<(), Error> {
        self.find_gaps_near(pairs);
        let (kept, worst) = (self.guarded.clone(), self.guarded.mesh.worst());
        let (made, projected) = (passes.len(), self.projected);
        let (before, crossed) = (pairs.clone(), self.crossed.clone());
        let valid = |corners| quality(corners) >= LEAST;
        if how == How::ThroughOthers {
            self.guarded.forget_gaps();
        }
        if how != How::Alone {
            for kind in kinds {
                self.drag(pairs, *kind, valid);
                self.keep_crossing(pairs);
            }
        }
        self.pull_on(pairs, kinds, &LONG, valid);
        let mended = |work: &Self| work.met() || work.guarded.mesh.worst() >= worst;
        for number in 0..MENDING {
            if mended(self) {
                break;
            }
            let done = self.rescue(number, run)?;
            passes.push(done);
        }
        if passes.len() > made {
            *pairs = self.crossing();
        }
        let in_vain = how == How::ThroughOthers && pairs.len() >= before.len();
        if in_vain || (!mended(self) && !self.goals_met()) {
            self.go_back(kept, projected, crossed);
            passes.truncate(made);
            *pairs = before;
        }
        Ok(())
    }

    /// Steps of these kinds in turn, while any pair crosses. Leaves the pairs that cross then.
    fn pull_on(
        &mut self,
        pairs: &mut Vec<Pair>,
        kinds: &[Pull],
        shares: &[f64],
        good: impl Fn([Point3; 4]) -> bool + Sync,
    ) {
        for kind in kinds.iter().cycle().take(PULLS) {
            if pairs.is_empty() {
                return;
            }
            self.pull(pairs, *kind, shares, &good);
            self.keep_crossing(pairs);
        }
        if !pairs.is_empty() {
            *pairs = self.crossing();
        }
    }

    /// Drops the pairs that no longer cross. Where none is left, others may have come in their place.
    /// They are searched only then.
    fn keep_crossing(&mut self, pairs: &mut Vec<Pair>) {
        let mesh = &self.guarded.mesh;
        let boxed = |t| BoxedTriangle::new(t, &|v: u32| mesh.x[v as usize]);
        pairs.retain(|&[s, t]| boxed(s).crosses(&boxed(t)));
        if pairs.is_empty() {
            *pairs = self.crossing();
        }
    }

    /// Where each corner of these triangles would go.
    fn wishes(&self, pairs: &[Pair], kind: Pull) -> Vec<Wish> {
        match kind {
            Pull::Apart => wishes_apart(&self.guarded.mesh, pairs, ROOM * self.spacing),
            Pull::Fair => wishes_for_fairness(&self.guarded.mesh, pairs),
        }
    }

    /// One step of each corner of these triangles together with its neighbours, which make room for it.
    /// Each is a proposal with the smoothing of a whole neighbourhood, so that one round carries out only those that do
    /// not meet.
    fn drag(&mut self, pairs: &[Pair], kind: Pull, good: impl Fn([Point3; 4]) -> bool + Sync) {
        let wishes = self.wishes(pairs, kind);
        let Some(field) = self.surface else {
            return;
        };
        let rules = SurfaceRules {
            field,
            tolerance: self.deviation(),
            rescue: true,
        };
        let step = |guarded: &GuardedMesh, v: u32, star: &mut Star| {
            let wish = wish_of(&wishes, v)?;
            let x = guarded.mesh.x[v as usize];
            load(&guarded.mesh, v, star);
            LONG.iter().find_map(|share| {
                let to = x + wish * *share;
                let found = project_with_neighbours(guarded, v, to, &rules, &good, star);
                found.filter(|p| guarded.allows(p))
            })
        };
        let free = |v: &u32| self.guarded.mesh.freedom[*v as usize] == Freedom::Field;
        let vertices: Vec<u32> = wishes.iter().map(|w| w.0).filter(free).collect();
        let mut done = Pass::default();
        round_of_projections(
            &mut self.guarded,
            &mut self.plain,
            &vertices,
            step,
            &mut done,
        );
    }

    /// One step of each corner of these triangles, as far as its tetrahedra stay `good` or the worst of them does not get
    /// worse.
    /// Longer shares come first within a list: the vertex takes the longest step that it may.
    fn pull(
        &mut self,
        pairs: &[Pair],
        kind: Pull,
        shares: &[f64],
        good: impl Fn([Point3; 4]) -> bool + Sync,
    ) {
        let wishes = self.wishes(pairs, kind);
        let step = |guarded: &GuardedMesh, v: u32, star: &mut Star| {
            let mesh = &guarded.mesh;
            let wish = wish_of(&wishes, v)?;
            load(mesh, v, star);
            let x = mesh.x[v as usize];
            let floor = star.value(&x.coords);
            shares.iter().find_map(|share| {
                let candidate = x + wish * *share;
                let may = star.all_good(&candidate.coords, floor, &good)
                    && guarded.guard.allows_move(mesh, v, candidate);
                may.then_some(candidate)
            })
        };
        self.guarded.mesh.tick();
        let vertices: Vec<u32> = wishes.iter().map(|w| w.0).collect();
        let fit = |freedom| freedom == Freedom::Field;
        sweep(
            &mut self.guarded,
            &vertices,
            fit,
            step,
            GuardedMesh::move_vertex,
        );
    }
}

/// The wish of a vertex among wishes by vertex.
fn wish_of(wishes: &[Wish], v: u32) -> Option<Vector3> {
    let at = wishes.binary_search_by_key(&v, |w| w.0).ok()?;
    Some(wishes[at].1)
}

/// Half of the way each along the direction in which two triangles face each other; of each vertex the longest, by vertex.
/// The direction is the difference of the two outward normals: through a gap, one wall's outside is where the other
/// wall should be. Corners that are on their own side of the middle plane already, with the room to spare, have no
/// wish.
fn wishes_apart(mesh: &EditableMesh, pairs: &[Pair], room: f64) -> Vec<Wish> {
    let mut wishes: Vec<Wish> = Vec::new();
    for pair in pairs {
        let [s, t] = pair.map(|t| t.map(|v| mesh.x[v as usize]));
        let Some(axis) = (normal(s) - normal(t)).try_normalize(1e-12) else {
            continue;
        };
        let along = |p: [Point3; 3]| p.map(|p| axis.dot(&p.coords));
        let (low, high) = (along(s), along(t));
        let top = low.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let bottom = high.into_iter().fold(f64::INFINITY, f64::min);
        let middle = 0.5 * (top + bottom);
        let down = low.map(|at| (middle - room - at).min(0.0));
        let up = high.map(|at| (middle + room - at).max(0.0));
        for (corners, ways) in pair.iter().zip([down, up]) {
            let of = corners.iter().zip(ways);
            wishes.extend(of.map(|(&v, way)| (v, axis * way)));
        }
    }
    wishes.sort_by(|a, b| {
        let longer = b.1.norm_squared().total_cmp(&a.1.norm_squared());
        a.0.cmp(&b.0).then(longer)
    });
    wishes.dedup_by_key(|w| w.0);
    wishes.retain(|w| w.1 != Vector3::zeros());
    wishes
}

/// To the mean of the neighbours on the boundary, by vertex.
/// A fold around a vertex has no two sides. The mean of the neighbours, each counted once per face, flattens it.
fn wishes_for_fairness(mesh: &EditableMesh, pairs: &[Pair]) -> Vec<Wish> {
    let mut corners: Vec<u32> = pairs.as_flattened().as_flattened().to_vec();
    corners.sort_unstable();
    corners.dedup();
    let mut sums = vec![(Vector3::zeros(), 0.0); corners.len()];
    for face in mesh.boundary_faces() {
        for (i, v) in face.into_iter().enumerate() {
            let Ok(at) = corners.binary_search(&v) else {
                continue;
            };
            for u in [face[(i + 1) % 3], face[(i + 2) % 3]] {
                sums[at].0 += mesh.x[u as usize] - mesh.x[v as usize];
                sums[at].1 += 1.0;
            }
        }
    }
    let mean = |(sum, count): (Vector3, f64)| sum / f64::max(count, 1.0);
    corners
        .into_iter()
        .zip(sums.into_iter().map(mean))
        .collect()
}

/// Outwards: boundary faces are oriented so.
fn normal([a, b, c]: [Point3; 3]) -> Vector3 {
    let normal = (b - a).cross(&(c - a));
    normal.try_normalize(0.0).unwrap_or_default()
}
