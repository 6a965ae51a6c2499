//! A convex way out of folds.
//!
//! A triangle whose Jacobian J has a positive definite symmetric part, `xᵀ J x > 0` for all x, is upright and turned by less than
//! a quarter from the field: so lines turn around every vertex as often as the field does, which no energy of determinants
//! knows. All such maps are a convex set (Lipman, *Bounded distortion mapping spaces for triangular meshes*, 2012; Bommes et
//! al., *Integer-grid maps for reliable quad meshing*, 2013, inscribe a polygon), as the smallest eigenvalue of `(J + Jᵀ) / 2` is a
//! concave function of the map. What that falls short of a margin is minimized, squared, from
//! wherever a map begins: a convex function has no other minimum in which folds could hold each other.

use crate::backend::ChartDistortion;
use crate::map::spacing::Chart;

/// The eigenvalue that is aimed at: 1 is that of the field's own map. A minimum of squares falls short of its aim.
const MARGIN: f64 = 0.2;
/// What `|J − 1|²` counts for beside it: enough to say where the rest goes.
const SOFT: f64 = 1e-3;

/// Is the map of a triangle so?
pub(super) fn is_monotone(chart: &Chart, uv: &[[f64; 2]; 3]) -> bool {
    least_eigenvalue(chart, uv) > 0.0
}

/// Of the symmetric part of the Jacobian.
pub(super) fn least_eigenvalue(chart: &Chart, uv: &[[f64; 2]; 3]) -> f64 {
    let [[a, b], [c, d]] = chart.jacobian(uv);
    0.5 * (a + d - (a - d).hypot(b + c))
}

/// `A (max(0, margin − λ)² + soft |J − 1|²)` and its gradient by the corners, λ being the smallest eigenvalue.
pub(super) fn shortage(chart: &Chart, uv: &[[f64; 2]; 3]) -> ChartDistortion {
    /// Below it the two eigenvalues are one, and λ has no slope by their difference.
    const EQUAL: f64 = 1e-12;
    let [[a, b], [c, d]] = chart.jacobian(uv);
    let (p, q) = (a - d, b + c);
    let difference = p.hypot(q);
    let short = (MARGIN - 0.5 * (a + d - difference)).max(0.0);
    let turned = if difference > EQUAL {
        short / difference
    } else {
        0.0
    };
    let off = [[a - 1.0, b], [c, d - 1.0]];
    let norm: f64 = off.as_flattened().iter().map(|x| x * x).sum();
    let by_jacobian = [
        [turned * p - short, turned * q],
        [turned * q, -turned * p - short],
    ];
    let slope = |row: usize, hat: &[f64; 2]| {
        let along = |k: usize| (by_jacobian[row][k] + 2.0 * SOFT * off[row][k]) * hat[k];
        chart.area * (along(0) + along(1))
    };
    ChartDistortion {
        energy: chart.area * (short * short + SOFT * norm),
        gradient: [0, 1, 2].map(|k| [slope(0, &chart.along_u[k]), slope(1, &chart.along_v[k])]),
    }
}
