//! How good the triangles of a surface are, and its quads.
//!
//! [`radius_ratio`] and [`angles`] judge one triangle, [`TriangleReport`] a mesh; [`scaled_jacobian`] and
//! [`JacobianSummary`] do that for quads. Nothing here depends on the size of a mesh but for the lengths and areas,
//! which are in Å.

use crate::compute::parallel;
use crate::{Point3, TriMesh, Vector3};

/// Quality of a triangle: twice the radius of the inscribed over that of the circumscribed circle,
/// 1 for an equilateral one, 0 for a degenerate one.
///
/// ```
/// use geom_core::{Point3, mesh::quality::radius_ratio};
/// let triangle = |height: f64| [[0.0, 0.0], [2.0, 0.0], [1.0, height]].map(|[x, y]| Point3::new(x, y, 0.0));
/// assert!((radius_ratio(triangle(3f64.sqrt())) - 1.0).abs() < 1e-12);
/// assert!(radius_ratio(triangle(0.01)) < 1e-3);
/// ```
///
/// It is small for needles (one short edge) and caps (one large angle) alike.
pub fn radius_ratio(corners: [Point3; 3]) -> f64 {
    let [a, b, c] = edge_lengths(corners);
    let product = a * b * c;
    if product <= 0.0 {
        return 0.0;
    }
    // 2 r / R = (b + c − a) (c + a − b) (a + b − c) / (a b c)
    ((b + c - a) * (c + a - b) * (a + b - c) / product).clamp(0.0, 1.0)
}

/// Lengths of the edges, each opposite to the corner of the same number.
pub fn edge_lengths([a, b, c]: [Point3; 3]) -> [f64; 3] {
    [(c - b).norm(), (a - c).norm(), (b - a).norm()]
}

/// The angles at the corners, radians; 0 at a corner that coincides with another. From the arctangent of cross and dot
/// product: an arccosine would lose half of the digits of small angles. They sum to π unless corners coincide.
pub fn angles([a, b, c]: [Point3; 3]) -> [f64; 3] {
    let at = |p: Point3, q: Point3, r: Point3| {
        let (u, v) = (q - p, r - p);
        u.cross(&v).norm().atan2(u.dot(&v))
    };
    [at(a, b, c), at(b, c, a), at(c, a, b)]
}

/// Measures of all triangles of a surface.
///
/// Angles, edges and ratios are over all triangles, also those without area, which have an angle of 0 and the ratio 0.
/// Valences are over used vertices. [`TriangleReport::of`] makes it in linear time.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TriangleReport {
    /// Number of used vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Total area, Å².
    pub area: f64,
    /// Smallest angle of all, degrees.
    pub min_angle_deg: f64,
    /// Mean of the smallest angles of the triangles, degrees.
    pub mean_min_angle_deg: f64,
    /// Largest angle of all, degrees.
    pub max_angle_deg: f64,
    /// Triangles by their smallest angle in bins of 5°: 0–5, 5–10, … 55–60.
    pub min_angle_histogram: [usize; 12],
    /// Smallest [`radius_ratio`].
    pub min_radius_ratio: f64,
    /// Mean [`radius_ratio`].
    pub mean_radius_ratio: f64,
    /// Shortest edge, Å.
    pub min_edge: f64,
    /// Mean edge, Å; edges between two triangles count twice.
    pub mean_edge: f64,
    /// Standard deviation of the edges, Å.
    pub edge_deviation: f64,
    /// Longest edge, Å.
    pub max_edge: f64,
    /// Share of the used vertices with six triangles. Six are asked on a boundary, too, where a regular mesh has three.
    pub regular: f64,
    /// Share of the used vertices with five to seven triangles, on a boundary two to four.
    pub nearly_regular: f64,
    /// The ten triangles of the smallest angles, worst first, with those angles in degrees.
    pub worst: Vec<(u32, f64)>,
}

