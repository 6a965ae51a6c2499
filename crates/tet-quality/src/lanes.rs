//! Numbers on the processor's vectors: arithmetic that gives each lane what it would have alone, so that
//! results do not depend on how wide the vectors are.

use std::ops::{Add, Mul, Sub};

pub(crate) use pulp::{Arch, Scalar, Simd, WithSimd};

/// One number per tetrahedron, as many as a vector holds.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<S: Simd>(pub(crate) S, pub(crate) S::f64s);

/// One vector per tetrahedron, by coordinate.
pub(crate) type Vectors<S> = [Lanes<S>; 3];

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(self.0, self.0.add_f64s(self.1, b.1))
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(self.0, self.0.sub_f64s(self.1, b.1))
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(self.0, self.0.mul_f64s(self.1, b.1))
    }
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(crate) fn all(self, x: f64) -> Self {
        Self(self.0, self.0.splat_f64s(x))
    }
    #[inline(always)]
    pub(crate) fn over(self, b: Self) -> Self {
        Self(self.0, self.0.div_f64s(self.1, b.1))
    }
    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        Self(self.0, self.0.sqrt_f64s(self.1))
    }
    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        Self(self.0, self.0.abs_f64s(self.1))
    }
    #[inline(always)]
    pub(crate) fn max(self, b: Self) -> Self {
        Self(self.0, self.0.max_f64s(self.1, b.1))
    }
    #[inline(always)]
    pub(crate) fn min(self, b: Self) -> Self {
        Self(self.0, self.0.min_f64s(self.1, b.1))
    }
    /// Is any of the numbers above `bound`?
    #[inline(always)]
    pub(crate) fn any_above(self, bound: Self) -> bool {
        let mask = self.0.less_than_f64s(bound.1, self.1);
        self.0.first_true_m64s(mask) < S::F64_LANES
    }
    /// `yes` where this is below `bound`, `no` elsewhere.
    #[inline(always)]
    pub(crate) fn below(self, bound: Self, yes: Self, no: Self) -> Self {
        let mask = self.0.less_than_f64s(self.1, bound.1);
        Self(self.0, self.0.select_f64s(mask, yes.1, no.1))
    }
}

#[inline(always)]
pub(crate) fn minus<S: Simd>(a: &Vectors<S>, b: &Vectors<S>) -> Vectors<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(crate) fn dot<S: Simd>(a: &Vectors<S>, b: &Vectors<S>) -> Lanes<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn cross<S: Simd>(a: &Vectors<S>, b: &Vectors<S>) -> Vectors<S> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
