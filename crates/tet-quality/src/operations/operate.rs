//! Which operation replaces a tetrahedron, and rounds of operations that do not meet.
//!
//! A round has three parts. Bad tetrahedra that stand far enough apart are picked, worst first. They are judged side by
//! side on the mesh as it is; each gives at most one proposal. The proposals are made one after the other, the greatest
//! gain first, if what they looked at is still there. What was judged in vain is remembered until something near it
//! changes.

use geom_core::compute::parallel;
use geom_core::mesh::EDGES;

use crate::boundary::field::Isosurface;
use crate::boundary::guard::GuardedMesh;
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::proposal::{Floor, Operation, Proposal};
use crate::operations::contract::contraction;
use crate::operations::insert::edge_split;
use crate::operations::patch::{PatchSettings, hill_climb};
use crate::operations::swap::{edge_removal, face_swap, surface_flip};
use crate::options::Operations;
use crate::outcome::Pass;
use crate::smoothing::smooth::SurfaceRules;
use crate::smoothing::star::Star;

/// Distance of the middle of a flipped surface edge from the isosurface, in spacings.
/// The middle is where a chord is farthest from a curve.
const FLIP: f64 = 0.1;
/// Distance of the middle of the surface triangles of a contraction from the isosurface, in spacings.
const CONTRACTION: f64 = 0.15;
/// Objective that an operation must leave before the smoothing that follows it.
/// Barely positive: the search then starts from a valid mesh.
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
/// Stamps instead of flags: nothing has to be cleared between rounds.
#[derive(Default)]
pub(crate) struct Memory {
    tried: Vec<u32>,
    /// Per tetrahedron: the stamp of the round that removed it or used it.
    removed: Vec<u32>,
    /// Per vertex: the stamp of the round that reserved it.
    reserved: Vec<u32>,
    stamp: u32,
}

impl Memory {
    /// Makes room for what is new, and starts a new stamp.
    fn fit(&mut self, mesh: &EditableMesh) {
        self.tried.resize(mesh.tets.len(), 0);
        self.reserved.resize(mesh.x.len(), 0);
        self.stamp += 1;
    }

    /// Those of `bad` that stand alone: each reserves its corners, or their neighbours too, so that few
    /// of the changes judged side by side meet.
    fn alone(&mut self, mesh: &EditableMesh, bad: &[u32], reserve: Reserve) -> Vec<u32> {
        let stamp = self.stamp;
        let reserved = &mut self.reserved;
        let mut out = Vec::new();
        for &t in bad {
            let tet = mesh.tets[t as usize];
            if tet.iter().any(|&v| reserved[v as usize] == stamp) {
                continue;
            }
            for v in tet {
                reserved[v as usize] = stamp;
                if reserve == Reserve::Neighbours {
                    for &o in mesh.incidence.of(v) {
                        for u in mesh.tets[o as usize] {
                            reserved[u as usize] = stamp;
                        }
                    }
                }
            }
            out.push(t);
        }
        out
    }
}

/// What a tetrahedron that is judged keeps from others that are judged at the same time.
/// Too much reserves too few per round, too little lets proposals be refused that were dear to find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reserve {
    /// Its corners.
    Corners,
    /// Its corners and all around them: changes with smoothing reach that far.
    Neighbours,
}

/// How rounds of operations go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rounds {
    /// Tetrahedra below this objective are worked on.
    pub(crate) bound: f64,
    /// Most rounds.
    pub(crate) most: u32,
    pub(crate) reserve: Reserve,
}

/// Rounds on the tetrahedra below the bound: those that stand alone are judged side by side, worst
/// first, and the changes that do not meet are made, until all have been tried.
/// Each round sees what the one before has made. It ends when nothing below the bound is left that was not tried in
/// vain.
pub(crate) fn rounds(
    guarded: &mut GuardedMesh,
    memory: &mut Memory,
    rounds: Rounds,
    judge: impl Fn(&GuardedMesh, u32, &mut Star) -> Option<Proposal> + Sync,
    done: &mut Pass,
) {
    for _ in 0..rounds.most {
        let mesh = &mut guarded.mesh;
        memory.fit(mesh);
        let now = mesh.tick();
        // Slots are filled anew at a time when their corners changed, so their old entry does not count.
        let tried = &memory.tried;
        let untried = |t| mesh.changed_since(t, tried[t as usize]);
        let bad = mesh.below_and(rounds.bound, untried);
        let mut alone = memory.alone(mesh, &bad, rounds.reserve);
        if alone.is_empty() {
            break;
        }
        // Neighbours in memory are neighbours in space: what one has read the next one finds near by.
        alone.sort_unstable();
        let state = &*guarded;
        let judged: Vec<Option<Proposal>> =
            parallel::map_each_init(&alone, Star::default, |star, &t| judge(state, t, star));
        let mut proposals = Vec::new();
        for (&t, proposal) in alone.iter().zip(judged) {
            match proposal {
                Some(proposal) => proposals.push((t, proposal)),
                None => memory.tried[t as usize] = now,
            }
        }
        carry_out(guarded, memory, proposals, done);
    }
}

/// One round on the given vertices: those whose projections do not meet go to the isosurface.
pub(crate) fn round_of_projections(
    guarded: &mut GuardedMesh,
    memory: &mut Memory,
    vertices: &[u32],
    judge: impl Fn(&GuardedMesh, u32, &mut Star) -> Option<Proposal> + Sync,
    done: &mut Pass,
) {
    memory.fit(&guarded.mesh);
    let state = &*guarded;
    let judged: Vec<Option<Proposal>> =
        parallel::map_each_init(vertices, Star::default, |star, &v| judge(state, v, star));
    let judged = vertices.iter().zip(judged);
    let proposals: Vec<(u32, Proposal)> = judged.filter_map(|(&v, p)| Some((v, p?))).collect();
    carry_out(guarded, memory, proposals, done);
}