/// Sums and extremes of some triangles.
struct Part {
    area: f64,
    min_angle: f64,
    sum_min_angle: f64,
    max_angle: f64,
    histogram: [usize; 12],
    min_ratio: f64,
    sum_ratio: f64,
    edges: [f64; 4],
    worst: Vec<(u32, f64)>,
}

impl TriangleReport {
    /// The measures of `mesh`; all 0 for an empty one. Parallel, with the same bits for any number of threads.
    pub fn of(mesh: &TriMesh) -> Self {
        let n = mesh.triangles().len();
        if n == 0 {
            return Self::default();
        }
        // Angles in degrees, edges twice where two triangles share them.
        let parts = parallel::fold_chunks(n, |range| {
            let mut part = Part {
                area: 0.0,
                min_angle: f64::INFINITY,
                sum_min_angle: 0.0,
                max_angle: 0.0,
                histogram: [0; 12],
                min_ratio: f64::INFINITY,
                sum_ratio: 0.0,
                edges: [f64::INFINITY, 0.0, 0.0, 0.0],
                worst: Vec::with_capacity(range.len()),
            };
            // Sums over a fixed chunk; chunks are added in their order, so that the bits do not depend on threads.
            for t in range {
                let corners = mesh.corners(t);
                part.area += 0.5 * mesh.doubled_area_normal(t).norm();
                let angles = angles(corners).map(f64::to_degrees);
                let smallest = angles[0].min(angles[1]).min(angles[2]);
                part.min_angle = part.min_angle.min(smallest);
                part.sum_min_angle += smallest;
                part.max_angle = part.max_angle.max(angles[0]).max(angles[1]).max(angles[2]);
                part.histogram[((smallest / 5.0) as usize).min(11)] += 1;
                let ratio = radius_ratio(corners);
                part.min_ratio = part.min_ratio.min(ratio);
                part.sum_ratio += ratio;
                for e in edge_lengths(corners) {
                    part.edges[0] = part.edges[0].min(e);
                    part.edges[1] += e;
                    part.edges[2] += e * e;
                    part.edges[3] = part.edges[3].max(e);
                }
                part.worst.push((t as u32, smallest));
            }
            keep_worst(&mut part.worst);
            part
        });
        // What the chunks found together.
        let mut all = Self {
            triangles: n,
            ..Self::default()
        };
        (all.min_angle_deg, all.min_radius_ratio, all.min_edge) =
            (f64::INFINITY, f64::INFINITY, f64::INFINITY);
        let (mut edge_sum, mut edge_squares) = (0.0, 0.0);
        for part in parts {
            all.area += part.area;
            all.min_angle_deg = all.min_angle_deg.min(part.min_angle);
            all.mean_min_angle_deg += part.sum_min_angle;
            all.max_angle_deg = all.max_angle_deg.max(part.max_angle);
            for (sum, count) in all.min_angle_histogram.iter_mut().zip(part.histogram) {
                *sum += count;
            }
            all.min_radius_ratio = all.min_radius_ratio.min(part.min_ratio);
            all.mean_radius_ratio += part.sum_ratio;
            all.min_edge = all.min_edge.min(part.edges[0]);
            edge_sum += part.edges[1];
            edge_squares += part.edges[2];
            all.max_edge = all.max_edge.max(part.edges[3]);
            all.worst.extend(part.worst);
        }
        keep_worst(&mut all.worst);
        let count = n as f64;
        all.mean_min_angle_deg /= count;
        all.mean_radius_ratio /= count;
        all.mean_edge = edge_sum / (3.0 * count);
        let variance = edge_squares / (3.0 * count) - all.mean_edge * all.mean_edge;
        all.edge_deviation = variance.max(0.0).sqrt();
        let mut valence = vec![0u32; mesh.positions().len()];
        // Around an inner vertex the neighbours of its triangles cancel; on a boundary two are left.
        let mut turn = vec![0i64; mesh.positions().len()];
        for corners in mesh.triangles() {
            for k in 0..3 {
                let v = corners[k] as usize;
                valence[v] += 1;
                turn[v] += i64::from(corners[(k + 1) % 3]) - i64::from(corners[(k + 2) % 3]);
            }
        }
        all.vertices = valence.iter().filter(|&&n| n > 0).count();
        let regular = valence.iter().filter(|&&n| n == 6).count();
        all.regular = regular as f64 / all.vertices as f64;
        let nearly = valence.iter().zip(&turn).filter(|&(n, turn)| match turn {
            0 => (5..=7).contains(n),
            _ => (2..=4).contains(n),
        });
        all.nearly_regular = nearly.count() as f64 / all.vertices as f64;
        all
    }
}

