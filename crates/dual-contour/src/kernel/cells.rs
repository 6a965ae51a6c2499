//! What is done to every block and every cell: ranges, signs, dual vertices.
//!
//! Blocks are closed: 9³ values, x fastest, whose outer layers the neighbours have too. Selections are written as
//! comparisons, not as `min` and `max`, where that lets them become one instruction; none of the values is NaN by then.

use geom_core::compute::lanes::autovectorized;

use super::{BLOCK_CELLS, BLOCK_POINTS, BLOCK_SIDE, INSET, LANES, REGULAR};

/// [`crate::ContourBackend::dual_vertices`] on this machine.
/// Eight at a time; lanes that the last cells leave free hold the value 1 throughout, which has no crossing.
pub(crate) fn dual_vertices(cells: &[[f32; 8]], steps: u32, out: &mut [[f32; 3]]) {
    autovectorized(
        #[inline(always)]
        || {
            for (cells, out) in cells.chunks(LANES).zip(out.chunks_mut(LANES)) {
                let mut v = [[1.0; LANES]; 8];
                for (l, cell) in cells.iter().enumerate() {
                    for (v, &c) in v.iter_mut().zip(cell) {
                        v[l] = f64::from(c);
                    }
                }
                let x = dual_vertex(&v, steps);
                for (l, out) in out.iter_mut().enumerate() {
                    *out = [0, 1, 2].map(|k| x[k][l] as f32);
                }
            }
        },
    );
}

/// The lowest and the highest of each block's values.
/// Blocks follow each other without gaps, one result each.
pub(crate) fn min_max(blocks: &[f32], out: &mut [[f32; 2]]) {
    autovectorized(
        #[inline(always)]
        || {
            for (block, out) in blocks.chunks_exact(BLOCK_POINTS).zip(out.iter_mut()) {
                let (mut low, mut high) = ([f32::INFINITY; 16], [f32::NEG_INFINITY; 16]);
                let (chunks, rest) = block.as_chunks::<16>();
                for chunk in chunks {
                    low =
                        std::array::from_fn(|l| if chunk[l] < low[l] { chunk[l] } else { low[l] });
                    high = std::array::from_fn(|l| {
                        if chunk[l] > high[l] {
                            chunk[l]
                        } else {
                            high[l]
                        }
                    });
                }
                for (l, &v) in rest.iter().enumerate() {
                    low[l] = low[l].min(v);
                    high[l] = high[l].max(v);
                }
                *out = [
                    low.into_iter().fold(f32::INFINITY, f32::min),
                    high.into_iter().fold(f32::NEG_INFINITY, f32::max),
                ];
            }
        },
    );
}

/// Is none of the values infinite or not a number?
/// Looks at 64 values before it may stop, so that they are looked at together.
pub(crate) fn all_finite(values: &[f32]) -> bool {
    autovectorized(
        #[inline(always)]
        || {
            values.chunks(64).all(|chunk| {
                let bad = |bad: u32, v: &f32| bad | u32::from(!v.is_finite());
                chunk.iter().fold(0, bad) == 0
            })
        },
    )
}

/// The signs of the corners of all cells of the blocks.
/// Bit `x + 2y + 4z` of a mask is set where that corner is at least `level`; 512 masks per block, x fastest. 0 and 255
/// are cells without a surface.
pub(crate) fn crossings(blocks: &[f32], level: f32, masks: &mut [u8]) {
    autovectorized(
        #[inline(always)]
        || {
            let blocks = blocks.chunks_exact(BLOCK_POINTS);
            for (masks, values) in masks.chunks_exact_mut(BLOCK_CELLS).zip(blocks) {
                signs(values, level, masks);
            }
        },
    );
}