/// Makes the changes that do not meet, and counts them.
fn carry_out(
    guarded: &mut GuardedMesh,
    memory: &mut Memory,
    proposals: Vec<(u32, Proposal)>,
    done: &mut Pass,
) {
    guarded.mesh.tick();
    for operation in apply_all(guarded, proposals, &mut memory.removed, memory.stamp) {
        *match operation {
            Operation::EdgeRemoval => &mut done.edges_removed,
            Operation::FaceSwap => &mut done.faces_swapped,
            Operation::SurfaceFlip => &mut done.surface_flips,
            Operation::Contraction => &mut done.contracted,
            Operation::Insertion => &mut done.inserted,
            Operation::Projection => &mut done.projected,
        } += 1;
    }
}

/// Makes the changes that lock no common tetrahedron and still fit, greatest gain first, in steps of
/// 2⁻²⁰ so that equal ones go by their number. `removed` shows, by `stamp`, which tetrahedra are gone.
/// Gives the operations that were made.
///
/// Quantized gains keep the order from depending on last bits. A proposal locks what it has looked at, so that none is
/// made on a neighbourhood that is no longer the one it was judged on.
pub(crate) fn apply_all(
    guarded: &mut GuardedMesh,
    mut proposals: Vec<(u32, Proposal)>,
    removed: &mut Vec<u32>,
    stamp: u32,
) -> Vec<Operation> {
    let steps = |gain: f64| (gain * f64::from(1u32 << 20)) as i64;
    proposals.sort_by(|a, b| steps(b.1.gain).cmp(&steps(a.1.gain)).then(a.0.cmp(&b.0)));
    let mut made = Vec::new();
    for (_, proposal) in proposals {
        removed.resize(guarded.mesh.tets.len(), 0);
        if proposal.locks.iter().any(|&t| removed[t as usize] == stamp)
            || !proposal.fits(&guarded.mesh)
            || !guarded.allows(&proposal)
        {
            continue;
        }
        for &t in &proposal.locks {
            removed[t as usize] = stamp;
        }
        guarded.apply(&proposal);
        made.push(proposal.operation);
    }
    made
}

/// The operation that replaces `t` with the greatest gain.
/// Six edges, four faces and, if nothing else helps, twelve contractions are tried.
pub(crate) fn best_for(
    guarded: &GuardedMesh,
    t: u32,
    rules: &Rules<'_>,
    star: &mut Star,
) -> Option<Proposal> {
    let mut best: Option<Proposal> = None;
    offers(&guarded.mesh, t, rules, Floor::Old, star, |p| {
        if best.as_ref().is_none_or(|b| p.gain > b.gain) && guarded.allows(&p) {
            best = Some(p);
        }
    });
    best
}

/// The operation that replaces `t` best after smoothing: see [`hill_climb`].
/// The first that holds, not the best of all: they are tried in the order of what they give without smoothing.
pub(crate) fn best_hill_climb(
    guarded: &GuardedMesh,
    t: u32,
    rules: &Rules<'_>,
    surface: Option<&SurfaceRules<'_>>,
    goal: f64,
    settings: &PatchSettings,
    star: &mut Star,
) -> Option<Proposal> {
    let mut tries = Vec::new();
    let floor = Floor::Fixed(VALID);
    offers(&guarded.mesh, t, rules, floor, star, |p| tries.push(p));
    tries.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    tries.iter().take(settings.tries).find_map(|p| {
        hill_climb(guarded, p, surface, goal, settings, star).filter(|p| guarded.allows(p))
    })
}

/// All operations that replace `t` and leave what is above `floor`.
fn offers(
    mesh: &EditableMesh,
    t: u32,
    rules: &Rules<'_>,
    floor: Floor,
    star: &mut Star,
    mut offer: impl FnMut(Proposal),
) {
    let offered = std::cell::Cell::new(false);
    let mut offer = |p: Proposal| {
        offered.set(true);
        offer(p);
    };
    let tet = mesh.tets[t as usize];
    let allow = rules.allow;
    for [i, j] in EDGES {
        let (a, b) = (tet[i], tet[j]);
        if allow.swap {
            edge_removal(mesh, a, b, floor)
                .into_iter()
                .for_each(&mut offer);
        }
        let both = [a, b]
            .iter()
            .all(|&v| mesh.freedom[v as usize] != Freedom::Free);
        if allow.flip && both {
            let reach = FLIP * rules.spacing;
            surface_flip(mesh, a, b, rules.field, reach, floor)
                .into_iter()
                .for_each(&mut offer);
        }
        // A new vertex is worth it only where smoothing follows.
        if allow.insert && floor != Floor::Old {
            edge_split(mesh, a, b, rules.field, floor, star)
                .into_iter()
                .for_each(&mut offer);
        }
    }
    if allow.swap {
        for k in 0..4 {
            face_swap(mesh, t, k, floor)
                .into_iter()
                .for_each(&mut offer);
        }
    }
    // A contraction coarsens the mesh: only where nothing else helps, or smoothing follows.
    if allow.contract && rules.contract && (floor != Floor::Old || !offered.get()) {
        let reach = CONTRACTION * rules.spacing;
        for i in 0..4 {
            for j in (0..4).filter(|&j| j != i) {
                contraction(mesh, tet[i], tet[j], rules.field, reach, floor)
                    .into_iter()
                    .for_each(&mut offer);
            }
        }
    }
}
