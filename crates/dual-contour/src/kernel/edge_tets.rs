//! Volumes of the tetrahedra that an edge spans with two points around it, many at a time.

use geom_core::lanes::{Arch, Lanes, Simd, WithSimd, cross, dot, minus};

use super::load;

/// Points, coordinate by coordinate.
pub(crate) type Rows<const N: usize> = [[f64; N]; 3];

/// Tetrahedra on edges `a → b`, relative to a corner of their cell.
#[derive(Clone)]
pub(crate) struct Umbrellas<const N: usize> {
    pub(crate) a: Rows<N>,
    pub(crate) b: Rows<N>,
    /// 1 where the third corner comes before the fourth, counter-clockwise about the edge, else 0.
    pub(crate) first: [f64; N],
}

impl<const N: usize> Umbrellas<N> {
    /// Six times the volumes with the third corners at `x` and the fourth at `y`, above the least.
    pub(crate) fn spare(
        &self,
        origin: [f64; 3],
        x: &Rows<N>,
        y: &Rows<N>,
        least: &[f64; N],
    ) -> [f64; N] {
        let umbrellas = self;
        Arch::new().dispatch(Spare {
            umbrellas,
            origin,
            x,
            y,
            least,
        })
    }
}

struct Spare<'a, const N: usize> {
    umbrellas: &'a Umbrellas<N>,
    origin: [f64; 3],
    x: &'a Rows<N>,
    y: &'a Rows<N>,
    least: &'a [f64; N],
}

impl<const N: usize> WithSimd for Spare<'_, N> {
    type Output = [f64; N];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut out = [0.0; N];
        let half = simd.splat_f64s(0.5);
        for i in (0..N).step_by(S::F64_LANES) {
            let mut a = load(simd, &self.umbrellas.a, i);
            let mut b = load(simd, &self.umbrellas.b, i);
            let (x, y) = (load(simd, self.x, i), load(simd, self.y, i));
            let first = Lanes::of(simd, &self.umbrellas.first[i..]);
            let first = simd.less_than_f64s(half, first.1);
            let (mut c, mut d) = (x, y);
            for k in 0..3 {
                let origin = Lanes::splat(simd, self.origin[k]);
                (a[k], b[k]) = (a[k] + origin, b[k] + origin);
                c[k].1 = simd.select_f64s(first, x[k].1, y[k].1);
                d[k].1 = simd.select_f64s(first, y[k].1, x[k].1);
            }
            let volume = dot(cross(minus(b, a), minus(c, a)), minus(d, a));
            let spare = volume - Lanes::of(simd, &self.least[i..]);
            S::as_mut_simd_f64s(&mut out[i..]).0[0] = spare.1;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geom_core::lanes::Scalar;
    use proptest::prelude::*;

    proptest! {
        /// What lanes give is what machines without lanes give.
        #[test]
        fn volumes_are_the_same_in_any_lane(
            corners in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
            others in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
        ) {
            let rows = |x: &[[f64; 3]; 8]| [0, 1, 2].map(|k| x.map(|x| x[k]));
            let umbrellas = Umbrellas {
                a: rows(&corners),
                b: rows(&others),
                first: std::array::from_fn(|i| (i % 2) as f64),
            };
            let (x, y, least) = (rows(&others), rows(&corners.map(|x| x.map(|x| x + 0.1))), [1e-3; 8]);
            let origin = [0.25, 0.5, -0.5];
            let narrow = Spare { umbrellas: &umbrellas, origin, x: &x, y: &y, least: &least };
            let narrow = narrow.with_simd(Scalar::new());
            prop_assert_eq!(umbrellas.spare(origin, &x, &y, &least), narrow);
        }
    }
}
