//! Which vertices share an edge.
//!
//! Faces may be of any number of corners; the diagonals of quads are no edges.

use geom_core::compute::parallel;
use geom_core::{QuadMesh, TriMesh};

/// The neighbours of each vertex along edges, ascending.
/// All lists in one array; those of vertex v start at `starts[v]` and end where the next ones start.
#[derive(Clone, Debug)]
pub(crate) struct Neighbors {
    starts: Vec<usize>,
    neighbors: Vec<u32>,
}

impl Neighbors {
    pub(crate) fn of_triangles(mesh: &TriMesh) -> Self {
        Self::of(mesh.positions().len(), mesh.triangles())
    }

    pub(crate) fn of_quads(mesh: &QuadMesh) -> Self {
        Self::of(mesh.positions().len(), mesh.quads())
    }

    /// Each edge is met from both of its faces and both of its ends, sorted, and kept once for each end.
    fn of<const N: usize>(vertices: usize, faces: &[[u32; N]]) -> Self {
        let mut pairs: Vec<(u32, u32)> = faces
            .iter()
            .flat_map(|f| (0..N).map(move |k| (f[k], f[(k + 1) % N])))
            .flat_map(|(a, b)| [(a, b), (b, a)])
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut counts = vec![0u32; vertices];
        for &(v, _) in &pairs {
            counts[v as usize] += 1;
        }
        Self {
            starts: parallel::starts_of(&counts),
            neighbors: pairs.into_iter().map(|(_, w)| w).collect(),
        }
    }

    /// None for a vertex of no face.
    pub(crate) fn of_vertex(&self, v: usize) -> &[u32] {
        &self.neighbors[self.starts[v]..self.starts[v + 1]]
    }
}
