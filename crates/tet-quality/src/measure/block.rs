//! The measures of many tetrahedra on the processor's vectors. What a tetrahedron gets depends neither
//! on its neighbours nor on how wide the vectors are: there are no fused operations and no sums over
//! lanes.
//!
//! Six dihedral angles per tetrahedron need no six arc cosines: the cosine of the angle at edge ij is `−n_k · n_l / |n_k| |n_l|`
//! with the outward normals of the two faces there, the largest angle has the smallest cosine, and comparing `c |c|` instead of
//! c saves the square roots as well. Two arc cosines remain, in a polynomial.

use geom_core::Point3;
use geom_core::mesh::EDGES;

use crate::measure::metrics::{JOE_LIU, Measures};
use geom_core::compute::lanes::{
    Lanes, Scalar, Simd, Vectors, WithSimd, cross, dot, minus, vectorized,
};

/// Tetrahedra whose corners are gathered at a time: a multiple of all widths.
const BLOCK: usize = 64;

/// `asin t = t · p(t²)` for `0 ≤ t ≤ 1/2`, interpolated in the Chebyshev points: error 5·10⁻¹⁵.
const ARCSINE: [f64; 11] = [
    1.000000000000003,
    0.16666666666360228,
    0.07500000048801508,
    0.044642826955731976,
    0.030382897422153762,
    0.022354717905617195,
    0.0175500467737907,
    0.012550383228541292,
    0.017924318727452575,
    -0.007309187533171394,
    0.03150100073013245,
];

/// The angle, in degrees, with the cosine `c` of which `q = c |c|` is given.
/// Above one in size, which rounding may cause, it counts as one. The arc sine is taken of at most one half, where a
/// short polynomial does.
#[inline(always)]
fn angle<S: Simd>(q: Lanes<S>) -> Lanes<S> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let square = q.abs().min(q.all(1.0));
    let cosine = square.sqrt();
    // Up to 30° from the right angle the arc sine of the cosine, else that of the half angle.
    let half = q.all(0.5) * (q.all(1.0) - cosine);
    let quarter = q.all(0.25);
    let z = quarter.below(square, half, square);
    let t = quarter.below(square, half.sqrt(), cosine);
    let mut p = q.all(ARCSINE[10]);
    for &c in ARCSINE.iter().rev().skip(1) {
        p = p * z + q.all(c);
    }
    let arc = t * p;
    let acute = quarter.below(square, arc + arc, q.all(FRAC_PI_2) - arc);
    let turned = q.below(q.all(0.0), q.all(PI) - acute, acute);
    turned * q.all(180.0 / PI)
}

/// Six volumes, Joe–Liu, edge ratios, smallest and largest dihedral angles.
/// Not one branch: what does not apply is chosen away lane by lane, so that flat and inverted tetrahedra cost the same
/// and do not disturb their neighbours.
#[inline(always)]
fn kernel<S: Simd>(corners: &[Vectors<S>; 4]) -> [Lanes<S>; 5] {
    let number = corners[0][0];
    let [zero, one] = [0.0, 1.0].map(|x| number.all(x));
    let tiny = number.all(f64::MIN_POSITIVE);
    // The edges from the first corner, in units of the longest coordinate, so that neither large nor
    // small units overflow.
    // Loops, not `array::map`, which is not always compiled in place.
    let mut from = [[zero; 3]; 3];
    let mut reach = zero;
    for (x, corner) in from.iter_mut().zip(&corners[1..]) {
        *x = minus(*corner, corners[0]);
        for axis in x {
            reach = axis.abs().max(reach);
        }
    }
    let scale = zero.below(reach, reach, one);
    let unit = one / scale;
    for axis in from.iter_mut().flatten() {
        *axis = *axis * unit;
    }
    let [u, v, w] = from;
    let (bc, bd, cd) = (minus(v, u), minus(w, u), minus(w, v));
    let (mut sum, mut longest, mut shortest) = (zero, zero, number.all(f64::INFINITY));
    for d in [&u, &v, &w, &bc, &bd, &cd] {
        let square = dot(*d, *d);
        sum = sum + square;
        longest = square.max(longest);
        shortest = square.min(shortest);
    }
    // Outward, opposite the corner of the same number.
    let normals = [cross(bc, bd), cross(w, v), cross(u, w), cross(v, u)];
    let mut squares = [zero; 4];
    for (square, n) in squares.iter_mut().zip(&normals) {
        *square = dot(*n, *n);
    }
    let v6 = zero - dot(normals[3], w);
    let sum = sum.max(tiny);
    // The denominator underflows where all corners coincide.
    let joe_liu = number.all(JOE_LIU) * v6 / (sum * sum.sqrt()).max(tiny);
    // Coinciding corners have no shortest edge.
    let ratio = (longest / shortest.max(tiny)).sqrt();
    let ratio = zero.below(shortest, ratio, number.all(f64::INFINITY));
    // Extremes of cos |cos| = ∓ d² n_i² n_j² / Π n², which orders like cos and needs no root, and one
    // division for all.
    let (mut high, mut low) = (number.all(f64::NEG_INFINITY), number.all(f64::INFINITY));
    for ([k, l], [i, j]) in EDGES.into_iter().zip(EDGES.into_iter().rev()) {
        let d = dot(normals[k], normals[l]);
        let square = (zero - d) * d.abs() * (squares[i] * squares[j]);
        high = square.max(high);
        low = square.min(low);
    }
    let product = (squares[0] * squares[1]) * (squares[2] * squares[3]);
    let inverse = one / product.max(tiny);
    let flat = |angle: Lanes<S>, otherwise: f64| zero.below(v6, angle, number.all(otherwise));
    [
        v6 * scale * scale * scale,
        joe_liu,
        ratio,
        flat(angle(high * inverse), 0.0),
        flat(angle(low * inverse), 180.0),
    ]
}

