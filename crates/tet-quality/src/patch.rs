//! An operation together with the smoothing that it needs: judged on a copy of the neighbourhood.

use geom_core::{Point3, Vector3};

use crate::metrics::quality;
use crate::proposal::{NEW, Proposal};
use crate::ring::Ring;
use crate::search::{Compass, search};
use crate::smooth::{SurfaceRules, axes_of, slide_from};
use crate::work::{Freedom, Work};

/// Most vertices that are smoothed around an operation.
const MOVABLE: usize = 11;
/// Sweeps over them.
const SWEEPS: usize = 2;
/// Rounds of the search per vertex and sweep.
const ROUNDS: u32 = 4;
/// By how much the worst tetrahedron must get better, relatively.
const RISE: f64 = 1.02;

/// The tetrahedra around the corners of a cavity, after the operation.
struct Patch {
    ids: Vec<u32>,
    x: Vec<Point3>,
    /// Corners as places in `ids`.
    tets: Vec<[usize; 4]>,
}

impl Patch {
    fn place(&self, v: u32) -> usize {
        self.ids.binary_search(&v).expect("a corner of the patch")
    }

    fn corners(&self, tet: [usize; 4]) -> [Point3; 4] {
        tet.map(|i| self.x[i])
    }

    fn load(&self, i: usize, ring: &mut Ring) {
        ring.clear();
        for tet in &self.tets {
            if let Some(k) = tet.iter().position(|&j| j == i) {
                ring.push(geom_core::mesh::FACES[k].map(|c| self.x[tet[c]]));
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
    ring: &mut Ring,
) -> Option<Proposal> {
    let mut core: Vec<u32> = proposal.insert.iter().flat_map(|i| i.0).collect();
    core.sort_unstable();
    core.dedup();
    let mut around: Vec<u32> = core
        .iter()
        .filter(|&&v| v != NEW)
        .flat_map(|&v| work.rings.of(v).iter().copied())
        .collect();
    around.sort_unstable();
    around.dedup();
    let (old, lacked) = lack(
        around
            .iter()
            .chain(&proposal.remove)
            .map(|&t| work.q[t as usize]),
        goal,
    );
    let kept = around.iter().filter(|t| !proposal.remove.contains(t));
    let tets: Vec<[u32; 4]> = kept
        .map(|&t| work.tets[t as usize])
        .chain(proposal.insert.iter().map(|i| i.0))
        .collect();
    let mut ids: Vec<u32> = tets.iter().flatten().copied().collect();
    ids.sort_unstable();
    ids.dedup();
    let mut patch = Patch {
        x: ids
            .iter()
            .map(|&v| match (v, proposal.vertex) {
                (NEW, Some((x, ..))) => x,
                _ => work.x[v as usize],
            })
            .collect(),
        tets: Vec::new(),
        ids,
    };
    patch.tets = tets.iter().map(|t| t.map(|v| patch.place(v))).collect();
    // The worst first: they need it most.
    let mut movable: Vec<(f64, usize)> = core
        .iter()
        .map(|&v| {
            let i = patch.place(v);
            patch.load(i, ring);
            (ring.value(&patch.x[i].coords), i)
        })
        .collect();
    movable.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    movable.truncate(MOVABLE);
    for _ in 0..SWEEPS {
        for &(_, i) in &movable {
            let freedom = match (patch.ids[i], proposal.vertex) {
                (NEW, Some((_, _, freedom))) => freedom,
                (v, _) => work.freedom[v as usize],
            };
            patch.load(i, ring);
            let start = patch.x[i];
            match (freedom, surface) {
                (Freedom::Field, Some(rules)) => {
                    if let Some(x) = slide_from(start, None, ring, rules) {
                        patch.x[i] = x;
                    }
                }
                _ => {
                    if let Some(axes) = axes_of(freedom, None) {
                        let compass = Compass::along(&axes);
                        patch.x[i] = Point3::from(search(ring, start.coords, &compass, ROUNDS));
                    }
                }
            }
        }
    }
    let after = patch.tets.iter().map(|&t| quality(patch.corners(t)));
    let (worst, lacks) = lack(after, goal);
    if worst <= RISE * old || worst <= 0.0 || lacks >= lacked {
        return None;
    }
    let moved = |i: &usize| {
        patch.ids[*i] != NEW && {
            let d: Vector3 = patch.x[*i] - work.x[patch.ids[*i] as usize];
            d != Vector3::zeros()
        }
    };
    let mut locks: Vec<u32> = proposal.locks.clone();
    locks.extend(patch.ids.iter().filter(|&&v| v != NEW));
    locks.sort_unstable();
    locks.dedup();
    Some(Proposal {
        operation: proposal.operation,
        gain: worst - old,
        remove: proposal.remove.clone(),
        insert: proposal.insert.clone(),
        vertex: proposal
            .vertex
            .map(|(_, kind, freedom)| (patch.x[patch.place(NEW)], kind, freedom)),
        moves: (0..patch.ids.len())
            .filter(moved)
            .map(|i| (patch.ids[i], patch.x[i]))
            .collect(),
        locks,
    })
}
