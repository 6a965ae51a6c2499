//! How good a tetrahedron is, for choices between diagonals.

use geom_core::Point3;

use crate::lanes::{MOST, fans};

/// No diagonal of a quad keeps all tetrahedra positive.
pub(crate) const NO_FAN: u8 = 2;

/// The smallest squared sine of a dihedral angle, with the sign of the volume: larger is better, and
/// positive means not inverted. As the equation reads; where corners are shared, so is the work.
#[cfg(test)]
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
/// diagonal from `taken` may be another's.
pub(crate) fn best_fan(x: &[Point3], a: &Point3, b: &Point3, taken: Option<u8>) -> Option<usize> {
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
    for start in (0..starts).filter(|&s| taken != Some(s as u8)) {
        // Ties go to the first, whatever the last digits say.
        if worst[start] > best.0 * (1.0 + 1e-9) {
            best = (worst[start], Some(start));
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_regular_tetrahedron_has_seventy_degrees() {
        let p = [[1., 1., 1.], [-1., 1., -1.], [1., -1., -1.], [-1., -1., 1.]].map(Point3::from);
        let s = sine(&p);
        assert!(
            (s - 8.0 / 9.0).abs() < 1e-12,
            "sin² of acos(1/3) is 8/9, not {s}"
        );
        assert_eq!(sine(&[p[0], p[1], p[3], p[2]]), -1.0);
        assert_eq!(sine(&[p[0], p[1], p[2], p[2]]), -1.0);
    }

    proptest! {
        #[test]
        fn fans_are_best(
            n in 3usize..=MOST,
            steps in prop::array::uniform8(prop::array::uniform3(0.1f64..0.9)),
            taken in prop::option::of(0u8..2),
        ) {
            let (a, b) = (Point3::origin(), Point3::new(0.0, 0.0, 1.0));
            let taken = taken.filter(|_| n == 4);
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
                .map(|s| if taken == Some(s as u8) { -1.0 } else { worst(s) })
                .collect();
            let most = all.iter().copied().fold(0.0, f64::max);
            match best_fan(&x, &a, &b, taken) {
                None => prop_assert!(most < 1e-12, "{all:?}"),
                Some(s) => prop_assert!(all[s] > 0.0 && all[s] >= most * (1.0 - 1e-8), "{all:?}, not {s}"),
            }
        }
    }
}