/// The ten smallest, the lower triangle first of equal ones: sorted again wherever lists are joined, so that chunks do
/// not matter.
fn keep_worst(worst: &mut Vec<(u32, f64)>) {
    worst.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    worst.truncate(10);
}

/// The smallest signed sine between two sides that meet in a corner of a quad (the scaled Jacobian): 1 for a
/// rectangle, negative where a corner is turned inside out. Corners are seen along the quad's vector area, whose sign
/// is that of the surface's normal.
///
/// ```
/// use geom_core::{Point3, Vector3, mesh::quality::scaled_jacobian};
/// let quad = |x: f64| [[0.0, 0.0], [1.0, 0.0], [1.0 + x, 1.0], [x, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
/// let up = Vector3::z();
/// assert!((scaled_jacobian(&quad(0.0), &up) - 1.0).abs() < 1e-12);
/// // Sheared to 45°: the sine of its sharpest corner. Seen from below it is turned over.
/// assert!((scaled_jacobian(&quad(1.0), &up) - 0.5f64.sqrt()).abs() < 1e-12);
/// assert!(scaled_jacobian(&quad(1.0), &-up) < 0.0);
/// ```
pub fn scaled_jacobian(corners: &[Point3; 4], surface_normal: &Vector3) -> f64 {
    let Some(normal) = quad_area(corners).try_normalize(0.0) else {
        return -1.0;
    };
    let worst = smallest_sine(corners, &normal);
    if normal.dot(surface_normal) < 0.0 {
        -worst.abs()
    } else {
        worst
    }
}

/// What a search for better quads raises: the scaled Jacobian where the quad lies as the surface does. Of one that lies on
/// its back that has a ridge at 0, where the quad is flat, and beyond which it lies right: there it is the smallest sine
/// seen along the surface's normal, which grows all the way.
///
/// ```
/// use geom_core::{Point3, Vector3, mesh::quality::{scaled_jacobian, upright_jacobian}};
/// // A square that turns over about one of its sides.
/// let quad = |degrees: f64| {
///     let (z, y) = degrees.to_radians().sin_cos();
///     [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, y, z], [0.0, y, z]].map(Point3::from)
/// };
/// let (down, rising) = (quad(170.0), quad(100.0));
/// let up = Vector3::z();
/// assert!((scaled_jacobian(&down, &up) - scaled_jacobian(&rising, &up)).abs() < 1e-12);
/// assert!(upright_jacobian(&down, &up) < upright_jacobian(&rising, &up));
/// assert_eq!(upright_jacobian(&quad(60.0), &up), scaled_jacobian(&quad(60.0), &up));
/// ```
pub fn upright_jacobian(corners: &[Point3; 4], surface_normal: &Vector3) -> f64 {
    if quad_area(corners).dot(surface_normal) > 0.0 {
        return scaled_jacobian(corners, surface_normal);
    }
    let normal = surface_normal.try_normalize(1e-9).unwrap_or_default();
    smallest_sine(corners, &normal).min(0.0)
}

/// What [`upright_jacobian`] is at most, whatever the surface's normal: the least sine along the quad's own, which is what it is
/// where the quad lies right, or 0.
///
/// ```
/// use geom_core::{Point3, Vector3, mesh::quality::{highest_jacobian, upright_jacobian}};
/// let sheared = [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [1.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
/// assert_eq!(highest_jacobian(&sheared), upright_jacobian(&sheared, &Vector3::z()));
/// assert!(upright_jacobian(&sheared, &-Vector3::z()) < highest_jacobian(&sheared));
/// ```
pub fn highest_jacobian(corners: &[Point3; 4]) -> f64 {
    let normal = quad_area(corners).try_normalize(0.0);
    normal.map_or(0.0, |normal| smallest_sine(corners, &normal).max(0.0))
}

