//! The base complex: one object behind every mesh.
//!
//! Its cells are the leaves of the octree, seen as polyhedra whose corners include hanging lattice
//! points; leaves whose labels are not *simple* are cut into twelve tetrahedra. Around each edge of
//! the complex the cells stand in a ring, counter-clockwise about the edge; edge and consecutive
//! cells span the base tetrahedra. Where the ring is open, at the box, it begins and ends with a
//! ghost: a flat cell on the face of the box.
//!
//! What stands on it does not ask how the octree came about: a mesh is made by visiting each edge once (`rings`),
//! numbering what its ring names (`numbering`) and giving each cell a point. `cube` and `split` have the twelve
//! tetrahedra of a cut leaf, `frame` says which leaves need the cut, `collect` puts the lists of all threads together.
//! Positions are in finest cells throughout.
//!
//! What makes it fit to be meshed:
//!
//! - *It conforms.* A triangle of an edge and one cell is shared by the two base tetrahedra beside that cell in the
//!   ring; a triangle of a corner and two cells by the two edges of the cells' common face that meet in the corner.
//!   No diagonal has to be chosen anywhere.
//! - *It is positive.* Two cells of one size that share a face have a convex union, so the segment between their points
//!   passes that face, wherever they are in their cells. Beside a smaller cell this is sure while the larger one's
//!   point is in the middle, from where a corner of the smaller face lies straight ahead.
//! - *It is well shaped.* Among cells of one size it is the body-centred cubic lattice, with dihedral angles of 60° and
//!   90°; where sizes change they lie between 30° and 135°.

use geom_core::compute::parallel;
use geom_core::mesh::Region;
use geom_core::{Point3, Vector3};

use crate::octree::{Leaf, NONE, Octree, Samples, block_index, corner_of, exact, local};

pub(crate) mod collect;
pub(crate) mod cube;
mod frame;
mod numbering;
mod rings;
mod split;

pub(crate) use frame::{Frame, frame_of_corners, simple_masks};
pub(crate) use numbering::{Numbering, Vertex};
pub(crate) use split::Split;

use cube::part_base;
use frame::half_index;

/// A corner of the complex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Corner {
    /// A lattice point.
    Point([i32; 3]),
    /// The middle of a split leaf, by the number of the split.
    Centre(u32),
}

/// A cell of the complex.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Cell {
    /// A leaf that is not split.
    Leaf(u32),
    /// A tetrahedron of a split leaf: number of the split, and of the tetrahedron (2 · face + half).
    Part(u32, u8),
    /// A flat cell on the box: the leaf, its face (2 · axis + side), and the half of a split face.
    Ghost(u32, u8),
}

/// An edge of the complex and the cells around it, counter-clockwise about `a → b`.
pub(crate) struct Ring<'a> {
    /// The lower end and its label.
    pub(crate) a: (Corner, Region),
    /// The upper end and its label: the cells stand counter-clockwise as seen from here.
    pub(crate) b: (Corner, Region),
    pub(crate) cells: &'a [Cell],
    /// Does the ring begin and end with ghosts?
    pub(crate) open: bool,
    /// The diagonal between the cells `k` and `k + 2` of a ring of four that another edge may use.
    pub(crate) reserved: Option<u8>,
}

impl Ring<'_> {
    /// Consecutive cells around the edge; each two span a base tetrahedron with it.
    pub(crate) fn neighbours(&self) -> impl Iterator<Item = [Cell; 2]> {
        let n = self.cells.len();
        (0..if self.open { n - 1 } else { n }).map(move |i| [i, (i + 1) % n].map(|i| self.cells[i]))
    }
}

const SIMPLE: u8 = 0;
const INTERFACE: u8 = 1;
const SPLIT: u8 = 2;

/// The leaves with their labels: which carry the surface, which are split.
pub(crate) struct Complex<'a> {
    pub(crate) samples: &'a Samples<'a>,
    pub(crate) tree: &'a Octree,
    /// Per leaf: bits of [`INTERFACE`] and [`SPLIT`].
    kind: Vec<u8>,
    /// Split leaves in order, and how they are cut.
    pub(crate) split_leaves: Vec<u32>,
    pub(crate) splits: Vec<Split>,
}

