//! Triangles glued along sides.

use crate::field::frames::{Frames, previous};

const NONE: u32 = u32::MAX;

/// Triangles glued along sides, perhaps to themselves: what a map lies on. Half-edges are numbered as those of a mesh.
#[derive(Clone, Debug)]
pub(crate) struct Net {
    /// Per half-edge, the vertex it starts from; half-edge `3 t + k` leads from corner k of triangle t to the next.
    from: Vec<u32>,
    /// Per half-edge, the other one of its edge, or [`NONE`] on a boundary. It may belong to the same triangle.
    twin: Vec<u32>,
    /// A half-edge out of each vertex, on a boundary the one along it.
    out: Vec<u32>,
}

impl Net {
    /// That of a surface, with the same numbers.
    pub(crate) fn of(frames: &Frames) -> Self {
        Self {
            from: (0..frames.edges().len())
                .map(|h| frames.from(h) as u32)
                .collect(),
            twin: frames.edges().twins().to_vec(),
            out: (0..frames.edges().vertices())
                .map(|v| frames.around(v).next().map_or(NONE, |h| h as u32))
                .collect(),
        }
    }

    /// Made of its parts, which have to agree: twins of each other, and a half-edge of each vertex that has any.
    pub(super) fn new(from: Vec<u32>, twin: Vec<u32>, out: Vec<u32>) -> Self {
        Self { from, twin, out }
    }

    pub(crate) fn vertices(&self) -> usize {
        self.out.len()
    }

    pub(crate) fn faces(&self) -> usize {
        self.from.len() / 3
    }

    /// The vertex a half-edge starts from.
    pub(crate) fn from(&self, halfedge: usize) -> usize {
        self.from[halfedge] as usize
    }

    pub(crate) fn twin(&self, halfedge: usize) -> Option<usize> {
        let twin = self.twin[halfedge];
        (twin != NONE).then_some(twin as usize)
    }

    pub(crate) fn on_boundary(&self, vertex: usize) -> bool {
        let out = self.out[vertex];
        out != NONE && self.twin[out as usize] == NONE
    }

    /// The half-edges out of a vertex, counter-clockwise.
    /// On a boundary from its half-edge there to the last triangle. Vertices without triangles have none.
    pub(crate) fn around(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        let first = (self.out[vertex] != NONE).then_some(self.out[vertex] as usize);
        std::iter::successors(first, move |&h| {
            self.twin(previous(h)).filter(|&t| Some(t) != first)
        })
    }
}
