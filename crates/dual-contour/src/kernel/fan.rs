//! Which triangles of a polygon around an edge keep the tetrahedra on both sides best.
//!
//! Around an edge `a → b` whose ends lie on different sides, the points of the cells form a polygon that the surface
//! fills. Cut into a fan from one of its corners, each triangle spans a tetrahedron with `a` and one with `b`. Best is
//! the fan whose worst dihedral angle is farthest from 0° and 180°; sines are compared by their squares, so that no
//! root and no arc is taken. What both ends and neighbouring triangles share (areas, edges) is computed once.

use geom_core::Point3;
use geom_core::compute::lanes::{Lanes, Simd, WithSimd, cross, dot, minus, vectorized};

use super::{LANES, load, square};

/// No diagonal of a quad keeps all tetrahedra positive.
pub(crate) const NO_FAN: u8 = 2;

/// The smallest squared sine of a dihedral angle, with the sign of the volume: larger is better, and
/// positive means not inverted. As the equation reads; where corners are shared, so is the work.
#[cfg(feature = "testing")]
pub(crate) fn sine(x: &[Point3; 4]) -> f64 {
    let [a, b, c, d] = x;
    let (u, v, w) = (b - a, c - a, d - a);
    let volume = u.cross(&v).dot(&w);
    // Doubled area normals of the faces opposite a, b, c, d.
    let n = [
        (c - b).cross(&(d - b)).norm_squared(),
        v.cross(&w).norm_squared(),
        u.cross(&w).norm_squared(),
        u.cross(&v).norm_squared(),
    ];
    // An edge and the two faces at it: those opposite the corners that are not its ends.
    let edges = [
        (u.norm_squared(), 2, 3),
        (v.norm_squared(), 1, 3),
        (w.norm_squared(), 1, 2),
        ((c - b).norm_squared(), 0, 3),
        ((d - b).norm_squared(), 0, 2),
        ((d - c).norm_squared(), 0, 1),
    ];
    let least = edges
        .iter()
        .map(|&(e, i, j)| e / (n[i] * n[j]))
        .fold(f64::INFINITY, f64::min);
    let square = volume * volume * least;
    if volume > 0.0 && square.is_finite() {
        square
    } else {
        -1.0
    }
}

/// Where the fan of triangles over a polygon around the edge from `a` to `b` begins so that the worst
/// tetrahedron on either side is best; `None` if none keeps all of them positive. In a polygon of four, the
/// diagonal from `reserved` may be another's.
/// With three corners there is one fan, with four there are two, from corner 0 or 1; with more only fans are tried, not
/// all triangulations. All must be positive: a fan that inverts one tetrahedron is none.
pub(crate) fn best_fan(
    x: &[Point3],
    a: &Point3,
    b: &Point3,
    reserved: Option<u8>,
) -> Option<usize> {
    let n = x.len();
    // As each end sees them, twice around.
    let mut seen = [[[0.0; 2 * MOST]; 3]; 2];
    for (seen, end) in seen.iter_mut().zip([a, b]) {
        for i in 0..2 * MOST {
            let z = x[i % n] - end;
            (0..3).for_each(|k| seen[k][i] = z[k]);
        }
    }
    let worst = fans(&seen, n);
    let starts = match n {
        3 => 1,
        4 => 2,
        _ => n,
    };
    let mut best = (0.0, None);
    for start in (0..starts).filter(|&s| reserved != Some(s as u8)) {
        // Ties go to the first, whatever the last digits say.
        if worst[start] > best.0 * (1.0 + 1e-9) {
            best = (worst[start], Some(start));
        }
    }
    best.1
}

/// A squared sine, with the sign of the volume: −1 where that is not positive, or all is flat.
#[inline(always)]
fn where_positive<S: Simd>(sine: Lanes<S>, volume: Lanes<S>) -> Lanes<S> {
    let none = sine.all(-1.0);
    // Not a number compares as no.
    let finite = sine.below(sine.all(f64::INFINITY), sine, none);
    sine.all(0.0).below(volume, finite, none)
}