/// Which leaves can carry an interface.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Interfaces {
    /// Only finest ones, as where the octree has split all that labels change in.
    OfFinest,
    /// Any: the labels of each leaf's corners are looked at, the hanging ones included.
    OfAnySize,
}

/// What each leaf is: simple, an interface, or to be split.
pub(crate) struct Kinds(Vec<u8>);

impl Kinds {
    /// Judges all leaves.
    /// Finest ones by a table of 256 patterns where labels are signs, all others by the labels on their frame.
    pub(crate) fn of(samples: &Samples<'_>, tree: &Octree, interfaces: Interfaces) -> Self {
        let masks = simple_masks();
        let view = Complex {
            samples,
            tree,
            kind: Vec::new(),
            split_leaves: Vec::new(),
            splits: Vec::new(),
        };
        let kinds = parallel::map(tree.leaves.len(), |id| {
            let id = id as u32;
            if interfaces == Interfaces::OfFinest && tree.leaves[id as usize].log > 0 {
                SIMPLE
            } else {
                view.kind_of(id, &masks)
            }
        });
        Self(kinds)
    }

    /// Leaves that must be split first: not simple, and larger than finest.
    pub(crate) fn large(&self, tree: &Octree) -> Vec<u32> {
        (0..self.0.len() as u32)
            .filter(|&id| self.0[id as usize] & SPLIT != 0 && tree.leaves[id as usize].log > 0)
            .collect()
    }

    /// Finest leaves that are cut into tetrahedra.
    pub(crate) fn cut(&self, tree: &Octree) -> Vec<u32> {
        (0..self.0.len() as u32)
            .filter(|&id| self.0[id as usize] & SPLIT != 0 && tree.leaves[id as usize].log == 0)
            .collect()
    }

    /// Leaves with more than one label, whether simple or not.
    pub(crate) fn interfaces(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.0.len() as u32).filter(|&id| self.0[id as usize] & INTERFACE != 0)
    }

    /// The same with no leaf to be split.
    pub(crate) fn unsplit(mut self) -> Self {
        self.0.iter_mut().for_each(|k| *k &= !SPLIT);
        self
    }
}

impl<'a> Complex<'a> {
    /// A leaf of more than a block is simple: were labels to change in it, it would have been split.
    fn kind_of(&self, id: u32, masks: &[bool; 256]) -> u8 {
        let leaf = &self.tree.leaves[id as usize];
        if leaf.void || leaf.log > 3 {
            return SIMPLE;
        }
        let kind = |simple| if simple { INTERFACE } else { INTERFACE | SPLIT };
        if leaf.log == 0 {
            if let Some(mask) = self.samples.mask(leaf.origin()) {
                return match mask {
                    0 | 255 => SIMPLE,
                    _ => kind(masks[usize::from(mask)]),
                };
            }
            if self.block_is_uniform(leaf) {
                return SIMPLE;
            }
            let labels = self.corner_labels(leaf);
            if labels.iter().all(|&l| l == labels[0]) {
                return SIMPLE;
            }
            return kind(frame_of_corners(&labels).is_simple());
        }
        let frame = self.frame(id);
        if frame.is_uniform() {
            SIMPLE
        } else {
            kind(frame.is_simple())
        }
    }

    /// The complex of a tree whose larger leaves are all simple.
    pub(crate) fn new(samples: &'a Samples<'a>, tree: &'a Octree, kinds: Kinds) -> Self {
        let mut out = Self {
            samples,
            tree,
            kind: kinds.0,
            split_leaves: Vec::new(),
            splits: Vec::new(),
        };
        out.split_leaves = (0..tree.leaves.len() as u32)
            .filter(|&id| out.is_split(id))
            .collect();
        out.splits = parallel::map_each(&out.split_leaves, |&id| {
            let leaf = &tree.leaves[id as usize];
            Split::new(samples, leaf.origin(), &out.corner_labels(leaf))
        });
        out
    }

