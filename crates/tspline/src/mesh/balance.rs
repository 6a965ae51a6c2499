//! Which blocks become elements.
//!
//! Every fine quad says how large the element that holds it may be, and belongs to one block of each size. The search begins with the
//! largest blocks that all their quads allow. A side between elements two levels apart would have three T-junctions, more than
//! functions can see past; so the larger one is split into its four children, which may break the rule for its own neighbours, and so
//! on. Splitting only ever makes elements smaller, so that it ends.

use geom_core::mesh::Halfedges;
use geom_core::{HalfedgeId, VertexId};

use super::blocks::{Forest, NONE, rows, straight};
use super::is_extraordinary;

/// Per fine quad the level of its element: as coarse as allowed and supported; then what breaks a rule is split, until
/// nothing does.
///
/// - Elements that share a side differ by one level at most (the "strong balance" of the thesis).
/// - The elements within `rings` rings of an extraordinary vertex are of one level.
pub(crate) fn levels(edges: &Halfedges<4>, forest: &Forest, rings: u32) -> Vec<u8> {
    let mut cover = Cover {
        edges,
        forest,
        level: vec![0; edges.faces()],
    };
    for l in 1..forest.levels.len() {
        let usable = forest.usable(edges, l, rings);
        for (level, &block) in cover.level.iter_mut().zip(&forest.levels[l].of_quad) {
            if block != NONE && usable[block as usize] {
                *level = l as u8;
            }
        }
    }
    settled(cover, rings)
}

/// The same from the elements that there are, with those at some quads split into four.
pub(crate) fn cut(
    edges: &Halfedges<4>,
    forest: &Forest,
    level: Vec<u8>,
    quads: &[u32],
    rings: u32,
) -> Vec<u8> {
    let mut cover = Cover {
        edges,
        forest,
        level,
    };
    for &quad in quads {
        if cover.level[quad as usize] > 0 {
            cover.split(quad);
        }
    }
    settled(cover, rings)
}

/// The same from the elements that there are, with each four that are marked (by their quads) and that a block of the next
/// level may replace as that block, and without those that then break a rule.
pub(crate) fn merged(
    edges: &Halfedges<4>,
    forest: &Forest,
    mut level: Vec<u8>,
    marked: &[bool],
    rings: u32,
) -> Vec<u8> {
    let before = level.clone();
    for l in 1..forest.levels.len() {
        let blocks = &forest.levels[l];
        let usable = forest.usable(edges, l, rings);
        for (block, _) in blocks.list.iter().zip(usable).filter(|(_, usable)| *usable) {
            let quads = rows(edges, block.sides[0], 1 << l).flatten();
            let quads: Vec<usize> = quads.map(|h| edges.face(h).0 as usize).collect();
            let part = |&q: &usize| marked[q] && usize::from(before[q]) + 1 == l;
            if quads.iter().all(part) {
                quads.iter().for_each(|&q| level[q] = l as u8);
            }
        }
    }
    let cover = Cover {
        edges,
        forest,
        level,
    };
    settled(cover, rings)
}

/// Each round only splits, so that this ends.
fn settled(mut cover: Cover<'_>, rings: u32) -> Vec<u8> {
    let edges = cover.edges;
    let extraordinary: Vec<u32> = (0..edges.vertices() as u32)
        .filter(|&v| is_extraordinary(edges, v))
        .collect();
    let mut seen = vec![NONE; edges.faces()];
    loop {
        cover.balance();
        let mut split = false;
        for (i, &v) in (0u32..).zip(&extraordinary) {
            split |= cover.level_around(v, rings, i, &mut seen);
        }
        if !split {
            return cover.level;
        }
        seen.fill(NONE);
    }
}

/// Do blocks of these levels cover every quad once, neighbours a level apart at most and side on side?
pub(crate) fn is_cover(edges: &Halfedges<4>, forest: &Forest, level: &[u8]) -> bool {
    let there = |q: usize| {
        let blocks = forest.levels.get(usize::from(level[q]));
        blocks.is_some_and(|b| b.of_quad[q] != NONE)
    };
    if !(0..level.len()).all(there) {
        return false;
    }
    let cover = Cover {
        edges,
        forest,
        level: level.to_vec(),
    };
    let of = |q: u32| (level[q as usize], cover.start(q));
    // A block is looked at once, from where it begins; all others of its quads must be of that one.
    let whole = |q: u32| {
        let first = edges.face(cover.start(q)).0;
        let all = || cover.quads(q).into_iter().all(|other| of(other) == of(q));
        of(first) == of(q) && (first != q || all())
    };
    let fits = |h: HalfedgeId| {
        let Some(twin) = edges.twin(h) else {
            return true;
        };
        let (own, other) = (edges.face(h).0, edges.face(twin).0);
        let (l, m) = (level[own as usize], level[other as usize]);
        // Of a larger neighbour, a block of our level lies beside us.
        l.abs_diff(m) <= 1 && (l < m || of(own) == of(other) || forest.beside(edges, l, own, other))
    };
    (0..level.len() as u32).all(whole) && edges.iter().all(fits)
}

