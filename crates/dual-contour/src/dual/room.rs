//! How far a point may go before a tetrahedron lacks volume.
//!
//! The same few lines decide for the octree's mesher and for the one without, so that both stop a point at the same
//! place.

use geom_core::Point3;

/// A moved edge tetrahedron keeps at least this share of its volume.
pub(crate) const LEAST_VOLUME: f64 = 1e-3;

/// How often each point is tried: the second time where others have moved on.
pub(crate) const ROUNDS: usize = 2;

/// How far a point may go from its base to its place: the longest of some shares of the way, beyond
/// `share`, at which none of `n` tetrahedra lacks volume; else `share` itself. `margin(i, x)` is the volume
/// margin of tetrahedron `i` with the point at `x`, what it has above its least volume: linear on the way.
pub(crate) fn farthest(
    share: f64,
    [base, target]: [&Point3; 2],
    n: usize,
    margin: impl Fn(usize, &Point3) -> f64,
) -> f64 {
    if (0..n).all(|i| margin(i, target) > 0.0) {
        return 1.0;
    }
    longest(share, (0..n).map(|i| [base, target].map(|x| margin(i, x))))
}

/// The longest of some shares of the way beyond `share`, given the volume margins of tetrahedra at its two ends,
/// if not all are positive at the far one.
/// The shares are 0.75, its square, its cube and so on, down to 0.05. A tetrahedron that lacks volume at both ends
/// lacks it all the way.
pub(crate) fn longest(share: f64, margins: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for [first, last] in margins {
        if first <= 0.0 && last <= 0.0 {
            return share;
        }
        // Linear from one end to the other: here it is 0.
        let t = first / (first - last);
        if last <= 0.0 {
            high = high.min(t);
        } else if first <= 0.0 {
            low = low.max(t);
        }
    }
    // Few shares, so that rounding hardly ever decides; none that is all but what the point has.
    let mut t = 0.75;
    while t > share + 1e-3 && t >= 0.05 {
        if low < t && t < high {
            return t;
        }
        t *= 0.75;
    }
    share
}
