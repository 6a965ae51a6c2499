//! Which squares of fine quads could be one element: a forest of blocks of 2^l × 2^l quads.
//!
//! A block of level l + 1 is made of the four blocks of level l around one vertex, its centre. On a plane grid a
//! quarter of all vertices could be centres, in four ways, by whether their two coordinates are even or odd; which of
//! these one takes matters, since an extraordinary vertex has to be a corner of blocks. So each block gets a *label*,
//! the number of its corner that is to be the centre, and a label is carried from block to block across sides: next to
//! each other their centres are the same or mirror each other. Where a way around does not bring the label back that
//! one set out with, blocks do not fit together, and some quads have no block of this level. That is no fault: elements
//! there stay smaller.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use geom_core::mesh::Halfedges;
use geom_core::{HalfedgeId, VertexId};

/// No block, no element, no vertex.
pub const NONE: u32 = u32::MAX;

/// A square of 2^l × 2^l fine quads without an extraordinary vertex inside or within a side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Fine vertices at the corners, counter-clockwise.
    pub corners: [u32; 4],
    /// The fine half-edge that leaves each corner along the side that begins there, with the block on its left.
    pub sides: [HalfedgeId; 4],
}

/// All blocks of one level.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Blocks {
    pub(crate) list: Vec<Block>,
    /// Per fine quad its block, or [`NONE`].
    pub(crate) of_quad: Vec<u32>,
    /// Per block the level that its quads allow at most.
    allowed: Vec<u8>,
}

/// Blocks by level, each made of four of the level below; level 0 is the fine quads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Forest {
    pub(crate) levels: Vec<Blocks>,
}

/// Interior vertices of four quads and boundary vertices of two: lines of the mesh go straight through them.
pub(crate) fn is_regular(edges: &Halfedges<4>, v: u32) -> bool {
    let around = edges.around(VertexId(v)).count();
    around == if edges.on_boundary(VertexId(v)) { 2 } else { 4 }
}

/// So many half-edges one after the other on a straight line, from `start` on; the quads on their left belong to one
/// block.
/// At a boundary it ends early.
pub(crate) fn straight(
    edges: &Halfedges<4>,
    start: HalfedgeId,
    count: u32,
) -> impl Iterator<Item = HalfedgeId> + '_ {
    let ahead = |h: &HalfedgeId| edges.twin(edges.next(*h)).map(|t| edges.next(t));
    std::iter::successors(Some(start), ahead).take(count as usize)
}

/// The lower half-edges of the quads of a block of `size × size`, row by row.
/// From the side that `start` begins, upwards; columns run along it.
pub(crate) fn rows(
    edges: &Halfedges<4>,
    start: HalfedgeId,
    size: u32,
) -> impl Iterator<Item = impl Iterator<Item = HalfedgeId> + '_> + '_ {
    let above = |h: &HalfedgeId| edges.twin(edges.next(edges.next(*h)));
    std::iter::successors(Some(start), above)
        .take(size as usize)
        .map(move |first| straight(edges, first, size))
}

impl Forest {
    /// All blocks up to the highest level that a quad allows. Where blocks do not fit together (two extraordinary
    /// vertices an odd number of quads apart), the place of the misfit is chosen far from what may be coarse.
    ///
    /// Levels end with the first of which there is no block. The time is n log n for n quads; each level above has a
    /// quarter of the blocks.
    pub(crate) fn new(edges: &Halfedges<4>, allowed: &[u8]) -> Self {
        let fine = (0..edges.faces() as u32).map(|q| {
            let sides = [0, 1, 2, 3].map(|k| HalfedgeId(4 * q + k));
            let corners = sides.map(|h| edges.from(h).0);
            Block { corners, sides }
        });
        let mut levels = vec![Blocks {
            list: fine.collect(),
            of_quad: (0..edges.faces() as u32).collect(),
            allowed: allowed.to_vec(),
        }];
        let most = allowed.iter().copied().max().unwrap_or(0);
        let regular: Vec<bool> = (0..edges.vertices() as u32)
            .map(|v| is_regular(edges, v))
            .collect();
        for level in 1..=most {
            let next =
                Pairing::new(edges, &regular, &levels[usize::from(level) - 1], level).parents();
            if next.list.is_empty() {
                break;
            }
            levels.push(next);
        }
        Self { levels }
    }

