//! Basis functions at quadrature points, without any eigen-decomposition.
//!
//! A patch with an extraordinary corner of valence N is, level after level towards the corner, three
//! regular patches and a smaller copy of itself (Stam, 1998). The matrices of one level, found by
//! applying the rules of subdivision to the unit vectors, give every basis function everywhere but in the
//! last corner.

use crate::options::Quadrature;
use geom_core::algebra::quadrature::gauss;

/// Value and derivatives u, v, uu, uv, vv.
pub(crate) const ROWS: usize = 6;
/// Largest valence of a vertex.
pub(crate) const MOST_VALENCE: usize = 32;

/// The basis at the quadrature points of a quad with a corner of some valence.
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

    fn push(&mut self, weight: f64, rows: impl IntoIterator<Item = f64>) {
        self.weights.push(weight);
        self.basis.extend(rows);
    }
}

/// Control points of a quad with one corner of this valence, and of a regular one.
pub(crate) fn control_points(valence: usize) -> usize {
    if valence == 4 { 16 } else { 2 * valence + 8 }
}

/// The tables of all valences that occur.
#[derive(Clone, Debug)]
pub(crate) struct Tables(Vec<Option<Table>>);

impl Tables {
    pub(crate) fn of(valences: impl IntoIterator<Item = usize>, quadrature: Quadrature) -> Self {
        let mut tables = vec![None; MOST_VALENCE + 1];
        for n in valences {
            let slot: &mut Option<Table> = &mut tables[n];
            if slot.is_none() {
                *slot = Some(match n {
                    4 => regular(quadrature),
                    _ => extraordinary(n, quadrature),
                });
            }
        }
        Self(tables)
    }

    pub(crate) fn of_valence(&self, valence: usize) -> &Table {
        self.0[valence].as_ref().expect("a table per valence")
    }
}

/// Values, first and second derivatives of the four cubic B-splines at `t` in 0…1.
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

fn regular(quadrature: Quadrature) -> Table {
    let mut table = Table {
        ids: 16,
        weights: Vec::new(),
        basis: Vec::new(),
    };
    let rule = gauss(quadrature.points);
    for &(v, wv) in &rule {
        for &(u, wu) in &rule {
            table.push(wu * wv, bicubic(u, v).into_iter().flatten());
        }
    }
    table
}

