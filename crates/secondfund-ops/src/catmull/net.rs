//! One level of subdivision of a patch with an extraordinary corner, by applying the rules to unit vectors.
//!
//! The patch over a quad whose first corner has valence n depends on `2n + 8` control points: the corner, its n
//! neighbours, the n vertices across its quads, and seven more around the quad. Each child of the quad depends on the
//! points of the finer net, which are means of these; a mean is written as the row of its weights. Nothing is
//! diagonalized (compare Stam, 1998), so that a valence is nothing special and no table of eigenvectors has to be
//! right.

/// The matrices of one level of subdivision of a patch with an extraordinary corner.
/// Row after row. Applied again and again, `corner` leads from one ring of children to the next.
pub(super) struct Level {
    pub(super) ids: usize,
    /// From the control points of the patch to those of the child at the corner, `ids × ids`.
    pub(super) corner: Vec<f64>,
    /// To the 4 × 4 control points of the regular children beside it: along u, across, along v.
    pub(super) children: [Vec<f64>; 3],
}

/// The net of a patch: control points by number, in the order `v; e₀…; d₀…; o₀…o₆`, with quad i of the
/// corner = (v, e_i, d_i, e_{i+1}) and the patch itself quad 0.
/// Places of the grid are `(i, j)` with the corner at `(0, 0)`, the quad up to `(1, 1)`, and the ring around it.
struct Net {
    valence: usize,
    quads: Vec<[usize; 4]>,
}

impl Net {
    /// The quads around the corner first, then the five along the points `o`.
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

    /// The number of control points.
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

    /// The row of one control point itself.
    fn unit(&self, id: usize) -> Vec<f64> {
        let mut row = vec![0.0; self.ids()];
        row[id] = 1.0;
        row
    }

    /// The row of the mean of some.
    fn mean(&self, ids: &[usize]) -> Vec<f64> {
        let mut row = vec![0.0; self.ids()];
        ids.iter().for_each(|&i| row[i] += 1.0 / ids.len() as f64);
        row
    }

    /// The quads of the net that have all of these corners.
    fn quads_with(&self, ids: &[usize]) -> Vec<&[usize; 4]> {
        let has = |q: &&[usize; 4]| ids.iter().all(|i| q.contains(i));
        self.quads.iter().filter(has).collect()
    }

    /// The mean of both ends and of the middles of both quads.
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

    /// `(F̄ + 2 R̄ + (n − 3) V) / n`, as in `subdivide`, over the quads of the net around v.
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

/// The weighted sum of some rows.
pub(super) fn combine(parts: &[(f64, Vec<f64>)]) -> Vec<f64> {
    let mut out = vec![0.0; parts[0].1.len()];
    for (weight, row) in parts {
        out.iter_mut().zip(row).for_each(|(o, x)| *o += weight * x);
    }
    out
}

impl Level {
    /// Around an inner vertex of this valence.
    pub(super) fn inside(valence: usize) -> Self {
        let net = Net::of(valence);
        let n = valence;
        let mut corner = net.vertex_point(0);
        for i in 0..n {
            corner.extend(net.edge_point(0, 1 + i));
        }
        for i in 0..n {
            corner.extend(net.mean(&net.quads[i]));
        }
        Self::with(net.ids(), corner, |place| net.fine(place))
    }

    /// From the rows of the child's fan, and those of the places of the grid of half the spacing.
    pub(super) fn with(
        ids: usize,
        mut corner: Vec<f64>,
        fine: impl Fn((i32, i32)) -> Vec<f64>,
    ) -> Self {
        for place in OUTER {
            corner.extend(fine(place));
        }
        // The 4 × 4 points around a child whose first corner is at this fine place.
        let grid = |(i, j): (i32, i32)| -> Vec<f64> {
            (0..16)
                .flat_map(|k| fine((i - 1 + k % 4, j - 1 + k / 4)))
                .collect()
        };
        Self {
            ids,
            corner,
            children: [grid((1, 0)), grid((1, 1)), grid((0, 1))],
        }
    }
}

/// The places of a patch's outer control points, in their order.
pub(super) const OUTER: [(i32, i32); 7] =
    [(2, -1), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (-1, 2)];

/// Which control points of the net of valence 4 are those of the 4 × 4 grid, row after row.
#[cfg(feature = "testing")]
pub(super) fn grid_of_valence_four() -> Vec<usize> {
    let net = Net::of(4);
    let point = |k: i32| match (k % 4 - 1, k / 4 - 1) {
        (-1, -1) => 1 + 4 + 2,
        place => net.at(place),
    };
    (0..16).map(point).collect()
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;

    /// The subdominant eigenvalue of the corner, by the power method on what is orthogonal to constants.
    pub fn subdominant_eigenvalues_are_the_known_ones() {
        for (valence, known) in [(3, 0.4101), (5, 0.5500), (6, 0.5797)] {
            let level = Level::inside(valence);
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