    /// Do the blocks of a level at two quads share a whole side?
    pub(crate) fn beside(&self, edges: &Halfedges<4>, level: u8, a: u32, b: u32) -> bool {
        let blocks = &self.levels[usize::from(level)];
        let [a, b] = [a, b].map(|q| blocks.of_quad[q as usize]);
        let across = |k: usize| {
            blocks
                .across(edges, a, k)
                .is_some_and(|(other, _)| other == b)
        };
        b != NONE && (0..4).any(across)
    }

    /// The level that each fine quad allows at most.
    pub(crate) fn allowed(&self) -> &[u8] {
        &self.levels[0].allowed
    }

    /// Per block of a level, whether so many rings of blocks of this level lie around it, and all of it may be this
    /// coarse.
    ///
    /// Breadth first from the corners that are not all around blocks of this level: each step is a ring.
    pub(crate) fn usable(&self, edges: &Halfedges<4>, level: usize, rings: u32) -> Vec<bool> {
        let blocks = &self.levels[level];
        let mut depth = vec![NONE; edges.vertices()];
        let mut queue = VecDeque::new();
        for v in blocks.list.iter().flat_map(|b| b.corners) {
            let whole = edges
                .around(VertexId(v))
                .all(|h| blocks.cornered(edges, h).is_some());
            if !whole && depth[v as usize] == NONE {
                depth[v as usize] = 0;
                queue.push_back(v);
            }
        }
        while let Some(v) = queue.pop_front() {
            let next = depth[v as usize] + 1;
            for b in edges
                .around(VertexId(v))
                .filter_map(|h| blocks.cornered(edges, h))
            {
                for w in blocks.list[b as usize].corners {
                    if depth[w as usize] == NONE {
                        depth[w as usize] = next;
                        queue.push_back(w);
                    }
                }
            }
        }
        let enough = |(block, &allowed): (&Block, &u8)| {
            usize::from(allowed) >= level
                && block.corners.iter().all(|&v| depth[v as usize] >= rings)
        };
        blocks
            .list
            .iter()
            .zip(&blocks.allowed)
            .map(enough)
            .collect()
    }
}

impl Blocks {
    /// The block that has a corner where a fine half-edge begins, in the quad on its left.
    fn cornered(&self, edges: &Halfedges<4>, h: HalfedgeId) -> Option<u32> {
        let b = self.of_quad[edges.face(h).0 as usize];
        (b != NONE && self.list[b as usize].sides.contains(&h)).then_some(b)
    }

    /// The block across a whole side, and its side there.
    /// `None` at a boundary, and where blocks of this level do not share the side from end to end.
    fn across(&self, edges: &Halfedges<4>, block: u32, side: usize) -> Option<(u32, usize)> {
        let twin = edges.twin(self.list[block as usize].sides[side])?;
        let other = self.of_quad[edges.face(twin).0 as usize];
        if other == NONE {
            return None;
        }
        let sides = self.list[other as usize].sides;
        let last = |k: &usize| edges.previous(sides[(k + 1) % 4]) == twin;
        (0..4).find(last).map(|k| (other, k))
    }
}

/// Four blocks make one of the next level: which of their corners is its centre?
struct Pairing<'a> {
    edges: &'a Halfedges<4>,
    regular: &'a [bool],
    blocks: &'a Blocks,
    level: u8,
    across: Vec<[Option<(u32, usize)>; 4]>,
    /// Steps to the nearest block that must not be merged.
    depth: Vec<u32>,
    /// May the block be part of a coarse element, or support one?
    counts: Vec<bool>,
}

/// Blocks within so many steps of a wanted one count: twice the rings that bases need.
const SUPPORT: u32 = 6;
/// How many elements are lost with a quad at an extraordinary vertex that is no corner of a block: a quarter of 7 × 7.
const LOST: i64 = 12;

impl<'a> Pairing<'a> {
    fn new(edges: &'a Halfedges<4>, regular: &'a [bool], blocks: &'a Blocks, level: u8) -> Self {
        let across = (0..blocks.list.len() as u32)
            .map(|b| [0, 1, 2, 3].map(|k| blocks.across(edges, b, k)))
            .collect();
        let mut pairing = Self {
            edges,
            regular,
            blocks,
            level,
            across,
            depth: Vec::new(),
            counts: Vec::new(),
        };
        let all = 0..blocks.list.len();
        pairing.depth = pairing.steps(all.clone().map(|b| pairing.is_hindered(b)));
        let to_wanted = pairing.steps(all.map(|b| pairing.wanted(b)));
        pairing.counts = to_wanted.iter().map(|&s| s <= SUPPORT).collect();
        pairing
    }

