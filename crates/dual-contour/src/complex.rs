//! The base complex: one object behind every mesh.
//!
//! Its cells are the leaves of the octree, seen as polyhedra whose corners include hanging lattice
//! points; leaves whose labels are not *simple* are cut into twelve tetrahedra. Around each edge of
//! the complex the cells stand in a ring, counter-clockwise about the edge; edge and consecutive
//! cells span the base tetrahedra. Where the ring is open, at the box, it begins and ends with a
//! ghost: a flat cell on the face of the box.

use geom_core::Point3;
use geom_core::mesh::{INTERIOR, Region};
use rayon::prelude::*;

use crate::cut::PATTERNS;
use crate::octree::{Leaf, NONE, Octree};
use crate::samples::{Samples, local};

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
    pub(crate) a: (Corner, Region),
    pub(crate) b: (Corner, Region),
    pub(crate) cells: &'a [Cell],
    /// Does the ring begin and end with ghosts?
    pub(crate) open: bool,
    /// The diagonal between the cells `k` and `k + 2` of a ring of four that another edge may use.
    pub(crate) taken: Option<u8>,
}

const SIMPLE: u8 = 0;
const INTERFACE: u8 = 1;
const SPLIT: u8 = 2;

/// The leaves with their labels: which carry the surface, which are split.
pub(crate) struct Complex<'a> {
    pub(crate) samples: &'a Samples<'a>,
    pub(crate) tree: &'a Octree,
    kind: Vec<u8>,
    /// Split leaves in order, and how they are cut.
    pub(crate) split_leaves: Vec<u32>,
    pub(crate) splits: Vec<Split>,
}

/// A finest cell cut into twelve tetrahedra: its middle and the triangles of its faces.
#[derive(Clone, Debug)]
pub(crate) struct Split {
    pub(crate) label: Region,
    /// Value at the middle.
    pub(crate) value: f64,
    /// Bit `face`: the diagonal joins the corners 1 and 3 of the face, not 0 and 2.
    pub(crate) diagonals: u8,
}

/// Offsets of the corners of a cube: bit 0 is x, bit 1 is y, bit 2 is z.
pub(crate) fn corner_of(i: usize) -> [i32; 3] {
    [i & 1, i >> 1 & 1, i >> 2 & 1].map(|c| c as i32)
}

/// The corners of face `2 · axis + side` of the unit cube, counter-clockwise about the axis.
fn face_corners(face: usize) -> [usize; 4] {
    let (axis, side) = (face / 2, face % 2);
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let low = side << axis;
    [low, low | u, low | u | v, low | v]
}

/// The corners of a face of a cube, or all.
pub(crate) fn corners_of(face: Option<usize>) -> Vec<usize> {
    match face {
        Some(face) => face_corners(face).to_vec(),
        None => (0..8).collect(),
    }
}

/// The corners of a half of a face, given the diagonals of a cell.
pub(crate) fn triangle_of(diagonals: u8, part: usize) -> [usize; 3] {
    let f = face_corners(part / 2);
    match (diagonals >> (part / 2) & 1, part % 2) {
        (0, 0) => [f[0], f[1], f[2]],
        (0, _) => [f[0], f[2], f[3]],
        (_, 0) => [f[0], f[1], f[3]],
        _ => [f[1], f[2], f[3]],
    }
}

/// The ends of the diagonal of a face.
pub(crate) fn diagonal_of(diagonals: u8, face: usize) -> [usize; 2] {
    let f = face_corners(face);
    if diagonals >> face & 1 == 0 {
        [f[0], f[2]]
    } else {
        [f[1], f[3]]
    }
}

/// The half of a face that has both corners.
pub(crate) fn half_of(diagonals: u8, face: usize, p: usize, q: usize) -> u8 {
    let t = triangle_of(diagonals, 2 * face);
    (2 * face + usize::from(!(t.contains(&p) && t.contains(&q)))) as u8
}

