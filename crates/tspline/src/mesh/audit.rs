//! Is it a T-mesh? Counted again from its half-edges and vertices.

use super::blocks::NONE;
use super::{TMesh, VertexKind};

/// Counts and faults of a T-mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Audit {
    /// Vertices.
    pub vertices: usize,
    /// Elements.
    pub elements: usize,
    /// Elements per level, level 0 first.
    pub levels: Vec<usize>,
    /// T-junctions.
    pub t_junctions: usize,
    /// Extraordinary vertices.
    pub extraordinary: usize,
    /// Half-edges on the boundary.
    pub boundary: usize,
    /// Twice the Euler characteristic by the elements' sides: `2 V − 2 F − T − B` (for closed meshes `V − F − T/2 = χ`).
    pub doubled_euler: i64,
    /// Twice that of the fine mesh, which must be equal.
    pub doubled_euler_of_fine: i64,
    /// Pairs of neighbours that differ by more than a level.
    pub unbalanced: usize,
    /// Half-edges whose twin ends elsewhere or has another knot interval.
    pub mismatched: usize,
    /// T-junctions that are not the middle of exactly one side.
    pub misplaced: usize,
    /// Elements of which a side's knot intervals do not add up to its size.
    pub uneven: usize,
}

impl Audit {
    /// Is there no fault?
    pub fn is_valid(&self) -> bool {
        self.doubled_euler == self.doubled_euler_of_fine
            && self.unbalanced + self.mismatched + self.misplaced + self.uneven == 0
    }
}

impl TMesh {
    /// Counts everything and looks for faults.
    ///
    /// By half-edges, elements and kinds of vertices as all others see them, not by what the mesh was made with.
    /// T-meshes that [`TMesh::build`], [`TMesh::cut`] and [`TMesh::merge`] make are to have no fault.
    pub fn audit(&self) -> Audit {
        let half = self.halfedges();
        let mut audit = Audit {
            vertices: self.positions.len(),
            elements: self.elements.len(),
            doubled_euler_of_fine: 2 * self.fine.euler_characteristic(),
            ..Audit::default()
        };
        for element in &self.elements {
            let level = usize::from(element.level);
            if audit.levels.len() <= level {
                audit.levels.resize(level + 1, 0);
            }
            audit.levels[level] += 1;
        }
        // How often a vertex lies within a side, and how often as a corner.
        let (mut within, mut corner) = (vec![0; audit.vertices], vec![0; audit.vertices]);
        let mut lengths = vec![[0; 4]; audit.elements];
        for (i, h) in half.iter().enumerate() {
            let element = &self.elements[h.element as usize];
            lengths[h.element as usize][usize::from(h.side)] += h.interval;
            let is_corner = element.corners[usize::from(h.side)] == h.from;
            let count = if is_corner { &mut corner } else { &mut within };
            count[h.from as usize] += 1;
            if h.twin == NONE {
                audit.boundary += 1;
                continue;
            }
            let twin = &half[h.twin as usize];
            let to = half[h.next as usize].from;
            let meets = twin.from == to && half[twin.next as usize].from == h.from;
            let same = meets && twin.interval == h.interval && twin.twin == i as u32;
            audit.mismatched += usize::from(!same);
            let other = &self.elements[twin.element as usize];
            audit.unbalanced += usize::from(element.level > other.level + 1);
        }
        for (element, lengths) in self.elements.iter().zip(&lengths) {
            audit.uneven += usize::from(*lengths != [element.size; 4]);
        }
        for v in 0..audit.vertices {
            let hangs = match self.kinds[v] {
                VertexKind::TJunction => {
                    audit.t_junctions += 1;
                    (1, 2)
                }
                VertexKind::Extraordinary(valence) => {
                    audit.extraordinary += 1;
                    (0, valence)
                }
                VertexKind::Regular => (0, 4),
                VertexKind::Boundary => (0, corner[v]),
            };
            audit.misplaced += usize::from(hangs != (within[v], corner[v]));
        }
        let [v, f] = [audit.vertices, audit.elements].map(|n| 2 * n as i64);
        audit.doubled_euler = v - f - audit.t_junctions as i64 - audit.boundary as i64;
        audit
    }
}
