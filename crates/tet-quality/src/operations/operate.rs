//! Which operation replaces a tetrahedron, and rounds of operations that do not meet.

use geom_core::mesh::EDGES;
use rayon::prelude::*;

use crate::boundary::field::Isosurface;
use crate::mesh::editable::{Freedom, Work};
use crate::mesh::proposal::{Floor, Operation, Proposal, apply_all};
use crate::operations::contract::contraction;
use crate::operations::insert::edge_split;
use crate::operations::patch::{Effort, climb};
use crate::operations::swap::{edge_removal, face_swap, surface_flip};
use crate::smoothing::smooth::SurfaceRules;
use crate::smoothing::star::Ring;
use crate::{Operations, Pass};

/// Distance of the middle of a flipped surface edge from the isosurface, in spacings.
const FLIP: f64 = 0.1;
/// Distance of the middle of the surface triangles of a contraction from the isosurface, in spacings.
const CONTRACTION: f64 = 0.15;
/// Objective that an operation must leave before the smoothing that follows it.
const VALID: f64 = 1e-3;

/// What operations may do.
#[derive(Clone, Copy)]
pub(crate) struct Rules<'a> {
    pub(crate) allow: Operations,
    /// Are contractions due?
    pub(crate) contract: bool,
    pub(crate) field: Option<&'a Isosurface<'a>>,
    pub(crate) spacing: f64,
}

/// When each tetrahedron was last tried in vain.
#[derive(Default)]
pub(crate) struct Memory {
    tried: Vec<u32>,
    /// Per tetrahedron and per vertex: the stamp of the round that changed or claimed it.
    gone: Vec<u32>,
    claimed: Vec<u32>,
    stamp: u32,
}

impl Memory {
    fn fit(&mut self, work: &Work) {
        self.tried.resize(work.tets.len(), 0);
        self.claimed.resize(work.x.len(), 0);
        self.stamp += 1;
    }

    /// Those of `bad` that stand alone: each claims its corners, or, with `wide`, their neighbours
    /// too, so that few of the changes judged side by side meet.
    fn alone(&mut self, work: &Work, bad: &[u32], wide: bool) -> Vec<u32> {
        let stamp = self.stamp;
        let claimed = &mut self.claimed;
        let mut out = Vec::new();
        for &t in bad {
            let tet = work.tets[t as usize];
            if tet.iter().any(|&v| claimed[v as usize] == stamp) {
                continue;
            }
            for v in tet {
                claimed[v as usize] = stamp;
                if wide {
                    for &o in work.rings.of(v) {
                        for u in work.tets[o as usize] {
                            claimed[u as usize] = stamp;
                        }
                    }
                }
            }
            out.push(t);
        }
        out
    }
}

/// Rounds on the tetrahedra below `bound`, at most so many: those that stand alone are judged side by
/// side, worst first, and the changes that do not meet are made, until all have been tried.
pub(crate) fn rounds(
    work: &mut Work,
    memory: &mut Memory,
    (bound, most, wide): (f64, u32, bool),
    judge: impl Fn(&Work, u32, &mut Ring) -> Option<Proposal> + Sync,
    done: &mut Pass,
) {
    for _ in 0..most {
        memory.fit(work);
        let now = work.tick();
        // Slots are filled anew at a time when their corners changed, so their old entry does not count.
        let (state, tried) = (&*work, &memory.tried);
        let bad = state.below_and(bound, |t| state.changed_since(t, tried[t as usize]));
        let mut alone = memory.alone(work, &bad, wide);
        if alone.is_empty() {
            break;
        }
        // Neighbours in memory are neighbours in space: what one has read the next one finds near by.
        alone.sort_unstable();
        let state = &*work;
        let judged: Vec<Option<Proposal>> = alone
            .par_iter()
            .with_min_len(4)
            .map_init(Ring::default, |ring, &t| judge(state, t, ring))
            .collect();
        let mut proposals = Vec::new();
        for (&t, proposal) in alone.iter().zip(judged) {
            match proposal {
                Some(proposal) => proposals.push((t, proposal)),
                None => memory.tried[t as usize] = now,
            }
        }
        carry_out(work, memory, proposals, done);
    }
}

