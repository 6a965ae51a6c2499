//! An operation together with the smoothing that it needs: judged on a copy of the neighbourhood.

use geom_core::mesh::FACES;
use geom_core::{Point3, Vector3};

use crate::boundary::field::{Isosurface, Tangent};
use crate::measure::metrics::quality;
use crate::mesh::editable::{Freedom, Work};
use crate::mesh::proposal::{NEW, Proposal};
use crate::smoothing::search::{Compass, search};
use crate::smoothing::smooth::{SurfaceRules, axes_of, slide_from};
use crate::smoothing::star::Ring;

/// How much work an operation with its smoothing is worth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Effort {
    /// How many operations per tetrahedron are tried with smoothing.
    pub(crate) tries: usize,
    /// Most vertices that are smoothed around an operation.
    movable: usize,
    /// Sweeps over them.
    sweeps: usize,
    /// Rounds of the search per vertex and sweep.
    rounds: u32,
    /// Are the neighbours of the cavity smoothed too?
    wide: bool,
}

impl Effort {
    /// For many.
    pub(crate) const USUAL: Self = Self {
        tries: 6,
        movable: 11,
        sweeps: 2,
        rounds: 4,
        wide: false,
    };
    /// For the few that are left when everything else has failed.
    pub(crate) const LAST: Self = Self {
        tries: 24,
        movable: 40,
        sweeps: 4,
        rounds: 7,
        wide: true,
    };
}

/// By how much the worst tetrahedron must get better, relatively.
const RISE: f64 = 1.02;

/// The tetrahedra around the corners of a cavity, after the operation.
struct Patch {
    /// The tetrahedra before.
    around: Vec<u32>,
    ids: Vec<u32>,
    x: Vec<Point3>,
    /// The isosurface where it has been asked for.
    tangents: Vec<Tangent>,
    /// Corners as places in `ids`.
    tets: Vec<[usize; 4]>,
}

impl Patch {
    fn place(&self, v: u32) -> usize {
        self.ids.binary_search(&v).expect("a corner of the patch")
    }

    fn corners(&self, tet: [usize; 4]) -> [Point3; 4] {
        let [a, b, c, d] = tet;
        [self.x[a], self.x[b], self.x[c], self.x[d]]
    }

    fn tangent(&mut self, work: &Work, i: usize, field: &Isosurface<'_>) -> Tangent {
        if self.tangents[i].at != self.x[i] {
            let v = self.ids[i];
            self.tangents[i] = if v != NEW && work.x[v as usize] == self.x[i] {
                work.tangent(v, field)
            } else {
                field.tangent(&self.x[i])
            };
        }
        self.tangents[i]
    }

    /// The tetrahedra around `core` after the proposal, and the objectives of those before it.
    fn new(work: &Work, proposal: &Proposal, core: &[u32]) -> (Self, Vec<f64>) {
        let mut around: Vec<u32> = core
            .iter()
            .filter(|&&v| v != NEW)
            .flat_map(|&v| work.rings.of(v).iter().copied())
            .chain(proposal.remove.iter().copied())
            .collect();
        around.sort_unstable();
        around.dedup();
        let before = around.iter().map(|&t| work.q[t as usize]).collect();
        let tets: Vec<[u32; 4]> = around
            .iter()
            .filter(|t| !proposal.remove.contains(t))
            .map(|&t| work.tets[t as usize])
            .chain(proposal.insert.iter().map(|i| i.0))
            .collect();
        let mut ids: Vec<u32> = tets.iter().flatten().copied().collect();
        ids.sort_unstable();
        ids.dedup();
        let start = |v: u32| match proposal.moves.iter().find(|m| m.0 == v) {
            Some(m) => m.1,
            None => work.x[v as usize],
        };
        let mut patch = Self {
            x: ids
                .iter()
                .map(|&v| match (v, proposal.vertex) {
                    (NEW, Some((x, ..))) => x,
                    _ => start(v),
                })
                .collect(),
            tangents: vec![Tangent::UNKNOWN; ids.len()],
            tets: Vec::new(),
            ids,
            around,
        };
        patch.tets = tets.iter().map(|t| t.map(|v| patch.place(v))).collect();
        (patch, before)
    }

