//! Products of tall blocks with the sums in registers.
//!
//! Blocks of a basis have few columns and very many rows. A library's product of matrices packs them first, which takes
//! longer than the arithmetic; stored row after row they need no packing. Each sum is taken in the order of its rows or
//! columns, whatever the width of a register.

use crate::compute::lanes;

/// Sums that are held at a time: enough to hide the latency of a fused product.
const SUMS: usize = 8;

/// A tall block: some columns, row after row. As many rows as `values` holds of that width.
#[derive(Clone, Copy)]
pub(crate) struct Tall<'a> {
    pub(crate) values: &'a [f64],
    pub(crate) columns: usize,
}

impl<'a> Tall<'a> {
    pub(crate) fn of(values: &'a [f64], columns: usize) -> Self {
        Self { values, columns }
    }

    pub(super) fn rows(&self) -> usize {
        self.values.len() / self.columns.max(1)
    }

    pub(super) fn part(&self, from: usize, rows: usize) -> Self {
        let values = &self.values[from * self.columns..(from + rows) * self.columns];
        Self::of(values, self.columns)
    }
}

/// `out ← out + Aᵀ B`, row after row.
pub(super) fn add_gram(out: &mut [f64], a: Tall<'_>, b: Tall<'_>) {
    lanes::vectorized(Gram { out, a, b });
}

/// `out ← out + scale · A C`, where A stands in blocks side by side.
pub(super) fn add_product(out: &mut [f64], columns: usize, a: &[Tall<'_>], c: &[f64], scale: f64) {
    lanes::vectorized(Product {
        out,
        columns,
        a,
        c,
        scale,
    });
}

struct Gram<'a> {
    out: &'a mut [f64],
    a: Tall<'a>,
    b: Tall<'a>,
}

impl lanes::WithSimd for Gram<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: lanes::Simd>(mut self, simd: S) {
        let mut i = 0;
        while i < self.a.columns {
            let rows = SUMS.min(self.a.columns - i);
            match rows {
                SUMS => self.rows::<S, SUMS>(simd, i),
                4.. => self.rows::<S, 4>(simd, i),
                2.. => self.rows::<S, 2>(simd, i),
                _ => self.rows::<S, 1>(simd, i),
            }
            i += match rows {
                SUMS => SUMS,
                4.. => 4,
                2.. => 2,
                _ => 1,
            };
        }
    }
}

impl Gram<'_> {
    /// `P` rows of the result. Plain loops: an iterator's step that is not inlined here is a call per row of the blocks.
    #[inline(always)]
    fn rows<S: lanes::Simd, const P: usize>(&mut self, simd: S, i: usize) {
        let (m, n) = (self.a.columns, self.b.columns);
        let rows = self.a.rows().min(self.b.rows());
        let whole = n - n % S::F64_LANES;
        let mut j = 0;
        while j < n {
            let end = (j + S::F64_LANES).min(n);
            let mut sums = [simd.splat_f64s(0.0); P];
            for row in 0..rows {
                let a = &self.a.values[row * m + i..row * m + i + P];
                let b = &self.b.values[row * n + j..row * n + end];
                let b = if j < whole {
                    S::as_simd_f64s(b).0[0]
                } else {
                    simd.partial_load_f64s(b)
                };
                for p in 0..P {
                    sums[p] = simd.mul_add_e_f64s(simd.splat_f64s(a[p]), b, sums[p]);
                }
            }
            for (p, sum) in sums.into_iter().enumerate() {
                let row = (i + p) * n;
                add(simd, &mut self.out[row + j..row + end], sum);
            }
            j = end;
        }
    }
}

struct Product<'a> {
    out: &'a mut [f64],
    columns: usize,
    a: &'a [Tall<'a>],
    c: &'a [f64],
    scale: f64,
}

impl lanes::WithSimd for Product<'_> {
    type Output = ();

    /// A few columns at a time, for which C is copied side by side, with zeros up to the width of a register.
    #[inline(always)]
    fn with_simd<S: lanes::Simd>(mut self, simd: S) {
        let rows = self.out.len() / self.columns;
        let whole = rows - rows % SUMS;
        let mut packed = Vec::with_capacity(self.c.len() / self.columns * S::F64_LANES);
        for at in (0..self.columns).step_by(S::F64_LANES) {
            let end = (at + S::F64_LANES).min(self.columns);
            packed.clear();
            for row in self.c.chunks_exact(self.columns) {
                packed.extend_from_slice(&row[at..end]);
                packed.resize(packed.len() + S::F64_LANES - (end - at), 0.0);
            }
            for row in (0..whole).step_by(SUMS) {
                self.rows::<S, SUMS>(simd, row, at..end, &packed);
            }
            for row in whole..rows {
                self.rows::<S, 1>(simd, row, at..end, &packed);
            }
        }
    }
}

impl Product<'_> {
    /// `P` rows of some columns of the result.
    #[inline(always)]
    fn rows<S: lanes::Simd, const P: usize>(
        &mut self,
        simd: S,
        row: usize,
        at: std::ops::Range<usize>,
        packed: &[f64],
    ) {
        let mut sums = [simd.splat_f64s(0.0); P];
        let mut c = S::as_simd_f64s(packed).0;
        for block in self.a {
            let m = block.columns;
            let (own, more) = c.split_at(m);
            c = more;
            let a = &block.values[row * m..(row + P) * m];
            // The usual width, known to the compiler.
            if let (SUMS, Some(own)) = (m, own.first_chunk::<SUMS>()) {
                let a = &a.as_chunks::<SUMS>().0[..P];
                for k in 0..SUMS {
                    for p in 0..P {
                        sums[p] = simd.mul_add_e_f64s(simd.splat_f64s(a[p][k]), own[k], sums[p]);
                    }
                }
                continue;
            }
            for (k, &c) in own.iter().enumerate() {
                for p in 0..P {
                    sums[p] = simd.mul_add_e_f64s(simd.splat_f64s(a[p * m + k]), c, sums[p]);
                }
            }
        }
        let scale = simd.splat_f64s(self.scale);
        for (p, sum) in sums.into_iter().enumerate() {
            let first = (row + p) * self.columns;
            let out = &mut self.out[first + at.start..first + at.end];
            add(simd, out, simd.mul_f64s(scale, sum));
        }
    }
}

/// Adds to as many numbers as there are, at most those of a register.
#[inline(always)]
fn add<S: lanes::Simd>(simd: S, out: &mut [f64], sum: S::f64s) {
    let new = simd.add_f64s(simd.partial_load_f64s(out), sum);
    simd.partial_store_f64s(out, new);
}
