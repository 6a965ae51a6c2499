//! Measures of one tetrahedron, and the objective that the improvement raises.
//!
//! A tetrahedron `(a, b, c, d)` is positive when `(b − a, c − a, d − a)` is right-handed. All measures
//! are functions of the shape only: they ignore translations, rotations and uniform scaling.

use geom_core::mesh::{EDGES, FACES, six_volume};
use geom_core::{Point3, Vector3};

/// `8 · 3^(5/2) / 6`: the Joe–Liu measure is this times six volumes over `(Σ edge²)^(3/2)`.
pub(crate) const JOE_LIU: f64 = 20.784_609_690_826_528;

/// Weight of the Joe–Liu measure in the objective: `sin 20° / 0.3`, so that the two goals of the
/// thesis (20°, 0.3) are reached at the same value.
pub(crate) const SHAPE_WEIGHT: f64 = 1.14;

/// The measures of one tetrahedron.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Measures {
    /// Six times the signed volume, Å³.
    pub six_volume: f64,
    /// Signed Joe–Liu measure (thesis Eq. 3.16): 1 for the regular tetrahedron, 0 when flat,
    /// negative when inverted.
    pub joe_liu: f64,
    /// Longest over shortest edge; infinite when two corners coincide.
    pub edge_ratio: f64,
    /// Smallest dihedral angle, degrees; 0 unless the volume is positive.
    pub min_dihedral: f64,
    /// Largest dihedral angle, degrees; 180 unless the volume is positive.
    pub max_dihedral: f64,
}

/// Radius ratio `3 r / R` of in- and circumscribed spheres: 1 for the regular tetrahedron, 0 unless
/// the volume is positive.
///
/// ```
/// # use tet_quality::{geom_core::Point3, radius_ratio};
/// let corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
/// // r = 1 / (3 + √3), R = √3 / 2.
/// assert!((radius_ratio(corner) - 0.732_050_8).abs() < 1e-6);
/// ```
pub fn radius_ratio(corners: [Point3; 4]) -> f64 {
    let [a, b, c, d] = corners;
    let v6 = six_volume(corners);
    if v6 <= 0.0 {
        return 0.0;
    }
    let (u, v, w) = (b - a, c - a, d - a);
    let surface: f64 = face_normals(corners).iter().map(Vector3::norm).sum();
    // Circumcentre − a = (|u|² v×w + |v|² w×u + |w|² u×v) / (2 · 6V).
    let rise = v.cross(&w) * u.norm_squared()
        + w.cross(&u) * v.norm_squared()
        + u.cross(&v) * w.norm_squared();
    // r = 3V / area = 6V / Σ|n|;   R = |rise| / (2 · 6V).
    6.0 * v6 * v6 / (surface * rise.norm())
}

/// Longest edge over shortest altitude: √(3/2) for the regular tetrahedron, infinite unless the
/// volume is positive.
///
/// ```
/// # use tet_quality::{aspect_ratio, geom_core::Point3};
/// let corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
/// // √2 over the altitude 1 / √3 on the slanted face.
/// assert!((aspect_ratio(corner) - 6f64.sqrt()).abs() < 1e-12);
/// ```
pub fn aspect_ratio(corners: [Point3; 4]) -> f64 {
    let v6 = six_volume(corners);
    if v6 <= 0.0 {
        return f64::INFINITY;
    }
    let longest = edges_squared(corners)
        .into_iter()
        .fold(0.0, f64::max)
        .sqrt();
    // An altitude is 6V over twice the area of its face.
    let widest = face_normals(corners)
        .iter()
        .map(Vector3::norm)
        .fold(0.0, f64::max);
    longest * widest / v6
}

/// The objective `q`: for a positive tetrahedron the smaller of the smallest sine of a dihedral angle
/// and 1.14 times Joe–Liu; for others the Joe–Liu measure, which is ≤ 0. Never NaN for finite input.
///
/// `q ≥ sin θ` means that every dihedral angle lies in `[θ, 180° − θ]`.
///
/// ```
/// # use tet_quality::{geom_core::Point3, measure::metrics::quality};
/// let corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Point3::from);
/// // Its smallest angle is acos(1/√3), with sine √(2/3) = 0.816; 1.14 Joe–Liu is 0.878.
/// assert!((quality(corner) - (2.0f64 / 3.0).sqrt()).abs() < 1e-12);
/// ```
pub fn quality(corners: [Point3; 4]) -> f64 {
    let raw = Raw::of(corners);
    let shape = raw.joe_liu();
    if raw.v6 <= 0.0 {
        return shape;
    }
    raw.min_sine().min(SHAPE_WEIGHT * shape)
}

fn edges_squared(p: [Point3; 4]) -> [f64; 6] {
    // A loop, not `array::map`, which is not always compiled in place.
    let mut out = [0.0; 6];
    for (e, [i, j]) in out.iter_mut().zip(EDGES) {
        *e = (p[j] - p[i]).norm_squared();
    }
    out
}

/// Doubled area normals, pointing out of a positive tetrahedron; entry `k` lies opposite corner `k`.
fn face_normals(p: [Point3; 4]) -> [Vector3; 4] {
    let mut out = [Vector3::zeros(); 4];
    for (n, [i, j, k]) in out.iter_mut().zip(FACES) {
        *n = (p[j] - p[i]).cross(&(p[k] - p[i]));
    }
    out
}

/// What the objective is made of. Lengths are divided by the longest edge, so that neither large nor
/// small units overflow.
/// The fields: six volumes, squared edges in the order of `EDGES`, squares of the doubled areas opposite each corner.
struct Raw {
    v6: f64,
    edges: [f64; 6],
    squares: [f64; 4],
}

impl Raw {
    fn of(p: [Point3; 4]) -> Self {
        let reach = (p[1] - p[0])
            .amax()
            .max((p[2] - p[0]).amax())
            .max((p[3] - p[0]).amax());
        let scale = if reach > 0.0 { reach } else { 1.0 };
        let unit = 1.0 / scale;
        let [a, b, c, d] = p;
        let p = [
            Point3::origin(),
            Point3::from((b - a) * unit),
            Point3::from((c - a) * unit),
            Point3::from((d - a) * unit),
        ];
        let [k, l, m, n] = face_normals(p);
        Self {
            v6: six_volume(p),
            edges: edges_squared(p),
            squares: [
                k.norm_squared(),
                l.norm_squared(),
                m.norm_squared(),
                n.norm_squared(),
            ],
        }
    }

    fn joe_liu(&self) -> f64 {
        let sum: f64 = self.edges.iter().sum();
        if sum > 0.0 {
            JOE_LIU * self.v6 / (sum * sum.sqrt())
        } else {
            0.0
        }
    }

    /// Smallest sine of a dihedral angle: at edge `ij`, `sin = 6V |ij| / (|n_k| |n_l|)` with the faces
    /// `k`, `l` that meet there.
    fn min_sine(&self) -> f64 {
        let s = &self.squares;
        let product = s[0] * s[1] * s[2] * s[3];
        if product <= 0.0 {
            return 0.0;
        }
        // sin² = (6V)² e² n_i² n_j² / (n_0² n_1² n_2² n_3²): one division for all six.
        let least = EDGES
            .iter()
            .zip(&self.edges)
            .map(|(&[i, j], e)| e * s[i] * s[j])
            .fold(f64::INFINITY, f64::min);
        self.v6 * (least / product).sqrt()
    }
}
