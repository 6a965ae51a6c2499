//! Unfolding of a map with given integers.

use super::spacing::Chart;
use super::system::System;
use crate::Error;
use crate::backend::{ChartDistortion, CrossfieldBackend};

/// Steps remembered by the minimizer.
const HISTORY: usize = 10;
/// Steps per regularization.
const STEPS: usize = 120;
/// Halvings of the regularization.
const ROUNDS: usize = 14;

/// Minimizes the regularized distortion `Σ A ((|J|² + λ (det² + 1)) / 2χ + |J − 1|²)`, `χ = (det + √(ε² + det²)) / 2`, over
/// the real unknowns (Garanzha et al., *Foldover-free maps in 50 lines of code*, 2021), by L-BFGS. ε falls as the worst
/// determinant rises. Returns whether all determinants are positive.
pub(crate) fn untangle<B: CrossfieldBackend + ?Sized>(
    system: &System<'_>,
    y: &mut [f64],
    backend: &B,
) -> Result<bool, Error> {
    let mut energy = Energy {
        system,
        backend,
        fixed: y[system.seams.reals..].to_vec(),
        epsilon: 0.0,
        out: Vec::new(),
    };
    let mut x = y[..system.seams.reals].to_vec();
    let worst = energy.worst(&x)?;
    energy.epsilon = (0.5 * worst.abs()).max(0.1);
    let mut positive = worst > 0.0;
    for _ in 0..ROUNDS {
        minimize(&mut energy, &mut x)?;
        let worst = energy.worst(&x)?;
        positive = worst > 0.0;
        if positive && energy.epsilon <= 1e-6 {
            break;
        }
        energy.epsilon = if positive { 1e-6 } else { 0.5 * energy.epsilon };
    }
    y[..system.seams.reals].copy_from_slice(&x);
    Ok(positive)
}

struct Energy<'a, B: ?Sized> {
    system: &'a System<'a>,
    backend: &'a B,
    fixed: Vec<f64>,
    epsilon: f64,
    out: Vec<ChartDistortion>,
}

impl<B: CrossfieldBackend + ?Sized> Energy<'_, B> {
    fn evaluate(&mut self, x: &[f64]) -> Result<(), Error> {
        let y: Vec<f64> = x.iter().chain(&self.fixed).copied().collect();
        let corners = self.system.corners(&y);
        self.backend
            .chart_distortion(self.system.charts, &corners, self.epsilon, &mut self.out)
    }

    fn worst(&mut self, x: &[f64]) -> Result<f64, Error> {
        let y: Vec<f64> = x.iter().chain(&self.fixed).copied().collect();
        let corners = self.system.corners(&y);
        let determinant = |(chart, uv): (&Chart, &[[f64; 2]; 3])| {
            let j = chart.jacobian(uv);
            j[0][0] * j[1][1] - j[0][1] * j[1][0]
        };
        let all = self.system.charts.iter().zip(&corners).map(determinant);
        Ok(all.fold(f64::INFINITY, f64::min))
    }

    /// Energy and gradient with respect to the real unknowns.
    fn gradient(&mut self, x: &[f64]) -> Result<(f64, Vec<f64>), Error> {
        self.evaluate(x)?;
        let mut gradient = vec![0.0; x.len()];
        let mut value = 0.0;
        for (f, of) in self.out.iter().enumerate() {
            value += of.energy;
            for k in 0..3 {
                for component in 0..2 {
                    let copy = self.system.cut.copy[3 * f + k];
                    for (y, p) in self.system.seams.row(copy, component) {
                        if let Some(g) = gradient.get_mut(y) {
                            *g += f64::from(p) * of.gradient[k][component];
                        }
                    }
                }
            }
        }
        Ok((value, gradient))
    }
}

/// L-BFGS (Nocedal and Wright, *Numerical Optimization*, algorithm 7.5) with backtracking.
fn minimize<B: CrossfieldBackend + ?Sized>(
    energy: &mut Energy<'_, B>,
    x: &mut Vec<f64>,
) -> Result<(), Error> {
    let (mut value, mut gradient) = energy.gradient(x)?;
    let mut history: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::new();
    for _ in 0..STEPS {
        let mut direction = two_loops(&gradient, &history);
        let mut slope = dot(&direction, &gradient);
        if slope >= 0.0 {
            history.clear();
            direction = gradient.iter().map(|g| -g).collect();
            slope = dot(&direction, &gradient);
        }
        if slope > -1e-14 * (1.0 + value.abs()) {
            return Ok(());
        }
        // The first step is a small one: nothing is known of the curvature yet.
        let mut step = if history.is_empty() {
            0.1 / dot(&gradient, &gradient).sqrt().max(1e-12)
        } else {
            1.0
        };
        let mut next = None;
        for _ in 0..30 {
            let at: Vec<f64> = x
                .iter()
                .zip(&direction)
                .map(|(x, d)| x + step * d)
                .collect();
            let (there, slope_there) = energy.gradient(&at)?;
            if there.is_finite() && there <= value + 1e-4 * step * slope {
                next = Some((at, there, slope_there));
                break;
            }
            step *= 0.5;
        }
        let Some((at, there, gradient_there)) = next else {
            return Ok(());
        };
        let moved: Vec<f64> = at.iter().zip(x.iter()).map(|(a, b)| a - b).collect();
        let turned: Vec<f64> = gradient_there
            .iter()
            .zip(&gradient)
            .map(|(a, b)| a - b)
            .collect();
        let curvature = dot(&moved, &turned);
        if curvature > 1e-12 * dot(&turned, &turned) {
            history.push((moved, turned, 1.0 / curvature));
            if history.len() > HISTORY {
                history.remove(0);
            }
        }
        let gain = value - there;
        (*x, value, gradient) = (at, there, gradient_there);
        if gain < 1e-7 * value.abs() {
            return Ok(());
        }
    }
    Ok(())
}

fn two_loops(gradient: &[f64], history: &[(Vec<f64>, Vec<f64>, f64)]) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut alphas = Vec::new();
    for (s, y, rho) in history.iter().rev() {
        let alpha = rho * dot(s, &q);
        for (q, y) in q.iter_mut().zip(y) {
            *q -= alpha * y;
        }
        alphas.push(alpha);
    }
    if let Some((_, y, rho)) = history.last() {
        let scale = 1.0 / (rho * dot(y, y));
        for q in &mut q {
            *q *= scale;
        }
    }
    for ((s, y, rho), alpha) in history.iter().zip(alphas.into_iter().rev()) {
        let beta = rho * dot(y, &q);
        for (q, s) in q.iter_mut().zip(s) {
            *q += (alpha - beta) * s;
        }
    }
    q
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
