//! How far a point may go before a tetrahedron lacks volume.

use geom_core::Point3;

/// A moved umbrella tetrahedron keeps at least this share of its volume.
pub(crate) const LEAST_VOLUME: f64 = 1e-3;

/// How far a point may go from its base to its place: the longest of some shares of the way, beyond
/// `share`, at which none of `n` tetrahedra lacks volume; else `share` itself. `spare(i, x)` is what
/// tetrahedron `i` has above its least volume with the point at `x`: linear on the way.
pub(crate) fn farthest(
    share: f64,
    [base, target]: [&Point3; 2],
    n: usize,
    spare: impl Fn(usize, &Point3) -> f64,
) -> f64 {
    if (0..n).all(|i| spare(i, target) > 0.0) {
        return 1.0;
    }
    longest(share, (0..n).map(|i| [base, target].map(|x| spare(i, x))))
}

/// The longest of some shares of the way beyond `share`, given what tetrahedra have above their least
/// volumes at its ends, if not all have some at its end.
pub(crate) fn longest(share: f64, spares: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for [first, last] in spares {
        if first <= 0.0 && last <= 0.0 {
            return share;
        }
        let t = first / (first - last);
        if last <= 0.0 {
            high = high.min(t);
        } else if first <= 0.0 {
            low = low.max(t);
        }
    }
    let mut t = 0.75;
    while t > share + 1e-3 && t >= 0.05 {
        if low < t && t < high {
            return t;
        }
        t *= 0.75;
    }
    share
}
