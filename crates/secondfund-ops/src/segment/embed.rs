//! Vertices as points in the space of the modes.
//!
//! Divided by √λ, low modes count more than high ones. The squared distance of two such rows, over all modes, is the commute time
//! of a random walk between the two vertices, up to a factor: large across a bottleneck, small within a part.

use crate::operators::Spectrum;

/// One row per vertex, scaled so that the largest number is 1: f32, as the kernels read them.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    pub(crate) width: usize,
    pub(crate) values: Vec<f32>,
}

impl Rows {
    /// `(φ₁/√λ₁, …, φ_K/√λ_K)` per vertex: the distances of the commute time. Without the factor fine
    /// modes count as much as coarse ones.
    pub(crate) fn of(spectrum: &Spectrum, count: usize) -> Self {
        let vertices = spectrum.areas.len();
        let modes: Vec<(f64, &Vec<f64>)> = spectrum
            .values
            .iter()
            .zip(&spectrum.modes)
            .take(count)
            .map(|(&value, mode)| (1.0 / value.max(f64::MIN_POSITIVE).sqrt(), mode))
            .collect();
        let largest = modes
            .iter()
            .flat_map(|(s, mode)| mode.iter().map(move |x| (x * s).abs()))
            .fold(0.0, f64::max);
        let unit = if largest > 0.0 { 1.0 / largest } else { 1.0 };
        let row = |v: usize| {
            modes
                .iter()
                .map(move |(s, mode)| (mode[v] * s * unit) as f32)
        };
        Self {
            width: modes.len(),
            values: (0..vertices).flat_map(row).collect(),
        }
    }

    /// The number of rows.
    pub(crate) fn len(&self) -> usize {
        self.values.len().checked_div(self.width).unwrap_or(0)
    }

    /// `width` numbers.
    pub(crate) fn row(&self, vertex: usize) -> &[f32] {
        &self.values[vertex * self.width..(vertex + 1) * self.width]
    }

    /// The rows of these vertices.
    pub(crate) fn of_sample(&self, sample: &[u32]) -> Self {
        let rows = sample.iter().flat_map(|&v| self.row(v as usize));
        Self {
            width: self.width,
            values: rows.copied().collect(),
        }
    }

    /// The mean row of some vertices.
    pub(crate) fn mean(&self, vertices: &[u32], out: &mut Vec<f32>) {
        out.clear();
        out.resize(self.width, 0.0);
        let share = 1.0 / vertices.len() as f32;
        for &v in vertices {
            for (sum, x) in out.iter_mut().zip(self.row(v as usize)) {
                *sum += x * share;
            }
        }
    }
}

/// The squared distance of two rows.
pub(crate) fn squared(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}
