//! A surface on which the vertices of another mesh stay while they move.
//!
//! An optimizer moves a vertex, and this pulls it back to where it may be: onto the triangles, a line or its own place.
//! It is the input's surface that is followed, not the one being optimized, so that errors do not add up over many
//! moves.

use std::f64::consts::FRAC_PI_4;

use crate::search::bvh::{Closest, TreeError, TriangleTree};
use crate::{Point3, TriMesh, Vector3};

/// By so much at least a place must be better: less is rounding, and a search that takes it goes on and on. For values
/// around 1, as scaled Jacobians are.
const GAIN: f64 = 1e-6;

/// How a vertex may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// On the surface.
    Surface,
    /// Along boundaries and sharp edges.
    Line,
    /// Not at all: their corners.
    Fixed,
}

/// A surface, and the boundaries and sharp edges of it that are kept.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::ground::{Freedom, Ground};
/// use geom_core::Point3;
/// let sphere = shapes::icosphere(1.0, 3);
/// let ground = Ground::new(&sphere, Vec::new())?;
/// let (at, normal) = ground.pulled(&Point3::new(2.0, 0.0, 0.0), Freedom::Surface);
/// assert!((at.coords.norm() - 1.0).abs() < 0.01 && normal.x > 0.99);
/// # Ok::<(), geom_core::search::bvh::TreeError>(())
/// ```
///
/// It borrows the surface and builds a tree of its triangles; lines are searched one by one, so they should be few.
pub struct Ground<'a> {
    surface: &'a TriMesh,
    tree: TriangleTree,
    normals: Vec<Vector3>,
    lines: Vec<[Point3; 2]>,
}

impl<'a> Ground<'a> {
    /// A surface with these lines on it.
    ///
    /// # Errors
    /// Of a surface without triangles, or not finite.
    pub fn new(surface: &'a TriMesh, lines: Vec<[Point3; 2]>) -> Result<Self, TreeError> {
        Ok(Self {
            surface,
            tree: TriangleTree::new(surface)?,
            normals: surface.vertex_normals(),
            lines,
        })
    }

    /// Its lines.
    pub fn lines(&self) -> &[[Point3; 2]] {
        &self.lines
    }

    /// The nearest allowed place, and the surface's unit normal there: that of the vertices, blended.
    ///
    /// With [`Freedom::Line`] the place is on the nearest line, with [`Freedom::Fixed`] it is `p` itself, and the
    /// normal that of the surface nearest to it. Where the normals of the vertices cancel, it is that of the triangle.
    /// Without any line, a vertex that has the freedom of one stays where it is.
    pub fn pulled(&self, p: &Point3, freedom: Freedom) -> (Point3, Vector3) {
        let p = match freedom {
            Freedom::Line => on_segments(&self.lines, p),
            _ => *p,
        };
        self.at(self.tree.closest(&p), p, freedom)
    }

    /// [`pulled`](Self::pulled) after a move from a place on the surface: nothing is farther away than that, which the search
    /// need not look at.
    pub fn pulled_from(&self, start: &Point3, p: &Point3, freedom: Freedom) -> (Point3, Vector3) {
        // By so much the start may lie beside the surface for rounding, in lengths of coordinates.
        const BESIDE: f64 = 1e-12;
        let moved = (p - start).norm();
        let radius = moved * (1.0 + BESIDE) + start.coords.norm() * BESIDE;
        let near = (freedom == Freedom::Surface).then(|| self.tree.closest_within(p, radius));
        match near.flatten() {
            Some(closest) => self.at(closest, *p, freedom),
            None => self.pulled(p, freedom),
        }
    }

    /// The place for what is closest to `p`.
    fn at(&self, closest: Closest, p: Point3, freedom: Freedom) -> (Point3, Vector3) {
        let corners = self.surface.triangles()[closest.triangle as usize];
        let normal: Vector3 = (0..3)
            .map(|k| self.normals[corners[k] as usize] * closest.barycentric[k])
            .sum();
        let own = self.surface.doubled_area_normal(closest.triangle as usize);
        let normal = normal
            .try_normalize(1e-12)
            .or_else(|| own.try_normalize(0.0))
            .unwrap_or_else(Vector3::z);
        let at = if freedom == Freedom::Surface {
            closest.point
        } else {
            p
        };
        (at, normal)
    }