/// Squares that the dihedral angles at an end of an edge follow from: of the spokes to three corners, of
/// the doubled areas between them (opposite each), of the triangle's edges (opposite each) and of its doubled
/// area.
/// The sine at an edge is `6V |e| / (|n| |m|)` with the doubled area normals of its faces, so all six follow from these
/// and the volume.
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
    let worst = vectorized(Diagonals(quads));
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

/// For each of the two diagonals the smallest squared sine over its four tetrahedra. Seen from the second end the
/// points are shifted by one along the edge, and volumes change sign.
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
/// Four cut cells, with two parts each.
pub(crate) const MOST: usize = 8;

/// For each corner of a polygon of `n`, given as the two ends of its edge see it, twice around: the
/// smallest squared sine of a dihedral angle in the tetrahedra of both ends with the fan from that corner;
/// −1 if one of them is not positive.
pub(crate) fn fans(seen: &[[[f64; 2 * MOST]; 3]; 2], n: usize) -> [f64; MOST] {
    vectorized(Fans(seen, n))
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

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;
    use geom_core::compute::lanes::Scalar;
    use proptest::prelude::*;

    pub fn the_regular_tetrahedron_has_seventy_degrees() {
        let p = [[1., 1., 1.], [-1., 1., -1.], [1., -1., -1.], [-1., -1., 1.]].map(Point3::from);
        let s = sine(&p);
        assert!(
            (s - 8.0 / 9.0).abs() < 1e-12,
            "sin² of acos(1/3) is 8/9, not {s}"
        );
        assert_eq!(sine(&[p[0], p[1], p[3], p[2]]), -1.0);
        assert_eq!(sine(&[p[0], p[1], p[2], p[2]]), -1.0);
    }

    pub fn diagonals_are_best() {
        proptest!(|(points in prop::array::uniform4(prop::array::uniform3(0.01f64..0.99)))| {
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
            prop_assert_eq!(narrow, vectorized(Diagonals(&wide)));
        });
    }

    /// What lanes give is what machines without lanes give.
    pub fn fans_are_the_same_in_any_lane() {
        proptest!(|(
            n in 3..=MOST,
            corners in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
            others in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
        )| {
            let seen = [corners, others].map(|x| {
                [0, 1, 2].map(|k| std::array::from_fn(|i| x[i % n][k]))
            });
            let narrow = Fans(&seen, n).with_simd(Scalar::new());
            prop_assert_eq!(&fans(&seen, n)[..n], &narrow[..n]);
        });
    }

    pub fn fans_are_best() {
        proptest!(|(
            n in 3usize..=MOST,
            steps in prop::array::uniform8(prop::array::uniform3(0.1f64..0.9)),
            reserved in prop::option::of(0u8..2),
        )| {
            let (a, b) = (Point3::origin(), Point3::new(0.0, 0.0, 1.0));
            let reserved = reserved.filter(|_| n == 4);
            let x: Vec<Point3> = (0..n)
                .map(|i| {
                    let [turn, r, z] = steps[i];
                    let angle = std::f64::consts::TAU * (i as f64 + turn) / n as f64;
                    Point3::new(r * angle.cos(), r * angle.sin(), 1.6 * z - 0.3)
                })
                .collect();
            let worst = |s: usize| {
                (1..n - 1)
                    .map(|i| [s, (s + i) % n, (s + i + 1) % n].map(|q| x[q]))
                    .map(|t| sine(&[a, t[0], t[1], t[2]]).min(sine(&[b, t[0], t[2], t[1]])))
                    .fold(f64::INFINITY, f64::min)
            };
            let starts = match n { 3 => 1, 4 => 2, _ => n };
            let all: Vec<f64> = (0..starts)
                .map(|s| if reserved == Some(s as u8) { -1.0 } else { worst(s) })
                .collect();
            let most = all.iter().copied().fold(0.0, f64::max);
            match best_fan(&x, &a, &b, reserved) {
                None => prop_assert!(most < 1e-12, "{all:?}"),
                Some(s) => prop_assert!(all[s] > 0.0 && all[s] >= most * (1.0 - 1e-8), "{all:?}, not {s}"),
            }
        });
    }
}