/// The parts around the edge from the middle of a cell to a corner, counter-clockwise about it.
pub(crate) fn parts_around(diagonals: u8, corner: usize) -> Vec<u8> {
    let axis = (local(corner_of(corner)) - MIDDLE).normalize();
    let u = axis.cross(&geom_core::Vector3::x()).normalize();
    let v = axis.cross(&u);
    let mut parts: Vec<(f64, u8)> = (0..12u8)
        .filter(|&part| triangle_of(diagonals, part as usize).contains(&corner))
        .map(|part| {
            let d = part_base(diagonals, [0; 3], part as usize) - MIDDLE;
            (d.dot(&v).atan2(d.dot(&u)), part)
        })
        .collect();
    parts.sort_by(|x, y| x.0.total_cmp(&y.0));
    parts.into_iter().map(|(_, part)| part).collect()
}

/// Where a part of the finest cell at `o` stands before it moves to the surface, in finest cells.
pub(crate) fn part_base(diagonals: u8, o: [i32; 3], part: usize) -> Point3 {
    let o = local(o).coords;
    let corners = triangle_of(diagonals, part).map(|i| local(corner_of(i)).coords + o);
    let sum = corners.iter().fold(MIDDLE.coords + o, |s, c| s + c);
    Point3::from(sum / 4.0)
}

/// The middle of the unit cube.
pub(crate) const MIDDLE: Point3 = Point3::new(0.5, 0.5, 0.5);

impl Split {
    /// How the finest cell at `o` is cut. What its middle belongs to follows from its corners alone, so
    /// that a field that also tells the value there moves vertices but joins or parts nothing.
    pub(crate) fn new(samples: &Samples<'_>, o: [i32; 3], labels: &[Region; 8]) -> Self {
        let level = samples.labels.level;
        let values: [f64; 8] = std::array::from_fn(|i| {
            let p = corner_of(i);
            samples.value([0, 1, 2].map(|k| o[k] + p[k])) - level
        });
        let value = values.iter().sum::<f64>() / 8.0 + level;
        let mut diagonals = 0;
        for face in 0..6 {
            let f = face_corners(face);
            diagonals |= u8::from(joins_one_and_three(samples, o, f, labels, &values)) << face;
        }
        let middle = samples.domain.world(&(MIDDLE + local(o).coords));
        Self {
            label: samples.labels.at(value, &middle),
            value,
            diagonals,
        }
    }

    /// The corners of a half of a face.
    pub(crate) fn triangle(&self, part: usize) -> [usize; 3] {
        triangle_of(self.diagonals, part)
    }

    /// The half of a face that has both corners.
    fn half(&self, face: usize, p: usize, q: usize) -> u8 {
        half_of(self.diagonals, face, p, q)
    }
}

/// Which diagonal cuts a face: decided by the face alone, so that both sides agree.
fn joins_one_and_three(
    samples: &Samples<'_>,
    o: [i32; 3],
    f: [usize; 4],
    labels: &[Region; 8],
    values: &[f64; 8],
) -> bool {
    let l = f.map(|i| labels[i]);
    if l[0] == l[2] && l[1] == l[3] && l[0] != l[1] {
        if l.contains(&INTERIOR) {
            // The value at the saddle of the bilinear interpolant joins the pair of its sign.
            let v = f.map(|i| values[i]);
            let saddle = (v[0] * v[2] - v[1] * v[3]) / (v[0] + v[2] - v[1] - v[3]);
            return (saddle >= 0.0) != (v[0] >= 0.0);
        }
        let middle = f.iter().fold(Point3::origin(), |m, &i| {
            let p = corner_of(i);
            m + local([0, 1, 2].map(|k| o[k] + p[k])).coords * 0.25
        });
        let mean = f.iter().map(|&i| values[i]).sum::<f64>() / 4.0 + samples.labels.level;
        return samples.labels.at(mean, &samples.domain.world(&middle)) == l[1];
    }
    l[0] != l[2] && l[1] == l[3]
}

/// The labels on the half lattice of a leaf: 27 points, of which the eight corners and the hanging
/// ones are used. The middle never is.
pub(crate) struct Frame {
    pub(crate) used: u32,
    pub(crate) labels: [Region; 27],
}

/// Index of a half-lattice point from its three coordinates in 0…2.
const fn half_index(p: [usize; 3]) -> usize {
    p[0] + 3 * p[1] + 9 * p[2]
}

