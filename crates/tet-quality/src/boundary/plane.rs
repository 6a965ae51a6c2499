//! Planes that parts of interfaces lie in, and curves in which they cut the isosurface.

use geom_core::field::Tangent;
use geom_core::nalgebra::{Matrix3, SymmetricEigen};
use geom_core::{Point3, Vector3};

/// Distance from a plane that counts as none, Å: far more than a search for the crossing of an edge leaves, far less than
/// matters.
const EXACT: f64 = 1e-7;
/// The same per length, for a plane of which only a part is known.
const TILT: f64 = 1e-6;

/// All points `x` with `normal · x = offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// Of unit length.
    pub(crate) normal: Vector3,
    /// Å.
    pub(crate) offset: f64,
}

impl Plane {
    /// The plane across a unit normal through a point.
    pub(crate) fn through(x: &Point3, normal: Vector3) -> Self {
        let offset = normal.dot(&x.coords);
        Self { normal, offset }
    }

    /// Signed distance of a point, Å.
    pub(crate) fn height(&self, x: &Point3) -> f64 {
        self.normal.dot(&x.coords) - self.offset
    }

    /// Does a point lie in the plane, as far as meshers tell?
    pub(crate) fn holds(&self, x: &Point3) -> bool {
        self.height(x).abs() <= EXACT
    }

    /// The nearest point of the plane.
    pub(crate) fn foot(&self, x: &Point3) -> Point3 {
        x - self.normal * self.height(x)
    }

    /// A field within the plane through the point where it is known: of the gradient what lies in it. Newton's steps along
    /// that solve for plane and level set together.
    pub(crate) fn restrict(&self, tangent: Tangent) -> Tangent {
        let along = self.normal * tangent.gradient.dot(&self.normal);
        let gradient = tangent.gradient - along;
        Tangent {
            gradient,
            ..tangent
        }
    }
}

/// Points nearly in one plane, and the plane that fits them best.
pub(crate) struct PlaneFit {
    /// What was known of the plane at first.
    start: Point3,
    normal: Vector3,
    /// The sums of the points, seen from the start, and of their outer products.
    count: f64,
    sum: Vector3,
    squares: Matrix3<f64>,
}

impl PlaneFit {
    /// Of a first point and the unit normal there.
    pub(crate) fn at(start: Point3, normal: Vector3) -> Self {
        Self {
            start,
            normal,
            count: 0.0,
            sum: Vector3::zeros(),
            squares: Matrix3::zeros(),
        }
    }

    /// May a point with this unit normal lie in the same plane?
    pub(crate) fn takes(&self, x: &Point3, normal: &Vector3) -> bool {
        let d = x - self.start;
        self.normal.cross(normal).norm() <= TILT
            && self.normal.dot(&d).abs() <= EXACT + TILT * d.norm()
    }

    /// One more point.
    pub(crate) fn add(&mut self, x: &Point3) {
        let d = x - self.start;
        self.count += 1.0;
        self.sum += d;
        self.squares += d * d.transpose();
    }

    /// The plane of least squares: across the direction in which the points vary least.
    pub(crate) fn plane(&self) -> Plane {
        let mean = self.sum / self.count.max(1.0);
        let spread = self.squares - mean * mean.transpose() * self.count;
        let axes = SymmetricEigen::new(spread);
        let normal = axes
            .eigenvectors
            .column(axes.eigenvalues.imin())
            .normalize();
        let along = normal * self.normal.dot(&normal).signum();
        Plane::through(&(self.start + mean), along)
    }
}
