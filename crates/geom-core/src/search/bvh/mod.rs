//! Closest points and ray hits on a triangle mesh, by a tree of boxes.
//!
//! Every node of the tree has the boxes around its children, four of them, which one look settles together (a *wide* tree: Wald,
//! Benthin and Boulos, *Getting rid of packets*, 2008); those of a leaf are single triangles. A box farther away than the nearest
//! point so far cannot hold a nearer one, so that a question looks at a few of the leaves only: the nearest child first, the
//! others if they still may matter. Boxes are compared by lower bounds that rounding cannot make too large.
//!
//! [`TriangleTree`] is built once and asked often; single questions run on the calling thread,
//! batches on the caller's rayon pool. Equal distances go to the lowest triangle.

mod boxes;
mod triangle;

use rayon::prelude::*;

pub use self::triangle::closest_in_triangle;

use self::boxes::{Boxes, Rounded, WIDTH, bound};
use self::triangle::Ray;
use crate::compute::parallel;
use crate::{Aabb, Point3, TriMesh, Vector3};

/// Room for what waits: three of four children on each of the levels of 2³² triangles.
const WAITING: usize = 64;

/// Why a question to a [`TriangleTree`] has no answer. Single questions do not fail: what is not finite has no answer
/// there, which [`TriangleTree::closest`] and its kin say in what they give.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TreeError {
    /// There is nothing to be close to.
    #[error("the mesh has no triangles, so no point of it is closest to anything")]
    Empty,
    /// A query point is NaN or infinite.
    #[error("query {query} has a coordinate that is not a finite number")]
    NotFinite {
        /// Which of the queries.
        query: usize,
    },
}

/// The point of a mesh that is closest to a query.
///
/// Of a point as near to several triangles, as at a common edge, the lowest triangle is named: its normal need not be
/// that of the surface there. Weigh normals of vertices by [`Closest::barycentric`] for one that is continuous.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// The point on the mesh.
    pub point: Point3,
    /// The triangle it lies in; the lowest of equally close ones.
    pub triangle: u32,
    /// Its barycentric coordinates in that triangle: not negative, sum 1.
    pub barycentric: [f64; 3],
    /// Its distance from the query, Å. NaN when the query is not finite.
    pub distance: f64,
}

/// Where a ray meets a mesh.
///
/// Points are on the triangle up to rounding along the ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The point on the mesh.
    pub point: Point3,
    /// The triangle it lies in; the lowest of equally near ones.
    pub triangle: u32,
    /// Its barycentric coordinates in that triangle.
    pub barycentric: [f64; 3],
    /// How far along the ray, in lengths of its direction.
    pub time: f64,
    /// Does the ray enter through the outer side (against the normal)?
    pub entering: bool,
}

/// A balanced tree of boxes over the triangles of a mesh.
///
/// ```
/// use geom_core::{Point3, mesh::shapes};
/// use geom_core::search::bvh::TriangleTree;
/// let tree = TriangleTree::new(&shapes::icosphere(1.0, 4))?;
/// let near = tree.closest(&Point3::new(0.0, 3.0, 0.0));
/// assert!((near.distance - 2.0).abs() < 0.01);
/// # Ok::<(), geom_core::search::bvh::TreeError>(())
/// ```
///
/// It holds copies of the corners and outlives its mesh: 110 to 140 bytes per triangle. There are no pointers: the
/// shape of the tree follows from the number of triangles, so that the children of a node are equal but for one, whatever
/// the mesh.
#[derive(Clone, Debug)]
pub struct TriangleTree {
    bounds: Aabb,
    /// A complete tree: level after level, the leaves last. Below the first node every inner one has four children.
    nodes: Vec<Boxes>,
    /// The number of leaves, a power of two; leaf `i` holds the slots `n i / leaves … n (i + 1) / leaves`.
    leaves: usize,
    /// The triangles in leaf order.
    ids: Vec<u32>,
    corners: Vec<[Point3; 3]>,
}

impl TriangleTree {
    /// The tree of all triangles of `mesh`; `O(n log n)`, parallel. Degenerate triangles count as the
    /// segments or points they are.
    ///
    /// # Errors
    /// [`TreeError::Empty`].
    pub fn new(mesh: &TriMesh) -> Result<Self, TreeError> {
        Self::of(mesh.triangles().len(), |t| mesh.corners(t))
    }

