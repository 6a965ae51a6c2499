//! Open meshes made closed by ghost vertices, so that every patch is a regular one or has one
//! extraordinary corner.
//!
//! Across a boundary edge the net goes on linearly, `P₋₁ = 2 P₀ − P₁`, and at a corner
//! `P₋₁₋₁ = 4 P₀₀ − 2 P₁₀ − 2 P₀₁ + P₁₁`: the boundary curve is then the cubic B-spline of its vertices. A boundary vertex
//! of more than two quads has a ghost beyond each of its boundary edges and stays on the boundary.

use geom_core::mesh::Halfedges;
use geom_core::{QuadMesh, VertexId, id::Id};

/// A linear combination of vertices.
pub(crate) type Combination = Vec<(u32, f64)>;

/// The quads of a mesh and of a rim of ghosts around it.
#[derive(Clone, Debug)]
pub(crate) struct Extended {
    /// The mesh's own vertices.
    pub(crate) real: usize,
    /// The mesh's own quads come first.
    pub(crate) quads: Vec<[u32; 4]>,
    /// What each vertex beyond `real` is.
    pub(crate) ghosts: Vec<Combination>,
}

impl Extended {
    pub(crate) fn of(mesh: &QuadMesh, edges: &Halfedges<4>) -> Self {
        let mut extended = Self {
            real: mesh.positions().len(),
            quads: mesh.quads().to_vec(),
            ghosts: Vec::new(),
        };
        // Per boundary vertex: the ghost across the edge that leaves it, the one across the edge that
        // arrives, and at a corner the one between.
        let mut of_vertex = vec![[u32::MAX; 3]; mesh.positions().len()];
        for (v, ghosts) in (0..).zip(&mut of_vertex) {
            if edges.on_boundary(VertexId(v)) {
                *ghosts = extended.ghosts_of(edges, VertexId(v));
            }
        }
        for h in edges.iter().filter(|&h| edges.twin(h).is_none()) {
            let (a, b) = (edges.from(h), edges.to(h));
            let [leaving, _, _] = of_vertex[a.index()];
            let [_, arriving, _] = of_vertex[b.index()];
            extended.quads.push([b.0, a.0, leaving, arriving]);
        }
        for (v, &[leaving, arriving, between]) in of_vertex.iter().enumerate() {
            if between != u32::MAX {
                extended.quads.push([v as u32, arriving, between, leaving]);
            }
        }
        extended
    }

    fn ghosts_of(&mut self, edges: &Halfedges<4>, v: VertexId) -> [u32; 3] {
        let around: Vec<_> = edges.around(v).collect();
        let mut mirrored = |other: u32| self.ghost(vec![(v.0, 2.0), (other, -1.0)]);
        match around[..] {
            // A corner: the neighbours along the leaving edge, along the arriving one, and across.
            [h] => {
                let next = edges.to(h).0;
                let before = edges.from(edges.previous(h)).0;
                let across = edges.to(edges.next(h)).0;
                let (leaving, arriving) = (mirrored(before), mirrored(next));
                let corner = vec![(v.0, 4.0), (next, -2.0), (before, -2.0), (across, 1.0)];
                [leaving, arriving, self.ghost(corner)]
            }
            [_, inner] => {
                let ghost = mirrored(edges.to(inner).0);
                [ghost, ghost, u32::MAX]
            }
            // The neighbours inside next to each of the boundary edges.
            [_, first, .., last] => {
                let sides = [first, last].map(|h| mirrored(edges.to(h).0));
                [sides[0], sides[1], u32::MAX]
            }
            [] => [u32::MAX; 3],
        }
    }

    fn ghost(&mut self, combination: Combination) -> u32 {
        self.ghosts.push(combination);
        (self.real + self.ghosts.len() - 1) as u32
    }

    /// Adds `weight` times a vertex, real or not, to a combination of real ones.
    pub(crate) fn add(&self, vertex: u32, weight: f64, to: &mut Combination) {
        match self.ghosts.get((vertex as usize).wrapping_sub(self.real)) {
            None => add(to, vertex, weight),
            Some(combination) => {
                for &(v, w) in combination {
                    add(to, v, w * weight);
                }
            }
        }
    }
}

fn add(to: &mut Combination, vertex: u32, weight: f64) {
    match to.iter_mut().find(|t| t.0 == vertex) {
        Some(entry) => entry.1 += weight,
        None => to.push((vertex, weight)),
    }
}