/// Of one block: each value is compared once, not for each of the eight cells that it is a corner of.
#[inline(always)]
fn signs(values: &[f32], level: f32, masks: &mut [u8]) {
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

/// From `a` at `t = 0` to `b` at 1.
#[inline(always)]
fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn most(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The dual vertices of `L` cells, given corner by corner with the lane last. What a branch would skip is computed and
/// left out, so that all lanes go the same way.
#[inline(always)]
fn dual_vertex<const L: usize>(v: &[[f64; L]; 8], steps: u32) -> [[f64; L]; 3] {
    // The mean of the crossings on the twelve edges; lanes whose edge has none add zeros.
    let (mut sum, mut n) = ([[0.0; L]; 3], [0.0; L]);
    for axis in 0..3 {
        for i in 0..8usize {
            if i >> axis & 1 == 1 {
                continue;
            }
            let j = i | 1 << axis;
            for l in 0..L {
                let (a, b) = (v[i][l], v[j][l]);
                let change = if (a >= 0.0) != (b >= 0.0) { 1.0 } else { 0.0 };
                let along = if change > 0.0 { a / (a - b) } else { 0.0 };
                n[l] += change;
                sum[axis][l] += along;
                // The other two coordinates are those of the corner.
                let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
                sum[p][l] += change * (i >> p & 1) as f64;
                sum[q][l] += change * (i >> q & 1) as f64;
            }
        }
    }
    let mut x = [[0.5; L]; 3];
    for k in 0..3 {
        for l in 0..L {
            let mean = least(most(sum[k][l] / n[l], INSET), 1.0 - INSET);
            x[k][l] = if n[l] > 0.0 { mean } else { 0.5 };
        }
    }
    // What the square of the gradient is taken to be at least.
    let mut floor = [0.0; L];
    for l in 0..L {
        let (mut low, mut high) = (v[0][l], v[0][l]);
        for c in &v[1..] {
            low = least(low, c[l]);
            high = most(high, c[l]);
        }
        floor[l] = REGULAR * (high - low) * (high - low);
    }
    // Newton steps on the trilinear interpolant, each kept within the cell.
    for _ in 0..steps {
        for l in 0..L {
            let [x0, x1, x2] = [x[0][l], x[1][l], x[2][l]];
            let d = [
                v[1][l] - v[0][l],
                v[3][l] - v[2][l],
                v[5][l] - v[4][l],
                v[7][l] - v[6][l],
            ];
            let x00 = v[0][l] + d[0] * x0;
            let x10 = v[2][l] + d[1] * x0;
            let x01 = v[4][l] + d[2] * x0;
            let x11 = v[6][l] + d[3] * x0;
            let (y0, y1) = (mix(x00, x10, x1), mix(x01, x11, x1));
            let g0 = mix(mix(d[0], d[1], x1), mix(d[2], d[3], x1), x2);
            let g1 = mix(x10 - x00, x11 - x01, x2);
            let g2 = y1 - y0;
            let f = mix(y0, y1, x2);
            let square = g0 * g0 + g1 * g1 + g2 * g2 + floor[l];
            let t = if square > 0.0 { -f / square } else { 0.0 };
            x[0][l] = least(most(x0 + g0 * t, INSET), 1.0 - INSET);
            x[1][l] = least(most(x1 + g1 * t, INSET), 1.0 - INSET);
            x[2][l] = least(most(x2 + g2 * t, INSET), 1.0 - INSET);
        }
    }
    x
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;
    use proptest::prelude::*;

    /// Values of some blocks: smooth, noisy, or with many ties with the level 1.
    fn blocks() -> impl Strategy<Value = Vec<f32>> {
        let near = [1.0f32.next_up(), 1.0f32.next_down(), 0.0, -0.0];
        let value = prop_oneof![
            3 => -2.0f32..4.0,
            1 => Just(1.0f32),
            1 => prop::sample::select(near.to_vec()),
        ];
        (1..4usize).prop_flat_map(move |n| prop::collection::vec(value.clone(), n * BLOCK_POINTS))
    }

    /// The lowest and the highest value at each of the places of a block, in blocks that follow each other.
    pub fn extremes_are_seen_wherever_they_stand() {
        let mut values = vec![0.5f32; BLOCK_POINTS * BLOCK_POINTS];
        for (place, block) in values.chunks_exact_mut(BLOCK_POINTS).enumerate() {
            block[place] = 3.0 + place as f32;
            block[(place + 400) % BLOCK_POINTS] = -1.0 - place as f32;
        }
        let mut found = vec![[7.0; 2]; BLOCK_POINTS];
        min_max(&values, &mut found);
        for (place, range) in found.into_iter().enumerate() {
            assert_eq!(range, [-1.0 - place as f32, 3.0 + place as f32], "{place}");
        }
    }

    pub fn ranges_and_signs_are_those_of_each_value() {
        proptest!(ProptestConfig {
                rng_seed: proptest::test_runner::RngSeed::Fixed(3),
                failure_persistence: None,
                ..ProptestConfig::with_cases(48)
            }, |(values in blocks(), other in -0.5f32..1.5)| {
            let mut ranges = vec![[7.0; 2]; values.len() / BLOCK_POINTS];
            min_max(&values, &mut ranges);
            for (block, range) in values.chunks_exact(BLOCK_POINTS).zip(ranges) {
                let low = block.iter().copied().fold(f32::INFINITY, f32::min);
                let high = block.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                prop_assert_eq!(range, [low, high]);
            }
            for level in [1.0, other] {
                let mut masks = vec![7; values.len() / BLOCK_POINTS * BLOCK_CELLS];
                crossings(&values, level, &mut masks);
                for (i, mask) in masks.into_iter().enumerate() {
                    let (block, cell) = (i / BLOCK_CELLS, i % BLOCK_CELLS);
                    let at = [cell % 8, cell / 8 % 8, cell / 64];
                    for c in 0..8 {
                        let p = [0, 1, 2].map(|k| at[k] + (c >> k & 1));
                        let point = (p[2] * BLOCK_SIDE + p[1]) * BLOCK_SIDE + p[0];
                        let inside = values[block * BLOCK_POINTS + point] >= level;
                        prop_assert_eq!(mask >> c & 1 == 1, inside, "corner {} of cell {:?}", c, at);
                    }
                }
            }
        });
    }

    pub fn dual_vertices_are_those_of_the_specification() {
        proptest!(ProptestConfig {
                rng_seed: proptest::test_runner::RngSeed::Fixed(3),
                failure_persistence: None,
                ..ProptestConfig::with_cases(48)
            }, |(
            cells in prop::collection::vec(prop::array::uniform8(-1.0f32..1.0), 1..20),
        )| {
            let mut out = vec![[0.0; 3]; cells.len()];
            dual_vertices(&cells, 4, &mut out);
            for (v, x) in cells.iter().zip(&out) {
                let exact = crate::specification::dual_vertex(&v.map(f64::from), 4);
                for k in 0..3 {
                    prop_assert!((f64::from(x[k]) - exact[k]).abs() < 1e-6, "{x:?} {exact:?}");
                }
            }
        });
    }
}