impl Frame {
    /// The edges between used points on the boundary of the leaf: neighbours on the half lattice, or
    /// the ends of an edge whose middle is not used.
    pub(crate) fn edges(&self, mut f: impl FnMut(usize, usize)) {
        let used = |i: usize| self.used >> i & 1 == 1;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for j in 0..3 {
                for k in 0..3 {
                    if j == 1 && k == 1 {
                        continue;
                    }
                    let at = |i: usize| {
                        let mut p = [0; 3];
                        (p[axis], p[u], p[v]) = (i, j, k);
                        half_index(p)
                    };
                    let (low, middle, high) = (at(0), at(1), at(2));
                    if used(middle) {
                        if used(low) {
                            f(low, middle);
                        }
                        if used(high) {
                            f(middle, high);
                        }
                    } else if j != 1 && k != 1 {
                        f(low, high);
                    }
                }
            }
        }
    }

    /// Is the set of points of every label connected, and that of all others?
    fn is_simple(&self) -> bool {
        let mut labels = [self.labels[0]; 27];
        let mut n = 1;
        for i in (1..27).filter(|i| self.used >> i & 1 == 1) {
            if !labels[..n].contains(&self.labels[i]) {
                labels[n] = self.labels[i];
                n += 1;
            }
        }
        // Of two labels, the others of each are the other.
        let labels = if n == 2 { &labels[..1] } else { &labels[..n] };
        labels.iter().all(|&label| self.parts(label) <= 2)
    }

    /// Into how many connected parts one label divides the points: its own, and those of all others.
    fn parts(&self, label: Region) -> usize {
        let mut group: [u8; 27] = std::array::from_fn(|i| i as u8);
        fn root(group: &mut [u8; 27], mut i: usize) -> usize {
            while group[i] as usize != i {
                group[i] = group[group[i] as usize];
                i = group[i] as usize;
            }
            i
        }
        self.edges(|a, b| {
            if (self.labels[a] == label) == (self.labels[b] == label) {
                let (a, b) = (root(&mut group, a), root(&mut group, b));
                group[a.max(b)] = a.min(b) as u8;
            }
        });
        (0..27)
            .filter(|&i| self.used >> i & 1 == 1 && usize::from(group[i]) == i)
            .count()
    }

    fn is_uniform(&self) -> bool {
        (0..27)
            .filter(|i| self.used >> i & 1 == 1)
            .all(|i| self.labels[i] == self.labels[0])
    }
}

/// For each pattern of corner signs of a cube: are the corners of each sign connected?
pub(crate) fn simple_masks() -> [bool; 256] {
    std::array::from_fn(|mask| {
        let connected = |set: usize| {
            let mut reached = set & set.wrapping_neg();
            loop {
                let mut next = reached;
                for i in (0..8).filter(|i| reached >> i & 1 == 1) {
                    next |= set & (1 << (i ^ 1) | 1 << (i ^ 2) | 1 << (i ^ 4));
                }
                if next == reached {
                    return reached == set;
                }
                reached = next;
            }
        };
        connected(mask) && connected(!mask & 255)
    })
}

/// What each leaf is: simple, an interface, or to be split.
pub(crate) struct Kinds(Vec<u8>);

impl Kinds {
    /// Judges all leaves; if `finest`, only the finest carry interfaces.
    pub(crate) fn of(samples: &Samples<'_>, tree: &Octree, finest: bool) -> Self {
        let masks = simple_masks();
        let view = Complex {
            samples,
            tree,
            kind: Vec::new(),
            split_leaves: Vec::new(),
            splits: Vec::new(),
        };
        let kinds = (0..tree.leaves.len() as u32)
            .into_par_iter()
            .with_min_len(1024)
            .map(|id| {
                if finest && tree.leaves[id as usize].log > 0 {
                    SIMPLE
                } else {
                    view.kind_of(id, &masks)
                }
            })
            .collect();
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
        out.splits = out
            .split_leaves
            .par_iter()
            .map(|&id| {
                let leaf = &tree.leaves[id as usize];
                Split::new(samples, leaf.origin(), &out.corner_labels(leaf))
            })
            .collect();
        out
    }

