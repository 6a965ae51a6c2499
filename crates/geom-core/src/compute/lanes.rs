//! Numbers on the processor's vectors: arithmetic that gives each lane what it would have alone, so that
//! results do not depend on how wide the vectors are. There are no fused operations and no sums over lanes.
//!
//! There are two ways in. Loops that the compiler turns into vector instructions by itself are given to
//! [`autovectorized`] as a closure; chains that it does not see through are given to [`vectorized`] as a
//! [`WithSimd`] that names its [`Lanes`]. All that either calls must be `#[inline(always)]`, the closure too,
//! since only what is inlined is compiled for the instruction set.

use std::ops::{Add, Div, Mul, Sub};

use pulp::{Arch, NullaryFnOnce};
pub use pulp::{Scalar, Simd, WithSimd};

/// Does work with the widest vector instructions of this machine.
///
/// ```
/// use geom_core::compute::lanes::{Lanes, Simd, WithSimd, vectorized};
/// struct Squares<'a>(&'a [f64; 8]);
/// impl WithSimd for Squares<'_> {
///     type Output = [f64; 8];
///     #[inline(always)]
///     fn with_simd<S: Simd>(self, simd: S) -> [f64; 8] {
///         let mut out = [0.0; 8];
///         for first in (0..8).step_by(S::F64_LANES) {
///             let x = Lanes::of(simd, &self.0[first..]);
///             S::as_mut_simd_f64s(&mut out[first..]).0[0] = (x * x).1;
///         }
///         out
///     }
/// }
/// let x = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
/// assert_eq!(vectorized(Squares(&x)), x.map(|x| x * x));
/// ```
///
/// Which there are is looked up at the first call and remembered.
#[inline]
pub fn vectorized<W: WithSimd>(work: W) -> W::Output {
    Arch::new().dispatch(work)
}

/// Is a fused product one instruction? Without it, `mul_add` is a call, so that loops with such products are written for both
/// (by a constant of their own) and only this chooses. Of those that do use them the last digits differ from machine to machine.
#[cfg(feature = "algebra")]
#[inline(always)]
pub(crate) fn fuses<S: Simd>() -> bool {
    use std::any::TypeId;
    TypeId::of::<S>() != TypeId::of::<Scalar>()
}

/// The same as [`vectorized`] for plain loops.
///
/// ```
/// use geom_core::compute::lanes::autovectorized;
/// let x = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
/// let mut squares = [0.0; 8];
/// autovectorized(
///     #[inline(always)]
///     || {
///         for (square, x) in squares.iter_mut().zip(x) {
///             *square = x * x;
///         }
///     },
/// );
/// assert_eq!(squares, x.map(|x| x * x));
/// ```
// `FnMut`, and not the `FnOnce` that `dispatch` would take as it is: called as that, a closure that could be called
// again goes through a shim of the compiler's, which is not inlined when it is large, and so is compiled for the
// oldest processor (measured: half the speed of the density).
#[inline]
pub fn autovectorized<R>(work: impl FnMut() -> R) -> R {
    struct Plain<F>(F);
    impl<R, F: FnMut() -> R> NullaryFnOnce for Plain<F> {
        type Output = R;
        #[inline(always)]
        fn call(mut self) -> R {
            (self.0)()
        }
    }
    Arch::new().dispatch(Plain(work))
}

/// A number per lane: as many as a vector holds.
///
/// One, 2, 4 or 8 numbers, whatever `S` has: loops step by `S::F64_LANES`, and what is left over at the end is the
/// caller's to pad. The four operators work lane by lane, and round as scalars do.
#[derive(Clone, Copy)]
pub struct Lanes<S: Simd>(
    /// The instruction set.
    pub S,
    /// The numbers.
    pub S::f64s,
);

/// A vector of space per lane, by coordinate.
pub type Vectors<S> = [Lanes<S>; 3];

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

impl<S: Simd> Div for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(self.0, self.0.div_f64s(self.1, b.1))
    }
}

impl<S: Simd> Lanes<S> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, x: f64) -> Self {
        Self(simd, simd.splat_f64s(x))
    }
    /// The first numbers of a slice, which must fill the lanes.
    ///
    /// # Panics
    /// If there are fewer.
    #[inline(always)]
    pub fn of(simd: S, from: &[f64]) -> Self {
        Self(simd, S::as_simd_f64s(from).0[0])
    }
    /// Another number in every lane of as many.
    #[inline(always)]
    pub fn all(self, x: f64) -> Self {
        Self::splat(self.0, x)
    }
    /// Its negative.
    #[inline(always)]
    pub fn negative(self) -> Self {
        Self(self.0, self.0.neg_f64s(self.1))
    }
    /// The square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self(self.0, self.0.sqrt_f64s(self.1))
    }
    /// The absolute value.
    #[inline(always)]
    pub fn abs(self) -> Self {
        Self(self.0, self.0.abs_f64s(self.1))
    }
    /// The larger of the two.
    #[inline(always)]
    pub fn max(self, b: Self) -> Self {
        Self(self.0, self.0.max_f64s(self.1, b.1))
    }
    /// The smaller of the two.
    #[inline(always)]
    pub fn min(self, b: Self) -> Self {
        Self(self.0, self.0.min_f64s(self.1, b.1))
    }
    /// Is any of the numbers above `bound`? NaN is not.
    #[inline(always)]
    pub fn any_above(self, bound: Self) -> bool {
        let mask = self.0.less_than_f64s(bound.1, self.1);
        self.0.first_true_m64s(mask) < S::F64_LANES
    }
    /// `yes` where this is below `bound`, `no` elsewhere. Both are computed in every lane, and one is chosen: no
    /// branch. NaN takes `no`.
    #[inline(always)]
    pub fn below(self, bound: Self, yes: Self, no: Self) -> Self {
        let mask = self.0.less_than_f64s(self.1, bound.1);
        Self(self.0, self.0.select_f64s(mask, yes.1, no.1))
    }
}

/// `a − b`.
#[inline(always)]
pub fn minus<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Vectors<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The dot product.
#[inline(always)]
pub fn dot<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Lanes<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The cross product.
#[inline(always)]
pub fn cross<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Vectors<S> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
