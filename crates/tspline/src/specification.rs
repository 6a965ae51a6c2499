//! Each kernel as its equation reads: what backends are compared with.

use crate::backend::{Corner, CornerDistortion};

/// [`CornerDistortion`] of one corner.
pub fn corner_distortion(corner: &Corner, epsilon: f64) -> CornerDistortion {
    let ([a, b], n, m) = (corner.edges, corner.normal, corner.inverse);
    let (p, s) = (a * m[0][0] + b * m[1][0], a * m[0][1] + b * m[1][1]);
    let area = n.dot(&p.cross(&s));
    let root = (area * area + epsilon * epsilon).sqrt();
    let (bottom, slope) = (area + root, 1.0 + area / root);
    let top = p.norm_squared() + s.norm_squared();
    let along = top * slope / (bottom * bottom);
    let to_p = p * (2.0 / bottom) - s.cross(&n) * along;
    let to_s = s * (2.0 / bottom) - n.cross(&p) * along;
    CornerDistortion {
        energy: top / bottom,
        area,
        gradient: [
            to_p * m[0][0] + to_s * m[0][1],
            to_p * m[1][0] + to_s * m[1][1],
        ],
    }
}
