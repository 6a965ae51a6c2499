//! Triangles that go through each other, in f64: those that merely touch do not count.
//!
//! Meshers and untanglers ask it of surfaces that must not cross themselves. Signs are those of volumes in f64: what is
//! farther than rounding from touching is decided rightly, and overlaps within one plane are not looked for.

use crate::compute::parallel;

use super::bvh::TriangleTree;
use crate::mesh::{MeshError, six_volume};
use crate::{Aabb, Point3, TriMesh};

/// A triangle of a mesh with the box around it. Made once per triangle and compared with many: most pairs are settled
/// by the boxes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxedTriangle {
    /// The vertices.
    pub ids: [u32; 3],
    corners: [Point3; 3],
    /// The box around the corners.
    pub bounds: Aabb,
}

impl BoxedTriangle {
    /// The triangle of these vertices; `at` says where each of them is.
    #[inline]
    pub fn new(ids: [u32; 3], at: &impl Fn(u32) -> Point3) -> Self {
        let corners = ids.map(at);
        Self {
            ids,
            corners,
            bounds: Aabb::of_points(&corners),
        }
    }

    /// Do the triangles cross outside of their common corner? Those with a common edge do not. Two triangles cross
    /// where an edge of one goes through the inside of the other. Symmetric.
    pub fn crosses(&self, other: &Self) -> bool {
        if !self.bounds.intersects(&other.bounds) {
            return false;
        }
        if self.common(other) >= 2 {
            return false;
        }
        // One that lies on one side of the other's plane settles most pairs (Möller, *A fast triangle–triangle
        // intersection test*, 1997).
        let own = self.sides_of(other);
        if !are_on_both(&own) {
            return false;
        }
        let others = other.sides_of(self);
        are_on_both(&others) && (self.goes_through(other, own) || other.goes_through(self, others))
    }

    /// How many corners two triangles share.
    fn common(&self, other: &Self) -> usize {
        self.ids.iter().filter(|v| other.ids.contains(v)).count()
    }

    /// On which side of the other's plane each corner lies: the sign.
    fn sides_of(&self, other: &Self) -> [f64; 3] {
        let [a, b, c] = other.corners;
        self.corners.map(|p| six_volume([a, b, c, p]))
    }

    /// Does an edge go through the other triangle, of whose plane corners lie on these sides? Edges at a common corner lie
    /// beside it.
    fn goes_through(&self, other: &Self, sides: [f64; 3]) -> bool {
        (0..3).any(|i| {
            let (i, j) = (i, (i + 1) % 3);
            sides[i] * sides[j] < 0.0
                && ![i, j].iter().any(|&k| other.ids.contains(&self.ids[k]))
                && surrounds([self.corners[i], self.corners[j]], other.corners)
        })
    }
}

/// Are there corners on both sides of a plane, and not only in it?
fn are_on_both(sides: &[f64; 3]) -> bool {
    sides.iter().any(|&s| s < 0.0) && sides.iter().any(|&s| s > 0.0)
}

/// Does the line through two points go through the triangle?
///
/// The three volumes that the segment spans with the sides of the triangle have one sign if it passes on the same side
/// of all of them. Zeros count with either: a segment through an edge of a triangle goes through.
fn surrounds([p, q]: [Point3; 2], [a, b, c]: [Point3; 3]) -> bool {
    let turns = [[a, b], [b, c], [c, a]].map(|[s, t]| six_volume([p, q, s, t]));
    turns.iter().all(|&v| v >= 0.0) || turns.iter().all(|&v| v <= 0.0)
}

/// The pairs of triangles of a mesh that cross, by number, the lower one first, in order. Parallel; for
/// a mesh that hardly crosses itself `O(n log n)`.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::search::crossing::crossing_pairs;
/// assert!(crossing_pairs(&shapes::torus(2.0, 0.5, 40, 20)).is_empty());
/// // The hole is narrower than the tube: the inner side has come through itself.
/// assert!(!crossing_pairs(&shapes::torus(1.0, 1.5, 40, 20)).is_empty());
/// ```
///
/// Triangles that share an edge do not count, nor do those that touch in a common vertex only. Each pair is named once.
pub fn crossing_pairs(mesh: &TriMesh) -> Vec<[u32; 2]> {
    // Nothing crosses nothing.
    if mesh.triangles().is_empty() {
        return Vec::new();
    }
    let tree = TriangleTree::new(mesh).expect("there is a triangle");
    let boxed = boxed(mesh.positions(), mesh.triangles());
    tree.overlapping_pairs(|s, t| boxed[s as usize].crosses(&boxed[t as usize]))
}

