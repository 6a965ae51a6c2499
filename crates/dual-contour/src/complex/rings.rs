//! The rings of cells around the edges of the complex.
//!
//! On a lattice of one size, four cells stand around each edge. In a balanced octree it may be three, where one of them is
//! larger and holds the edge in its face, and around a diagonal of a cut cell any number from three on. The polygon of their
//! points is what an edge contributes to the surface if its ends differ; the tetrahedra of the edge and each two
//! consecutive cells are what it contributes to the volume. Each edge is visited once, by the leaf that owns it: the
//! smallest around it, and of several the first in a fixed order of quadrants.

use geom_core::mesh::Region;

use super::cube::{AROUND, QUADRANT, diagonal_of, faces_beside};
use super::{Cell, Complex, Corner, Ring};
use crate::octree::{Leaf, NONE, corner_of, local};

/// Who owns an edge: of the smallest leaves around it the first in this order of quadrants.
const OWNERS: [usize; 4] = [2, 3, 1, 0];

/// An edge between lattice points.
struct LatticeEdge {
    axis: usize,
    /// Its lower end.
    start: [i32; 3],
    /// Logarithm of its length.
    log: u8,
    /// The leaf in each quadrant, and the logarithm of its size.
    /// [`NONE`] beyond the domain.
    around: [(u32, u8); 4],
    a: (Corner, Region),
    b: (Corner, Region),
}

impl LatticeEdge {
    /// Its ends among the corners of the finest cell in a quadrant.
    fn corners_in(&self, quadrant: usize) -> [usize; 2] {
        let (u, v) = ((self.axis + 1) % 3, (self.axis + 2) % 3);
        let [du, dv] = QUADRANT[quadrant].map(|d| (-d) as usize);
        let p = du << u | dv << v;
        [p, p | 1 << self.axis]
    }

    /// The diagonal of a ring of four that the edge must leave to another. Two larger cells may face each other
    /// across both halves of their common edge, and a triangle of either half may join them; an edge of the
    /// surface would then have four triangles. The upper half leaves their diagonal to the lower one.
    fn reserved_diagonal(&self) -> Option<u8> {
        let larger = |q: usize| self.around[q].1 > self.log;
        let upper = self.start[self.axis] >> self.log & 1 == 1;
        let joins = |k: &u8| larger(usize::from(*k)) && larger(usize::from(*k) + 2);
        (0..2).rev().find(joins).filter(|_| upper)
    }
}

