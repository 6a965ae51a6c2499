//! What is nearest in one triangle, and where a ray meets it.

use crate::{Aabb, Point3, Vector3};

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
pub(super) struct Ray {
    origin: Point3,
    inverse: Vector3,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Ray {
    pub(super) fn new(origin: &Point3, direction: &Vector3) -> Option<Self> {
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
    pub(super) fn enters(&self, b: &Aabb) -> Option<f64> {
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
    pub(super) fn meets(&self, corners: &[Point3; 3]) -> Option<(f64, [f64; 3], bool)> {
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