/// Those of [`crossing_pairs`] of which at least one triangle is `among` some: of a mesh of which little has changed, what may
/// have come to cross. Parallel, `O(k log k)` for a tree of the k that are among them and at most `O(log k)` for each other
/// triangle that hardly crosses any.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::search::crossing::{crossing_pairs, crossing_pairs_among};
/// let torus = shapes::torus(1.0, 1.5, 40, 20);
/// let mut pairs = crossing_pairs(&torus);
/// pairs.retain(|pair| pair.iter().any(|t| t % 7 == 0));
/// assert_eq!(crossing_pairs_among(&torus, |t| t % 7 == 0), pairs);
/// ```
pub fn crossing_pairs_among(mesh: &TriMesh, among: impl Fn(u32) -> bool + Sync) -> Vec<[u32; 2]> {
    let count = mesh.triangles().len();
    let some: Vec<u32> = parallel::flat_map(count, |t| Some(t as u32).filter(|&t| among(t)));
    let corners = |i: usize| mesh.corners(some[i] as usize);
    let Ok(tree) = TriangleTree::of(some.len(), corners) else {
        return Vec::new();
    };
    let at = |v: u32| mesh.positions()[v as usize];
    let boxed = |t: u32| BoxedTriangle::new(mesh.triangles()[t as usize], &at);
    let own: Vec<BoxedTriangle> = parallel::map_each(&some, |&t| boxed(t));
    let mut pairs = parallel::flat_map(count, |t| {
        let (t, mut found) = (t as u32, Vec::new());
        let triangle = boxed(t);
        if tree.bounds().intersects(&triangle.bounds) {
            let is_own = some.binary_search(&t).is_ok();
            tree.meeting(&triangle.bounds, |i| {
                let s = some[i as usize];
                // Two of them meet twice, and each itself.
                let once = s < t || !is_own;
                if s != t && once && own[i as usize].crosses(&triangle) {
                    found.push([s.min(t), s.max(t)]);
                }
            });
        }
        found
    });
    pairs.sort_unstable();
    pairs
}

/// Triangles that move, watched for those that come to cross. Pairs that are near are gathered once, and looked at until
/// some vertex has moved so far that others could meet (the neighbour lists of Verlet, *Computer experiments on classical
/// fluids*, 1967).
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::search::crossing::{CrossingWatch, crossing_pairs};
/// let torus = shapes::torus(2.0, 0.5, 40, 20);
/// let mut watch = CrossingWatch::new(torus.triangles().to_vec(), 0.1);
/// assert!(watch.crossing_pairs(torus.positions())?.is_empty());
/// let through = shapes::torus(1.0, 1.5, 40, 20);
/// assert_eq!(watch.crossing_pairs(through.positions())?, crossing_pairs(&through));
/// # Ok::<(), geom_core::mesh::MeshError>(())
/// ```
///
/// While nothing has moved by half the margin, a question costs one look at each near pair and no tree.
#[derive(Clone, Debug)]
pub struct CrossingWatch {
    triangles: Vec<[u32; 3]>,
    margin: f64,
    /// Where the vertices were when the pairs were gathered.
    at: Vec<Point3>,
    near: Vec<[u32; 2]>,
}

impl CrossingWatch {
    /// Pairs count as near whose boxes lie up to `margin` apart: a large one makes lists long, a small one makes them anew
    /// often. A good one is several times what the vertices move between two questions. With 0 and below the list is made
    /// anew whenever something has moved.
    pub fn new(triangles: Vec<[u32; 3]>, margin: f64) -> Self {
        Self {
            triangles,
            margin: margin.max(0.0),
            at: Vec::new(),
            near: Vec::new(),
        }
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// What [`crossing_pairs`] gives for these positions. Parallel.
    ///
    /// # Errors
    /// Those of [`TriMesh::new`]: positions that are not finite, corners without one.
    pub fn crossing_pairs(&mut self, positions: &[Point3]) -> Result<Vec<[u32; 2]>, MeshError> {
        // Two boxes come nearer by what both have moved.
        let most = 0.5 * self.margin;
        let stayed = |(p, q): (&Point3, &Point3)| (p - q).norm() <= most;
        if self.at.len() != positions.len() || !self.at.iter().zip(positions).all(stayed) {
            self.gather(positions)?;
        }
        let boxed = boxed(positions, &self.triangles);
        let crosses = |[s, t]: &[u32; 2]| boxed[*s as usize].crosses(&boxed[*t as usize]);
        let near = &self.near;
        let mut pairs = parallel::flat_map(near.len(), |i| Some(near[i]).filter(crosses));
        pairs.sort_unstable();
        Ok(pairs)
    }

    /// Pairs with a common edge are left out for good, since they cannot cross.
    fn gather(&mut self, positions: &[Point3]) -> Result<(), MeshError> {
        let mesh = TriMesh::new(positions.to_vec(), self.triangles.clone())?;
        self.at = positions.to_vec();
        self.near = Vec::new();
        if self.triangles.is_empty() {
            return Ok(());
        }
        let tree = TriangleTree::new(&mesh).expect("there is a triangle");
        let mut wide = boxed(positions, &self.triangles);
        wide.iter_mut()
            .for_each(|t| t.bounds = t.bounds.inflated(0.5 * self.margin));
        self.near = tree.pairs_by_leaf(self.margin, |s, t| {
            let (s, t) = (&wide[s as usize], &wide[t as usize]);
            s.bounds.intersects(&t.bounds) && s.common(t) < 2
        });
        Ok(())
    }
}

fn boxed(positions: &[Point3], triangles: &[[u32; 3]]) -> Vec<BoxedTriangle> {
    let at = |v: u32| positions[v as usize];
    let boxed = |&t: &[u32; 3]| BoxedTriangle::new(t, &at);
    parallel::map_each(triangles, boxed)
}
