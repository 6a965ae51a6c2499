//! Places in the charts of a map, and what leads from one chart to another.
//!
//! All of this is kept twice: as numbers of the relaxed map, by which is decided what is convex or flat, and as sums
//! over the integers of the map ([`Sum`]), which stay exact through any number of flips. Only decisions may be
//! inexact.

use crate::map::transition::{Sum, turned};

/// Triangles with an area below this over their sides squared are flat.
pub(super) const FLAT: f64 = 1e-9;

type Terms<'a> = std::iter::Peekable<std::slice::Iter<'a, (u32, i64)>>;

/// A position in a chart: as it is in the relaxed map, and as sums of integers where it is one.
#[derive(Clone, Debug, Default)]
pub(super) struct Place {
    /// In units of lines.
    pub(super) at: [f64; 2],
    /// `None` for regular vertices, which have real coordinates, and are all taken out in the end.
    pub(super) exact: Option<[Sum; 2]>,
}

/// `p ↦ R(−90° turn) p + shift`: from one chart to another.
#[derive(Clone, Debug, Default)]
pub(super) struct Link {
    /// 0…3 quarter turns to the right.
    pub(super) turn: u8,
    /// Of the relaxed map, where it need not be an integer.
    pub(super) shift: [f64; 2],
    /// The same shift as sums of integers.
    pub(super) exact: [Sum; 2],
}

impl Link {
    /// This, then `after`.
    pub(super) fn then(&self, after: &Link) -> Link {
        let moved = rotated(self.shift, (4 - after.turn) % 4);
        let mut exact = rotated_sums(&self.exact, (4 - after.turn) % 4);
        add(&mut exact, &after.exact, 1);
        Link {
            turn: (self.turn + after.turn) % 4,
            shift: [moved[0] + after.shift[0], moved[1] + after.shift[1]],
            exact,
        }
    }

    /// Where a place lies in the other chart; exactly, if it is known exactly here.
    pub(super) fn apply(&self, place: &Place) -> Place {
        let moved = rotated(place.at, (4 - self.turn) % 4);
        let exact = place.exact.as_ref().map(|form| {
            let mut form = rotated_sums(form, (4 - self.turn) % 4);
            add(&mut form, &self.exact, 1);
            form
        });
        Place {
            at: [moved[0] + self.shift[0], moved[1] + self.shift[1]],
            exact,
        }
    }
}

/// What leads back: `q ↦ R(90° turn) (q − shift)`.
pub(super) fn inverse(link: &Link) -> Link {
    let back = rotated(link.shift, link.turn);
    let mut exact = [Sum::new(), Sum::new()];
    add(&mut exact, &rotated_sums(&link.exact, link.turn), -1);
    Link {
        turn: (4 - link.turn) % 4,
        shift: [-back[0], -back[1]],
        exact,
    }
}

/// Turned left by quarters.
pub(super) fn rotated(p: [f64; 2], quarters: u8) -> [f64; 2] {
    [0, 1].map(|c| {
        let (from, sign) = turned(quarters, c);
        sign as f64 * p[from]
    })
}

/// The same of exact parts: components change places and signs.
pub(super) fn rotated_sums(sums: &[Sum; 2], quarters: u8) -> [Sum; 2] {
    [0, 1].map(|c| {
        let (from, sign) = turned(quarters, c);
        sums[from].iter().map(|&(k, v)| (k, sign * v)).collect()
    })
}

/// `sums += factor · others`, in both components.
pub(super) fn add(sums: &mut [Sum; 2], others: &[Sum; 2], factor: i64) {
    for (sum, other) in sums.iter_mut().zip(others) {
        *sum = added(sum, other, factor);
    }
}

/// `sum + factor · other`.
pub(super) fn added(sum: &Sum, other: &Sum, factor: i64) -> Sum {
    let mut all = Sum::with_capacity(sum.len() + other.len());
    let (mut a, mut b) = (sum.iter().peekable(), other.iter().peekable());
    loop {
        let from = [&mut a, &mut b].map(|terms| terms.peek().map_or(u32::MAX, |t| t.0));
        let term = |terms: &mut Terms<'_>, k| terms.next_if(|t| t.0 == k).map_or(0, |t| t.1);
        match from[0].min(from[1]) {
            u32::MAX => return all,
            k => {
                let c = term(&mut a, k) + factor * term(&mut b, k);
                all.extend((c != 0).then_some((k, c)));
            }
        }
    }
}

pub(super) fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// The angle from one direction counter-clockwise to another, below a full turn.
pub(super) fn opening(from: [f64; 2], to: [f64; 2]) -> f64 {
    let cosine = from[0] * to[0] + from[1] * to[1];
    cross(from, to)
        .atan2(cosine)
        .rem_euclid(std::f64::consts::TAU)
}

/// Twice the area, above 0 if a, b, c are counter-clockwise.
pub(super) fn signed_area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    cross(minus(b, a), minus(c, a))
}

/// A triangulation of a simple polygon by cutting off its best ears; `None` if it has none.
///
/// The best ear is that of the largest area over the sum of its squared sides. Corners of the polygon that lie in an
/// ear, or on its rim, forbid it; a triangle flatter than [`FLAT`] is none. The time is n³ for n corners, of which
/// there are few.
pub(super) fn ears(polygon: &[[f64; 2]]) -> Option<Vec<[usize; 3]>> {
    let mut left: Vec<usize> = (0..polygon.len()).collect();
    let mut out = Vec::new();
    let squared = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
    while left.len() >= 3 {
        let n = left.len();
        let quality = |k: usize| {
            let corner = [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
            let [a, b, c] = corner.map(|i| polygon[i]);
            let area = signed_area(a, b, c);
            let size = squared(a, b) + squared(b, c) + squared(c, a);
            let holds = |i: usize| {
                let p = polygon[i];
                [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|&(s, t)| signed_area(s, t, p) >= 0.0)
            };
            let empty = left.iter().all(|&i| corner.contains(&i) || !holds(i));
            (empty && area > FLAT * size).then_some(area / size)
        };
        let best = (0..n)
            .filter_map(|k| quality(k).map(|q| (q, k)))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
        let k = best.1;
        out.push([left[(k + n - 1) % n], left[k], left[(k + 1) % n]]);
        left.remove(k);
    }
    (out.len() + 2 == polygon.len()).then_some(out)
}
