//! The hot loops over cells, for eight cells at a time. Where a step is one loop over the lanes the compiler
//! turns it into the widest instructions at hand ([`widest`]); longer chains, which it does not see through,
//! name their vectors ([`geom_core::lanes`]). Bits do not depend on which instructions those are, nor on the
//! number of lanes.

use geom_core::lanes::{Arch, Lanes, Simd, Vectors, WithSimd, cross, dot, minus};

use crate::cpu::{INSET, REGULAR};
use crate::quality::NO_FAN;

/// Cells at a time.
pub(crate) const LANES: usize = 8;

/// Runs `work` with the widest instructions of this machine.
pub(crate) fn widest<R>(work: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(work)
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

/// The lowest and the highest of each block's values.
pub(crate) fn min_max(blocks: &[f32], points: usize, out: &mut [[f32; 2]]) {
    widest(
        #[inline(always)]
        || {
            for (block, out) in blocks.chunks_exact(points).zip(out) {
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
pub(crate) fn all_finite(values: &[f32]) -> bool {
    widest(
        #[inline(always)]
        || {
            values.chunks(64).all(|chunk| {
                let bad = |bad: u32, v: &f32| bad | u32::from(!v.is_finite());
                chunk.iter().fold(0, bad) == 0
            })
        },
    )
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

/// A squared sine, with the sign of the volume: −1 where that is not positive, or all is flat.
#[inline(always)]
fn where_positive<S: Simd>(sine: Lanes<S>, volume: Lanes<S>) -> Lanes<S> {
    let none = sine.all(-1.0);
    // Not a number compares as no.
    let finite = sine.below(sine.all(f64::INFINITY), sine, none);
    sine.all(0.0).below(volume, finite, none)
}

/// The vectors whose coordinates stand in three rows, from a place on.
#[inline(always)]
fn load<S: Simd, const N: usize>(simd: S, rows: &[[f64; N]; 3], at: usize) -> Vectors<S> {
    [
        Lanes::of(simd, &rows[0][at..]),
        Lanes::of(simd, &rows[1][at..]),
        Lanes::of(simd, &rows[2][at..]),
    ]
}

#[inline(always)]
fn square<S: Simd>(a: Vectors<S>) -> Lanes<S> {
    dot(a, a)
}

/// Squares that the dihedral angles at an end of an edge follow from: of the spokes to three corners, of
/// the doubled areas between them (opposite each), of the triangle's edges (opposite each) and of its doubled
/// area.
struct Squares<S: Simd> {
    spokes: [Lanes<S>; 3],
    sides: [Lanes<S>; 3],
    edges: [Lanes<S>; 3],
    base: Lanes<S>,
}

impl<S: Simd> Squares<S> {
    /// The smallest squared sine of a dihedral angle, given six times the volume.
    #[inline(always)]
    fn sine(&self, volume: Lanes<S>) -> Lanes<S> {
        let ([a, b, c], base) = (self.sides, self.base);
        let [p, q, r] = self.spokes;
        let at_end = (p * a * base).min(q * b * base).min(r * c * base);
        let [p, q, r] = self.edges;
        let around = (p * b * c).min(q * a * c).min(r * a * b);
        let sine = volume * volume * at_end.min(around) / (a * b * c * base);
        where_positive(sine, volume)
    }
}

/// Four points around the edge from the origin to (0, 0, 1), counter-clockwise about it; lane last.
pub(crate) type Quads = [[[f64; LANES]; 3]; 4];

/// Which diagonal cuts each quad so that the worst of the four tetrahedra with the ends of the edge is
/// best: 0 from point 0 to 2, 1 from 1 to 3, [`NO_FAN`] if either way one of them is not positive.
pub(crate) fn diagonals(quads: &Quads) -> [u8; LANES] {
    let worst = Arch::new().dispatch(Diagonals(quads));
    std::array::from_fn(|l| {
        let [first, second] = [worst[0][l], worst[1][l]];
        let least = if first > 0.0 { first } else { 0.0 };
        // Ties go to the first, whatever the last digits say.
        if second > least * (1.0 + 1e-9) {
            1
        } else if least > 0.0 {
            0
        } else {
            NO_FAN
        }
    })
}

/// [`diagonals`] of one quad.
pub(crate) fn diagonal(quad: [[f64; 3]; 4]) -> Option<usize> {
    let [start, ..] = diagonals(&quad.map(|x| x.map(|c| [c; LANES])));
    Some(usize::from(start)).filter(|_| start != NO_FAN)
}

struct Diagonals<'a>(&'a Quads);

impl WithSimd for Diagonals<'_> {
    type Output = [[f64; LANES]; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut out = [[0.0; LANES]; 2];
        let one = Lanes::splat(simd, 1.0);
        for first in (0..LANES).step_by(S::F64_LANES) {
            // Arrays are filled by loops: what a closure does is not sure to become one instruction.
            let mut z = [[one; 3]; 4];
            for (z, rows) in z.iter_mut().zip(self.0) {
                *z = load(simd, rows, first);
            }
            let (mut ring, mut edges) = (z, [one; 4]);
            for q in 0..4 {
                ring[q] = minus(z[(q + 1) % 4], z[q]);
                edges[q] = square(ring[q]);
            }
            let across = [square(minus(z[2], z[0])), square(minus(z[3], z[1]))];
            // Triangle k has the corners k, k + 1 and k + 2.
            let mut bases = edges;
            for k in 0..4 {
                bases[k] = square(cross(ring[k], ring[(k + 1) % 4]));
            }
            let mut worst = [Lanes::splat(simd, f64::INFINITY); 2];
            for end in 0..2 {
                let (mut spokes, mut normals, mut areas) = (edges, z, edges);
                for q in 0..4 {
                    spokes[q] = square(z[q]);
                    normals[q] = cross(z[q], z[(q + 1) % 4]);
                    areas[q] = square(normals[q]);
                }
                for s in 0..2 {
                    let cut = square(cross(z[s], z[s + 2]));
                    for a in [s, s + 2] {
                        let (b, c) = ((a + 1) % 4, (a + 2) % 4);
                        let volume = dot(normals[a], z[c]);
                        let squares = Squares {
                            spokes: [spokes[a], spokes[b], spokes[c]],
                            sides: [areas[b], cut, areas[a]],
                            edges: [edges[b], across[s], edges[a]],
                            base: bases[a],
                        };
                        let volume = if end == 0 { volume } else { volume.negative() };
                        worst[s] = worst[s].min(squares.sine(volume));
                    }
                }
                for z in &mut z {
                    z[2] = z[2] - one;
                }
            }
            for (out, worst) in out.iter_mut().zip(worst) {
                S::as_mut_simd_f64s(&mut out[first..]).0[0] = worst.1;
            }
        }
        out
    }
}

/// Most cells around an edge.
pub(crate) const MOST: usize = 8;

/// For each corner of a polygon of `n`, given as the two ends of its edge see it, twice around: the
/// smallest squared sine of a dihedral angle in the tetrahedra of both ends with the fan from that corner;
/// −1 if one of them is not positive.
pub(crate) fn fans(seen: &[[[f64; 2 * MOST]; 3]; 2], n: usize) -> [f64; MOST] {
    Arch::new().dispatch(Fans(seen, n))
}

struct Fans<'a>(&'a [[[f64; 2 * MOST]; 3]; 2], usize);

impl WithSimd for Fans<'_> {
    type Output = [f64; MOST];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut out = [f64::INFINITY; MOST];
        for first in (0..self.1).step_by(S::F64_LANES) {
            let mut worst = Lanes::splat(simd, f64::INFINITY);
            for (end, z) in self.0.iter().enumerate() {
                // The corner so many after that of each lane.
                let a = load(simd, z, first);
                let mut b = load(simd, z, first + 1);
                let mut ab = cross(a, b);
                for i in 2..self.1 {
                    let c = load(simd, z, first + i);
                    let ca = cross(c, a);
                    let (from_a, from_b) = (minus(b, a), minus(c, b));
                    let squares = Squares {
                        spokes: [square(a), square(b), square(c)],
                        sides: [square(cross(b, c)), square(ca), square(ab)],
                        edges: [square(from_b), square(minus(a, c)), square(from_a)],
                        base: square(cross(from_a, from_b)),
                    };
                    let volume = dot(ab, c);
                    let volume = if end == 0 { volume } else { volume.negative() };
                    worst = worst.min(squares.sine(volume));
                    ab = [ca[0].negative(), ca[1].negative(), ca[2].negative()];
                    b = c;
                }
            }
            S::as_mut_simd_f64s(&mut out[first..]).0[0] = worst.1;
        }
        out
    }
}

/// Points, coordinate by coordinate.
pub(crate) type Rows<const N: usize> = [[f64; N]; 3];

/// Tetrahedra on edges `a → b`, relative to a corner of their cell.
#[derive(Clone)]
pub(crate) struct Umbrellas<const N: usize> {
    pub(crate) a: Rows<N>,
    pub(crate) b: Rows<N>,
    /// 1 where the third corner comes before the fourth, counter-clockwise about the edge, else 0.
    pub(crate) first: [f64; N],
}

impl<const N: usize> Umbrellas<N> {
    /// Six times the volumes with the third corners at `x` and the fourth at `y`, above the least.
    pub(crate) fn spare(
        &self,
        origin: [f64; 3],
        x: &Rows<N>,
        y: &Rows<N>,
        least: &[f64; N],
    ) -> [f64; N] {
        let umbrellas = self;
        Arch::new().dispatch(Spare {
            umbrellas,
            origin,
            x,
            y,
            least,
        })
    }
}

struct Spare<'a, const N: usize> {
    umbrellas: &'a Umbrellas<N>,
    origin: [f64; 3],
    x: &'a Rows<N>,
    y: &'a Rows<N>,
    least: &'a [f64; N],
}

