//! Each kernel as its equation reads: what backends are compared with.

use crate::backend::{Corner, CornerDistortion};

/// [`CornerDistortion`] of one corner.
pub fn corner_distortion(corner: &Corner, epsilon: f64) -> CornerDistortion {
    let ([a, b], m) = (corner.edges, corner.inverse);
    let columns = [0, 1].map(|k| a * m[0][k] + b * m[1][k]);
    let of_columns = CornerDistortion::of(&columns, &corner.normal, epsilon);
    let [p, s] = of_columns.gradient;
    CornerDistortion {
        gradient: [0, 1].map(|k| p * m[k][0] + s * m[k][1]),
        ..of_columns
    }
}