    /// Has all of the leaf's block one label, so that nothing need be looked at?
    fn block_is_uniform(&self, leaf: &Leaf) -> bool {
        let b = leaf.origin().map(|c| c >> 3);
        self.samples
            .slot(block_index(self.tree.blocks, b))
            .is_none()
    }

    /// Does the boundary of the leaf have corners of more than one label?
    pub(crate) fn is_interface(&self, leaf: u32) -> bool {
        self.kind[leaf as usize] & INTERFACE != 0
    }

    /// Is the leaf cut into twelve tetrahedra?
    pub(crate) fn is_split(&self, leaf: u32) -> bool {
        self.kind[leaf as usize] & SPLIT != 0
    }

    /// Does a leaf have a face on the box?
    pub(crate) fn is_on_box(&self, id: u32) -> bool {
        let leaf = self.leaf(id);
        let (o, s) = (leaf.origin(), leaf.size());
        (0..3).any(|k| o[k] == 0 || o[k] + s == self.tree.cells[k])
    }

    /// Does a leaf touch a box of finest cells, `low..high`? All do if there is none.
    pub(crate) fn touches(&self, id: u32, within: Option<[[i32; 3]; 2]>) -> bool {
        let leaf = self.leaf(id);
        let (o, s) = (leaf.origin(), leaf.size());
        within.is_none_or(|[low, high]| (0..3).all(|k| o[k] <= high[k] && o[k] + s >= low[k]))
    }

    /// The number of the split of a leaf that is cut.
    pub(crate) fn split_of(&self, leaf: u32) -> u32 {
        self.split_leaves.partition_point(|&l| l < leaf) as u32
    }

    pub(crate) fn leaf(&self, id: u32) -> &Leaf {
        &self.tree.leaves[id as usize]
    }

    /// The middle of a leaf, in finest cells.
    pub(crate) fn centre_of(&self, leaf: &Leaf) -> Point3 {
        let half = 0.5 * f64::from(leaf.size());
        local(leaf.origin()).map(|c| c + half)
    }

    pub(crate) fn corner_labels(&self, leaf: &Leaf) -> [Region; 8] {
        self.samples.corner_labels(leaf.origin(), leaf.size())
    }

    /// The labels of the corners of a cell; for an unsplit leaf of one label only that one.
    pub(crate) fn labels_of(&self, cell: &Cell) -> Vec<Region> {
        let (id, half) = match *cell {
            Cell::Leaf(id) => (id, None),
            Cell::Part(k, part) => (self.split_leaves[k as usize], Some(part)),
            Cell::Ghost(id, half) => (id, Some(half)),
        };
        if !self.is_interface(id) {
            return vec![self.samples.label(self.leaf(id).origin())];
        }
        if let (Some(half), true) = (half, self.is_split(id)) {
            let split = &self.splits[self.split_of(id) as usize];
            let corners = self.corner_labels(self.leaf(id));
            let triangle = split.triangle(usize::from(half)).into_iter();
            let apex = matches!(cell, Cell::Part(..)).then_some(split.label);
            return triangle.map(|i| corners[i]).chain(apex).collect();
        }
        let frame = self.frame(id);
        let on_face = |i: usize| match half {
            None => true,
            Some(half) => {
                let place = [i % 3, i / 3 % 3, i / 9];
                place[usize::from(half / 4)] == 2 * usize::from(half / 2 % 2)
            }
        };
        (0..27)
            .filter(|&i| frame.used >> i & 1 == 1 && on_face(i))
            .map(|i| frame.labels[i])
            .collect()
    }