impl Complex<'_> {
    /// The rings of the edges that this leaf owns: lattice edges, and if it is split the diagonals of
    /// its faces and the edges to its middle. `wanted` is asked for the labels of both ends first.
    /// Over all leaves each edge comes once, which replaces a table of edges that have been seen.
    pub(crate) fn rings_of(
        &self,
        id: u32,
        wanted: impl Fn(Region, Region) -> bool,
        mut f: impl FnMut(&Ring),
    ) {
        let leaf = self.leaf(id);
        if leaf.void {
            return;
        }
        let labels = self.corner_labels(leaf);
        self.lattice_rings(id, leaf, &labels, &wanted, &mut f);
        if self.is_split(id) {
            let k = self.split_of(id);
            self.diagonal_rings(k, leaf, &labels, &wanted, &mut f);
            self.centre_rings(k, leaf, &labels, &wanted, &mut f);
        }
    }

    /// The lattice edges of a leaf that it owns.
    /// Of its twelve edges those that no smaller leaf subdivides and no other of its size comes first at.
    fn lattice_rings(
        &self,
        id: u32,
        leaf: &Leaf,
        labels: &[Region; 8],
        wanted: &impl Fn(Region, Region) -> bool,
        f: &mut impl FnMut(&Ring),
    ) {
        let (o, s) = (leaf.origin(), leaf.size());
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for mine in OWNERS {
                let (du, dv) = (-QUADRANT[mine][0], -QUADRANT[mine][1]);
                let low = ((du as usize) << u) | ((dv as usize) << v);
                let (la, lb) = (labels[low], labels[low | 1 << axis]);
                if !wanted(la, lb) {
                    continue;
                }
                let mut start = o;
                start[u] += du * s;
                start[v] += dv * s;
                let Some(around) = self.owned_quadrants((id, leaf.log), mine, axis, start) else {
                    continue;
                };
                let mut end = start;
                end[axis] += s;
                let edge = LatticeEdge {
                    axis,
                    start,
                    log: leaf.log,
                    around,
                    a: (Corner::Point(start), la),
                    b: (Corner::Point(end), lb),
                };
                self.lattice_ring(&edge, f);
            }
        }
    }

    /// The leaves in the quadrants around the edge at `start`, with the logarithms of their sizes, if the leaf
    /// `own` in quadrant `mine` owns it: none is smaller, and none of its size comes first.
    fn owned_quadrants(
        &self,
        own: (u32, u8),
        mine: usize,
        axis: usize,
        start: [i32; 3],
    ) -> Option<[(u32, u8); 4]> {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut found = [(NONE, u8::MAX); 4];
        let mut before = true;
        for q in OWNERS {
            if q == mine {
                found[q] = own;
                before = false;
                continue;
            }
            let mut cell = start;
            cell[u] += QUADRANT[q][0];
            cell[v] += QUADRANT[q][1];
            found[q] = self.tree.find(cell);
            if found[q].1 < own.1 || before && found[q].1 == own.1 {
                return None;
            }
        }
        Some(found)
    }

    /// Puts the cells around a lattice edge in order.
    /// At most ten: four cut leaves have two parts each, and a ring that is open has two ghosts.
    fn lattice_ring(&self, edge: &LatticeEdge, f: &mut impl FnMut(&Ring)) {
        let [before, after] = faces_beside(edge.axis);
        let found = &edge.around;
        let open = found.iter().any(|c| c.0 == NONE);
        // An open ring begins after the box.
        let first = if open {
            (0..4)
                .find(|&q| found[q].0 != NONE && found[(q + 3) % 4].0 == NONE)
                .expect("an edge has a cell")
        } else {
            0
        };
        let mut cells = [Cell::Leaf(NONE); 10];
        let mut n = 0;
        let mut push = |c: Cell| {
            cells[n] = c;
            n += 1;
        };
        if open {
            push(self.ghost(edge, first, before[first]));
        }
        let mut last = first;
        let mut previous = NONE;
        for i in 0..4 {
            let q = (first + i) % 4;
            let id = found[q].0;
            if id == NONE {
                break;
            }
            last = q;
            if self.is_split(id) {
                // Of a cut leaf the two parts at the faces that hold the edge.
                let k = self.split_of(id);
                let [p, r] = edge.corners_in(q);
                let split = &self.splits[k as usize];
                push(Cell::Part(k, split.half(before[q], p, r)));
                push(Cell::Part(k, split.half(after[q], p, r)));
            } else if id != previous && !(i == 3 && !open && id == found[first].0) {
                // A large leaf may fill two quadrants: it stands in the ring once.
                push(Cell::Leaf(id));
            }
            previous = id;
        }
        if open {
            push(self.ghost(edge, last, after[last]));
        }
        f(&Ring {
            a: edge.a,
            b: edge.b,
            cells: &cells[..n],
            open,
            reserved: if n == 4 && !open {
                edge.reserved_diagonal()
            } else {
                None
            },
        });
    }

    /// The ghost beyond a face of the leaf in a quadrant.
    /// Of a cut leaf the ghost of that half of the face which has the edge.
    fn ghost(&self, edge: &LatticeEdge, quadrant: usize, face: usize) -> Cell {
        let id = edge.around[quadrant].0;
        if self.is_split(id) {
            let [p, r] = edge.corners_in(quadrant);
            Cell::Ghost(id, self.splits[self.split_of(id) as usize].half(face, p, r))
        } else {
            Cell::Ghost(id, 2 * face as u8)
        }
    }

    /// The diagonals of the faces of a split leaf; one between two split leaves belongs to the lower.
    /// Beyond such a face stands a part of the neighbour per half, or the neighbour itself, or at the box a ghost per
    /// half. Whether the list is counter-clockwise is told by a volume with the points at their bases, never where they
    /// have moved to.
    fn diagonal_rings(
        &self,
        k: u32,
        leaf: &Leaf,
        labels: &[Region; 8],
        wanted: &impl Fn(Region, Region) -> bool,
        f: &mut impl FnMut(&Ring),
    ) {
        let split = &self.splits[k as usize];
        let o = leaf.origin();
        for face in 0..6 {
            let (axis, side) = (face / 2, face % 2);
            let [p, q] = diagonal_of(split.diagonals, face);
            if !wanted(labels[p], labels[q]) {
                continue;
            }
            let mut beyond = o;
            beyond[axis] += if side == 1 { 1 } else { -1 };
            let (other, _) = self.tree.find(beyond);
            let (first, second) = (2 * face as u8, 2 * face as u8 + 1);
            let mut cells = vec![Cell::Part(k, first), Cell::Part(k, second)];
            let open = other == NONE;
            if open {
                cells.insert(0, Cell::Ghost(self.split_leaves[k as usize], first));
                cells.push(Cell::Ghost(self.split_leaves[k as usize], second));
            } else if self.is_split(other) {
                if side == 0 {
                    continue;
                }
                let j = self.split_of(other);
                let opposite = 2 * (face as u8 - 1);
                cells.push(Cell::Part(j, opposite + 1));
                cells.push(Cell::Part(j, opposite));
            } else {
                cells.push(Cell::Leaf(other));
            }
            let a = [0, 1, 2].map(|i| o[i] + corner_of(p)[i]);
            let b = [0, 1, 2].map(|i| o[i] + corner_of(q)[i]);
            let base = |c| self.base_position(&c);
            let (x, y) = (base(Cell::Part(k, first)), base(Cell::Part(k, second)));
            if geom_core::mesh::six_volume([local(a), local(b), x, y]) < 0.0 {
                cells.reverse();
            }
            f(&Ring {
                a: (Corner::Point(a), labels[p]),
                b: (Corner::Point(b), labels[q]),
                cells: &cells,
                open,
                reserved: None,
            });
        }
    }

    /// The edges from the middle of a split leaf to its corners.
    /// These rings are closed and have three to six parts.
    fn centre_rings(
        &self,
        k: u32,
        leaf: &Leaf,
        labels: &[Region; 8],
        wanted: &impl Fn(Region, Region) -> bool,
        f: &mut impl FnMut(&Ring),
    ) {
        let split = &self.splits[k as usize];
        let o = leaf.origin();
        for (corner, &label) in labels.iter().enumerate() {
            if !wanted(split.label, label) {
                continue;
            }
            let p = [0, 1, 2].map(|i| o[i] + corner_of(corner)[i]);
            let parts = &AROUND[usize::from(split.diagonals)][corner];
            let cells: Vec<Cell> = parts.iter().map(|&part| Cell::Part(k, part)).collect();
            f(&Ring {
                a: (Corner::Centre(k), split.label),
                b: (Corner::Point(p), label),
                cells: &cells,
                open: false,
                reserved: None,
            });
        }
    }
}
