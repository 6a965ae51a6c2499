//! Symmetric 2 × 2 forms, and the curvatures of a pair of them.

use std::ops::{Add, Mul};

/// A symmetric 2 × 2 matrix: a metric, a second form, a conductivity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Symmetric {
    /// Entry 1, 1.
    pub xx: f64,
    /// Entries 1, 2 and 2, 1.
    pub xy: f64,
    /// Entry 2, 2.
    pub yy: f64,
}

impl Symmetric {
    /// The matrix with these entries.
    #[inline]
    pub const fn new(xx: f64, xy: f64, yy: f64) -> Self {
        Self { xx, xy, yy }
    }

    /// `s` times the unit matrix.
    #[inline]
    pub const fn scaled_unit(s: f64) -> Self {
        Self::new(s, 0.0, s)
    }

    /// Sum of the diagonal.
    #[inline]
    pub fn trace(self) -> f64 {
        self.xx + self.yy
    }

    /// Determinant.
    #[inline]
    pub fn determinant(self) -> f64 {
        self.xx * self.yy - self.xy * self.xy
    }

    /// The adjugate: `adj(b) b = det(b) 1`, also where b has no inverse.
    #[inline]
    #[must_use]
    pub fn adjugate(self) -> Self {
        Self::new(self.yy, -self.xy, self.xx)
    }

    /// The inverse; entries are infinite or NaN where there is none.
    #[inline]
    #[must_use]
    pub fn inverse(self) -> Self {
        self.adjugate() * (1.0 / self.determinant())
    }

    /// `S M S` with the symmetric middle M.
    #[inline]
    #[must_use]
    pub fn around(self, middle: Self) -> Self {
        let (s, m) = (self, middle);
        // First row and second row of S M.
        let a = [s.xx * m.xx + s.xy * m.xy, s.xx * m.xy + s.xy * m.yy];
        let b = [s.xy * m.xx + s.yy * m.xy, s.xy * m.xy + s.yy * m.yy];
        Self::new(
            a[0] * s.xx + a[1] * s.xy,
            a[0] * s.xy + a[1] * s.yy,
            b[0] * s.xy + b[1] * s.yy,
        )
    }

    /// `pᵀ S q`.
    #[inline]
    pub fn between(self, p: [f64; 2], q: [f64; 2]) -> f64 {
        p[0] * (self.xx * q[0] + self.xy * q[1]) + p[1] * (self.xy * q[0] + self.yy * q[1])
    }

    /// `Bᵀ S B` with the columns `b0` and `b1` of B.
    #[inline]
    #[must_use]
    pub fn pulled_back(self, b0: [f64; 2], b1: [f64; 2]) -> Self {
        Self::new(
            self.between(b0, b0),
            self.between(b0, b1),
            self.between(b1, b1),
        )
    }

    /// Eigenvalues, the larger first, and the unit vector of the larger.
    #[inline]
    pub fn eigen(self) -> (f64, f64, [f64; 2]) {
        let middle = 0.5 * self.trace();
        let half = 0.5 * (self.xx - self.yy);
        let reach = (half * half + self.xy * self.xy).sqrt();
        // The longer of the two rows of S − λ₂ gives the direction without cancellation.
        let direction = if half >= 0.0 {
            [half + reach, self.xy]
        } else {
            [self.xy, reach - half]
        };
        let length = (direction[0] * direction[0] + direction[1] * direction[1]).sqrt();
        let unit = if length > 0.0 {
            [direction[0] / length, direction[1] / length]
        } else {
            [1.0, 0.0]
        };
        (middle + reach, middle - reach, unit)
    }

    /// The part with the positive eigenvalues and the one with the negative, sign turned:
    /// `S = S₊ − S₋`, both positive semi-definite.
    /// Meant for forms in an orthonormal frame: in skew coordinates signs of eigenvalues mean nothing.
    #[inline]
    pub fn split(self) -> (Self, Self) {
        let (large, small, [x, y]) = self.eigen();
        let along = Self::new(x * x, x * y, y * y);
        let across = Self::new(y * y, -x * y, x * x);
        let part = |l: f64, s: f64| along * l.max(0.0) + across * s.max(0.0);
        (part(large, small), part(-large, -small))
    }
}

impl Add for Symmetric {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self::new(self.xx + other.xx, self.xy + other.xy, self.yy + other.yy)
    }
}

impl Mul<f64> for Symmetric {
    type Output = Self;
    #[inline]
    fn mul(self, s: f64) -> Self {
        Self::new(self.xx * s, self.xy * s, self.yy * s)
    }
}

/// The first and second fundamental form at a point: `g_ab = x_a · x_b`, `b_ab = −n · x_ab` with the
/// outward normal n, so that curvature is positive where the surface is convex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forms {
    /// g.
    pub first: Symmetric,
    /// b.
    pub second: Symmetric,
}

/// Principal curvatures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principal {
    /// The larger one.
    pub max: f64,
    /// The smaller one.
    pub min: f64,
}

impl Forms {
    /// The forms in an orthonormal frame of the tangent plane: g = 1, b = the shape operator.
    #[inline]
    pub fn of_shape(shape: Symmetric) -> Self {
        Self {
            first: Symmetric::scaled_unit(1.0),
            second: shape,
        }
    }

    /// Mean curvature `½ tr(g⁻¹ b)`; 1/R on a sphere.
    #[inline]
    pub fn mean(&self) -> f64 {
        let (g, b) = (self.first, self.second);
        0.5 * (g.yy * b.xx - 2.0 * g.xy * b.xy + g.xx * b.yy) / g.determinant()
    }

    /// Gaussian curvature `det b / det g` (the thesis prints `b₁₁ g₂₂ − b₁₂²` as the numerator).
    #[inline]
    pub fn gaussian(&self) -> f64 {
        self.second.determinant() / self.first.determinant()
    }

    /// `H ± √(H² − K)`.
    #[inline]
    pub fn principal(&self) -> Principal {
        let mean = self.mean();
        let reach = (mean * mean - self.gaussian()).max(0.0).sqrt();
        Principal {
            max: mean + reach,
            min: mean - reach,
        }
    }

    /// The third form `III = b g⁻¹ b = n_a · n_b`: the metric of the Gauss image.
    #[inline]
    pub fn third(&self) -> Symmetric {
        self.second.around(self.first.inverse())
    }

    /// The shape operator in the orthonormal frame that begins with `x_u`, and the inverse F of the
    /// coordinates' matrix: `A^{ab} = Fᵃ S Fᵇ` takes a conductivity back.
    ///
    /// By Cholesky's factor of the metric. Not finite where the tangents are parallel.
    #[inline]
    pub fn in_frame(&self) -> (Self, [[f64; 2]; 2]) {
        let (g, b) = (self.first, self.second);
        // g = Lᵀ L with the upper triangular L = [[l, m], [0, r]], and F = L⁻¹.
        let l = g.xx.sqrt();
        let m = g.xy / l;
        let r = (g.determinant() / g.xx).sqrt();
        let inverse = [[1.0 / l, -m / (l * r)], [0.0, 1.0 / r]];
        let column = |k: usize| [inverse[0][k], inverse[1][k]];
        (Self::of_shape(b.pulled_back(column(0), column(1))), inverse)
    }

    /// The same point with both curvatures multiplied by `s ≤ 1`, so that none exceeds `limit`.
    #[inline]
    #[must_use]
    pub fn capped(&self, limit: f64) -> Self {
        let principal = self.principal();
        let largest = principal.max.abs().max(principal.min.abs());
        if largest > limit {
            Self {
                second: self.second * (limit / largest),
                ..*self
            }
        } else {
            *self
        }
    }
}