    fn block_is_uniform(&self, leaf: &Leaf) -> bool {
        let b = leaf.origin().map(|c| c >> 3);
        self.samples
            .slot(crate::octree::block_index(self.tree.blocks, b))
            .is_none()
    }

    /// Does the boundary of the leaf have corners of more than one label?
    pub(crate) fn is_interface(&self, leaf: u32) -> bool {
        self.kind[leaf as usize] & INTERFACE != 0
    }

    pub(crate) fn is_split(&self, leaf: u32) -> bool {
        self.kind[leaf as usize] & SPLIT != 0
    }

    /// Does a leaf have a face on the box?
    pub(crate) fn is_on_box(&self, id: u32) -> bool {
        let leaf = self.leaf(id);
        let (o, s) = (leaf.origin(), leaf.size());
        (0..3).any(|k| o[k] == 0 || o[k] + s == self.tree.cells[k])
    }

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
        let (o, s) = (leaf.origin(), leaf.size());
        std::array::from_fn(|i| {
            let p = corner_of(i);
            self.samples.label([0, 1, 2].map(|k| o[k] + s * p[k]))
        })
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

    /// The rings of the edges that this leaf owns: lattice edges, and if it is split the diagonals of
    /// its faces and the edges to its middle. `wanted` is asked for the labels of both ends first.
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

