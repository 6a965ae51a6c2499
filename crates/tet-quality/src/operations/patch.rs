//! An operation together with the smoothing that it needs: judged on a copy of the neighbourhood.
//!
//! Smoothing gets stuck where the connections are wrong, operations where the vertices stand wrong for the new connections. So
//! an operation that makes the worst tetrahedron worse may still be the right one, once its vertices have moved. It is tried on a
//! small copy: the cavity with what it is replaced by, and the tetrahedra around its corners. The corners move there, worst
//! first, and only if the worst tetrahedron of all is better than before is any of it done in the mesh.

use geom_core::field::Tangent;
use geom_core::mesh::FACES;
use geom_core::{Point3, Vector3};

use crate::boundary::field::{Isosurface, UNKNOWN};
use crate::boundary::guard::GuardedMesh;
use crate::measure::metrics::quality;
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::proposal::{NEW, NewVertex, Proposal, VertexMove};
use crate::smoothing::search::{Compass, search};
use crate::smoothing::smooth::{SurfaceRules, axes_of, slide_from};
use crate::smoothing::star::Star;

/// How long the search around an operation is: what one with its smoothing is worth.
/// The last search costs some fifty times the usual one, and is for a hundred tetrahedra at most.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PatchSettings {
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

impl PatchSettings {
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
/// Sorted by number, so that slots are found by bisection; [`NEW`] comes last.
struct Patch {
    /// The tetrahedra before.
    around: Vec<u32>,
    /// What they fall short of the goal.
    before: Shortfall,
    ids: Vec<u32>,
    x: Vec<Point3>,
    /// The isosurface where it has been asked for.
    tangents: Vec<Tangent>,
    /// Corners as slots in `ids`.
    tets: Vec<[usize; 4]>,
}

impl Patch {
    /// The slot of a vertex in the patch.
    fn slot(&self, v: u32) -> usize {
        self.ids.binary_search(&v).expect("a corner of the patch")
    }

    fn corners(&self, tet: [usize; 4]) -> [Point3; 4] {
        let [a, b, c, d] = tet;
        [self.x[a], self.x[b], self.x[c], self.x[d]]
    }

    /// The isosurface at a slot: what the patch knows, what the mesh knows, or the field.
    fn tangent(&mut self, mesh: &EditableMesh, i: usize, field: &Isosurface<'_>) -> Tangent {
        if self.tangents[i].at != self.x[i] {
            let v = self.ids[i];
            self.tangents[i] = if v != NEW && mesh.x[v as usize] == self.x[i] {
                mesh.tangent(v, field)
            } else {
                field.tangent(&self.x[i])
            };
        }
        self.tangents[i]
    }

    /// The tetrahedra around `core` after the proposal.
    fn new(mesh: &EditableMesh, proposal: &Proposal, core: &[u32], goal: f64) -> Self {
        let mut around: Vec<u32> = core
            .iter()
            .filter(|&&v| v != NEW)
            .flat_map(|&v| mesh.incidence.of(v).iter().copied())
            .chain(proposal.remove.iter().copied())
            .collect();
        around.sort_unstable();
        around.dedup();
        let before = Shortfall::of(around.iter().map(|&t| mesh.q[t as usize]), goal);
        let tets: Vec<[u32; 4]> = around
            .iter()
            .filter(|t| !proposal.remove.contains(t))
            .map(|&t| mesh.tets[t as usize])
            .chain(proposal.insert.iter().map(|new| new.corners))
            .collect();
        let mut ids: Vec<u32> = tets.iter().flatten().copied().collect();
        ids.sort_unstable();
        ids.dedup();
        let mut patch = Self {
            x: ids
                .iter()
                .map(|&v| proposal.position_after(mesh, v))
                .collect(),
            tangents: vec![UNKNOWN; ids.len()],
            tets: Vec::new(),
            ids,
            around,
            before,
        };
        patch.tets = tets.iter().map(|t| t.map(|v| patch.slot(v))).collect();
        patch
    }

    /// Moves the worst of `core` to where the tetrahedra are best.
    fn smooth(
        &mut self,
        guarded: &GuardedMesh,
        proposal: &Proposal,
        core: &[u32],
        surface: Option<&SurfaceRules<'_>>,
        settings: &PatchSettings,
        star: &mut Star,
    ) {
        // The worst first: they need it most.
        let mut movable: Vec<(f64, usize)> = core
            .iter()
            .map(|&v| {
                let i = self.slot(v);
                self.load(i, star);
                (star.value(&self.x[i].coords), i)
            })
            .collect();
        movable.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        movable.truncate(settings.movable);
        for _ in 0..settings.sweeps {
            for &(_, i) in &movable {
                let freedom = match (self.ids[i], proposal.vertex) {
                    (NEW, Some(new)) => new.freedom,
                    (v, _) => guarded.mesh.freedom[v as usize],
                };
                self.load(i, star);
                match (freedom, surface) {
                    (Freedom::Field | Freedom::Curve(_), Some(rules)) => {
                        self.slide(guarded, i, &rules.of(freedom), star);
                    }
                    _ => {
                        if let Some(axes) = axes_of(freedom, None) {
                            let (start, compass) = (self.x[i].coords, Compass::along(&axes));
                            self.x[i] =
                                Point3::from(search(star, start, &compass, settings.rounds));
                        }
                    }
                }
            }
        }
    }