    /// The surface's normal over a quad with these corners on it, of any length: the sum of `normals`, its normals there, where
    /// they agree with each other about how the quad lies. At a tip or in a tunnel as narrow as the quad they point anywhere;
    /// then it is the mean over what lies nearest to the quad, by Simpson's rule: over a piece of a surface whose rim the
    /// sides follow, that is parallel to the quad's vector area. What is left is not looked at where it cannot turn the quad
    /// over any more: on which side it lies is all that is asked of one that lies right.
    ///
    /// ```
    /// use geom_core::mesh::shapes;
    /// use geom_core::surface::ground::{Freedom, Ground};
    /// use geom_core::Point3;
    /// // A rod whose end is one quad: at its rim the normals point sideways.
    /// let rod = shapes::cylinder(1.0, 20.0, 32, 20);
    /// let ground = Ground::new(&rod, Vec::new())?;
    /// let end = rod.bounds().max.z;
    /// let corners = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].map(|[x, y]| Point3::new(x, y, end - 0.3));
    /// let normals = corners.map(|p| ground.pulled(&p, Freedom::Surface).1);
    /// assert!(ground.normal_over(&corners, &normals).normalize().z > 0.9);
    /// # Ok::<(), geom_core::search::bvh::TreeError>(())
    /// ```
    pub fn normal_over(&self, corners: &[Point3; 4], normals: &[Vector3; 4]) -> Vector3 {
        /// From this mean cosine on, corners say it.
        const AGREE: f64 = 0.5;
        let sum: Vector3 = normals.iter().sum();
        let own = (corners[2] - corners[0]).cross(&(corners[3] - corners[1]));
        if sum.dot(&own).abs() >= 4.0 * AGREE * own.norm() {
            return sum;
        }
        // The heaviest first, which says it nearly alone.
        let at = |p: Point3, k: usize| self.pulled_from(&corners[k], &p, Freedom::Surface).1;
        let all = corners.iter().map(|p| p.coords).sum::<Vector3>();
        let mut over = sum + at(Point3::from(all / 4.0), 0) * 16.0;
        for k in 0..4 {
            // Unit normals that are not asked for, all of them against it.
            let left = 4.0 * (4 - k) as f64;
            if over.dot(&own) > left * own.norm() {
                break;
            }
            over += at(nalgebra::center(&corners[k], &corners[(k + 1) % 4]), k) * 4.0;
        }
        over
    }

    /// The place in eight directions around one with this normal, `length` away, whose value is the largest and above
    /// `before` by more than 1e-6, with its normal: a step of a compass search (Kolda, Lewis and Torczon, SIAM Review 45, 2003). `None` if
    /// there is none; of equal ones the first.
    ///
    /// The directions begin with a tangent that depends on the normal alone, so that the search is the same on every
    /// machine, and are turned by `turn` eighths of a circle: where few directions are better, other tries find others.
    /// `normal` must be a unit vector. Eight questions of the tree. `value` is told what it has to exceed, and may answer
    /// anything below that as soon as it knows that it does not.
    ///
    /// ```
    /// use geom_core::mesh::shapes;
    /// use geom_core::surface::ground::{Freedom, Ground};
    /// use geom_core::Point3;
    /// let sphere = shapes::icosphere(1.0, 3);
    /// let ground = Ground::new(&sphere, Vec::new())?;
    /// let pole = ground.pulled(&Point3::new(0.0, 0.0, 1.0), Freedom::Surface);
    /// let step = [0.2, 0.0];
    /// let (east, _) = ground.best_around(pole, step, Freedom::Surface, 0.0, |p, _| p.0.x).unwrap();
    /// assert!(east.x > 0.18);
    /// let higher = ground.best_around(pole, step, Freedom::Surface, pole.0.z, |p, _| p.0.z);
    /// assert!(higher.is_none());
    /// # Ok::<(), geom_core::search::bvh::TreeError>(())
    /// ```
    pub fn best_around(
        &self,
        (p, normal): (Point3, Vector3),
        [length, turn]: [f64; 2],
        freedom: Freedom,
        before: f64,
        mut value: impl FnMut(&(Point3, Vector3), f64) -> f64,
    ) -> Option<(Point3, Vector3)> {
        let first = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
        let second = normal.cross(&first);
        let mut best = (before + GAIN, None);
        for k in 0..8 {
            let (sine, cosine) = (FRAC_PI_4 * (f64::from(k) + turn)).sin_cos();
            let to = p + (first * cosine + second * sine) * length;
            let place = self.pulled_from(&p, &to, freedom);
            let found = value(&place, best.0);
            if found > best.0 {
                best = (found, Some(place));
            }
        }
        best.1
    }
}

/// The point of some segments that is nearest to `p`; `p` itself without any. Of equally near ones that of the first
/// segment. Linear in their number.
pub fn on_segments(segments: &[[Point3; 2]], p: &Point3) -> Point3 {
    let on = |[a, b]: &[Point3; 2]| {
        let d = b - a;
        let part = (p - a).dot(&d) / d.norm_squared();
        // A segment without length is its end.
        let part = if part.is_finite() { part } else { 0.0 };
        a + d * part.clamp(0.0, 1.0)
    };
    let nearer = |a: &Point3, b: &Point3| (a - p).norm_squared().total_cmp(&(b - p).norm_squared());
    segments.iter().map(on).min_by(nearer).unwrap_or(*p)
}
