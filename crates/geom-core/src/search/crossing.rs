//! Triangles that go through each other, in f64: those that merely touch do not count.

use rayon::prelude::*;

use super::bvh::TriangleTree;
use crate::mesh::{MeshError, six_volume};
use crate::{Aabb, Point3, TriMesh};

/// A triangle of a mesh with the box around it.
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

    /// Do the triangles cross outside of their common corner? Those with a common edge do not.
    pub fn crosses(&self, other: &Self) -> bool {
        if !self.bounds.intersects(&other.bounds) {
            return false;
        }
        self.common(other) < 2 && (self.goes_through(other) || other.goes_through(self))
    }

    /// How many corners two triangles share.
    fn common(&self, other: &Self) -> usize {
        self.ids.iter().filter(|v| other.ids.contains(v)).count()
    }

    /// Does an edge go through the other triangle? Edges at a common corner lie beside it.
    fn goes_through(&self, other: &Self) -> bool {
        let [a, b, c] = other.corners;
        // On which side of the other's plane each corner lies settles most pairs.
        let sides = self.corners.map(|p| six_volume([a, b, c, p]));
        (0..3).any(|i| {
            let (i, j) = (i, (i + 1) % 3);
            sides[i] * sides[j] < 0.0
                && ![i, j].iter().any(|&k| other.ids.contains(&self.ids[k]))
                && surrounds([self.corners[i], self.corners[j]], other.corners)
        })
    }
}

/// Does the line through two points go through the triangle?
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
pub fn crossing_pairs(mesh: &TriMesh) -> Vec<[u32; 2]> {
    // Nothing crosses nothing.
    if mesh.triangles().is_empty() {
        return Vec::new();
    }
    let tree = TriangleTree::new(mesh).expect("there is a triangle");
    let boxed = boxed(mesh.positions(), mesh.triangles());
    tree.overlapping_pairs(|s, t| boxed[s as usize].crosses(&boxed[t as usize]))
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
    /// often.
    pub fn new(triangles: Vec<[u32; 3]>, margin: f64) -> Self {
        Self {
            triangles,
            margin,
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
        let crosses = |[s, t]: &&[u32; 2]| boxed[*s as usize].crosses(&boxed[*t as usize]);
        let mut pairs: Vec<[u32; 2]> = self.near.par_iter().filter(crosses).copied().collect();
        pairs.sort_unstable();
        Ok(pairs)
    }

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
    triangles.par_iter().map(boxed).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn by_hand(mesh: &TriMesh) -> Vec<[u32; 2]> {
        let boxed = boxed(mesh.positions(), mesh.triangles());
        let all = (0..boxed.len()).flat_map(|i| (i + 1..boxed.len()).map(move |j| [i, j]));
        all.filter(|&[i, j]| boxed[i].crosses(&boxed[j]))
            .map(|pair| pair.map(|i| i as u32))
            .collect()
    }

    proptest! {
        #![proptest_config(crate::testing::cases(64))]

        #[test]
        fn the_tree_finds_what_all_pairs_find(
            x in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 4..60),
            corners in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 0..80),
        ) {
            let distinct = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
            let triangles = corners.iter().map(|t| t.map(|i| i.index(x.len()) as u32));
            let triangles: Vec<_> = triangles.filter(distinct).collect();
            let mesh = TriMesh::new(x.into_iter().map(Point3::from).collect(), triangles).unwrap();
            prop_assert_eq!(crossing_pairs(&mesh), by_hand(&mesh));
        }
    }

    /// Steps shorter and longer than the margin: a plate whose lower side is shaken ever more.
    #[test]
    fn a_watched_surface_crosses_where_it_does() {
        let ball = crate::mesh::shapes::icosphere(1.0, 3);
        for step in [0.002, 0.06] {
            let mut watch = CrossingWatch::new(ball.triangles().to_vec(), 0.02);
            let mut found = 0;
            for round in 0..12 {
                let shaken = ball.positions().iter().enumerate().map(|(v, p)| {
                    let up = 0.05 * p.z + step * f64::from(round) * f64::from(v % 5 == 0);
                    Point3::new(p.x, p.y, up)
                });
                let shaken: Vec<Point3> = shaken.collect();
                let mesh = TriMesh::new(shaken.clone(), ball.triangles().to_vec()).unwrap();
                let pairs = watch.crossing_pairs(&shaken).unwrap();
                assert_eq!(pairs, crossing_pairs(&mesh), "round {round} of {step}");
                found += pairs.len();
            }
            assert!(found > 10, "{found}");
        }
        let mut nothing = CrossingWatch::new(Vec::new(), 0.1);
        assert_eq!(nothing.crossing_pairs(&[]), Ok(Vec::new()));
        let mut watch = CrossingWatch::new(ball.triangles().to_vec(), 0.02);
        let mut lost = ball.positions().to_vec();
        assert_eq!(watch.crossing_pairs(&lost), Ok(Vec::new()));
        lost[7].x = f64::NAN;
        assert!(watch.crossing_pairs(&lost).is_err() && watch.crossing_pairs(&[]).is_err());
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
        let pairs = |triangles: [[u32; 3]; 2]| {
            crossing_pairs(&TriMesh::new(x.to_vec(), triangles.to_vec()).unwrap())
        };
        assert_eq!(pairs([[0, 1, 2], [3, 4, 5]]), [[0, 1]]);
        assert_eq!(pairs([[0, 1, 2], [6, 7, 8]]), [[0; 2]; 0]);
        // A fold about a common edge is no crossing; one about a common corner may be.
        assert_eq!(pairs([[0, 1, 2], [1, 0, 4]]), [[0; 2]; 0]);
        assert_eq!(pairs([[0, 1, 2], [0, 3, 4]]), [[0, 1]]);
    }
}