/// Levels 1…depth; what is left of the corner is left out (its area falls like λ^{2 depth}).
fn extraordinary(valence: usize, quadrature: Quadrature) -> Table {
    let level = Level::of(valence);
    let ids = level.ids;
    let mut table = Table {
        ids,
        weights: Vec::new(),
        basis: Vec::new(),
    };
    let rule = gauss(quadrature.points);
    let mut power = identity(ids);
    for n in 1..=quadrature.depth {
        // A child of level n spans 2⁻ⁿ of the parameters.
        let stretch = 2f64.powi(n as i32);
        for child in &level.children {
            let grid = product(child, &power, ids);
            for &(v, wv) in &rule {
                for &(u, wu) in &rule {
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

/// The matrices of one level of subdivision of a patch with an extraordinary corner.
pub(crate) struct Level {
    pub(crate) ids: usize,
    /// From the control points of the patch to those of the child at the corner, `ids × ids`.
    pub(crate) corner: Vec<f64>,
    /// To the 4 × 4 control points of the regular children beside it: along u, across, along v.
    pub(crate) children: [Vec<f64>; 3],
}

/// The net of a patch: control points by number, in the order `v; e₀…; d₀…; o₀…o₆`, with quad i of the
/// corner = (v, e_i, d_i, e_{i+1}) and the patch itself quad 0.
struct Net {
    valence: usize,
    quads: Vec<[usize; 4]>,
}

impl Net {
    fn of(valence: usize) -> Self {
        let n = valence;
        let (e, d) = (|i: usize| 1 + i % n, |i: usize| 1 + n + i % n);
        let o = |i: usize| 1 + 2 * n + i;
        let mut quads: Vec<[usize; 4]> = (0..n).map(|i| [0, e(i), d(i), e(i + 1)]).collect();
        quads.push([d(n - 1), o(0), o(1), e(0)]);
        quads.push([e(0), o(1), o(2), d(0)]);
        quads.push([d(0), o(2), o(3), o(4)]);
        quads.push([e(1), d(0), o(4), o(5)]);
        quads.push([d(1), e(1), o(5), o(6)]);
        Self { valence, quads }
    }

    fn ids(&self) -> usize {
        2 * self.valence + 8
    }

    /// The control point at a place of the patch's grid.
    fn at(&self, place: (i32, i32)) -> usize {
        let n = self.valence;
        let (e, d, o) = (1, 1 + n, 1 + 2 * n);
        match place {
            (0, 0) => 0,
            (1, 0) => e,
            (0, 1) => e + 1,
            (-1, 0) => e + 2 % n,
            (0, -1) => e + n - 1,
            (1, 1) => d,
            (-1, 1) => d + 1,
            (1, -1) => d + n - 1,
            (2, -1) => o,
            (2, 0) => o + 1,
            (2, 1) => o + 2,
            (2, 2) => o + 3,
            (1, 2) => o + 4,
            (0, 2) => o + 5,
            (-1, 2) => o + 6,
            _ => unreachable!("no place of the net"),
        }
    }

    fn unit(&self, id: usize) -> Vec<f64> {
        let mut row = vec![0.0; self.ids()];
        row[id] = 1.0;
        row
    }

    fn mean(&self, ids: &[usize]) -> Vec<f64> {
        let mut row = vec![0.0; self.ids()];
        ids.iter().for_each(|&i| row[i] += 1.0 / ids.len() as f64);
        row
    }

    fn quads_with(&self, ids: &[usize]) -> Vec<&[usize; 4]> {
        let has = |q: &&[usize; 4]| ids.iter().all(|i| q.contains(i));
        self.quads.iter().filter(has).collect()
    }

    fn edge_point(&self, a: usize, b: usize) -> Vec<f64> {
        let quads = self.quads_with(&[a, b]);
        let [f, g] = quads[..] else {
            unreachable!("an inner edge of the net has two quads");
        };
        combine(&[
            (0.25, self.unit(a)),
            (0.25, self.unit(b)),
            (0.25, self.mean(f)),
            (0.25, self.mean(g)),
        ])
    }

    fn vertex_point(&self, v: usize) -> Vec<f64> {
        let quads = self.quads_with(&[v]);
        let n = quads.len() as f64;
        let mut parts = vec![((n - 3.0) / n, self.unit(v))];
        for quad in quads {
            parts.push((1.0 / (n * n), self.mean(quad)));
            // Each neighbour along an edge lies in two quads: half of its middle from each.
            let k = quad.iter().position(|&i| i == v).expect("chosen for it");
            for other in [quad[(k + 1) % 4], quad[(k + 3) % 4]] {
                parts.push((1.0 / (n * n), self.mean(&[v, other])));
            }
        }
        combine(&parts)
    }

    /// The control point of the next level at a place of the grid of half the spacing.
    fn fine(&self, (i, j): (i32, i32)) -> Vec<f64> {
        let (low, high) = (|k: i32| k.div_euclid(2), |k: i32| (k + 1).div_euclid(2));
        match (i.rem_euclid(2), j.rem_euclid(2)) {
            (0, 0) => self.vertex_point(self.at((i / 2, j / 2))),
            (1, 1) => {
                let places = [
                    (low(i), low(j)),
                    (high(i), low(j)),
                    (high(i), high(j)),
                    (low(i), high(j)),
                ];
                self.mean(&places.map(|p| self.at(p)))
            }
            _ => self.edge_point(self.at((low(i), low(j))), self.at((high(i), high(j)))),
        }
    }
}

fn combine(parts: &[(f64, Vec<f64>)]) -> Vec<f64> {
    let mut out = vec![0.0; parts[0].1.len()];
    for (weight, row) in parts {
        out.iter_mut().zip(row).for_each(|(o, x)| *o += weight * x);
    }
    out
}

impl Level {
    pub(crate) fn of(valence: usize) -> Self {
        let net = Net::of(valence);
        let n = valence;
        let mut corner = net.vertex_point(0);
        for i in 0..n {
            corner.extend(net.edge_point(0, 1 + i));
        }
        for i in 0..n {
            corner.extend(net.mean(&net.quads[i]));
        }
        for place in [(2, -1), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (-1, 2)] {
            corner.extend(net.fine(place));
        }
        // The 4 × 4 points around a child whose first corner is at this fine place.
        let grid = |(i, j): (i32, i32)| -> Vec<f64> {
            (0..16)
                .flat_map(|k| net.fine((i - 1 + k % 4, j - 1 + k / 4)))
                .collect()
        };
        Self {
            ids: net.ids(),
            corner,
            children: [grid((1, 0)), grid((1, 1)), grid((0, 1))],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn basis_functions_sum_to_one_and_their_derivatives_to_zero() {
        for valence in 3..=12 {
            let tables = Tables::of([valence], Quadrature::default());
            let table = tables.of_valence(valence);
            let area: f64 = table.weights.iter().sum();
            let left_out = if valence == 4 { 0.0 } else { 0.25f64.powi(6) };
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
                        "valence {valence}, point {q}, derivative {k}: {sum} of {size}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_level_of_valence_four_is_the_b_spline() {
        // The net of valence 4 is the 4 × 4 grid in another order.
        let level = Level::of(4);
        let net = Net::of(4);
        let order: Vec<usize> = (0..16)
            .map(|k| match (k % 4 - 1, k / 4 - 1) {
                (-1, -1) => 1 + 4 + 2,
                place => net.at(place),
            })
            .collect();
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

    /// The subdominant eigenvalue of the corner, by the power method on what is orthogonal to constants.
    #[test]
    fn subdominant_eigenvalues_are_the_known_ones() {
        for (valence, known) in [(3, 0.4101), (5, 0.5500), (6, 0.5797)] {
            let level = Level::of(valence);
            let n = level.ids;
            let mut x: Vec<f64> = (0..n).map(|i| (i as f64 * 1.7).sin()).collect();
            let mut ratio = 0.0;
            for _ in 0..400 {
                let y: Vec<f64> = level
                    .corner
                    .chunks(n)
                    .map(|row| row.iter().zip(&x).map(|(a, b)| a * b).sum())
                    .collect();
                // The first point converges to the limit: differences from it drop the constant.
                let y: Vec<f64> = y.iter().map(|v| v - y[0]).collect();
                let size = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
                ratio = size(&y) / size(&x);
                let scale = 1.0 / size(&y);
                x = y.iter().map(|v| v * scale).collect();
            }
            assert!((ratio - known).abs() < 2e-3, "{valence}: {ratio}");
        }
    }
}
