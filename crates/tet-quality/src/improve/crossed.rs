//! Which triangles of the boundary cross, looked for again and again while walls are parted.
//!
//! A search of the whole boundary takes as long as a pass. But what has not changed since the last one crosses as it did, and the
//! mesh knows of each vertex when something around it changed.

use geom_core::TriMesh;
use geom_core::compute::parallel;
use geom_core::search::crossing::{crossing_pairs, crossing_pairs_among};

use crate::mesh::editable::EditableMesh;

/// Fewer triangles than one in so many may have changed to search only these.
const ONE_IN: usize = 8;

/// Two triangles of the boundary that cross.
/// By their corners, not by the numbers of faces, which would not outlast a change of the boundary.
pub(crate) type Pair = [[u32; 3]; 2];

/// The pairs that crossed at the last search. It belongs to the mesh as it was then: who goes back to an older one goes back to
/// what was known of that.
#[derive(Clone, Default)]
pub(crate) struct Crossed {
    pairs: Vec<Pair>,
    /// The time of the search; 0 before the first, when all is new.
    at: u32,
}

impl Crossed {
    /// The pairs that cross now, in order.
    pub(crate) fn search(&mut self, mesh: &mut EditableMesh) -> Vec<Pair> {
        let faces = mesh.boundary_faces();
        let changed = |v: &u32| mesh.changed[*v as usize] > self.at;
        let fresh = parallel::map_each(&faces, |t| t.iter().any(changed));
        let count = fresh.iter().filter(|f| **f).count();
        let boundary = TriMesh::new(mesh.x.clone(), faces.clone());
        let boundary = boundary.expect("the operations keep the mesh valid");
        let (found, kept) = if ONE_IN * count < faces.len() {
            let found = crossing_pairs_among(&boundary, |t| fresh[t as usize]);
            (found, std::mem::take(&mut self.pairs))
        } else {
            (crossing_pairs(&boundary), Vec::new())
        };
        // A triangle none of whose corners has changed is as it was.
        let kept = kept.into_iter();
        let kept = kept.filter(|pair| !pair.as_flattened().iter().any(changed));
        let found = found.iter().map(|pair| pair.map(|t| faces[t as usize]));
        let mut pairs: Vec<Pair> = kept.chain(found).collect();
        pairs.iter_mut().for_each(|pair| pair.sort_unstable());
        pairs.sort_unstable();
        // What changes from now on is later than this.
        self.at = mesh.tick() - 1;
        self.pairs.clone_from(&pairs);
        pairs
    }
}
