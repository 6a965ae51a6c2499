//! The half-edges of a T-mesh: sides of elements, cut at T-junctions.

use super::TMesh;
use super::blocks::{NONE, straight};

/// A half-edge of a T-mesh, with its element on the left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct THalfedge {
    /// The vertex where it starts.
    pub from: u32,
    /// The element on its left.
    pub element: u32,
    /// The side of the element that it is part of.
    pub side: u8,
    /// Its knot interval: its length in sides of fine quads.
    pub interval: u32,
    /// The next half-edge around the element.
    pub next: u32,
    /// The half-edge on the other side, or [`NONE`] on a boundary.
    pub twin: u32,
}

impl TMesh {
    /// All half-edges, element by element, side by side.
    ///
    /// Counted anew at each call, in the time of the fine half-edges along the sides.
    pub fn halfedges(&self) -> Vec<THalfedge> {
        let edges = &self.edges;
        let mut all: Vec<THalfedge> =
            Vec::with_capacity(self.along.len() - self.side_start.len() + 1);
        // Per fine half-edge the one that begins there; per half-edge the last fine one of its way.
        let mut begins = vec![NONE; edges.len()];
        let mut last = Vec::with_capacity(all.capacity());
        for (e, (element, starts)) in self.elements.iter().zip(&self.starts).enumerate() {
            let first = all.len() as u32;
            for (side, &start) in (0..).zip(starts) {
                for h in straight(edges, start, element.size) {
                    let from = self.vertex_of[edges.from(h).0 as usize];
                    if from == NONE {
                        let half: &mut THalfedge =
                            all.last_mut().expect("a side begins with a corner");
                        half.interval += 1;
                        *last.last_mut().expect("as many") = h;
                        continue;
                    }
                    begins[h.0 as usize] = all.len() as u32;
                    last.push(h);
                    all.push(THalfedge {
                        from,
                        element: e as u32,
                        side,
                        interval: 1,
                        next: all.len() as u32 + 1,
                        twin: NONE,
                    });
                }
            }
            all.last_mut().expect("four sides").next = first;
        }
        for (half, &last) in all.iter_mut().zip(&last) {
            half.twin = edges.twin(last).map_or(NONE, |t| begins[t.0 as usize]);
        }
        all
    }
}