/// Levels that say of every quad which block its element is; the quads of an element agree.
struct Cover<'a> {
    edges: &'a Halfedges<4>,
    forest: &'a Forest,
    level: Vec<u8>,
}

impl Cover<'_> {
    /// The four children of the element at a quad take its place.
    fn split(&mut self, quad: u32) {
        let level = self.level[quad as usize];
        for q in self.quads(quad) {
            self.level[q as usize] = level - 1;
        }
    }

    /// The fine quads of the element at a quad.
    fn quads(&self, quad: u32) -> Vec<u32> {
        let (edges, size) = (self.edges, 1 << self.level[quad as usize]);
        rows(edges, self.start(quad), size)
            .flatten()
            .map(|h| edges.face(h).0)
            .collect()
    }

    /// The first half-edge of the element at a quad.
    fn start(&self, quad: u32) -> HalfedgeId {
        let blocks = &self.forest.levels[usize::from(self.level[quad as usize])];
        blocks.list[blocks.of_quad[quad as usize] as usize].sides[0]
    }

    /// Until the levels of elements that share a part of a side differ by one at most; in any order, as what has to be
    /// split does not depend on it.
    fn balance(&mut self) {
        let mut work: Vec<u32> = (0..self.level.len() as u32).collect();
        while let Some(quad) = work.pop() {
            for k in 0..4 {
                let Some(twin) = self.edges.twin(HalfedgeId(4 * quad + k)) else {
                    continue;
                };
                let other = self.edges.face(twin).0;
                if self.level[other as usize] > self.level[quad as usize] + 1 {
                    // Its smaller parts may be too fine for others.
                    work.extend(self.quads(other));
                    self.split(other);
                    work.push(quad);
                }
            }
        }
    }

    /// Splits what is coarser than the finest element within the rings around a vertex; says whether it did.
    ///
    /// `mark` tells this vertex from others in `seen`, which is shared to save memory. Rings are of elements, whatever
    /// their size.
    fn level_around(&mut self, v: u32, rings: u32, mark: u32, seen: &mut [u32]) -> bool {
        let mut found = Vec::new();
        let mut front = vec![v];
        for _ in 0..rings {
            let first = found.len();
            for &v in &front {
                for h in self.edges.around(VertexId(v)) {
                    let quad = self.edges.face(h).0;
                    let start = self.edges.face(self.start(quad)).0;
                    if seen[start as usize] != mark {
                        seen[start as usize] = mark;
                        found.push(start);
                    }
                }
            }
            front = found[first..].iter().flat_map(|&q| self.rim(q)).collect();
        }
        let level = |&q: &u32| self.level[q as usize];
        let finest = found.iter().map(level).min().unwrap_or(0);
        let coarser = |q: &u32| level(q) > finest;
        let mut coarse: Vec<u32> = found.into_iter().filter(coarser).collect();
        // When those at the vertex are split, its rings shrink: others may stay.
        let corners = self.edges.around(VertexId(v)).map(|h| self.edges.face(h).0);
        let own: Vec<u32> = corners
            .filter(coarser)
            .map(|q| self.edges.face(self.start(q)).0)
            .collect();
        if !own.is_empty() {
            coarse = own;
        }
        for &quad in &coarse {
            self.split(quad);
        }
        !coarse.is_empty()
    }

    /// The fine vertices around an element.
    fn rim(&self, quad: u32) -> Vec<u32> {
        let level = self.level[quad as usize];
        let blocks = &self.forest.levels[usize::from(level)];
        let block = &blocks.list[blocks.of_quad[quad as usize] as usize];
        let edges = self.edges;
        let sides = block.sides.iter();
        sides
            .flat_map(|&h| straight(edges, h, 1 << level))
            .map(|h| edges.from(h).0)
            .collect()
    }
}