fn assemble(values: [f64; 5]) -> Measures {
    let [six_volume, joe_liu, edge_ratio, min_dihedral, max_dihedral] = values;
    Measures {
        six_volume,
        joe_liu,
        edge_ratio,
        min_dihedral,
        max_dihedral,
    }
}

/// Measures a tetrahedron.
///
/// By the kernel that [`QualityBackend::measure`](crate::QualityBackend::measure) runs on the CPU. Lengths are taken in
/// units of the longest coordinate from the first corner, so that neither small nor large units spoil the shape. If the
/// volume is not positive, the angles are 0° and 180°.
///
/// ```
/// use tet_quality::{geom_core::Point3, measures};
/// let corner = |x, y, z| Point3::new(x, y, z);
/// let regular = measures([
///     corner(1.0, 1.0, 1.0), corner(-1.0, 1.0, -1.0), corner(1.0, -1.0, -1.0), corner(-1.0, -1.0, 1.0),
/// ]);
/// assert!((regular.joe_liu - 1.0).abs() < 1e-12);
/// assert!((regular.min_dihedral - 70.528_779).abs() < 1e-5);
/// ```
pub fn measures(corners: [Point3; 4]) -> Measures {
    let one = Scalar::new();
    let lanes = kernel(&corners.map(|p| [p.x, p.y, p.z].map(|x| Lanes(one, x))));
    assemble(lanes.map(|l| l.1))
}

/// Measures tetrahedra on the widest vectors that the processor has.
pub(crate) fn measure(positions: &[Point3], tets: &[[u32; 4]], out: &mut [Measures]) {
    vectorized(Task {
        positions,
        tets,
        out,
    });
}

/// What [`measure`] hands to the vectors: corners are gathered into rows, one per coordinate, and results scattered
/// again.
struct Task<'a> {
    positions: &'a [Point3],
    tets: &'a [[u32; 4]],
    out: &'a mut [Measures],
}

impl WithSimd for Task<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut coordinates = [[0.0; BLOCK]; 12];
        let mut values = [[0.0; BLOCK]; 5];
        let blocks = self.tets.chunks(BLOCK).zip(self.out.chunks_mut(BLOCK));
        for (tets, out) in blocks {
            for (i, tet) in (0..BLOCK).zip(tets) {
                for (k, &v) in tet.iter().enumerate() {
                    let p = self.positions[v as usize];
                    coordinates[3 * k][i] = p.x;
                    coordinates[3 * k + 1][i] = p.y;
                    coordinates[3 * k + 2][i] = p.z;
                }
            }
            // Lanes beyond the last tetrahedron hold what was there before.
            for g in 0..tets.len().div_ceil(S::F64_LANES) {
                let mut corners = [[Lanes(simd, simd.splat_f64s(0.0)); 3]; 4];
                for (lanes, row) in corners.iter_mut().flatten().zip(&coordinates) {
                    lanes.1 = S::as_simd_f64s(row).0[g];
                }
                for (lanes, row) in kernel(&corners).iter().zip(&mut values) {
                    S::as_mut_simd_f64s(row).0[g] = lanes.1;
                }
            }
            for (i, m) in (0..BLOCK).zip(out) {
                *m = assemble([0, 1, 2, 3, 4].map(|k| values[k][i]));
            }
        }
    }
}

/// [`angle`] of one number, in degrees, for tests.
#[cfg(feature = "testing")]
pub(crate) fn angle_of(square: f64) -> f64 {
    angle(Lanes(Scalar::new(), square)).1
}