    /// Moves the vertex in a slot, whose star is loaded, along the isosurface.
    fn slide(
        &mut self,
        guarded: &GuardedMesh,
        i: usize,
        rules: &SurfaceRules<'_>,
        star: &mut Star,
    ) {
        let start = self.tangent(&guarded.mesh, i, &rules.field);
        let id = self.ids[i];
        // A vertex that is not yet there is judged with the whole proposal.
        let may = |x: Point3| id == NEW || guarded.guard.allows_move(&guarded.mesh, id, x);
        if let Some(tangent) = slide_from(start, None, star, rules, may) {
            self.x[i] = tangent.at;
            self.tangents[i] = tangent;
        }
    }

    /// The proposal with all moves.
    /// Locked is all that was looked at, not only what is removed.
    fn finish(&self, mesh: &EditableMesh, proposal: &Proposal, gain: f64) -> Proposal {
        let moved = |i: &usize| {
            self.ids[*i] != NEW && {
                let d: Vector3 = self.x[*i] - mesh.x[self.ids[*i] as usize];
                d != Vector3::zeros()
            }
        };
        Proposal {
            operation: proposal.operation,
            gain,
            remove: proposal.remove.clone(),
            insert: proposal.insert.clone(),
            vertex: proposal.vertex.map(|new| NewVertex {
                position: self.x[self.slot(NEW)],
                ..new
            }),
            moves: (0..self.ids.len())
                .filter(moved)
                .map(|i| VertexMove {
                    vertex: self.ids[i],
                    to: self.x[i],
                })
                .collect(),
            locks: self.around.clone(),
            edge: proposal.edge,
        }
    }

    /// The star of a slot within the patch: all of it for vertices of the core, whose tetrahedra are all here.
    fn load(&self, i: usize, star: &mut Star) {
        star.clear();
        for tet in &self.tets {
            if let Some(k) = tet.iter().position(|&j| j == i) {
                let [a, b, c] = FACES[k];
                star.push([self.x[tet[a]], self.x[tet[b]], self.x[tet[c]]]);
            }
        }
    }
}

/// What some tetrahedra fall short of a goal.
#[derive(Clone, Copy)]
struct Shortfall {
    /// The smallest objective.
    worst: f64,
    /// Sum of the squares of what is missing: what must shrink, so that one bad element is not traded
    /// for many.
    missing: f64,
}

impl Shortfall {
    fn of(qualities: impl Iterator<Item = f64>, goal: f64) -> Self {
        let none = Self {
            worst: f64::INFINITY,
            missing: 0.0,
        };
        qualities.fold(none, |sum, q| {
            let d = (goal - q).max(0.0);
            Self {
                worst: sum.worst.min(q),
                missing: sum.missing + d * d,
            }
        })
    }
}

/// The proposal followed by smoothing around it (hill climbing over both), if the worst tetrahedron of
/// the neighbourhood gets better and less is missing to `goal`.
pub(crate) fn hill_climb(
    guarded: &GuardedMesh,
    proposal: &Proposal,
    surface: Option<&SurfaceRules<'_>>,
    goal: f64,
    settings: &PatchSettings,
    star: &mut Star,
) -> Option<Proposal> {
    let mesh = &guarded.mesh;
    let mut core: Vec<u32> = proposal.insert.iter().flat_map(|new| new.corners).collect();
    if settings.wide {
        for v in core.clone().into_iter().filter(|&v| v != NEW) {
            let around = mesh.incidence.of(v).iter();
            core.extend(around.flat_map(|&t| mesh.tets[t as usize]));
        }
        // A vertex that is contracted away is no more.
        let removed = proposal.edge.map(|e| e.from);
        core.retain(|&v| Some(v) != removed);
    }
    core.sort_unstable();
    core.dedup();
    let mut patch = Patch::new(mesh, proposal, &core, goal);
    patch.smooth(guarded, proposal, &core, surface, settings, star);
    let after = patch.tets.iter().map(|&t| quality(patch.corners(t)));
    let (before, after) = (patch.before, Shortfall::of(after, goal));
    if after.worst <= RISE * before.worst || after.worst <= 0.0 || after.missing >= before.missing {
        return None;
    }
    Some(patch.finish(mesh, proposal, after.worst - before.worst))
}

/// The vertex `v` moved to `foot` on the isosurface, followed by smoothing around it, if every
/// tetrahedron then is `good` or none is worse than the worst one was.
pub(crate) fn project_with_neighbours(
    guarded: &GuardedMesh,
    v: u32,
    foot: Point3,
    surface: &SurfaceRules<'_>,
    good: impl Fn([Point3; 4]) -> bool,
    star: &mut Star,
) -> Option<Proposal> {
    let mesh = &guarded.mesh;
    let mut core: Vec<u32> = mesh
        .incidence
        .of(v)
        .iter()
        .flat_map(|&t| mesh.tets[t as usize])
        .collect();
    core.sort_unstable();
    core.dedup();
    let proposal = Proposal::projection(v, foot);
    let mut patch = Patch::new(mesh, &proposal, &core, f64::NEG_INFINITY);
    let settings = &PatchSettings::USUAL;
    patch.smooth(guarded, &proposal, &core, Some(surface), settings, star);
    let fine = patch.tets.iter().all(|&t| {
        let corners = patch.corners(t);
        quality(corners) >= patch.before.worst || good(corners)
    });
    let moved = patch.x[patch.slot(v)] != mesh.x[v as usize];
    (fine && moved).then(|| patch.finish(mesh, &proposal, 0.0))
}
