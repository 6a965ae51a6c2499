//! The measures of some tetrahedra side by side: every step is a loop over them without branches or
//! calls, so that it runs on the processor's vectors. What a tetrahedron gets does not depend on its
//! neighbours in the block.

use geom_core::Point3;
use geom_core::mesh::{EDGES, FACES};

use crate::metrics::{JOE_LIU, Measures};

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

/// One number per tetrahedron.
type Lane<const N: usize> = [f64; N];
/// One vector per tetrahedron, by coordinate.
type Lanes<const N: usize> = [Lane<N>; 3];

#[inline(always)]
fn each<const N: usize>(f: impl Fn(usize) -> f64) -> Lane<N> {
    let mut out = [0.0; N];
    for (i, o) in out.iter_mut().enumerate() {
        *o = f(i);
    }
    out
}

#[inline(always)]
fn minus<const N: usize>(a: &Lanes<N>, b: &Lanes<N>) -> Lanes<N> {
    [
        each(|i| a[0][i] - b[0][i]),
        each(|i| a[1][i] - b[1][i]),
        each(|i| a[2][i] - b[2][i]),
    ]
}

#[inline(always)]
fn dot<const N: usize>(a: &Lanes<N>, b: &Lanes<N>) -> Lane<N> {
    each(|i| a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i])
}

#[inline(always)]
fn cross<const N: usize>(a: &Lanes<N>, b: &Lanes<N>) -> Lanes<N> {
    [
        each(|i| a[1][i] * b[2][i] - a[2][i] * b[1][i]),
        each(|i| a[2][i] * b[0][i] - a[0][i] * b[2][i]),
        each(|i| a[0][i] * b[1][i] - a[1][i] * b[0][i]),
    ]
}