/// Twice the vector area of a quad.
fn quad_area(corners: &[Point3; 4]) -> Vector3 {
    (corners[2] - corners[0]).cross(&(corners[3] - corners[1]))
}

/// Of the four corners, seen along a unit normal; −1 for a side without a length.
fn smallest_sine(corners: &[Point3; 4], normal: &Vector3) -> f64 {
    let sine = |k: usize| {
        let next = corners[(k + 1) % 4] - corners[k];
        let previous = corners[(k + 3) % 4] - corners[k];
        let lengths = next.norm() * previous.norm();
        if lengths > 0.0 {
            next.cross(&previous).dot(normal) / lengths
        } else {
            -1.0
        }
    };
    (0..4).map(sine).fold(f64::INFINITY, f64::min)
}

/// Scaled Jacobians of all quads of a mesh.
///
/// Values are those of [`scaled_jacobian`], from −1 to 1. Percentiles are values of the list itself (the one at the
/// share, rounded down), not interpolated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct JacobianSummary {
    /// The smallest.
    pub min: f64,
    /// One in a hundred is smaller.
    pub percentile_1: f64,
    /// One in twenty is smaller.
    pub percentile_5: f64,
    /// The mean.
    pub mean: f64,
    /// Quads below 0.3.
    pub below_0_3: usize,
    /// The smallest if inverted corners counted as upright ones: what tables of the literature may mean.
    pub unsigned_min: f64,
}

impl JacobianSummary {
    /// Of these values. All 0 for none.
    pub fn of(values: &[f64]) -> Self {
        if values.is_empty() {
            return Self::default();
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
        Self {
            min: sorted[0],
            percentile_1: at(0.01),
            percentile_5: at(0.05),
            mean: values.iter().sum::<f64>() / values.len() as f64,
            below_0_3: values.iter().filter(|&&j| j < 0.3).count(),
            unsigned_min: values.iter().fold(f64::INFINITY, |a, j| a.min(j.abs())),
        }
    }
}

/// How far a corner is from a right angle between sides of equal length, and the derivatives by the sides.
///
/// What optimizers of quads sum over the corners of a mesh and lower: 1 for a right angle between sides that are the
/// same multiple of their wanted lengths, more for any other corner. A common factor of both sides does not change it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CornerDistortion {
    /// The distortion; 1 is perfect.
    pub energy: f64,
    /// The area that the sides span, positive where the corner is not inverted.
    pub area: f64,
    /// Derivatives of the distortion with respect to the sides.
    pub gradient: [Vector3; 2],
}

impl CornerDistortion {
    /// `(P² + S²) / (s + √(s² + ε²))` with `s = n · (P × S)` (T. Liao, X. Li, G. Xu and Y. Zhang, Eq. 5.5, signed), for
    /// sides in units of their wanted lengths, the second to the left of the first, and the surface's unit normal.
    /// Finite for inverted corners while ε > 0.
    ///
    /// ε says what an inverted corner costs: with a small one the energy is almost that of a barrier, with a large one
    /// it is smooth and the corner can be turned back by following the gradient. Lower it as corners become upright.
    /// With ε = 0 it is infinite where the area is not positive.
    pub fn of([p, s]: &[Vector3; 2], n: &Vector3, epsilon: f64) -> Self {
        let area = n.dot(&p.cross(s));
        let root = (area * area + epsilon * epsilon).sqrt();
        let (bottom, slope) = (area + root, 1.0 + area / root);
        let top = p.norm_squared() + s.norm_squared();
        let along = top * slope / (bottom * bottom);
        Self {
            energy: top / bottom,
            area,
            gradient: [
                p * (2.0 / bottom) - s.cross(n) * along,
                s * (2.0 / bottom) - n.cross(p) * along,
            ],
        }
    }
}