    /// The same of `n` triangles, given by their corners.
    pub(super) fn of(
        n: usize,
        corners: impl Fn(usize) -> [Point3; 3] + Sync,
    ) -> Result<Self, TreeError> {
        if n == 0 {
            return Err(TreeError::Empty);
        }
        let leaves = n.div_ceil(WIDTH).next_power_of_two();
        let mut order: Vec<(Point3, u32)> = parallel::map(n, |t| {
            let [a, b, c] = corners(t);
            (
                Point3::from((a.coords + b.coords + c.coords) / 3.0),
                t as u32,
            )
        });
        partition(&mut order, 0, leaves, leaves, n);
        let ids: Vec<u32> = order.iter().map(|&(_, t)| t).collect();
        let corners: Vec<[Point3; 3]> = parallel::map_each(&ids, |&t| corners(t as usize));
        let mut tree = Self {
            bounds: Aabb::of_points(corners.iter().flatten()),
            nodes: Vec::new(),
            leaves,
            ids,
            corners,
        };
        tree.nodes = tree.boxes();
        Ok(tree)
    }

    /// The boxes of all nodes, from those of the triangles upwards.
    fn boxes(&self) -> Vec<Boxes> {
        let mut levels = vec![parallel::map(self.leaves, |leaf| {
            Boxes::of(self.corners[self.slots(leaf)].iter().map(Aabb::of_points))
        })];
        let mut counts: Vec<usize> = (0..self.leaves).map(|l| self.slots(l).len()).collect();
        while let Some(below) = levels.last().filter(|level| level.len() > 1) {
            let children = below.len().min(WIDTH);
            let union = |at: usize| below[at].union(counts[at]);
            let level = parallel::map(below.len() / children, |node| {
                Boxes::of((children * node..children * (node + 1)).map(union))
            });
            counts = vec![children; level.len()];
            levels.push(level);
        }
        levels.into_iter().rev().flatten().collect()
    }

    /// The children of a node, by number; for a leaf, its triangles, by slot. The first node has two where the leaves are no
    /// power of four.
    fn children(&self, node: usize) -> Children {
        let first_leaf = self.nodes.len() - self.leaves;
        if node >= first_leaf {
            return Children::Triangles(self.slots(node - first_leaf));
        }
        let of_first = WIDTH >> (self.leaves.trailing_zeros() % 2);
        Children::Nodes(match node {
            0 => 1..1 + of_first,
            _ => WIDTH * node + of_first - 3..WIDTH * node + of_first + 1,
        })
    }

