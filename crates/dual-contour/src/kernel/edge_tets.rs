//! Volumes of the tetrahedra that an edge spans with two points around it, many at a time.
//!
//! For the cut cells of a surface without an octree, where the same few shapes come again and again: their edges are
//! tables, only the points around them change.

use geom_core::compute::lanes::{Lanes, Simd, WithSimd, cross, dot, minus, vectorized};

use super::load;

/// Points, coordinate by coordinate.
pub(crate) type Rows<const N: usize> = [[f64; N]; 3];

/// Edge tetrahedra: edges `a → b`, relative to a corner of their cell, that each span one with two points around.
#[derive(Clone)]
pub(crate) struct EdgeTets<const N: usize> {
    pub(crate) a: Rows<N>,
    pub(crate) b: Rows<N>,
    /// 1 where the third corner comes before the fourth, counter-clockwise about the edge, else 0.
    pub(crate) first: [f64; N],
}

impl<const N: usize> EdgeTets<N> {
    /// Volume margins: six times the volumes with the third corners at `x` and the fourth at `y`, above the least.
    /// Edges are moved to `origin` before anything is subtracted, so that the numbers are those of the octree's mesher,
    /// to the last bit.
    pub(crate) fn margins(
        &self,
        origin: [f64; 3],
        x: &Rows<N>,
        y: &Rows<N>,
        least: &[f64; N],
    ) -> [f64; N] {
        let tets = self;
        vectorized(Margins {
            tets,
            origin,
            x,
            y,
            least,
        })
    }
}

struct Margins<'a, const N: usize> {
    tets: &'a EdgeTets<N>,
    origin: [f64; 3],
    x: &'a Rows<N>,
    y: &'a Rows<N>,
    least: &'a [f64; N],
}

impl<const N: usize> WithSimd for Margins<'_, N> {
    type Output = [f64; N];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut out = [0.0; N];
        let half = simd.splat_f64s(0.5);
        for i in (0..N).step_by(S::F64_LANES) {
            let mut a = load(simd, &self.tets.a, i);
            let mut b = load(simd, &self.tets.b, i);
            let (x, y) = (load(simd, self.x, i), load(simd, self.y, i));
            let first = Lanes::of(simd, &self.tets.first[i..]);
            let first = simd.less_than_f64s(half, first.1);
            let (mut c, mut d) = (x, y);
            for k in 0..3 {
                let origin = Lanes::splat(simd, self.origin[k]);
                (a[k], b[k]) = (a[k] + origin, b[k] + origin);
                c[k].1 = simd.select_f64s(first, x[k].1, y[k].1);
                d[k].1 = simd.select_f64s(first, y[k].1, x[k].1);
            }
            let volume = dot(cross(minus(b, a), minus(c, a)), minus(d, a));
            let margin = volume - Lanes::of(simd, &self.least[i..]);
            S::as_mut_simd_f64s(&mut out[i..]).0[0] = margin.1;
        }
        out
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;
    use geom_core::compute::lanes::Scalar;
    use proptest::prelude::*;

    /// What lanes give is what machines without lanes give.
    pub fn volumes_are_the_same_in_any_lane() {
        proptest!(|(
            corners in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
            others in prop::array::uniform8(prop::array::uniform3(-1.0f64..1.0)),
        )| {
            let rows = |x: &[[f64; 3]; 8]| [0, 1, 2].map(|k| x.map(|x| x[k]));
            let tets = EdgeTets {
                a: rows(&corners),
                b: rows(&others),
                first: std::array::from_fn(|i| (i % 2) as f64),
            };
            let (x, y, least) = (rows(&others), rows(&corners.map(|x| x.map(|x| x + 0.1))), [1e-3; 8]);
            let origin = [0.25, 0.5, -0.5];
            let narrow = Margins { tets: &tets, origin, x: &x, y: &y, least: &least };
            let narrow = narrow.with_simd(Scalar::new());
            prop_assert_eq!(tets.margins(origin, &x, &y, &least), narrow);
        });
    }
}
