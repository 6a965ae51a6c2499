//! A change of the mesh that is worth making.
//!
//! Operations do not change the mesh: they read it, many at once, and say what they would do and what it would gain.
//! What is found is then sorted, checked against the changes made before it, and made by one thread. So the result is
//! the same for any number of threads, and an operation that is not made costs no undoing.

use geom_core::Point3;
use geom_core::mesh::{EDGES, FACES, Region, VertexKind};

use crate::mesh::editable::{EditableMesh, Freedom, GAIN};
use crate::mesh::incidence::NONE;
use crate::mesh::link::{ContractedEdge, still_contracts};

/// The number of the new vertex among the corners of [`Proposal::insert`].
/// Its true number is known only when the change is made.
pub(crate) const NEW: u32 = NONE - 1;

/// Which operation a proposal is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operation {
    EdgeRemoval,
    FaceSwap,
    SurfaceFlip,
    Contraction,
    Insertion,
    /// No operation: vertices move together, one of them to the isosurface.
    Projection,
}

/// What the worst of the new tetrahedra must exceed.
/// An operation gives up as soon as one new tetrahedron is not above it, which is why it is passed down.
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

/// A tetrahedron that a proposal makes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NewTet {
    /// Its corners; [`NEW`] is the vertex that the proposal makes.
    pub(crate) corners: [u32; 4],
    pub(crate) region: Region,
}

/// A vertex that a proposal makes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NewVertex {
    pub(crate) position: Point3,
    pub(crate) kind: VertexKind,
    pub(crate) freedom: Freedom,
}

/// A vertex that stays but moves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VertexMove {
    pub(crate) vertex: u32,
    pub(crate) to: Point3,
}

/// Some tetrahedra to be replaced by others.
///
/// `remove` and `insert` fill the same part of space, with the same faces around it, unless a surface flips, an edge is
/// contracted or vertices move. A proposal with smoothing lists in `locks` the whole neighbourhood on which it was
/// judged.
#[derive(Clone, Debug)]
pub(crate) struct Proposal {
    pub(crate) operation: Operation,
    /// By how much the worst objective among the tetrahedra rises.
    pub(crate) gain: f64,
    pub(crate) remove: Vec<u32>,
    pub(crate) insert: Vec<NewTet>,
    /// [`NEW`], if the proposal makes a vertex.
    pub(crate) vertex: Option<NewVertex>,
    pub(crate) moves: Vec<VertexMove>,
    /// The tetrahedra that the proposal looked at or changes: it holds while they stay.
    pub(crate) locks: Vec<u32>,
    /// The edge that a contraction contracts.
    pub(crate) edge: Option<ContractedEdge>,
}

impl Proposal {
    /// A replacement without new or moved vertices.
    pub(crate) fn swap(
        operation: Operation,
        gain: f64,
        remove: Vec<u32>,
        insert: Vec<NewTet>,
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
    pub(crate) fn projection(vertex: u32, to: Point3) -> Self {
        Self {
            operation: Operation::Projection,
            gain: 0.0,
            remove: Vec::new(),
            insert: Vec::new(),
            vertex: None,
            moves: vec![VertexMove { vertex, to }],
            locks: Vec::new(),
            edge: None,
        }
    }

    /// Where a vertex, old or new, lies after the change.
    pub(crate) fn position_after(&self, mesh: &EditableMesh, v: u32) -> Point3 {
        match self.vertex {
            Some(new) if v == NEW => new.position,
            _ => {
                let moved = self.moves.iter().find(|m| m.vertex == v);
                moved.map_or_else(|| mesh.x[v as usize], |m| m.to)
            }
        }
    }

    /// Does the mesh outside of the locked tetrahedra, which stayed, still allow the change? What a
    /// neighbouring change made since the last [`EditableMesh::tick`] may be an edge or a face that
    /// this one would make again; where nothing changed, what was judged then still holds.
    pub(crate) fn fits(&self, mesh: &EditableMesh) -> bool {
        let fresh = |v: u32| mesh.changed_now(v);
        if let Some(edge) = self.edge {
            return !(fresh(edge.from) || fresh(edge.to)) || still_contracts(mesh, edge);
        }
        let old = || self.remove.iter().map(|&t| mesh.tets[t as usize]);
        self.insert.iter().all(|new| {
            let tet = new.corners;
            EDGES.iter().all(|&[i, j]| {
                let (u, v) = (tet[i], tet[j]);
                u == NEW
                    || v == NEW
                    || !(fresh(u) && fresh(v))
                    || old().any(|t| t.contains(&u) && t.contains(&v))
                    || !mesh.edge_exists(u, v)
            }) && FACES.iter().all(|f| {
                let f = f.map(|i| tet[i]);
                f.contains(&NEW)
                    || !f.iter().all(|&v| fresh(v))
                    || old().any(|t| f.iter().all(|v| t.contains(v)))
                    || !mesh.face_exists(f[0], f[1], f[2])
            })
        })
    }

    /// Makes the change.
    /// In this order: a slot that becomes empty is filled again at once, and moved vertices are measured with their new
    /// tetrahedra.
    pub(crate) fn apply(&self, mesh: &mut EditableMesh) {
        for &t in &self.remove {
            mesh.remove(t);
        }
        let new = self
            .vertex
            .map(|new| mesh.add_vertex(new.position, new.kind, new.freedom));
        for tet in &self.insert {
            let corners = tet.corners.map(|v| {
                if v == NEW {
                    new.expect("a new vertex")
                } else {
                    v
                }
            });
            mesh.insert(corners, tet.region);
        }
        for moved in &self.moves {
            mesh.set_position(moved.vertex, moved.to);
        }
    }
}