    /// The box around the mesh.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn slots(&self, leaf: usize) -> std::ops::Range<usize> {
        let n = self.ids.len();
        let levels = self.leaves.trailing_zeros();
        (n * leaf) >> levels..(n * (leaf + 1)) >> levels
    }

    /// The closest point of the mesh to `p`.
    ///
    /// Logarithmic time near the surface. From places that are about as far from all of it, like the middle of a
    /// sphere, most of the tree has to be looked at.
    pub fn closest(&self, p: &Point3) -> Closest {
        self.closest_within(p, f64::INFINITY).unwrap_or(Closest {
            point: self.corners[0][0],
            triangle: self.ids[0],
            barycentric: [1.0, 0.0, 0.0],
            distance: f64::NAN,
        })
    }

    /// The closest point of the mesh to `p` if it is at most `radius` away, else `None`. The bound makes it faster:
    /// what is farther is not looked at. `None`, too, for a point that is not finite.
    pub fn closest_within(&self, p: &Point3, radius: f64) -> Option<Closest> {
        if radius < 0.0 || p.iter().any(|c| !c.is_finite()) {
            return None;
        }
        let rounded = Rounded::of(p);
        let mut best_squared = radius * radius;
        let mut most = bound(best_squared);
        let mut best: Option<(u32, [f64; 3], Point3)> = None;
        // Nodes that may matter, and how near they are at least.
        let mut waiting = [(0.0f32, 0u32); WAITING];
        let mut count = 1;
        'waiting: while count > 0 {
            count -= 1;
            let (distance, mut node) = waiting[count];
            if distance > most {
                continue;
            }
            // Down to the nearest child each time; others wait.
            let (slots, near) = loop {
                let near = self.nodes[node as usize].near(&rounded, most);
                let children = match self.children(node as usize) {
                    Children::Triangles(slots) => break (slots, near),
                    Children::Nodes(children) => children,
                };
                let mut lanes = near.lanes(children.len());
                let Some(lane) = lanes.next() else {
                    continue 'waiting;
                };
                let mut next = (near.distances[lane], (children.start + lane) as u32);
                for lane in lanes {
                    let other = (near.distances[lane], (children.start + lane) as u32);
                    let is_nearer = other.0 < next.0;
                    waiting[count] = if is_nearer { next } else { other };
                    next = if is_nearer { other } else { next };
                    count += 1;
                }
                node = next.1;
            };
            for lane in near.lanes(slots.len()) {
                if near.distances[lane] > most {
                    continue;
                }
                let slot = slots.start + lane;
                let (barycentric, q) = closest_in_triangle(p, &self.corners[slot]);
                let d = (q - p).norm_squared();
                let id = self.ids[slot];
                let wins = match best {
                    Some((b, ..)) => d < best_squared || (d == best_squared && id < b),
                    None => d <= best_squared,
                };
                if wins {
                    best_squared = d;
                    most = bound(d);
                    best = Some((id, barycentric, q));
                }
            }
        }
        best.map(|(triangle, barycentric, point)| Closest {
            point,
            triangle,
            barycentric,
            distance: best_squared.sqrt(),
        })
    }

    /// The closest points to all queries, in their order; parallel.
    ///
    /// # Errors
    /// [`TreeError::NotFinite`] names the first such query, before any is answered.
    pub fn closest_to_all(&self, queries: &[Point3]) -> Result<Vec<Closest>, TreeError> {
        if let Some(query) = queries
            .iter()
            .position(|p| p.iter().any(|c| !c.is_finite()))
        {
            return Err(TreeError::NotFinite { query });
        }
        Ok(parallel::map_each(queries, |p| self.closest(p)))
    }

    /// The pairs of triangles whose boxes meet and of which `holds` is true, the lower one first, in
    /// order. Parallel. It is a first sieve: the boxes here are rounded outwards, so `holds` is to
    /// compare these first where it matters. Triangles with a common corner are among the pairs.
    pub fn overlapping_pairs(&self, holds: impl Fn(u32, u32) -> bool + Sync) -> Vec<[u32; 2]> {
        self.pairs_within(0.0, holds)
    }

    /// The same of boxes that lie at most `margin` apart on each axis.
    pub fn pairs_within(
        &self,
        margin: f64,
        holds: impl Fn(u32, u32) -> bool + Sync,
    ) -> Vec<[u32; 2]> {
        let mut pairs = self.pairs_by_leaf(margin, holds);
        pairs.par_sort_unstable();
        pairs
    }

    /// [`pairs_within`](Self::pairs_within), leaf after leaf: as many lists are long, and few are wanted in order.
    pub(super) fn pairs_by_leaf(
        &self,
        margin: f64,
        holds: impl Fn(u32, u32) -> bool + Sync,
    ) -> Vec<[u32; 2]> {
        let first_leaf = self.nodes.len() - self.leaves;
        parallel::flat_map(self.leaves, |leaf| {
            let mut found = Vec::new();
            let own = &self.nodes[first_leaf + leaf];
            let slots = self.slots(leaf);
            let bounds = own.union(slots.len()).inflated(margin);
            let boxes: Vec<Aabb> = (0..slots.len())
                .map(|lane| own.lane(lane).inflated(margin))
                .collect();
            let mut waiting = vec![0];
            while let Some(node) = waiting.pop() {
                // Each pair of leaves once, by the lower one.
                if node >= first_leaf && node < first_leaf + leaf {
                    continue;
                }
                match self.children(node) {
                    Children::Nodes(children) => {
                        let meet = children.zip(self.nodes[node].meet(&bounds));
                        waiting.extend(meet.filter_map(|(child, meets)| meets.then_some(child)));
                    }
                    Children::Triangles(others) => {
                        for (s, bounds) in slots.clone().zip(&boxes) {
                            for (t, meets) in others.clone().zip(self.nodes[node].meet(bounds)) {
                                // Within a leaf each pair of slots once.
                                if !meets || t <= s && node == first_leaf + leaf {
                                    continue;
                                }
                                let (a, b) = (self.ids[s], self.ids[t]);
                                let pair = [a.min(b), a.max(b)];
                                if holds(pair[0], pair[1]) {
                                    found.push(pair);
                                }
                            }
                        }
                    }
                }
            }
            found
        })
    }

    /// Calls `found` with the triangles whose boxes, rounded outwards, meet `bounds`; in the order of the tree.
    pub(super) fn meeting(&self, bounds: &Aabb, mut found: impl FnMut(u32)) {
        let mut waiting = vec![0];
        while let Some(node) = waiting.pop() {
            let meet = self.nodes[node].meet(bounds);
            match self.children(node) {
                Children::Nodes(children) => {
                    let met = children.zip(meet).filter(|(_, meets)| *meets);
                    waiting.extend(met.map(|(child, _)| child));
                }
                Children::Triangles(slots) => {
                    let met = slots.zip(meet).filter(|(_, meets)| *meets);
                    met.for_each(|(slot, _)| found(self.ids[slot]));
                }
            }
        }
    }

    /// The first point where the ray `origin + time · direction`, `time ≥ 0`, meets the mesh.
    ///
    /// The test is watertight: a ray through an edge or vertex of a closed mesh does not slip
    /// through (Woop, Benthin and Wald, *Watertight Ray/Triangle Intersection*, 2013).
    ///
    /// Triangles are hit from either side; [`Hit::entering`] tells which. One that is seen edge-on is not hit, its
    /// neighbours are. `None` if nothing is hit, if the direction is zero, or if something is not finite.
    pub fn first_hit(&self, origin: &Point3, direction: &Vector3) -> Option<Hit> {
        let ray = Ray::new(origin, direction)?;
        let mut best: Option<(f64, u32, [f64; 3], bool)> = None;
        // Nodes that may matter, and when the ray enters them: the earliest last.
        let mut waiting = vec![(0.0, 0usize)];
        while let Some((entry, node)) = waiting.pop() {
            if best.is_some_and(|b| entry > b.0) {
                continue;
            }
            let boxes = &self.nodes[node];
            match self.children(node) {
                Children::Nodes(children) => {
                    let first = waiting.len();
                    let entered = children
                        .enumerate()
                        .filter_map(|(lane, child)| Some((ray.enters(&boxes.lane(lane))?, child)));
                    waiting.extend(entered);
                    waiting[first..].sort_by(|a, b| b.0.total_cmp(&a.0));
                }
                Children::Triangles(slots) => {
                    for slot in slots {
                        let id = self.ids[slot];
                        if let Some((time, barycentric, entering)) = ray.meets(&self.corners[slot])
                            && best.is_none_or(|b| time < b.0 || (time == b.0 && id < b.1))
                        {
                            best = Some((time, id, barycentric, entering));
                        }
                    }
                }
            }
        }
        best.map(|(time, triangle, barycentric, entering)| Hit {
            point: origin + direction * time,
            triangle,
            barycentric,
            time,
            entering,
        })
    }
}

/// What is below a node.
enum Children {
    Nodes(std::ops::Range<usize>),
    Triangles(std::ops::Range<usize>),
}

/// Sorts triangles so that the slots of every node's children are the halves of its own along its
/// longest axis. `order` holds the slots of the `count` leaves from `first` on, of `leaves` in all.
fn partition(order: &mut [(Point3, u32)], first: usize, count: usize, leaves: usize, n: usize) {
    if count == 1 || order.len() < 2 {
        return;
    }
    let axis = Aabb::of_points(order.iter().map(|(p, _)| p))
        .extent()
        .imax();
    let half = count / 2;
    let middle = n * (first + half) / leaves - n * first / leaves;
    if middle < order.len() {
        order.select_nth_unstable_by(middle, |a, b| {
            a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1))
        });
    }
    let (left, right) = order.split_at_mut(middle);
    rayon::join(
        || partition(left, first, half, leaves, n),
        || partition(right, first + half, half, leaves, n),
    );
}