/// One round on the given vertices: those whose pushes do not meet go to the isosurface.
pub(crate) fn round_of_pushes(
    work: &mut Work,
    memory: &mut Memory,
    vertices: &[u32],
    judge: impl Fn(&Work, u32, &mut Ring) -> Option<Proposal> + Sync,
    done: &mut Pass,
) {
    memory.fit(work);
    let state = &*work;
    let proposals: Vec<(u32, Proposal)> = vertices
        .par_iter()
        .with_min_len(4)
        .map_init(Ring::default, |ring, &v| Some((v, judge(state, v, ring)?)))
        .flatten()
        .collect();
    carry_out(work, memory, proposals, done);
}

fn carry_out(
    work: &mut Work,
    memory: &mut Memory,
    proposals: Vec<(u32, Proposal)>,
    done: &mut Pass,
) {
    work.tick();
    for proposal in apply_all(work, proposals, &mut memory.gone, memory.stamp) {
        *match proposal.operation {
            Operation::EdgeRemoval => &mut done.edges_removed,
            Operation::FaceSwap => &mut done.faces_swapped,
            Operation::SurfaceFlip => &mut done.surface_flips,
            Operation::Contraction => &mut done.contracted,
            Operation::Insertion => &mut done.inserted,
            Operation::Push => &mut done.projected,
        } += 1;
    }
}

/// The operation that replaces `t` with the greatest gain.
pub(crate) fn best_for(
    work: &Work,
    t: u32,
    rules: &Rules<'_>,
    ring: &mut Ring,
) -> Option<Proposal> {
    let mut best: Option<Proposal> = None;
    offers(work, t, rules, Floor::Old, ring, |p| {
        if best.as_ref().is_none_or(|b| p.gain > b.gain) && work.walls_bear(&p) {
            best = Some(p);
        }
    });
    best
}

/// The operation that replaces `t` best after smoothing: see [`climb`].
pub(crate) fn best_climb(
    work: &Work,
    t: u32,
    rules: &Rules<'_>,
    surface: Option<&SurfaceRules<'_>>,
    goal: f64,
    effort: &Effort,
    ring: &mut Ring,
) -> Option<Proposal> {
    let mut tries = Vec::new();
    offers(work, t, rules, Floor::Fixed(VALID), ring, |p| tries.push(p));
    tries.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    tries
        .iter()
        .take(effort.tries)
        .find_map(|p| climb(work, p, surface, goal, effort, ring).filter(|p| work.walls_bear(p)))
}

/// All operations that replace `t` and leave what is above `floor`.
fn offers(
    work: &Work,
    t: u32,
    rules: &Rules<'_>,
    floor: Floor,
    ring: &mut Ring,
    mut offer: impl FnMut(Proposal),
) {
    let offered = std::cell::Cell::new(false);
    let mut offer = |p: Proposal| {
        offered.set(true);
        offer(p);
    };
    let tet = work.tets[t as usize];
    let allow = rules.allow;
    for [i, j] in EDGES {
        let (a, b) = (tet[i], tet[j]);
        if allow.swap {
            edge_removal(work, a, b, floor)
                .into_iter()
                .for_each(&mut offer);
        }
        let both = [a, b]
            .iter()
            .all(|&v| work.freedom[v as usize] != Freedom::Free);
        if allow.flip && both {
            let reach = FLIP * rules.spacing;
            surface_flip(work, a, b, rules.field, reach, floor)
                .into_iter()
                .for_each(&mut offer);
        }
        // A new vertex is worth it only where smoothing follows.
        if allow.insert && floor != Floor::Old {
            edge_split(work, a, b, rules.field, floor, ring)
                .into_iter()
                .for_each(&mut offer);
        }
    }
    if allow.swap {
        for k in 0..4 {
            face_swap(work, t, k, floor)
                .into_iter()
                .for_each(&mut offer);
        }
    }
    // A contraction coarsens the mesh: only where nothing else helps, or smoothing follows.
    if allow.contract && rules.contract && (floor != Floor::Old || !offered.get()) {
        let reach = CONTRACTION * rules.spacing;
        for i in 0..4 {
            for j in (0..4).filter(|&j| j != i) {
                contraction(work, tet[i], tet[j], rules.field, reach, floor)
                    .into_iter()
                    .for_each(&mut offer);
            }
        }
    }
}
