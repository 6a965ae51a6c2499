//! The kernels on the CPU: the specification.

use geom_core::{Cpu, Point3};
use rayon::prelude::*;

use crate::backend::{BLOCK_CELLS, BLOCK_POINTS, BLOCK_SIDE, ContourBackend};
use crate::{Error, lanes};

/// A dual vertex keeps this distance from the sides of its cell.
pub(crate) const INSET: f64 = 0.01;
/// Newton steps behave as if the gradient were at least √REGULAR times the spread of the corner values
/// per cell: flat places move little instead of jumping.
pub(crate) const REGULAR: f64 = 0.01;

impl ContourBackend for Cpu {
    fn min_max(&self, blocks: &[f32]) -> Result<Vec<[f32; 2]>, Error> {
        Ok(blocks.par_chunks_exact(BLOCK_POINTS).map(min_max).collect())
    }

    fn crossings(&self, blocks: &[f32], level: f32) -> Result<Vec<u8>, Error> {
        let mut masks = vec![0; blocks.len() / BLOCK_POINTS * BLOCK_CELLS];
        masks
            .par_chunks_exact_mut(BLOCK_CELLS)
            .zip(blocks.par_chunks_exact(BLOCK_POINTS))
            .for_each(|(masks, values)| crossings(values, level, masks));
        Ok(masks)
    }

    fn dual_vertices(&self, cells: &[[f32; 8]], steps: u32) -> Result<Vec<[f32; 3]>, Error> {
        let mut out = vec![[0.0; 3]; cells.len()];
        out.par_chunks_mut(1024)
            .zip(cells.par_chunks(1024))
            .for_each(|(out, cells)| lanes::dual_vertices(cells, steps, out));
        Ok(out)
    }
}

fn min_max(values: &[f32]) -> [f32; 2] {
    // Lanes, so that the compiler may use wide registers.
    let (mut low, mut high) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
    for chunk in values.chunks(8) {
        for (i, &v) in chunk.iter().enumerate() {
            low[i] = low[i].min(v);
            high[i] = high[i].max(v);
        }
    }
    [
        low.into_iter().fold(f32::INFINITY, f32::min),
        high.into_iter().fold(f32::NEG_INFINITY, f32::max),
    ]
}

fn crossings(values: &[f32], level: f32, masks: &mut [u8]) {
    const ROW: usize = BLOCK_SIDE;
    const LAYER: usize = BLOCK_SIDE * BLOCK_SIDE;
    let mut signs = [0u8; BLOCK_POINTS];
    for (s, &v) in signs.iter_mut().zip(values) {
        *s = u8::from(v >= level);
    }
    for z in 0..8 {
        for y in 0..8 {
            let at = (z * BLOCK_SIDE + y) * BLOCK_SIDE;
            let corner = |offset: usize, bit: u8, x: usize| signs[at + offset + x] << bit;
            for x in 0..8 {
                masks[(z * 8 + y) * 8 + x] = corner(0, 0, x)
                    | corner(1, 1, x)
                    | corner(ROW, 2, x)
                    | corner(ROW + 1, 3, x)
                    | corner(LAYER, 4, x)
                    | corner(LAYER + 1, 5, x)
                    | corner(LAYER + ROW, 6, x)
                    | corner(LAYER + ROW + 1, 7, x);
            }
        }
    }
}

/// A point of the unit cube as a point of space, in cells.
pub(crate) fn within(low: [i32; 3], x: [f32; 3]) -> Point3 {
    Point3::from([0, 1, 2].map(|k| f64::from(low[k]) + f64::from(x[k])))
}

/// The kernels as the equations read, for one cell at a time: what [`lanes`] must give.
#[cfg(test)]
pub(crate) mod specification {
    use super::{INSET, REGULAR};
    use geom_core::Vector3;

    /// Value and gradient of the trilinear interpolant of the corners of the unit cube.
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

    /// [`ContourBackend::dual_vertices`] for one cell, as the equations read.
    pub(crate) fn dual_vertex(v: &[f64; 8], steps: u32) -> [f64; 3] {
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

    /// A regularized Newton step towards the level set, in cells: `f` is value minus level, `g` its
    /// gradient per cell, `spread` the range of the values in the cell.
    fn newton_step(f: f64, g: &Vector3, spread: f64) -> Vector3 {
        let square = g.norm_squared() + REGULAR * spread * spread;
        if square > 0.0 {
            g * (-f / square)
        } else {
            Vector3::zeros()
        }
    }
}