impl<const N: usize> WithSimd for Spare<'_, N> {
    type Output = [f64; N];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut out = [0.0; N];
        let half = simd.splat_f64s(0.5);
        for i in (0..N).step_by(S::F64_LANES) {
            let mut a = load(simd, &self.umbrellas.a, i);
            let mut b = load(simd, &self.umbrellas.b, i);
            let (x, y) = (load(simd, self.x, i), load(simd, self.y, i));
            let first = Lanes::of(simd, &self.umbrellas.first[i..]);
            let first = simd.less_than_f64s(half, first.1);
            let (mut c, mut d) = (x, y);
            for k in 0..3 {
                let origin = Lanes::splat(simd, self.origin[k]);
                (a[k], b[k]) = (a[k] + origin, b[k] + origin);
                c[k].1 = simd.select_f64s(first, x[k].1, y[k].1);
                d[k].1 = simd.select_f64s(first, y[k].1, x[k].1);
            }
            let volume = dot(cross(minus(b, a), minus(c, a)), minus(d, a));
            let spare = volume - Lanes::of(simd, &self.least[i..]);
            S::as_mut_simd_f64s(&mut out[i..]).0[0] = spare.1;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::sine;
    use geom_core::Point3;
    use geom_core::lanes::Scalar;
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
            let found = diagonal(x.map(|x| x.coords.into()));
            let w = [worst(0), worst(1)];
            match found {
                None => prop_assert!(w[0] <= 0.0 && w[1] <= 0.0),
                Some(s) => {
                    prop_assert!(w[s] > 0.0 && w[s] >= w[1 - s] * (1.0 - 1e-8), "{w:?}, not {s}");
                }
            }
            // The same in any lane, and on machines without lanes.
            let wide: Quads = x.map(|x| [[x.x; LANES], [x.y; LANES], [x.z; LANES]]);
            let start = found.map_or(NO_FAN, |s| s as u8);
            prop_assert_eq!(diagonals(&wide), [start; LANES]);
            let narrow = Diagonals(&wide).with_simd(Scalar::new());
            prop_assert_eq!(narrow, Arch::new().dispatch(Diagonals(&wide)));
        }

        /// What lanes give is what machines without lanes give.
        #[test]
        fn fans_and_umbrellas_are_the_same_in_any_lane(
            n in 3..=MOST,
            corners in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
            others in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
        ) {
            let rows = |x: &[[f64; 3]; 8]| [0, 1, 2].map(|k| x.map(|x| x[k]));
            let seen = [corners, others].map(|x| {
                [0, 1, 2].map(|k| std::array::from_fn(|i| x[i % n][k]))
            });
            let narrow = Fans(&seen, n).with_simd(Scalar::new());
            prop_assert_eq!(&fans(&seen, n)[..n], &narrow[..n]);

            let umbrellas = Umbrellas {
                a: rows(&corners),
                b: rows(&others),
                first: std::array::from_fn(|i| (i % 2) as f64),
            };
            let (x, y, least) = (rows(&others), rows(&corners.map(|x| x.map(|x| x + 0.1))), [1e-3; 8]);
            let origin = [0.25, 0.5, -0.5];
            let narrow = Spare { umbrellas: &umbrellas, origin, x: &x, y: &y, least: &least };
            let narrow = narrow.with_simd(Scalar::new());
            prop_assert_eq!(umbrellas.spare(origin, &x, &y, &least), narrow);
        }
    }
}
