//! A change of the mesh that is worth making, and the choice of changes that do not meet.

use geom_core::Point3;
use geom_core::mesh::{Region, VertexKind};

use crate::ring::GAIN;
use crate::work::{Freedom, NONE, Work};

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
    /// The vertices whose tetrahedra the proposal looked at or changes.
    pub(crate) locks: Vec<u32>,
}

impl Proposal {
    /// A replacement without new or moved vertices, locking all corners of what it removes.
    pub(crate) fn swap(
        work: &Work,
        operation: Operation,
        gain: f64,
        remove: Vec<u32>,
        insert: Vec<([u32; 4], Region)>,
    ) -> Self {
        let mut locks: Vec<u32> = remove.iter().flat_map(|&t| work.tets[t as usize]).collect();
        locks.sort_unstable();
        locks.dedup();
        Self {
            operation,
            gain,
            remove,
            insert,
            vertex: None,
            moves: Vec::new(),
            locks,
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
            locks: vec![v],
        }
    }

    /// Makes the change.
    pub(crate) fn apply(&self, work: &mut Work) {
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

/// Proposals that lock no common vertex: greatest gain first, in steps of 2⁻²⁰ so that equal ones go
/// by their order. `marks` has one entry per vertex; a vertex is locked when its mark is `stamp`.
pub(crate) fn independent(
    mut proposals: Vec<(u32, Proposal)>,
    marks: &mut [u32],
    stamp: u32,
) -> Vec<Proposal> {
    let steps = |gain: f64| (gain * f64::from(1u32 << 20)) as i64;
    proposals.sort_by(|a, b| steps(b.1.gain).cmp(&steps(a.1.gain)).then(a.0.cmp(&b.0)));
    let mut chosen = Vec::new();
    for (_, proposal) in proposals {
        if proposal.locks.iter().any(|&v| marks[v as usize] == stamp) {
            continue;
        }
        for &v in &proposal.locks {
            marks[v as usize] = stamp;
        }
        chosen.push(proposal);
    }
    chosen
}
