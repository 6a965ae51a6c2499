//! The gate through which all changes of the mesh go. Between tetrahedra, validity is local: a positive
//! neighbourhood stays positive. Where the other side of a boundary is not meshed nothing local says no,
//! so two guards do: one keeps cavities from collapsing, one keeps walls of gaps from passing through each
//! other.

use geom_core::Point3;
use geom_core::field::Tangent;

use crate::boundary::gaps::SelfIntersectionGuard;
use crate::boundary::walls::CavityGuard;
use crate::mesh::editable::EditableMesh;
use crate::mesh::proposal::Proposal;

/// What keeps boundaries from going through themselves.
#[derive(Clone, Default)]
pub(crate) struct Guard {
    pub(crate) walls: CavityGuard,
    pub(crate) gaps: SelfIntersectionGuard,
}

impl Guard {
    /// May the change be made?
    pub(crate) fn allows(&self, mesh: &EditableMesh, proposal: &Proposal) -> bool {
        let rises = self.walls.rises(mesh, proposal);
        rises.iter().all(|rise| self.walls.allows(rise)) && self.gaps.allows(mesh, proposal)
    }

    /// May the vertex go to `x` as far as narrow gaps are concerned? Cavities are asked when the move is
    /// made: what one move takes from a cavity the next one no longer has.
    pub(crate) fn allows_move(&self, mesh: &EditableMesh, v: u32, x: Point3) -> bool {
        self.gaps.allows_move(mesh, v, x)
    }

    /// Takes account of a change; to be called before it is made.
    fn record(&mut self, mesh: &EditableMesh, proposal: &Proposal) {
        self.gaps.record(mesh, proposal);
        for rise in self.walls.rises(mesh, proposal) {
            self.walls.record(&rise);
        }
        self.walls.record_new_vertex(mesh, proposal);
    }

    /// Takes account of a move if all allow it; to be called before it is made. Gives whether they do.
    fn admit_move(&mut self, mesh: &EditableMesh, v: u32, x: Point3) -> bool {
        if !self.allows_move(mesh, v, x) {
            return false;
        }
        if let Some(rise) = self.walls.rise_of_move(mesh, v, x) {
            if !self.walls.allows(&rise) {
                return false;
            }
            self.walls.record(&rise);
        }
        true
    }
}

/// A mesh behind its guard.
#[derive(Clone)]
pub(crate) struct GuardedMesh {
    pub(crate) mesh: EditableMesh,
    pub(crate) guard: Guard,
}

impl GuardedMesh {
    /// Looks for the cavities of the mesh; from now on no change may turn one inside out.
    pub(crate) fn new(mesh: EditableMesh) -> Self {
        let guard = Guard {
            walls: CavityGuard::of(&mesh),
            gaps: SelfIntersectionGuard::default(),
        };
        Self { mesh, guard }
    }

    /// Looks for the parts of the boundary that face each other across narrow gaps, near some points or everywhere.
    pub(crate) fn find_gaps(&mut self, spacing: f64, near: Option<&[Point3]>) {
        self.guard.gaps = SelfIntersectionGuard::of(&self.mesh, spacing, near);
    }

    /// From now on no gap is known, until they are looked for again.
    pub(crate) fn forget_gaps(&mut self) {
        self.guard.gaps = SelfIntersectionGuard::default();
    }

    /// May the change be made?
    pub(crate) fn allows(&self, proposal: &Proposal) -> bool {
        self.guard.allows(&self.mesh, proposal)
    }

    /// Makes a change that is allowed.
    pub(crate) fn apply(&mut self, proposal: &Proposal) {
        self.guard.record(&self.mesh, proposal);
        proposal.apply(&mut self.mesh);
    }

    /// Moves a vertex, whose tetrahedra are then to be measured anew, unless the guard forbids it. Gives
    /// whether it moved.
    pub(crate) fn move_vertex(&mut self, v: u32, x: Point3) -> bool {
        let admitted = self.guard.admit_move(&self.mesh, v, x);
        if admitted {
            self.mesh.x[v as usize] = x;
        }
        admitted
    }

    /// The same to a point at which the isosurface is known.
    pub(crate) fn move_on_surface(&mut self, v: u32, tangent: Tangent) -> bool {
        let moved = self.move_vertex(v, tangent.at);
        if moved {
            self.mesh.set_tangent(v, tangent);
        }
        moved
    }
}