    /// Moves the worst of `core` to where the tetrahedra are best.
    fn smooth(
        &mut self,
        work: &Work,
        proposal: &Proposal,
        core: &[u32],
        surface: Option<&SurfaceRules<'_>>,
        effort: &Effort,
        ring: &mut Ring,
    ) {
        // The worst first: they need it most.
        let mut movable: Vec<(f64, usize)> = core
            .iter()
            .map(|&v| {
                let i = self.place(v);
                self.load(i, ring);
                (ring.value(&self.x[i].coords), i)
            })
            .collect();
        movable.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        movable.truncate(effort.movable);
        for _ in 0..effort.sweeps {
            for &(_, i) in &movable {
                let freedom = match (self.ids[i], proposal.vertex) {
                    (NEW, Some((_, _, freedom))) => freedom,
                    (v, _) => work.freedom[v as usize],
                };
                self.load(i, ring);
                let start = self.x[i];
                match (freedom, surface) {
                    (Freedom::Field, Some(rules)) => {
                        let start = self.tangent(work, i, rules.field);
                        let id = self.ids[i];
                        let may = |x: Point3| id == NEW || work.gap_bears_move(id, x);
                        if let Some(tangent) = slide_from(start, None, ring, rules, may) {
                            self.x[i] = tangent.at;
                            self.tangents[i] = tangent;
                        }
                    }
                    _ => {
                        if let Some(axes) = axes_of(freedom, None) {
                            let compass = Compass::along(&axes);
                            self.x[i] =
                                Point3::from(search(ring, start.coords, &compass, effort.rounds));
                        }
                    }
                }
            }
        }
    }

    /// The proposal with all moves.
    fn finish(&self, work: &Work, proposal: &Proposal, gain: f64) -> Proposal {
        let moved = |i: &usize| {
            self.ids[*i] != NEW && {
                let d: Vector3 = self.x[*i] - work.x[self.ids[*i] as usize];
                d != Vector3::zeros()
            }
        };
        Proposal {
            operation: proposal.operation,
            gain,
            remove: proposal.remove.clone(),
            insert: proposal.insert.clone(),
            vertex: proposal
                .vertex
                .map(|(_, kind, freedom)| (self.x[self.place(NEW)], kind, freedom)),
            moves: (0..self.ids.len())
                .filter(moved)
                .map(|i| (self.ids[i], self.x[i]))
                .collect(),
            locks: self.around.clone(),
            edge: proposal.edge,
        }
    }

    fn load(&self, i: usize, ring: &mut Ring) {
        ring.clear();
        for tet in &self.tets {
            if let Some(k) = tet.iter().position(|&j| j == i) {
                let [a, b, c] = FACES[k];
                ring.push([self.x[tet[a]], self.x[tet[b]], self.x[tet[c]]]);
            }
        }
    }
}

/// How much is missing to `goal`: what must shrink, so that one bad element is not traded for many.
fn lack(qualities: impl Iterator<Item = f64>, goal: f64) -> (f64, f64) {
    qualities.fold((f64::INFINITY, 0.0), |(worst, sum), q| {
        let d = (goal - q).max(0.0);
        (worst.min(q), sum + d * d)
    })
}

/// The proposal followed by smoothing around it, if the worst tetrahedron of the neighbourhood gets
/// better and less is missing to `goal`.
pub(crate) fn climb(
    work: &Work,
    proposal: &Proposal,
    surface: Option<&SurfaceRules<'_>>,
    goal: f64,
    effort: &Effort,
    ring: &mut Ring,
) -> Option<Proposal> {
    let mut core: Vec<u32> = proposal.insert.iter().flat_map(|i| i.0).collect();
    if effort.wide {
        for v in core.clone().into_iter().filter(|&v| v != NEW) {
            let around = work.rings.of(v).iter();
            core.extend(around.flat_map(|&t| work.tets[t as usize]));
        }
        // A vertex that is contracted away is no more.
        let gone = proposal.edge.map(|e| e.0);
        core.retain(|&v| Some(v) != gone);
    }
    core.sort_unstable();
    core.dedup();
    let (mut patch, before) = Patch::new(work, proposal, &core);
    let (old, lacked) = lack(before.into_iter(), goal);
    patch.smooth(work, proposal, &core, surface, effort, ring);
    let after = patch.tets.iter().map(|&t| quality(patch.corners(t)));
    let (worst, lacks) = lack(after, goal);
    if worst <= RISE * old || worst <= 0.0 || lacks >= lacked {
        return None;
    }
    Some(patch.finish(work, proposal, worst - old))
}

/// The vertex `v` moved to `foot`, followed by smoothing around it, if every tetrahedron then is
/// `good` or none is worse than the worst one was.
pub(crate) fn push(
    work: &Work,
    v: u32,
    foot: Point3,
    surface: &SurfaceRules<'_>,
    good: impl Fn([Point3; 4]) -> bool,
    ring: &mut Ring,
) -> Option<Proposal> {
    let mut core: Vec<u32> = work
        .rings
        .of(v)
        .iter()
        .flat_map(|&t| work.tets[t as usize])
        .collect();
    core.sort_unstable();
    core.dedup();
    let proposal = Proposal::push(v, foot);
    let (mut patch, before) = Patch::new(work, &proposal, &core);
    let old = before.into_iter().fold(f64::INFINITY, f64::min);
    patch.smooth(work, &proposal, &core, Some(surface), &Effort::USUAL, ring);
    let fine = patch.tets.iter().all(|&t| {
        let corners = patch.corners(t);
        quality(corners) >= old || good(corners)
    });
    let stays = patch.x[patch.place(v)] != work.x[v as usize];
    (fine && stays).then(|| patch.finish(work, &proposal, 0.0))
}
