//! Each kernel as its equation reads: what backends are compared with.

use crate::backend::ChartDistortion;
use crate::map::Chart;

/// [`ChartDistortion`] of one triangle.
pub fn chart_distortion(chart: &Chart, corners: &[[f64; 2]; 3], epsilon: f64) -> ChartDistortion {
    let j = chart.jacobian(corners);
    let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
    let root = (epsilon * epsilon + determinant * determinant).sqrt();
    let chi = (determinant + root) / 2.0;
    let chi_slope = (1.0 + determinant / root) / 2.0;
    let squares: f64 = j.iter().flatten().map(|x| x * x).sum();
    let barrier = (squares + determinant * determinant + 1.0) / (2.0 * chi);
    let off = [[j[0][0] - 1.0, j[0][1]], [j[1][0], j[1][1] - 1.0]];
    let fit: f64 = off.iter().flatten().map(|x| x * x).sum();
    let cofactor = [[j[1][1], -j[1][0]], [-j[0][1], j[0][0]]];
    let along_cofactor = (determinant - barrier * chi_slope) / chi;
    let mut gradient = [[0.0; 2]; 3];
    for (k, g) in gradient.iter_mut().enumerate() {
        for (row, hats) in [&chart.along_u, &chart.along_v].into_iter().enumerate() {
            for c in 0..2 {
                let slope = j[row][c] / chi + along_cofactor * cofactor[row][c] + 2.0 * off[row][c];
                g[row] += chart.area * slope * hats[k][c];
            }
        }
    }
    ChartDistortion {
        energy: chart.area * (barrier + fit),
        gradient,
    }
}