    /// The used points of the half lattice of a leaf and their labels.
    /// A middle of an edge or face is a corner if a leaf beyond has half the size; balance allows no smaller one.
    pub(crate) fn frame(&self, id: u32) -> Frame {
        let leaf = self.leaf(id);
        let (o, s) = (leaf.origin(), leaf.size());
        if s == 1 {
            return frame_of_corners(&self.corner_labels(leaf));
        }
        let half = s / 2;
        let mut frame = Frame {
            used: 0,
            labels: [0; 27],
        };
        let mut take = |p: [usize; 3]| {
            let i = half_index(p);
            frame.used |= 1 << i;
            frame.labels[i] = self
                .samples
                .label([0, 1, 2].map(|k| o[k] + half * p[k] as i32));
        };
        let finer = |cell: [i32; 3]| {
            let (other, log) = self.tree.find(cell);
            other != NONE && log < leaf.log
        };
        for i in 0..8 {
            take([2 * (i & 1), 2 * (i >> 1 & 1), 2 * (i >> 2)]);
        }
        // A cell just outside in the direction d (−1, 0, 1 per axis); 0 is the low end.
        let beside = |d: [i32; 3]| {
            [0, 1, 2].map(|k| match d[k] {
                -1 => o[k] - 1,
                0 => o[k],
                _ => o[k] + s,
            })
        };
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            // Finer leaves beyond a face hang its middle and the middles of its edges on it.
            for side in [0usize, 2] {
                let mut d = [0; 3];
                d[axis] = side as i32 - 1;
                if finer(beside(d)) {
                    let mut p = [1; 3];
                    p[axis] = side;
                    take(p);
                    for (w, end) in [(u, 0), (u, 2), (v, 0), (v, 2)] {
                        let mut q = p;
                        q[w] = end;
                        take(q);
                    }
                }
            }
            // Finer leaves that only share an edge along the axis hang its middle on it.
            for j in [0usize, 2] {
                for k in [0usize, 2] {
                    let mut d = [0; 3];
                    (d[u], d[v]) = (j as i32 - 1, k as i32 - 1);
                    if finer(beside(d)) {
                        let mut p = [1; 3];
                        (p[u], p[v]) = (j, k);
                        take(p);
                    }
                }
            }
        }
        frame
    }

    /// Where the point of a cell stands before it moves to the surface, in finest cells.
    /// The middle of a leaf or of a face, the mean of a part's corners. With all points here every base tetrahedron is
    /// positive.
    pub(crate) fn base_position(&self, cell: &Cell) -> Point3 {
        match *cell {
            Cell::Leaf(id) => self.centre_of(self.leaf(id)),
            Cell::Part(k, part) => {
                let o = self.leaf(self.split_leaves[k as usize]).origin();
                part_base(self.splits[k as usize].diagonals, o, part as usize)
            }
            Cell::Ghost(id, half) => {
                let leaf = self.leaf(id);
                let (o, s) = (leaf.origin(), f64::from(leaf.size()));
                let face = usize::from(half / 2);
                if self.is_split(id) {
                    let split = &self.splits[self.split_of(id) as usize];
                    let corners = split.triangle(half as usize).map(corner_of).map(local);
                    let sum: Vector3 = corners.iter().map(|p| p.coords).sum();
                    return local(o) + (sum / 3.0).map(exact);
                }
                let mut p = self.centre_of(leaf);
                p[face / 2] = f64::from(o[face / 2]) + if face % 2 == 1 { s } else { 0.0 };
                p
            }
        }
    }

    /// Position of a corner, in finest cells.
    pub(crate) fn corner_position(&self, corner: Corner) -> Point3 {
        match corner {
            Corner::Point(p) => local(p),
            Corner::Centre(k) => self.centre_of(self.leaf(self.split_leaves[k as usize])),
        }
    }

    /// The ghost cells of a box that is part of the mesh, in order.
    /// By leaf, then by face, then by half: what [`Numbering`] and the dual vertices search in.
    pub(crate) fn ghosts(&self) -> Vec<(u32, u8)> {
        parallel::flat_map(self.tree.leaves.len(), |id| {
            let id = id as u32;
            let leaf = self.leaf(id);
            let (o, s) = (leaf.origin(), leaf.size());
            let halves = if self.is_split(id) { 2 } else { 1 };
            let outer = move |face: usize| {
                let (axis, side) = (face / 2, face % 2);
                !leaf.void
                    && if side == 0 {
                        o[axis] == 0
                    } else {
                        o[axis] + s == self.tree.cells[axis]
                    }
            };
            (0..6usize)
                .filter(move |&f| outer(f))
                .flat_map(move |f| (0..halves).map(move |h| (id, (2 * f + h) as u8)))
        })
    }
}
