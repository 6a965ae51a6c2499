//! The map in fixed point, and its predicates in integers: 64 bits for coordinates, 128 for products.

use super::cut::Cut;
use super::net::Net;
use super::transition::{Seams, turned};
use crate::Error;
use crate::field::CrossField;
use crate::field::frames::{Frames, next, previous};

/// Binary digits after the point: coordinates stay below 2³⁸, products in 128 bits.
pub(super) const BITS: u32 = 24;

/// A map of the surface into the plane, triangle by triangle, in fixed point. Over an edge coordinates turn by quarter
/// turns and shift by whole numbers, exactly; every triangle has a positive area.
///
/// Coordinates count lines, without a unit: a triangle with corners at (0, 0), (2, 0), (0, 1) holds one quad's worth of area,
/// and [`GridMap::coordinates`] gives them as floating-point numbers, exactly (fewer than 2⁵³ parts).
#[derive(Clone, Debug, PartialEq)]
pub struct GridMap {
    /// Coordinates of the three corners of each triangle, in units of 2^−bits.
    pub corners: Vec<[[i64; 2]; 3]>,
    /// Per half-edge: coordinates in the neighbour are those here turned right by this many quarters, and shifted.
    pub turn: Vec<u8>,
    /// Binary digits after the point.
    pub bits: u32,
    /// How it came about.
    pub report: MapReport,
}

/// How an integer-grid map came about.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct MapReport {
    /// Integers of the seams and lines, after exact elimination of all conditions.
    pub integers: usize,
    /// Mean of `|J − 1|²` over the area before the integers were rounded.
    pub relaxed_energy: f64,
    /// Triangles inverted, turned away from the field or at a wrong angle then; if any, the map was unfolded before the
    /// integers were sought.
    pub relaxed_folded: usize,
    /// The same energy of the final map.
    pub energy: f64,
    /// Whether rounding laid singular vertices onto each other and other integers had to be found.
    pub respaced: bool,
    /// Triangles inverted by rounding.
    pub folded: usize,
    /// Whether the map had to be unfolded or untangled then.
    pub untangled: bool,
    /// Whether the triangles of the surface could not be untangled, and the quads are those of the decimated map, laid on the
    /// surface along straight lines of the map before its rounding.
    pub decimated: bool,
}

impl GridMap {
    /// Coordinates in units of lines.
    pub fn coordinates(&self, face: usize) -> [[f64; 2]; 3] {
        let unit = (1i64 << self.bits) as f64;
        self.corners[face].map(|c| c.map(|x| x as f64 / unit))
    }
}

/// Twice the signed area, in units of 2^−2·bits.
pub(crate) fn doubled_area([a, b, c]: &[[i64; 2]; 3]) -> i128 {
    cross(minus(*b, *a), minus(*c, *a))
}

pub(crate) fn minus(a: [i64; 2], b: [i64; 2]) -> [i64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

pub(crate) fn cross(a: [i64; 2], b: [i64; 2]) -> i128 {
    i128::from(a[0]) * i128::from(b[1]) - i128::from(a[1]) * i128::from(b[0])
}

pub(crate) fn dot(a: [i64; 2], b: [i64; 2]) -> i128 {
    i128::from(a[0]) * i128::from(b[0]) + i128::from(a[1]) * i128::from(b[1])
}

/// Turned left by quarters.
pub(crate) fn rotated(v: [i64; 2], quarters: u8) -> [i64; 2] {
    [0, 1].map(|c| {
        let (from, sign) = turned(quarters, c);
        sign * v[from]
    })
}

/// The directions along the half-edge out of a corner and against the one into it.
pub(crate) fn sector(map: &GridMap, h: usize) -> [[i64; 2]; 2] {
    let uv = &map.corners[h / 3];
    let at = uv[h % 3];
    [minus(uv[next(h) % 3], at), minus(uv[previous(h) % 3], at)]
}

/// The unit directions, as quarter turns from +u, within the half-open sector from a counter-clockwise to b, in that
/// order; `closed`: b too.
pub(crate) fn axes_in(a: [i64; 2], b: [i64; 2], closed: bool) -> impl Iterator<Item = u8> {
    let inside = move |d: [i64; 2]| {
        let from = cross(a, d);
        (from == 0 && dot(a, d) > 0)
            || (from > 0 && cross(d, b) > 0)
            || (closed && cross(b, d) == 0 && dot(b, d) > 0)
    };
    // The first axis at or after a, counter-clockwise: a sector is below half a turn.
    let first = (0..4u8)
        .find(|&q| {
            let (d, before) = (rotated([1, 0], q), rotated([1, 0], (q + 3) % 4));
            cross(before, a) > 0 && cross(a, d) >= 0
        })
        .unwrap_or(0);
    (0..3u8)
        .map(move |k| (first + k) % 4)
        .filter(move |&q| inside(rotated([1, 0], q)))
}

/// The map in fixed point, checked exactly.
pub(super) fn fixed(
    frames: &Frames,
    field: &CrossField,
    cut: &Cut,
    seams: &Seams,
    w: &[f64],
    stage: &'static str,
    report: MapReport,
) -> Result<GridMap, Error> {
    let unit = (1i64 << BITS) as f64;
    let mut values: Vec<i64> = w
        .iter()
        .enumerate()
        .map(|(k, &w)| {
            if k < seams.reals {
                (w * unit).round() as i64
            } else {
                (w.round() as i64) << BITS
            }
        })
        .collect();
    seams.add_up(&mut values);
    let at = |copy: u32, component: usize| -> i64 {
        seams
            .row(copy, component)
            .map(|(k, c)| i64::from(c) * values[k])
            .sum()
    };
    let corners: Vec<[[i64; 2]; 3]> = cut
        .copy
        .chunks_exact(3)
        .map(|c| [0, 1, 2].map(|k| [at(c[k], 0), at(c[k], 1)]))
        .collect();
    let triangles = corners.iter().filter(|uv| doubled_area(uv) <= 0).count();
    let map = GridMap {
        corners,
        turn: cut.turn.clone(),
        bits: BITS,
        report,
    };
    let cones = wrong_cones(&Net::of(frames), &field.index, &map).len();
    if triangles + cones > 0 {
        return Err(Error::Folded {
            triangles,
            cones,
            stage,
            relaxed: false,
        });
    }
    Ok(map)
}

/// Vertices around which the axis directions do not number `4 − 4 I` (inside) or `3 − 4 I` (on a boundary), counted
/// exactly.
pub(super) fn wrong_cones(net: &Net, index: &[i32], map: &GridMap) -> Vec<usize> {
    (0..net.vertices())
        .filter(|&v| {
            let fan: Vec<usize> = net.around(v).collect();
            if fan.is_empty() {
                return false;
            }
            let on_boundary = net.on_boundary(v);
            let last = fan.len() - 1;
            let count: usize = fan
                .iter()
                .enumerate()
                .map(|(i, &h)| {
                    let [a, b] = sector(map, h);
                    axes_in(a, b, on_boundary && i == last).count()
                })
                .sum();
            let whole = if on_boundary { 3 } else { 4 };
            count as i32 != whole - index[v]
        })
        .collect()
}
