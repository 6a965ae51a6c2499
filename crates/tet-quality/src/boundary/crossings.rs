//! Triangles that go through each other, in f64: those that merely touch do not count.

use geom_core::mesh::six_volume;
use geom_core::{Aabb, Point3};
use rayon::prelude::*;

/// Triangles per leaf of the tree.
const LEAF: usize = 8;

/// A triangle and the box around it.
pub(crate) struct Boxed {
    pub(crate) ids: [u32; 3],
    corners: [Point3; 3],
    pub(crate) bounds: Aabb,
}

impl Boxed {
    pub(crate) fn new(ids: [u32; 3], at: &impl Fn(u32) -> Point3) -> Self {
        let corners @ [a, b, c] = ids.map(at);
        let bounds = Aabb::new(a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        Self {
            ids,
            corners,
            bounds,
        }
    }

    /// Do triangles cross outside of their common corner? Those with a common edge do not.
    pub(crate) fn crosses(&self, other: &Self) -> bool {
        if !self.bounds.intersects(&other.bounds) {
            return false;
        }
        let common = self.ids.iter().filter(|v| other.ids.contains(v)).count();
        common < 2 && (self.goes_through(other) || other.goes_through(self))
    }

    fn goes_through(&self, other: &Self) -> bool {
        (0..3).any(|i| {
            let ends = [i, (i + 1) % 3];
            !ends.iter().any(|&k| other.ids.contains(&self.ids[k]))
                && pierces(ends.map(|k| self.corners[k]), other.corners)
        })
    }
}

/// Does the segment go through the triangle?
fn pierces([p, q]: [Point3; 2], [a, b, c]: [Point3; 3]) -> bool {
    if six_volume([a, b, c, p]) * six_volume([a, b, c, q]) >= 0.0 {
        return false;
    }
    let turns = [[a, b], [b, c], [c, a]].map(|[s, t]| six_volume([p, q, s, t]));
    turns.iter().all(|&v| v >= 0.0) || turns.iter().all(|&v| v <= 0.0)
}

/// The pairs of triangles that cross, by number, the lower one first.
pub(crate) fn crossing_pairs(x: &[Point3], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let at = |v: u32| x[v as usize];
    let boxed: Vec<Boxed> = triangles.iter().map(|&t| Boxed::new(t, &at)).collect();
    let tree = Tree::new(&boxed);
    let mut pairs: Vec<[u32; 2]> = (0..boxed.len() as u32)
        .into_par_iter()
        .with_min_len(256)
        .flat_map_iter(|i| {
            let one = &boxed[i as usize];
            let near = tree.near(&one.bounds).filter(move |&j| j > i);
            let crossed = near.filter(|&j| one.crosses(&boxed[j as usize]));
            crossed.map(move |j| [i, j]).collect::<Vec<_>>()
        })
        .collect();
    pairs.sort_unstable();
    pairs
}

/// Boxes in boxes: a node is followed by its subtree.
struct Tree {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

struct Node {
    bounds: Aabb,
    /// The node after its subtree.
    next: u32,
    /// Its triangles in the order of the tree; none but in leaves.
    first: u32,
    count: u32,
}

impl Tree {
    fn new(boxed: &[Boxed]) -> Self {
        let mut order: Vec<u32> = (0..boxed.len() as u32).collect();
        let mut nodes = Vec::new();
        if !boxed.is_empty() {
            split(boxed, &mut order, 0, &mut nodes);
        }
        Self { nodes, order }
    }

    /// The triangles whose boxes may meet this one.
    fn near(&self, bounds: &Aabb) -> impl Iterator<Item = u32> {
        let mut found = Vec::new();
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if node.bounds.intersects(bounds) {
                let first = node.first as usize;
                found.extend_from_slice(&self.order[first..first + node.count as usize]);
                at += 1;
            } else {
                at = node.next as usize;
            }
        }
        found.into_iter()
    }
}

/// Adds the node of these triangles and its subtree: halves by the middles along the longest side.
fn split(boxed: &[Boxed], order: &mut [u32], first: u32, nodes: &mut Vec<Node>) {
    let bounds = order
        .iter()
        .fold(Aabb::EMPTY, |all, &t| all.union(&boxed[t as usize].bounds));
    let own = nodes.len();
    let leaf = order.len() <= LEAF;
    nodes.push(Node {
        bounds,
        next: 0,
        first,
        count: if leaf { order.len() as u32 } else { 0 },
    });
    if !leaf {
        let axis = (bounds.max - bounds.min).imax();
        let middle = |t: &u32| {
            let b = &boxed[*t as usize].bounds;
            b.min[axis] + b.max[axis]
        };
        let half = order.len() / 2;
        order.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)).then(a.cmp(b)));
        let (low, high) = order.split_at_mut(half);
        split(boxed, low, first, nodes);
        split(boxed, high, first + half as u32, nodes);
    }
    nodes[own].next = nodes.len() as u32;
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn by_hand(x: &[Point3], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
        let at = |v: u32| x[v as usize];
        let boxed: Vec<Boxed> = triangles.iter().map(|&t| Boxed::new(t, &at)).collect();
        let all = (0..boxed.len()).flat_map(|i| (i + 1..boxed.len()).map(move |j| [i, j]));
        all.filter(|&[i, j]| boxed[i].crosses(&boxed[j]))
            .map(|pair| pair.map(|i| i as u32))
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn the_tree_finds_what_all_pairs_find(
            x in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 4..60),
            corners in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 0..80),
        ) {
            let x: Vec<Point3> = x.into_iter().map(Point3::from).collect();
            let triangles: Vec<[u32; 3]> =
                corners.iter().map(|t| t.map(|i| i.index(x.len()) as u32)).collect();
            prop_assert_eq!(crossing_pairs(&x, &triangles), by_hand(&x, &triangles));
        }
    }

    #[test]
    fn what_touches_does_not_cross() {
        let p = |x, y, z| Point3::new(x, y, z);
        let x = [
            p(0.0, 0.0, 0.0),
            p(4.0, 0.0, 0.0),
            p(0.0, 4.0, 0.0),
            // Through the first, from below to above.
            p(1.0, 1.0, -1.0),
            p(1.0, 1.0, 1.0),
            p(1.5, 1.0, 1.0),
            // On it with one corner.
            p(0.5, 0.5, 0.0),
            p(0.5, 0.5, 2.0),
            p(0.0, 0.5, 2.0),
        ];
        assert_eq!(crossing_pairs(&x, &[[0, 1, 2], [3, 4, 5]]), [[0, 1]]);
        assert_eq!(crossing_pairs(&x, &[[0, 1, 2], [6, 7, 8]]), [[0; 2]; 0]);
        // A fold about a common edge is no crossing; one about a common corner may be.
        assert_eq!(crossing_pairs(&x, &[[0, 1, 2], [1, 0, 4]]), [[0; 2]; 0]);
        assert_eq!(crossing_pairs(&x, &[[0, 1, 2], [0, 3, 4]]), [[0, 1]]);
    }
}