    /// Do all of its quads allow the next level?
    fn wanted(&self, block: usize) -> bool {
        self.blocks.allowed[block] >= self.level
    }

    /// Nothing beside it, an extraordinary vertex at a corner, or to be kept fine.
    fn is_hindered(&self, b: usize) -> bool {
        let block = &self.blocks.list[b];
        let open = |k: usize| self.edges.twin(block.sides[k]).is_some();
        let lone = (0..4).any(|k| self.across[b][k].is_none() && open(k));
        lone || block.corners.iter().any(|&v| !self.regular[v as usize]) || !self.wanted(b)
    }

    /// Steps from block to block to the nearest of some; [`NONE`] where there is no way.
    fn steps(&self, from: impl Iterator<Item = bool>) -> Vec<u32> {
        let mut steps: Vec<u32> = from.map(|is| if is { 0 } else { NONE }).collect();
        let starts = (0..steps.len()).filter(|&b| steps[b] == 0);
        let mut queue: VecDeque<usize> = starts.collect();
        while let Some(b) = queue.pop_front() {
            for (other, _) in self.across[b].into_iter().flatten() {
                if steps[other as usize] == NONE {
                    steps[other as usize] = steps[b] + 1;
                    queue.push_back(other as usize);
                }
            }
        }
        steps
    }

    /// The next level: in each connected part, the one of four ways to pair that gives the most wanted blocks.
    fn parents(&self) -> Blocks {
        let count = self.blocks.list.len();
        let mut centre = vec![u8::MAX; count];
        let mut roots: Vec<u32> = (0..count as u32).collect();
        roots.sort_by_key(|&b| (Reverse(self.depth[b as usize]), b));
        for root in roots {
            if centre[root as usize] == u8::MAX {
                self.label_part(root, &mut centre);
            }
        }
        let mut parents = self.merged(&centre, 0..count as u32);
        self.drop_double_sides(&mut parents);
        let mut next = Blocks {
            of_quad: vec![NONE; self.edges.faces()],
            ..Blocks::default()
        };
        let mut parent_of = vec![NONE; count];
        for (parent, children) in parents {
            for child in children {
                parent_of[child as usize] = next.list.len() as u32;
            }
            let allowed = children.map(|c| self.blocks.allowed[c as usize]);
            next.allowed.push(allowed.into_iter().min().expect("four"));
            next.list.push(parent);
        }
        for (of, &block) in next.of_quad.iter_mut().zip(&self.blocks.of_quad) {
            if block != NONE {
                *of = parent_of[block as usize];
            }
        }
        next
    }

    /// Labels all blocks that hang together with `root`: across a maximum spanning tree of depths, so that labels that
    /// do not agree meet where nothing is to be merged.
    ///
    /// All four labels of the root are tried. The first score counts blocks that elements or their neighbourhoods need,
    /// less what is lost around extraordinary vertices; then blocks of which elements may be made; then all.
    fn label_part(&self, root: u32, centre: &mut [u8]) {
        let mut order = Vec::new();
        let mut heap = BinaryHeap::from([(NONE, Reverse(root), None)]);
        while let Some((_, Reverse(block), from)) = heap.pop() {
            if centre[block as usize] != u8::MAX {
                continue;
            }
            // The label of the root is chosen below.
            centre[block as usize] = 0;
            order.push((block, from));
            for side in 0..4 {
                if let Some((other, there)) = self.across[block as usize][side]
                    && centre[other as usize] == u8::MAX
                {
                    let depth = self.depth[block as usize].min(self.depth[other as usize]);
                    heap.push((depth, Reverse(other), Some((block, side, there))));
                }
            }
        }
        let blocks: Vec<u32> = order.iter().map(|o| o.0).collect();
        let mut best = ([i64::MIN; 3], 0);
        for choice in 0..4 {
            self.spread(&order, choice, centre);
            let made = self.merged(centre, blocks.iter().copied());
            let with = |holds: &dyn Fn(usize) -> bool| {
                let all = |m: &&(Block, [u32; 4])| m.1.iter().all(|&c| holds(c as usize));
                made.iter().filter(all).count()
            };
            // An element needs blocks of its level around it, whether or not they are elements; none are around an
            // extraordinary vertex that is no corner of them.
            let supporting = with(&|b| self.counts[b]) as i64;
            let lost = blocks
                .iter()
                .filter(|&&b| self.misses_corner(b, centre))
                .count() as i64;
            let score = [
                supporting - LOST * lost,
                with(&|b| self.wanted(b)) as i64,
                made.len() as i64,
            ];
            if score > best.0 {
                best = (score, choice);
            }
        }
        self.spread(&order, best.1, centre);
    }