    fn lattice_rings(
        &self,
        id: u32,
        leaf: &Leaf,
        labels: &[Region; 8],
        wanted: &impl Fn(Region, Region) -> bool,
        f: &mut impl FnMut(&Ring),
    ) {
        let (o, s) = (leaf.origin(), leaf.size());
        // Quadrants about the axis: 0 (−,−), 1 (+,−), 2 (+,+), 3 (−,+).
        const QUADRANT: [[i32; 2]; 4] = [[-1, -1], [0, -1], [0, 0], [-1, 0]];
        // Who owns an edge: the first of these that has its size.
        const ORDER: [usize; 4] = [2, 3, 1, 0];
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for mine in ORDER {
                let (du, dv) = (-QUADRANT[mine][0], -QUADRANT[mine][1]);
                let low = ((du as usize) << u) | ((dv as usize) << v);
                let (la, lb) = (labels[low], labels[low | 1 << axis]);
                if !wanted(la, lb) {
                    continue;
                }
                let mut start = o;
                start[u] += du * s;
                start[v] += dv * s;
                let mut found = [(NONE, u8::MAX); 4];
                let mut owner = true;
                let mut before = true;
                for q in ORDER {
                    if q == mine {
                        found[q] = (id, leaf.log);
                        before = false;
                        continue;
                    }
                    let mut cell = start;
                    cell[u] += QUADRANT[q][0];
                    cell[v] += QUADRANT[q][1];
                    found[q] = self.tree.find(cell);
                    if found[q].1 < leaf.log || before && found[q].1 == leaf.log {
                        owner = false;
                        break;
                    }
                }
                if !owner {
                    continue;
                }
                let mut end = start;
                end[axis] += s;
                self.ring(
                    axis,
                    low,
                    start,
                    found,
                    (Corner::Point(start), la),
                    (Corner::Point(end), lb),
                    leaf.log,
                    f,
                );
            }
        }
    }

    /// Puts the cells around a lattice edge in order.
    #[expect(clippy::too_many_arguments, reason = "the pieces of one edge")]
    fn ring(
        &self,
        axis: usize,
        _low: usize,
        start: [i32; 3],
        found: [(u32, u8); 4],
        a: (Corner, Region),
        b: (Corner, Region),
        log: u8,
        f: &mut impl FnMut(&Ring),
    ) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        // The face of a cell in quadrant q towards the quadrant before and after it.
        let before = [2 * v + 1, 2 * u, 2 * v, 2 * u + 1];
        let after = [2 * u + 1, 2 * v + 1, 2 * u, 2 * v];
        let open = found.iter().any(|c| c.0 == NONE);
        // An open ring begins after the box.
        let first = if open {
            (0..4)
                .find(|&q| found[q].0 != NONE && found[(q + 3) % 4].0 == NONE)
                .expect("an edge has a cell")
        } else {
            0
        };
        // Corners of the edge in the unit cube of a finest cell in quadrant q.
        let ends = |q: usize| {
            let low = [[1, 1], [0, 1], [0, 0], [1, 0]][q];
            let p = low[0] << u | low[1] << v;
            (p, p | 1 << axis)
        };
        let mut cells = [Cell::Leaf(NONE); 10];
        let mut n = 0;
        let mut push = |c: Cell| {
            cells[n] = c;
            n += 1;
        };
        let ghost = |q: usize, face: usize| {
            let id = found[q].0;
            if self.is_split(id) {
                let (p, r) = ends(q);
                Cell::Ghost(id, self.splits[self.split_of(id) as usize].half(face, p, r))
            } else {
                Cell::Ghost(id, 2 * face as u8)
            }
        };
        if open {
            push(ghost(first, before[first]));
        }
        let mut last_quadrant = first;
        let mut previous = NONE;
        for i in 0..4 {
            let q = (first + i) % 4;
            let id = found[q].0;
            if id == NONE {
                break;
            }
            last_quadrant = q;
            if self.is_split(id) {
                let k = self.split_of(id);
                let (p, r) = ends(q);
                let split = &self.splits[k as usize];
                push(Cell::Part(k, split.half(before[q], p, r)));
                push(Cell::Part(k, split.half(after[q], p, r)));
            } else if id != previous && !(i == 3 && !open && id == found[first].0) {
                push(Cell::Leaf(id));
            }
            previous = id;
        }
        if open {
            push(ghost(last_quadrant, after[last_quadrant]));
        }
        // Two larger cells face each other across both halves of their common edge: the upper half
        // leaves their diagonal to the lower one.
        let mut taken = None;
        if n == 4 && !open {
            for k in 0..2 {
                let larger = |q: usize| found[q].1 > log;
                if larger(k) && larger(k + 2) && start[axis] >> log & 1 == 1 {
                    taken = Some(k as u8);
                }
            }
        }
        f(&Ring {
            a,
            b,
            cells: &cells[..n],
            open,
            taken,
        });
    }

    /// The diagonals of the faces of a split leaf; one between two split leaves belongs to the lower.
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
                taken: None,
            });
        }
    }

    /// The edges from the middle of a split leaf to its corners.
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
            let parts = &PATTERNS[usize::from(split.diagonals)].around[corner];
            let cells: Vec<Cell> = parts.iter().map(|&part| Cell::Part(k, part)).collect();
            f(&Ring {
                a: (Corner::Centre(k), split.label),
                b: (Corner::Point(p), label),
                cells: &cells,
                open: false,
                taken: None,
            });
        }
    }

    /// Where the point of a cell stands before it moves to the surface, in finest cells.
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
                    let sum = split.triangle(half as usize).iter().fold(
                        geom_core::Vector3::zeros(),
                        |s, &i| {
                            let p = corner_of(i);
                            s + local([0, 1, 2].map(|k| o[k] + p[k])).coords
                        },
                    );
                    return Point3::from(sum / 3.0);
                }
                let mut p = self.centre_of(leaf);
                p[face / 2] = f64::from(o[face / 2]) + if face % 2 == 1 { s } else { 0.0 };
                p
            }
        }
    }

    /// Position and label of a corner, in finest cells.
    pub(crate) fn corner_position(&self, corner: Corner) -> Point3 {
        match corner {
            Corner::Point(p) => local(p),
            Corner::Centre(k) => self.centre_of(self.leaf(self.split_leaves[k as usize])),
        }
    }
}

pub(crate) fn frame_of_corners(corners: &[Region; 8]) -> Frame {
    let mut frame = Frame {
        used: 0,
        labels: [0; 27],
    };
    for (i, &label) in corners.iter().enumerate() {
        let j = half_index([2 * (i & 1), 2 * (i >> 1 & 1), 2 * (i >> 2)]);
        frame.used |= 1 << j;
        frame.labels[j] = label;
    }
    frame
}
