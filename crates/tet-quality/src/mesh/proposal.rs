//! A change of the mesh that is worth making, and the choice of changes that do not meet.

use geom_core::Point3;
use geom_core::mesh::{EDGES, FACES, Region, VertexKind};

use crate::mesh::editable::{Freedom, Work};
use crate::mesh::incidence::NONE;
use crate::mesh::link::still_contracts;
use crate::smoothing::star::GAIN;

/// The place of the new vertex among the corners of [`Proposal::insert`].
pub(crate) const NEW: u32 = NONE - 1;

/// Which operation a proposal is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operation {
    EdgeRemoval,
    FaceSwap,
    SurfaceFlip,
    Contraction,
    Insertion,
    /// No operation: vertices move together.
    Push,
}

/// What the worst of the new tetrahedra must exceed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Floor {
    /// The worst of the old ones.
    Old,
    /// This objective: smoothing follows.
    Fixed(f64),
}

impl Floor {
    pub(crate) fn above(self, old: f64) -> f64 {
        match self {
            Self::Old => old + GAIN,
            Self::Fixed(q) => q,
        }
    }
}

/// Some tetrahedra to be replaced by others.
#[derive(Clone, Debug)]
pub(crate) struct Proposal {
    pub(crate) operation: Operation,
    /// By how much the worst objective among the tetrahedra rises.
    pub(crate) gain: f64,
    pub(crate) remove: Vec<u32>,
    pub(crate) insert: Vec<([u32; 4], Region)>,
    /// A new vertex; [`NEW`] stands for it in `insert`.
    pub(crate) vertex: Option<(Point3, VertexKind, Freedom)>,
    /// Vertices that stay but move.
    pub(crate) moves: Vec<(u32, Point3)>,
    /// The tetrahedra that the proposal looked at or changes: it holds while they stay.
    pub(crate) locks: Vec<u32>,
    /// The edge that a contraction contracts, from the vertex that vanishes, and whether it lies on an
    /// interface.
    pub(crate) edge: Option<(u32, u32, bool)>,
}

impl Proposal {
    /// A replacement without new or moved vertices.
    pub(crate) fn swap(
        operation: Operation,
        gain: f64,
        remove: Vec<u32>,
        insert: Vec<([u32; 4], Region)>,
    ) -> Self {
        Self {
            operation,
            gain,
            locks: remove.clone(),
            remove,
            insert,
            vertex: None,
            moves: Vec::new(),
            edge: None,
        }
    }

    /// A vertex that goes to the isosurface.
    pub(crate) fn push(v: u32, foot: Point3) -> Self {
        Self {
            operation: Operation::Push,
            gain: 0.0,
            remove: Vec::new(),
            insert: Vec::new(),
            vertex: None,
            moves: vec![(v, foot)],
            locks: Vec::new(),
            edge: None,
        }
    }

    /// Does the mesh outside of the locked tetrahedra, which stayed, still allow the change? What a
    /// neighbouring change made since the last [`Work::tick`] may be an edge or a face that this one
    /// would make again; where nothing changed, what was judged then still holds.
    fn fits(&self, work: &Work) -> bool {
        let fresh = |v: u32| work.changed_now(v);
        if let Some((a, b, on_surface)) = self.edge {
            return !(fresh(a) || fresh(b)) || still_contracts(work, a, b, on_surface);
        }
        let old = || self.remove.iter().map(|&t| work.tets[t as usize]);
        self.insert.iter().all(|(tet, _)| {
            EDGES.iter().all(|&[i, j]| {
                let (u, v) = (tet[i], tet[j]);
                u == NEW
                    || v == NEW
                    || !(fresh(u) && fresh(v))
                    || old().any(|t| t.contains(&u) && t.contains(&v))
                    || !work.edge_exists(u, v)
            }) && FACES.iter().all(|f| {
                let f = f.map(|i| tet[i]);
                f.contains(&NEW)
                    || !f.iter().all(|&v| fresh(v))
                    || old().any(|t| f.iter().all(|v| t.contains(v)))
                    || !work.face_exists(f[0], f[1], f[2])
            })
        })
    }

    /// Makes the change.
    pub(crate) fn apply(&self, work: &mut Work) {
        work.change_walls(self);
        for &t in &self.remove {
            work.remove(t);
        }
        let new = self
            .vertex
            .map(|(x, kind, freedom)| work.add_vertex(x, kind, freedom));
        for &(tet, region) in &self.insert {
            let tet = tet.map(|v| {
                if v == NEW {
                    new.expect("a new vertex")
                } else {
                    v
                }
            });
            work.insert(tet, region);
        }
        for &(v, x) in &self.moves {
            work.set_position(v, x);
        }
    }
}

/// Makes the changes that lock no common tetrahedron and still fit, greatest gain first, in steps of
/// 2⁻²⁰ so that equal ones go by their order. `marks` shows, by `stamp`, which tetrahedra are gone.
/// Gives those that were made.
pub(crate) fn apply_all(
    work: &mut Work,
    mut proposals: Vec<(u32, Proposal)>,
    marks: &mut Vec<u32>,
    stamp: u32,
) -> Vec<Proposal> {
    let steps = |gain: f64| (gain * f64::from(1u32 << 20)) as i64;
    proposals.sort_by(|a, b| steps(b.1.gain).cmp(&steps(a.1.gain)).then(a.0.cmp(&b.0)));
    let mut made = Vec::new();
    for (_, proposal) in proposals {
        marks.resize(work.tets.len(), 0);
        if proposal.locks.iter().any(|&t| marks[t as usize] == stamp)
            || !proposal.fits(work)
            || !work.walls_bear(&proposal)
        {
            continue;
        }
        for &t in &proposal.locks {
            marks[t as usize] = stamp;
        }
        proposal.apply(work);
        made.push(proposal);
    }
    made
}
