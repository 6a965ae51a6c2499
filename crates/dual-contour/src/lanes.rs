//! The two hot loops over cells, for eight cells at a time: each step is one loop over the lanes, which
//! the compiler turns into the widest instructions at hand. Bits do not depend on which those are, nor
//! on the number of lanes.

use crate::cpu::{INSET, REGULAR};
use crate::quality::NO_FAN;

/// Cells at a time.
pub(crate) const LANES: usize = 8;

/// Runs `work` with the widest instructions of this machine.
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

/// [`crate::ContourBackend::dual_vertices`] on this machine.
pub(crate) fn dual_vertices(cells: &[[f32; 8]], steps: u32, out: &mut [[f32; 3]]) {
    widest(
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

#[inline(always)]
fn dual_vertex<const L: usize>(v: &[[f64; L]; 8], steps: u32) -> [[f64; L]; 3] {
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
    let mut floor = [0.0; L];
    for l in 0..L {
        let (mut low, mut high) = (v[0][l], v[0][l]);
        for c in &v[1..] {
            low = least(low, c[l]);
            high = most(high, c[l]);
        }
        floor[l] = REGULAR * (high - low) * (high - low);
    }
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

/// Four points around the edge from the origin to (0, 0, 1), counter-clockwise about it; lane last.
pub(crate) type Quads<const L: usize> = [[[f64; L]; 3]; 4];

/// Which diagonal cuts each quad so that the worst of the four tetrahedra with the ends of the edge is
/// best: 0 from point 0 to 2, 1 from 1 to 3, [`NO_FAN`] if either way one of them is not positive.
#[inline(always)]
pub(crate) fn diagonals<const L: usize>(p: &Quads<L>) -> [u8; L] {
    let mut out = [NO_FAN; L];
    let mut worst = [[0.0; L]; 2];
    for l in 0..L {
        let x: [[f64; 3]; 4] = std::array::from_fn(|q| [p[q][0][l], p[q][1][l], p[q][2][l]]);
        let y = x.map(|x| [x[0], x[1], x[2] - 1.0]);
        let ring: [[f64; 3]; 4] = std::array::from_fn(|q| minus(x[(q + 1) % 4], x[q]));
        let length = ring.map(|r| dot(r, r));
        let across = [minus(x[2], x[0]), minus(x[3], x[1])];
        let across_length = across.map(|d| dot(d, d));
        // Normals of the triangles of the quad: start k gives (k, k + 1, k + 2) and (k, k + 2, k + 3).
        let side: [[f64; 3]; 4] = std::array::from_fn(|q| cross(ring[q], ring[(q + 1) % 4]));
        let side = side.map(|n| dot(n, n));
        let mut w = [f64::INFINITY; 2];
        for (z, sign) in [(x, 1.0), (y, -1.0)] {
            let spoke = z.map(|z| dot(z, z));
            let normal: [[f64; 3]; 4] = std::array::from_fn(|q| cross(z[q], z[(q + 1) % 4]));
            let area = normal.map(|n| dot(n, n));
            for (s, w) in w.iter_mut().enumerate() {
                let cut = cross(z[s], z[s + 2]);
                let cut = dot(cut, cut);
                // Corners a, b, c around the apex z = 0, with c − b the ring's, a the start or not.
                for k in [s, (s + 2) % 4] {
                    let (a, b, c) = (k, (k + 1) % 4, (k + 2) % 4);
                    let volume = sign * dot(normal[a], z[c]);
                    let (ab, bc, ca) = (area[a], area[b], cut);
                    let base = side[a];
                    let num = least(
                        least(
                            least(spoke[a] * bc * base, spoke[b] * ca * base),
                            spoke[c] * ab * base,
                        ),
                        least(
                            least(length[a] * bc * ca, length[b] * ab * ca),
                            across_length[s] * ab * bc,
                        ),
                    );
                    let sine = volume * volume * num / (ab * bc * ca * base);
                    let sine = if volume > 0.0 && sine < f64::INFINITY {
                        sine
                    } else {
                        -1.0
                    };
                    *w = least(*w, sine);
                }
            }
        }
        worst[0][l] = w[0];
        worst[1][l] = w[1];
    }
    for l in 0..L {
        let first = if worst[0][l] > 0.0 { worst[0][l] } else { 0.0 };
        if first > 0.0 {
            out[l] = 0;
        }
        // Ties go to the first, whatever the last digits say.
        if worst[1][l] > first * (1.0 + 1e-9) {
            out[l] = 1;
        }
    }
    out
}

#[inline(always)]
fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::sine;
    use geom_core::Point3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn dual_vertices_are_those_of_the_specification(
            cells in prop::collection::vec(prop::array::uniform8(-1.0f32..1.0), 1..20),
        ) {
            let mut out = vec![[0.0; 3]; cells.len()];
            dual_vertices(&cells, 4, &mut out);
            for (v, x) in cells.iter().zip(&out) {
                let exact = crate::cpu::specification::dual_vertex(&v.map(f64::from), 4);
                for k in 0..3 {
                    prop_assert!((f64::from(x[k]) - exact[k]).abs() < 1e-6, "{x:?} {exact:?}");
                }
            }
        }

        #[test]
        fn diagonals_are_best(points in prop::array::uniform4(prop::array::uniform3(0.01f64..0.99))) {
            let corner = [[-1.0, -1.0], [0.0, -1.0], [0.0, 0.0], [-1.0, 0.0]];
            let x: [Point3; 4] = std::array::from_fn(|q| {
                Point3::new(points[q][0] + corner[q][0], points[q][1] + corner[q][1], points[q][2])
            });
            let (a, b) = (Point3::origin(), Point3::new(0.0, 0.0, 1.0));
            let worst = |s: usize| {
                [[s, s + 1, s + 2], [s, s + 2, (s + 3) % 4]]
                    .map(|t| t.map(|q| x[q]))
                    .iter()
                    .map(|t| sine(&[a, t[0], t[1], t[2]]).min(sine(&[b, t[0], t[2], t[1]])))
                    .fold(f64::INFINITY, f64::min)
            };
            let quads: Quads<1> = x.map(|x| [[x.x], [x.y], [x.z]]);
            let [found] = diagonals(&quads);
            let w = [worst(0), worst(1)];
            match found {
                NO_FAN => prop_assert!(w[0] <= 0.0 && w[1] <= 0.0),
                s => {
                    let s = usize::from(s);
                    prop_assert!(w[s] > 0.0 && w[s] >= w[1 - s] * (1.0 - 1e-8), "{w:?}, not {s}");
                }
            }
            // The same in any lane.
            let wide: Quads<LANES> = x.map(|x| [[x.x; LANES], [x.y; LANES], [x.z; LANES]]);
            prop_assert_eq!(widest(|| diagonals(&wide)), [found; LANES]);
        }
    }
}
