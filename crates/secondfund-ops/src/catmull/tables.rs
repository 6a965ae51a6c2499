//! Basis functions at quadrature points, without any eigen-decomposition.
//!
//! A patch with an extraordinary corner of valence N is, level after level towards the corner, three
//! regular patches and a smaller copy of itself (Stam, 1998). The matrices of one level, found by
//! applying the rules of subdivision to the unit vectors, give every basis function everywhere but in the
//! last corner.

use std::collections::BTreeMap;

use geom_core::algebra::quadrature::gauss;

use super::net::Level;
use super::rim;
use crate::options::Quadrature;

/// Value and derivatives u, v, uu, uv, vv.
pub(crate) const ROWS: usize = 6;
/// Largest valence of a vertex.
pub(crate) const MOST_VALENCE: usize = 32;

/// The basis at the quadrature points of a quad with a corner of some valence.
/// Quads with the same corner share one, whatever their places: that is what lets a kernel take many at a time.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    /// Control points.
    pub(crate) ids: usize,
    /// Weight of each point in the parameter square.
    pub(crate) weights: Vec<f64>,
    /// Per point [`ROWS`] rows of `ids` numbers.
    pub(crate) basis: Vec<f64>,
}

impl Table {
    /// The rows of a point.
    pub(crate) fn point(&self, q: usize) -> &[f64] {
        let size = ROWS * self.ids;
        &self.basis[q * size..(q + 1) * size]
    }

    /// Appends a point.
    fn push(&mut self, weight: f64, rows: impl IntoIterator<Item = f64>) {
        self.weights.push(weight);
        self.basis.extend(rows);
    }
}

/// What the extraordinary corner of a quad is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Corner {
    /// There is none.
    Regular,
    /// A vertex inside the surface of this valence.
    Inside(usize),
    /// A vertex on a boundary with this many quads, more than two, of which this one is quad `place`, counted from
    /// the boundary edge that leaves it.
    Rim { quads: usize, place: usize },
}

impl Corner {
    /// The number of control points.
    pub(crate) fn points(self) -> usize {
        match self {
            Self::Regular => 16,
            Self::Inside(valence) => 2 * valence + 8,
            Self::Rim { quads, .. } => 2 * quads + 9,
        }
    }
}

/// The tables of all corners that occur.
#[derive(Clone, Debug)]
pub(crate) struct Tables(BTreeMap<Corner, Table>);

impl Tables {
    pub(crate) fn of(corners: impl IntoIterator<Item = Corner>, quadrature: Quadrature) -> Self {
        Self::with_rule(corners, &gauss(quadrature.points), quadrature.depth)
    }

    /// The same for any points and weights on 0…1.
    pub(super) fn with_rule(
        corners: impl IntoIterator<Item = Corner>,
        rule: &[(f64, f64)],
        depth: usize,
    ) -> Self {
        let mut tables = BTreeMap::new();
        for corner in corners {
            tables.entry(corner).or_insert_with(|| match corner {
                Corner::Regular => regular(rule),
                Corner::Inside(valence) => extraordinary(&Level::inside(valence), rule, depth),
                Corner::Rim { quads, place } => {
                    extraordinary(&rim::level(quads, place), rule, depth)
                }
            });
        }
        Self(tables)
    }

    /// Panics if the corner was not among those that the tables were made of.
    pub(crate) fn of_corner(&self, corner: Corner) -> &Table {
        &self.0[&corner]
    }
}

