//! Bicubic Bézier patches: values, derivatives, curvatures.
//!
//! The point at (s, t) of the unit square is `Σ B_i(s) B_j(t) w_ij P_ij / Σ B_i(s) B_j(t) w_ij`, with Bernstein's polynomials of
//! degree 3, `B_i(s) = (3 choose i) sⁱ (1 − s)³⁻ⁱ`. Weights are 1 unless the basis is rational. Derivatives are with respect to s and t;
//! curvatures follow from the two fundamental forms that these make.

use geom_core::{Point3, Vector3};

/// The 16 homogeneous points (x w, y w, z w, w) of a patch; `a + 4 b` as in [`POINTS`](super::POINTS).
pub type PatchPoints = [[f64; 4]; 16];

/// The cubic Bernstein polynomials at `t`, their first and their second derivatives.
///
/// They sum to one, their derivatives to zero; `t` may lie outside of 0…1.
pub fn bernstein(t: f64) -> [[f64; 4]; 3] {
    let s = 1.0 - t;
    [
        [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t],
        [
            -3.0 * s * s,
            3.0 * s * (s - 2.0 * t),
            3.0 * t * (2.0 * s - t),
            3.0 * t * t,
        ],
        [6.0 * s, 6.0 * t - 12.0 * s, 6.0 * s - 12.0 * t, 6.0 * t],
    ]
}

/// A point of a surface with the derivatives by the parameters of its patch, in Å.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet {
    /// The point.
    pub point: Point3,
    /// First derivatives: along side 0 and along side 3.
    pub first: [Vector3; 2],
    /// Second derivatives: twice along side 0, once along each, twice along side 3.
    pub second: [Vector3; 3],
}

impl Jet {
    /// At `(s, t)` of a patch.
    ///
    /// NaN where the weight is zero, which no basis has.
    pub fn of(points: &PatchPoints, [s, t]: [f64; 2]) -> Self {
        let (a, b) = (bernstein(s), bernstein(t));
        // Along side 0 first: per row the point and two derivatives.
        let mut rows = [[[0.0; 4]; 4]; 3];
        for (j, row) in points.chunks_exact(4).enumerate() {
            for (i, a) in a.iter().enumerate() {
                for (point, x) in row.iter().zip(a) {
                    for (out, c) in rows[i][j].iter_mut().zip(point) {
                        *out += c * x;
                    }
                }
            }
        }
        let sum = |i: usize, j: usize| {
            let mut sum = [0.0; 4];
            for (row, y) in rows[i].iter().zip(b[j]) {
                for (out, c) in sum.iter_mut().zip(row) {
                    *out += c * y;
                }
            }
            (Vector3::new(sum[0], sum[1], sum[2]), sum[3])
        };
        // The quotient rule, from the lowest order on.
        let (h, w) = sum(0, 0);
        let [(hs, ws), (ht, wt)] = [sum(1, 0), sum(0, 1)];
        let [(hss, wss), (hst, wst), (htt, wtt)] = [sum(2, 0), sum(1, 1), sum(0, 2)];
        let x = h / w;
        let (xs, xt) = ((hs - x * ws) / w, (ht - x * wt) / w);
        Self {
            point: Point3::from(x),
            first: [xs, xt],
            second: [
                (hss - xs * (2.0 * ws) - x * wss) / w,
                (hst - xt * ws - xs * wt - x * wst) / w,
                (htt - xt * (2.0 * wt) - x * wtt) / w,
            ],
        }
    }

    /// The product of the first derivatives, outwards: its length is the area per area of parameters.
    pub fn area_vector(&self) -> Vector3 {
        self.first[0].cross(&self.first[1])
    }

    /// The outward unit normal; `None` where the first derivatives span no plane.
    pub fn normal(&self) -> Option<Vector3> {
        let scale = self.first[0].norm_squared() + self.first[1].norm_squared();
        let n = self.area_vector();
        let length = n.norm();
        (length > 1e-10 * scale).then(|| n / length)
    }

    /// Mean and Gaussian curvature, Å⁻¹ and Å⁻²: both positive on a sphere seen from outside. `None` as for
    /// [`normal`](Self::normal).
    pub fn curvatures(&self) -> Option<[f64; 2]> {
        let n = self.normal()?;
        let [xs, xt] = &self.first;
        let [e, f, g] = [xs.dot(xs), xs.dot(xt), xt.dot(xt)];
        let [l, m, o] = self.second.map(|x| -x.dot(&n));
        let area = e * g - f * f;
        Some([
            0.5 * (e * o - 2.0 * f * m + g * l) / area,
            (l * o - m * m) / area,
        ])
    }
}

/// A sample of a patch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// The point, Å.
    pub point: Point3,
    /// The outward unit normal; zero where there is none.
    pub normal: Vector3,
    /// Area per area of the patch's parameters, Å².
    pub area: f64,
}

/// Samples of one patch at all pairs of parameters whose Bernstein polynomials are given, the first one running fastest.
pub(crate) fn samples(points: &PatchPoints, table: &[[[f64; 4]; 2]], out: &mut [Sample]) {
    for (row, [b, d]) in out.chunks_exact_mut(table.len()).zip(table) {
        // The curve at this t, and its derivative.
        let mut curve = [[0.0; 4]; 4];
        let mut change = [[0.0; 4]; 4];
        for k in 0..4 {
            for a in 0..4 {
                for c in 0..4 {
                    curve[a][c] += points[a + 4 * k][c] * b[k];
                    change[a][c] += points[a + 4 * k][c] * d[k];
                }
            }
        }
        for (sample, [b, d]) in row.iter_mut().zip(table) {
            let (mut h, mut hs, mut ht) = ([0.0; 4], [0.0; 4], [0.0; 4]);
            for a in 0..4 {
                for c in 0..4 {
                    h[c] += curve[a][c] * b[a];
                    hs[c] += curve[a][c] * d[a];
                    ht[c] += change[a][c] * b[a];
                }
            }
            *sample = of_sums(h, hs, ht);
        }
    }
}

#[inline(always)]
fn of_sums(h: [f64; 4], hs: [f64; 4], ht: [f64; 4]) -> Sample {
    let over = 1.0 / h[3];
    let x: [f64; 3] = std::array::from_fn(|c| h[c] * over);
    let along = |d: [f64; 4]| -> [f64; 3] { std::array::from_fn(|c| (d[c] - x[c] * d[3]) * over) };
    let (s, t) = (along(hs), along(ht));
    let n = [
        s[1] * t[2] - s[2] * t[1],
        s[2] * t[0] - s[0] * t[2],
        s[0] * t[1] - s[1] * t[0],
    ];
    let area = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
    let unit = if area > 0.0 { 1.0 / area } else { 0.0 };
    Sample {
        point: Point3::new(x[0], x[1], x[2]),
        normal: Vector3::new(n[0] * unit, n[1] * unit, n[2] * unit),
        area,
    }
}