// Unlike `f64::max` and `min` these leave NaN unspecified, which is one instruction; positions are
// finite.
#[inline(always)]
fn more(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline(always)]
fn less(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The angles, in degrees, with cosines `c` of which `q = c |c|` is given.
#[inline(always)]
fn angles<const N: usize>(q: &Lane<N>) -> Lane<N> {
    let square: Lane<N> = each(|i| less(q[i].abs(), 1.0));
    let cosine: Lane<N> = each(|i| square[i].sqrt());
    // Up to 30° from the right angle the arc sine of the cosine, else that of the half angle.
    let half: Lane<N> = each(|i| 0.5 * (1.0 - cosine[i]));
    let root: Lane<N> = each(|i| half[i].sqrt());
    let z: Lane<N> = each(|i| {
        if square[i] <= 0.25 {
            square[i]
        } else {
            half[i]
        }
    });
    let t: Lane<N> = each(|i| {
        if square[i] <= 0.25 {
            cosine[i]
        } else {
            root[i]
        }
    });
    let mut p: Lane<N> = [ARCSINE[10]; N];
    for c in ARCSINE.iter().rev().skip(1) {
        p = each(|i| p[i] * z[i] + c);
    }
    use std::f64::consts::{FRAC_PI_2, PI};
    let (steep, slight): (Lane<N>, Lane<N>) = (
        each(|i| FRAC_PI_2 - t[i] * p[i]),
        each(|i| 2.0 * t[i] * p[i]),
    );
    let acute: Lane<N> = each(|i| {
        if square[i] <= 0.25 {
            steep[i]
        } else {
            slight[i]
        }
    });
    let obtuse: Lane<N> = each(|i| PI - acute[i]);
    each(|i| if q[i] >= 0.0 { acute[i] } else { obtuse[i] } * (180.0 / PI))
}

/// Measures tetrahedra with these corners.
#[inline(always)]
pub(crate) fn measures<const N: usize>(corners: &[[Point3; 4]; N]) -> [Measures; N] {
    // The corners from the first one on, in units of the longest coordinate, so that neither large
    // nor small units overflow.
    let mut from: [Lanes<N>; 4] = [[[0.0; N]; 3]; 4];
    for (i, tet) in corners.iter().enumerate() {
        for k in 1..4 {
            for axis in 0..3 {
                from[k][axis][i] = tet[k][axis] - tet[0][axis];
            }
        }
    }
    let scale: Lane<N> = each(|i| {
        let mut reach = 0.0;
        for corner in &from[1..] {
            for axis in corner {
                reach = more(axis[i].abs(), reach);
            }
        }
        if reach > 0.0 { reach } else { 1.0 }
    });
    let unit: Lane<N> = each(|i| 1.0 / scale[i]);
    for corner in &mut from[1..] {
        for axis in corner {
            *axis = each(|i| axis[i] * unit[i]);
        }
    }
    // Loops, not `array::map`, which is not always compiled in place.
    let mut edges = [[0.0; N]; 6];
    for (e, [a, b]) in edges.iter_mut().zip(EDGES) {
        let d = minus(&from[b], &from[a]);
        *e = dot(&d, &d);
    }
    let mut normals = [[[0.0; N]; 3]; 4];
    let mut inverse = [[0.0; N]; 4];
    for (k, [a, b, c]) in FACES.into_iter().enumerate() {
        let n = cross(&minus(&from[b], &from[a]), &minus(&from[c], &from[a]));
        let square = dot(&n, &n);
        inverse[k] = each(|i| 1.0 / more(square[i], f64::MIN_POSITIVE));
        normals[k] = n;
    }
    let v6: Lane<N> = dot(&cross(&from[1], &from[2]), &from[3]);
    let joe_liu: Lane<N> = each(|i| {
        let sum = edges[0][i] + edges[1][i] + edges[2][i] + edges[3][i] + edges[4][i] + edges[5][i];
        let sum = more(sum, f64::MIN_POSITIVE);
        JOE_LIU * v6[i] / (sum * sum.sqrt())
    });
    let mut longest = edges[0];
    let mut shortest = edges[0];
    for e in &edges[1..] {
        longest = each(|i| more(e[i], longest[i]));
        shortest = each(|i| less(e[i], shortest[i]));
    }
    let ratio: Lane<N> = each(|i| (longest[i] / shortest[i]).sqrt());
    // Extremes of cos |cos|, which orders like cos and needs no root.
    let mut high = [-1.0; N];
    let mut low = [1.0; N];
    for [k, l] in EDGES {
        let d = dot(&normals[k], &normals[l]);
        let square: Lane<N> = each(|i| -(d[i] * inverse[k][i]) * (d[i].abs() * inverse[l][i]));
        high = each(|i| more(square[i], high[i]));
        low = each(|i| less(square[i], low[i]));
    }
    let (high, low) = (angles(&high), angles(&low));
    let narrow: Lane<N> = each(|i| if v6[i] > 0.0 { high[i] } else { 0.0 });
    let wide: Lane<N> = each(|i| if v6[i] > 0.0 { low[i] } else { 180.0 });
    let mut out = [Measures::default(); N];
    for (i, m) in out.iter_mut().enumerate() {
        *m = Measures {
            six_volume: v6[i] * scale[i] * scale[i] * scale[i],
            joe_liu: joe_liu[i],
            // Coinciding corners have no shortest edge.
            edge_ratio: if shortest[i] > 0.0 {
                ratio[i]
            } else {
                f64::INFINITY
            },
            min_dihedral: narrow[i],
            max_dihedral: wide[i],
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_angle_is_the_arc_cosine() {
        for k in -100_000..=100_000 {
            let c = f64::from(k) / 1e5;
            let [found] = angles(&[c * c.abs()]);
            // Where the cosine is flat the argument itself has fewer digits.
            let allowed = 2e-12 + 1e-13 / (1.0 - c * c).max(1e-15).sqrt();
            assert!((found - c.acos().to_degrees()).abs() < allowed, "{c}");
        }
        assert_eq!(angles(&[1.0, -1.0]), [0.0, 180.0]);
    }

    proptest! {
        #[test]
        fn neighbours_in_the_block_do_not_matter(
            coordinates in proptest::collection::vec(-1.0..1.0f64, 8 * 12),
        ) {
            let tets: [[Point3; 4]; 8] = std::array::from_fn(|t| {
                std::array::from_fn(|k| {
                    let at = 12 * t + 3 * k;
                    Point3::new(coordinates[at], coordinates[at + 1], coordinates[at + 2])
                })
            });
            let together = measures(&tets);
            for (tet, m) in tets.into_iter().zip(together) {
                prop_assert_eq!(measures(&[tet]), [m]);
            }
        }
    }
}
