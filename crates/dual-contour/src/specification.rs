//! The kernel as its equations read, one cell at a time, in f64: what every backend must give.
//!
//! It shares two constants with the kernel of the CPU and no code. Coordinates are those of the unit cube, values are
//! minus the level, corner `x + 2y + 4z` is the one with these bits.

use crate::kernel::{INSET, REGULAR};
use geom_core::Vector3;

/// [`ContourBackend::dual_vertices`](crate::ContourBackend) for one cell: from the mean of the crossings `steps`
/// Newton steps, each kept off the sides of the cell.
/// A cell without a change of sign begins in its middle.
pub fn dual_vertex(v: &[f64; 8], steps: u32) -> [f64; 3] {
    let spread = v.iter().fold(f64::NEG_INFINITY, |m, &c| m.max(c))
        - v.iter().fold(f64::INFINITY, |m, &c| m.min(c));
    let mut x = mass_point(v);
    for _ in 0..steps {
        let (f, g) = trilinear(v, &x);
        let step = newton_step(f, &Vector3::from(g), spread);
        for k in 0..3 {
            x[k] = (x[k] + step[k]).clamp(INSET, 1.0 - INSET);
        }
    }
    x
}

/// Value and gradient of the trilinear interpolant of the corners of the unit cube.
/// The gradient is per edge of the cell.
fn trilinear(v: &[f64; 8], x: &[f64; 3]) -> (f64, [f64; 3]) {
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let x00 = mix(v[0], v[1], x[0]);
    let x10 = mix(v[2], v[3], x[0]);
    let x01 = mix(v[4], v[5], x[0]);
    let x11 = mix(v[6], v[7], x[0]);
    let (y0, y1) = (mix(x00, x10, x[1]), mix(x01, x11, x[1]));
    let gradient = [
        mix(
            mix(v[1] - v[0], v[3] - v[2], x[1]),
            mix(v[5] - v[4], v[7] - v[6], x[1]),
            x[2],
        ),
        mix(x10 - x00, x11 - x01, x[2]),
        y1 - y0,
    ];
    (mix(y0, y1, x[2]), gradient)
}

/// The mean of the points where edges of the unit cube change sign, kept off its sides; its middle if
/// none does.
fn mass_point(v: &[f64; 8]) -> [f64; 3] {
    let (mut sum, mut n) = ([0.0; 3], 0.0);
    for axis in 0..3 {
        for i in (0..8usize).filter(|i| i >> axis & 1 == 0) {
            let j = i | 1 << axis;
            if (v[i] >= 0.0) != (v[j] >= 0.0) {
                for (k, s) in sum.iter_mut().enumerate() {
                    *s += if k == axis {
                        v[i] / (v[i] - v[j])
                    } else {
                        (i >> k & 1) as f64
                    };
                }
                n += 1.0;
            }
        }
    }
    if n == 0.0 {
        [0.5; 3]
    } else {
        sum.map(|s| (s / n).clamp(INSET, 1.0 - INSET))
    }
}

/// A regularized Newton step towards the level set, in cells: `f` is value minus level, `g` its
/// gradient per cell, `spread` the range of the values in the cell.
/// `−f g / (|g|² + R spread²)`: with `R = 0` Newton's step along the gradient, with a small `R` (a Levenberg–Marquardt
/// term) one that stays short where the interpolant is flat. 0 in a cell of one value.
fn newton_step(f: f64, g: &Vector3, spread: f64) -> Vector3 {
    let square = g.norm_squared() + REGULAR * spread * spread;
    if square > 0.0 {
        g * (-f / square)
    } else {
        Vector3::zeros()
    }
}