/// Values, first and second derivatives of the four cubic B-splines at `t` in 0…1.
/// In the order of their control points −1, 0, 1 and 2. Values sum to 1, derivatives to 0.
fn cubic(t: f64) -> [[f64; 4]; 3] {
    let s = 1.0 - t;
    [
        [
            s * s * s / 6.0,
            (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
            (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
            t * t * t / 6.0,
        ],
        [
            -s * s / 2.0,
            (3.0 * t - 4.0) * t / 2.0,
            (4.0 - 3.0 * s) * s / 2.0,
            t * t / 2.0,
        ],
        [s, 3.0 * t - 2.0, 3.0 * s - 2.0, t],
    ]
}

/// The six rows of the 16 bicubic B-splines at `(u, v)`; function `4 j + i` belongs to control point
/// `(i − 1, j − 1)` of the patch over the unit square.
pub(crate) fn bicubic(u: f64, v: f64) -> [[f64; 16]; ROWS] {
    let (a, b) = (cubic(u), cubic(v));
    let orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];
    orders.map(|(i, j)| std::array::from_fn(|k| a[i][k % 4] * b[j][k / 4]))
}

/// v is the slow parameter, u the fast one.
fn regular(rule: &[(f64, f64)]) -> Table {
    let mut table = Table {
        ids: 16,
        weights: Vec::new(),
        basis: Vec::new(),
    };
    for &(v, wv) in rule {
        for &(u, wu) in rule {
            table.push(wu * wv, bicubic(u, v).into_iter().flatten());
        }
    }
    table
}

/// Levels 1…depth; what is left of the corner is left out (its area falls like λ^{2 depth}).
/// A child of level n is half as wide as one of the level before, so that first derivatives by the parameters of the
/// quad are 2ⁿ times those by its own, second ones 4ⁿ times.
fn extraordinary(level: &Level, rule: &[(f64, f64)], depth: usize) -> Table {
    let ids = level.ids;
    let mut table = Table {
        ids,
        weights: Vec::new(),
        basis: Vec::new(),
    };
    let mut power = identity(ids);
    for n in 1..=depth {
        // A child of level n spans 2⁻ⁿ of the parameters.
        let stretch = 2f64.powi(n as i32);
        for child in &level.children {
            let grid = product(child, &power, ids);
            for &(v, wv) in rule {
                for &(u, wu) in rule {
                    let rows = bicubic(u, v);
                    let scales = [
                        1.0,
                        stretch,
                        stretch,
                        stretch * stretch,
                        stretch * stretch,
                        stretch * stretch,
                    ];
                    let weight = wu * wv / (stretch * stretch);
                    let all = rows.iter().zip(scales).flat_map(|(row, scale)| {
                        let grid = &grid;
                        (0..ids).map(move |k| {
                            scale * (0..16).map(|i| row[i] * grid[i * ids + k]).sum::<f64>()
                        })
                    });
                    table.push(weight, all.collect::<Vec<_>>());
                }
            }
        }
        power = product(&level.corner, &power, ids);
    }
    table
}

fn identity(n: usize) -> Vec<f64> {
    let mut m = vec![0.0; n * n];
    m.iter_mut().step_by(n + 1).for_each(|x| *x = 1.0);
    m
}

/// `A B` with B of `n × n`.
fn product(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; a.len()];
    for (row, out) in a.chunks_exact(n).zip(out.chunks_exact_mut(n)) {
        for (&x, b) in row.iter().zip(b.chunks_exact(n)) {
            if x != 0.0 {
                out.iter_mut().zip(b).for_each(|(o, &y)| *o += x * y);
            }
        }
    }
    out
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::super::net::grid_of_valence_four;
    use super::*;

    pub fn a_level_of_valence_four_is_the_b_spline() {
        // The net of valence 4 is the 4 × 4 grid in another order.
        let (level, order) = (Level::inside(4), grid_of_valence_four());
        let child = &level.children[1];
        let (u, v) = (0.3, 0.8);
        let fine = bicubic(u, v);
        let coarse = bicubic((1.0 + u) / 2.0, (1.0 + v) / 2.0);
        for k in 0..16 {
            let value: f64 = (0..16).map(|i| fine[0][i] * child[i * 16 + order[k]]).sum();
            assert!((value - coarse[0][k]).abs() < 1e-15);
            let second: f64 = (0..16)
                .map(|i| 4.0 * fine[4][i] * child[i * 16 + order[k]])
                .sum();
            assert!((second - coarse[4][k]).abs() < 1e-14);
        }
    }

    pub fn basis_functions_sum_to_one_and_their_derivatives_to_zero() {
        let inside = (3..=12).filter(|&n| n != 4).map(Corner::Inside);
        let on_rims =
            (3..=6).flat_map(|quads| (0..quads).map(move |place| Corner::Rim { quads, place }));
        for corner in inside.chain([Corner::Regular]).chain(on_rims) {
            let tables = Tables::of([corner], Quadrature::default());
            let table = tables.of_corner(corner);
            assert_eq!(table.ids, corner.points());
            let area: f64 = table.weights.iter().sum();
            let left_out = if corner == Corner::Regular {
                0.0
            } else {
                0.25f64.powi(6)
            };
            assert!((area - 1.0 + left_out).abs() < 1e-14);
            for q in 0..table.weights.len() {
                for (k, row) in table.point(q).chunks(table.ids).enumerate() {
                    let sum: f64 = row.iter().sum();
                    let size: f64 = row.iter().map(|x| x.abs()).sum();
                    let wanted = f64::from(k == 0);
                    // Each of six levels doubles first derivatives and quadruples second ones, and their
                    // rounding with them.
                    let scale = 64f64.powi([0, 1, 1, 2, 2, 2][k]);
                    let rounding = 1e-13 * size.max(1.0) + 4.0 * f64::EPSILON * scale;
                    assert!(
                        (sum - wanted).abs() < rounding,
                        "{corner:?}, point {q}, derivative {k}: {sum} of {size}"
                    );
                }
            }
        }
    }
}
