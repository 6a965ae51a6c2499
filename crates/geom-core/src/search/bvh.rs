//! Closest points and ray hits on a triangle mesh, by a tree of boxes.
//!
//! Every node of the tree has the box around its triangles. A box farther away than the nearest point so far cannot hold a nearer
//! one, so that a question looks at a few of the leaves only: the nearer child first, the other if it still may matter. Boxes are
//! compared by lower bounds that rounding cannot make too large.
//!
//! [`TriangleTree`] is built once and asked often; single questions run on the calling thread,
//! batches on the caller's rayon pool. Equal distances go to the lowest triangle.

use crate::compute::parallel;
use rayon::prelude::*;

use crate::{Aabb, Point3, TriMesh, Vector3};

/// Most triangles in a leaf. More make the tree smaller and the leaves slower.
const LEAF: usize = 4;

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
/// It holds copies of the corners and outlives its mesh: 100 to 125 bytes per triangle. There are no pointers: the
/// shape of the tree follows from the number of triangles, so that the halves of a node are equal but for one, whatever
/// the mesh.
#[derive(Clone, Debug)]
pub struct TriangleTree {
    /// A complete binary tree: the children of node `i` are `2 i + 1` and `2 i + 2`.
    boxes: Vec<Aabb>,
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
        let n = mesh.triangles().len();
        if n == 0 {
            return Err(TreeError::Empty);
        }
        let leaves = n.div_ceil(LEAF).next_power_of_two();
        let mut order: Vec<(Point3, u32)> = parallel::map(n, |t| {
            let [a, b, c] = mesh.corners(t);
            (
                Point3::from((a.coords + b.coords + c.coords) / 3.0),
                t as u32,
            )
        });
        partition(&mut order, 0, leaves, leaves, n);
        let ids: Vec<u32> = order.iter().map(|&(_, t)| t).collect();
        let corners: Vec<[Point3; 3]> = parallel::map_each(&ids, |&t| mesh.corners(t as usize));
        let mut tree = Self {
            boxes: vec![Aabb::EMPTY; 2 * leaves - 1],
            leaves,
            ids,
            corners,
        };
        let leaf_boxes: Vec<Aabb> = parallel::map(leaves, |l| {
            Aabb::of_points(tree.corners[tree.slots(l)].iter().flatten())
        });
        tree.boxes[leaves - 1..].copy_from_slice(&leaf_boxes);
        for i in (0..leaves - 1).rev() {
            tree.boxes[i] = tree.boxes[2 * i + 1].union(&tree.boxes[2 * i + 2]);
        }
        Ok(tree)
    }

    /// The box around the mesh.
    pub fn bounds(&self) -> Aabb {
        self.boxes[0]
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
        // Boxes round differently from triangles: a box is left out only if it is surely farther.
        const SURELY: f64 = 1.0 - 1e-12;
        if radius < 0.0 {
            return None;
        }
        let mut best_squared = radius * radius;
        let mut best: Option<(u32, [f64; 3], Point3)> = None;
        // 2³² triangles make a tree of 31 levels; one sibling waits on each.
        let mut stack = [(0.0, 0u32); 40];
        let mut depth = 1;
        stack[0] = (self.boxes[0].distance_squared(p), 0);
        'waiting: while depth > 0 {
            depth -= 1;
            let (bound, mut node) = stack[depth];
            if bound * SURELY > best_squared {
                continue;
            }
            while (node as usize) < self.leaves - 1 {
                let (left, right) = (2 * node + 1, 2 * node + 2);
                let [dl, dr] = [left, right].map(|c| self.boxes[c as usize].distance_squared(p));
                let (near, far, d_far) = if dl <= dr {
                    (left, right, dr)
                } else {
                    (right, left, dl)
                };
                if dl.min(dr) * SURELY > best_squared {
                    continue 'waiting;
                }
                if d_far * SURELY <= best_squared {
                    stack[depth] = (d_far, far);
                    depth += 1;
                }
                node = near;
            }
            for slot in self.slots(node as usize + 1 - self.leaves) {
                // Most triangles of a leaf are farther than the nearest so far, and their boxes say so at a fraction of the price.
                let corners = &self.corners[slot];
                if box_distance_squared(corners, p) * SURELY > best_squared {
                    continue;
                }
                let (barycentric, q) = closest_in_triangle(p, corners);
                let d = (q - p).norm_squared();
                let id = self.ids[slot];
                let wins = match best {
                    Some((b, ..)) => d < best_squared || (d == best_squared && id < b),
                    None => d <= best_squared,
                };
                if wins {
                    best_squared = d;
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

    /// The pairs of triangles whose leaves' boxes meet and of which `holds` is true, the lower one first, in
    /// order. Parallel. It is a first sieve: boxes of leaves are larger than those of triangles, so `holds` is to
    /// compare these first. Triangles with a common corner are among the pairs.
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
        let inner = self.leaves - 1;
        parallel::flat_map(self.leaves, |leaf| {
            let mut found = Vec::new();
            let bounds = &self.boxes[inner + leaf].inflated(margin);
            let mut waiting = vec![0];
            while let Some(node) = waiting.pop() {
                if !self.boxes[node].intersects(bounds) {
                    continue;
                }
                if node < inner {
                    waiting.extend([2 * node + 1, 2 * node + 2]);
                    continue;
                }
                // Each pair of leaves once, by the lower one.
                let other = node - inner;
                for s in self.slots(leaf).filter(|_| other >= leaf) {
                    let from = if other == leaf { s + 1 } else { 0 };
                    for t in self.slots(other).filter(|&t| t >= from) {
                        let pair = [self.ids[s].min(self.ids[t]), self.ids[s].max(self.ids[t])];
                        if holds(pair[0], pair[1]) {
                            found.push(pair);
                        }
                    }
                }
            }
            found
        })
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
        let mut stack = vec![0usize];
        while let Some(node) = stack.pop() {
            let limit = best.map_or(f64::INFINITY, |b| b.0);
            if ray.enters(&self.boxes[node]).is_none_or(|t| t > limit) {
                continue;
            }
            if node < self.leaves - 1 {
                // The nearer child last, so that it comes first.
                let mut children = [2 * node + 1, 2 * node + 2];
                let [l, r] = children.map(|c| ray.enters(&self.boxes[c]).unwrap_or(f64::INFINITY));
                if l <= r {
                    children.swap(0, 1);
                }
                stack.extend(children);
                continue;
            }
            for slot in self.slots(node + 1 - self.leaves) {
                let id = self.ids[slot];
                if let Some((time, barycentric, entering)) = ray.meets(&self.corners[slot])
                    && best.is_none_or(|b| time < b.0 || (time == b.0 && id < b.1))
                {
                    best = Some((time, id, barycentric, entering));
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

/// Squared distance from `p` to the box around a triangle: [`Aabb::distance_squared`] without a box between them.
fn box_distance_squared([a, b, c]: &[Point3; 3], p: &Point3) -> f64 {
    let apart = |k: usize| {
        let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
        let d = (low - p[k]).max(p[k] - high).max(0.0);
        d * d
    };
    (0..3).map(apart).sum()
}

/// The closest point to `p` in a triangle, and its barycentric coordinates. Follows the Voronoi
/// regions of corners, edges and face (Ericson, *Real-Time Collision Detection*, 2005, §5.1.5). The coordinates are not
/// negative and sum to 1 up to rounding. A triangle without area (doubled, at most 10⁻¹² of the square of a side) is
/// taken for its three edges, so that needles and points give what is nearest on them.
pub fn closest_in_triangle(p: &Point3, corners: &[Point3; 3]) -> ([f64; 3], Point3) {
    let [a, b, c] = *corners;
    let (ab, ac) = (b - a, c - a);
    let longest = ab.norm_squared().max(ac.norm_squared());
    // Without a plane the regions mean nothing: the closest point is on an edge.
    if ab.cross(&ac).norm_squared() <= 1e-24 * longest * longest {
        return closest_on_edges(p, corners);
    }
    let ap = p - a;
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ([1.0, 0.0, 0.0], a);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return ([0.0, 1.0, 0.0], b);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return ([1.0 - t, t, 0.0], a + ab * t);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return ([0.0, 0.0, 1.0], c);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return ([1.0 - t, 0.0, t], a + ac * t);
    }
    let va = d3 * d6 - d5 * d4;
    let (e4, e5) = (d4 - d3, d5 - d6);
    if va <= 0.0 && e4 >= 0.0 && e5 >= 0.0 {
        let t = e4 / (e4 + e5);
        return ([0.0, 1.0 - t, t], b + (c - b) * t);
    }
    let (v, w) = (vb / (va + vb + vc), vc / (va + vb + vc));
    ([(1.0 - v - w).max(0.0), v, w], a + ab * v + ac * w)
}

/// The nearest point of three segments, which may be points; the first of equally near ones.
fn closest_on_edges(p: &Point3, corners: &[Point3; 3]) -> ([f64; 3], Point3) {
    let mut best = ([1.0, 0.0, 0.0], corners[0], f64::INFINITY);
    for k in 0..3 {
        let (i, j) = (k, (k + 1) % 3);
        let edge = corners[j] - corners[i];
        let length = edge.norm_squared();
        let t = if length > 0.0 {
            (edge.dot(&(p - corners[i])) / length).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let q = corners[i] + edge * t;
        let d = (q - p).norm_squared();
        if d < best.2 {
            let mut barycentric = [0.0; 3];
            barycentric[i] = 1.0 - t;
            barycentric[j] = t;
            best = (barycentric, q, d);
        }
    }
    (best.0, best.1)
}

/// A ray with its axes permuted so that it runs along z, and sheared onto it. In that frame a triangle is met where
/// three signed areas of its shadow agree, and an edge that two triangles share gives both the same number: none is
/// missed between them.
struct Ray {
    origin: Point3,
    inverse: Vector3,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Ray {
    fn new(origin: &Point3, direction: &Vector3) -> Option<Self> {
        let finite = origin.iter().chain(direction.iter()).all(|c| c.is_finite());
        if !finite || *direction == Vector3::zeros() {
            return None;
        }
        let z = direction.iamax();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        // Keeps the sense of the triangles.
        if direction[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let shear = [
            direction[x] / direction[z],
            direction[y] / direction[z],
            1.0 / direction[z],
        ];
        Some(Self {
            origin: *origin,
            inverse: direction.map(|d| 1.0 / d),
            axes: [x, y, z],
            shear,
        })
    }

    /// When the ray enters the box, a little early; `None` when it misses.
    fn enters(&self, b: &Aabb) -> Option<f64> {
        // Rounding of the two products: 3 ulp is the bound of Ize, 2013.
        const WIDEN: f64 = 1.0 + 3.0 * f64::EPSILON;
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for k in 0..3 {
            let (low, high) = (b.min[k] - self.origin[k], b.max[k] - self.origin[k]);
            if self.inverse[k].is_infinite() {
                // Along the slab: inside all the way, or never. 0 · ∞ would say nothing.
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (t0, t1) = (low * self.inverse[k], high * self.inverse[k]);
            near = near.max(t0.min(t1));
            far = far.min(t0.max(t1) * WIDEN);
        }
        (near <= far).then_some(near)
    }

    /// Barycentric coordinates are areas over their sum; the time is the height of the shadow's corners, weighted by
    /// them.
    fn meets(&self, corners: &[Point3; 3]) -> Option<(f64, [f64; 3], bool)> {
        let [x, y, z] = self.axes;
        let [sx, sy, sz] = self.shear;
        let [a, b, c] = corners.map(|p| {
            let d = p - self.origin;
            [d[x] - sx * d[z], d[y] - sy * d[z], sz * d[z]]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let total = u + v + w;
        if total == 0.0 {
            return None;
        }
        let time = (u * a[2] + v * b[2] + w * c[2]) / total;
        (time >= 0.0).then(|| (time, [u, v, w].map(|s| s / total), total > 0.0))
    }
}