    /// Has the block an extraordinary vertex that is no corner of its parent?
    fn misses_corner(&self, block: u32, centre: &[u8]) -> bool {
        let outer = (usize::from(centre[block as usize]) + 2) % 4;
        let corners = self.blocks.list[block as usize].corners;
        let misses = |k: usize| k != outer && !self.regular[corners[k] as usize];
        self.counts[block as usize] && (0..4).any(misses)
    }

    /// Labels of a tree whose root has this one. Across a side, the centre is the same if it lies on that side, and
    /// mirrored to the far side otherwise.
    fn spread(&self, order: &[Step], choice: u8, centre: &mut [u8]) {
        for &(block, from) in order {
            centre[block as usize] = match from {
                None => choice,
                Some((parent, side, there)) => {
                    let seen = (usize::from(centre[parent as usize]) + 4 - side) % 4;
                    ((there + [1, 0, 3, 2][seen]) % 4) as u8
                }
            };
        }
    }

    /// The blocks of the next level that these labels make, with their children; each once.
    fn merged(&self, centre: &[u8], of: impl Iterator<Item = u32>) -> Vec<(Block, [u32; 4])> {
        of.filter_map(|b| self.parent(centre, b)).collect()
    }

    /// The parent of a block, if it is the lowest of the four.
    ///
    /// Four blocks have the same centre if a turn around it meets four labels that name it. There is no parent where
    /// the centre or the middle of a side is not regular, or where two of the nine vertices are the same.
    fn parent(&self, centre: &[u8], lowest: u32) -> Option<(Block, [u32; 4])> {
        let edges = self.edges;
        let mut children = [lowest; 4];
        let mut h = self.blocks.list[lowest as usize].sides[usize::from(centre[lowest as usize])];
        let start = h;
        let v = edges.from(h);
        if edges.on_boundary(v) || !self.regular[v.0 as usize] {
            return None;
        }
        for child in &mut children {
            *child = self.blocks.cornered(edges, h)?;
            let own = &self.blocks.list[*child as usize];
            if *child < lowest || own.sides[usize::from(centre[*child as usize])] != h {
                return None;
            }
            h = edges.twin(edges.previous(h))?;
        }
        debug_assert_eq!(h, start);
        let corner = |i: usize, by: usize| {
            let child = children[i] as usize;
            (
                &self.blocks.list[child],
                (usize::from(centre[child]) + by) % 4,
            )
        };
        let sides = [0, 1, 2, 3].map(|i| {
            let (block, k) = corner(i, 2);
            block.sides[k]
        });
        let corners = sides.map(|h| edges.from(h).0);
        let middles = [0, 1, 2, 3].map(|i| {
            let (block, k) = corner(i, 3);
            block.corners[k]
        });
        if middles.iter().any(|&m| !self.regular[m as usize]) {
            return None;
        }
        let mut all = [[v.0; 4], corners, middles].concat();
        all.sort_unstable();
        all.dedup();
        (all.len() == 9).then_some((Block { corners, sides }, children))
    }

    /// Two ways between the same corners, as around a thin tube, would be one edge of a coarse mesh: blocks of such
    /// sides go.
    fn drop_double_sides(&self, parents: &mut Vec<(Block, [u32; 4])>) {
        let mut sides: Vec<(u32, u32, u32, usize)> = Vec::with_capacity(4 * parents.len());
        for (p, (block, children)) in parents.iter().enumerate() {
            for (k, &child) in children.iter().enumerate() {
                let (a, b) = (block.corners[k], block.corners[(k + 1) % 4]);
                let child = &self.blocks.list[child as usize];
                let at = child.sides.iter().position(|&h| h == block.sides[k]);
                let middle = child.corners[(at.expect("a side of the child") + 1) % 4];
                sides.push((a.min(b), a.max(b), middle, p));
            }
        }
        sides.sort_unstable();
        let mut bad = vec![false; parents.len()];
        for group in sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            if group.iter().any(|s| s.2 != group[0].2) {
                for side in group {
                    bad[side.3] = true;
                }
            }
        }
        let mut bad = bad.into_iter();
        parents.retain(|_| !bad.next().expect("one each"));
    }
}

/// A block, and from where it is labelled: that block, its side there, our side.
type Step = (u32, Option<(u32, usize, usize)>);
