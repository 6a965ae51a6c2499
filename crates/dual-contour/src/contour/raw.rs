//! A mesh as its mesher leaves it.
//!
//! Vertices that no element uses are still among its positions; the verbs leave them out (`compact`), for triangles and
//! tetrahedra each by themselves, and bring the rest to Å.

use geom_core::Point3;
use geom_core::mesh::{Region, VertexKind};

use crate::complex::collect::kinds;
use crate::dual::{Emission, Emitter};

/// A mesh in the vertex numbers of its mesher, positions in finest cells.
#[derive(Default)]
pub(crate) struct Raw {
    pub(crate) positions: Vec<Point3>,
    pub(crate) kinds: Vec<VertexKind>,
    pub(crate) tets: Vec<[u32; 4]>,
    pub(crate) regions: Vec<Region>,
    /// The boundary of the molecule, seen from outside of it.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Vertices beside cells and corners.
    pub(crate) added: usize,
}

impl Raw {
    /// Kinds are found only where there are tetrahedra.
    pub(super) fn from_emission(
        emitter: &Emitter<'_>,
        emission: Emission,
        keep: impl Fn(Region) -> bool + Sync,
    ) -> Self {
        let positions = emitter.positions(&emission.added);
        let kinds = if emission.tets.is_empty() {
            Vec::new()
        } else {
            let meeting = emitter.meeting(emission.added.len(), keep);
            kinds(&positions, &meeting, emitter.complex.tree.cells)
        };
        Self {
            kinds,
            positions,
            tets: emission.tets,
            regions: emission.regions,
            triangles: emission.triangles,
            added: emission.added.len(),
        }
    }
}
