//! Products of tall blocks with the sums in registers.
//!
//! Blocks of a basis have few columns and very many rows. A library's product of matrices packs them first, which takes
//! longer than the arithmetic; stored row after row they need no packing. Tiles of four rows by two registers of columns take three
//! loads for four fused products. The blocks of a basis lie apart, and a few of them are read at a time, for which the processor
//! fetches ahead. Each sum is taken in the order of its rows or columns, whatever the width of a register.

use crate::compute::lanes;

/// Sums that are held at a time: enough to hide the latency of a fused product.
const SUMS: usize = 8;
/// Half of them: two registers of each row.
const HALF: usize = SUMS / 2;
/// Rows of which sums are taken at a time, in the first cache. Part of the result: another number, other last bits.
const GRAM_STRIP: usize = 128;
/// Numbers of B that stay in the second cache while one block of A after the other is read.
const KEPT: usize = 1 << 15;
/// Rows of which products are taken at a time,
const PRODUCT_STRIP: usize = 256;
/// and blocks of a basis: their rows stay in the second cache while all columns are taken. Part of the result, too.
const BLOCKS: usize = 8;

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

/// `out ← out + Aᵀ B`, row after row, where A stands in blocks side by side, each of the rows of B.
pub(super) fn add_gram(out: &mut [f64], a: &[Tall<'_>], b: Tall<'_>) {
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
    a: &'a [Tall<'a>],
    b: Tall<'a>,
}

impl lanes::WithSimd for Gram<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: lanes::Simd>(self, simd: S) {
        let (n, rows) = (self.b.columns, self.b.rows());
        let kept = (KEPT / n.max(1)).next_multiple_of(GRAM_STRIP);
        for start in (0..rows).step_by(kept) {
            let end = (start + kept).min(rows);
            let mut at = 0;
            for a in self.a {
                let out = &mut self.out[at * n..(at + a.columns) * n];
                at += a.columns;
                for first in (start..end).step_by(GRAM_STRIP) {
                    let count = GRAM_STRIP.min(end - first);
                    gram_of(simd, out, a.part(first, count), self.b.part(first, count));
                }
            }
        }
    }
}

/// The products of one block's columns with all of B, tile by tile.
#[inline(always)]
fn gram_of<S: lanes::Simd>(simd: S, out: &mut [f64], a: Tall<'_>, b: Tall<'_>) {
    let mut j = 0;
    while j < b.columns {
        let wide = b.columns - j >= 2 * S::F64_LANES;
        let mut i = 0;
        while i < a.columns {
            let left = a.columns - i;
            i += match (wide, left) {
                (true, HALF..) => gram_tile::<S, HALF, 2>(simd, out, (a, i), (b, j)),
                (true, _) => gram_tile::<S, 1, 2>(simd, out, (a, i), (b, j)),
                (false, SUMS..) => gram_tile::<S, SUMS, 1>(simd, out, (a, i), (b, j)),
                (false, HALF..) => gram_tile::<S, HALF, 1>(simd, out, (a, i), (b, j)),
                (false, _) => gram_tile::<S, 1, 1>(simd, out, (a, i), (b, j)),
            };
        }
        j += if wide { 2 } else { 1 } * S::F64_LANES;
    }
}

/// `P` rows and `Q` registers of columns of the result; `P`. Plain loops: an iterator's step that is not inlined here is a call
/// per row of the blocks.
#[inline(always)]
fn gram_tile<S: lanes::Simd, const P: usize, const Q: usize>(
    simd: S,
    out: &mut [f64],
    (a, i): (Tall<'_>, usize),
    (b, j): (Tall<'_>, usize),
) -> usize {
    let (m, n, rows) = (a.columns, b.columns, b.rows());
    let width = (Q * S::F64_LANES).min(n - j);
    let mut sums = [[simd.splat_f64s(0.0); Q]; P];
    for row in 0..rows {
        let a = &a.values[row * m + i..row * m + i + P];
        let b = &b.values[row * n + j..row * n + j + width];
        let mut own = [simd.splat_f64s(0.0); Q];
        for (q, own) in own.iter_mut().enumerate() {
            *own = load(simd, b, q);
        }
        for p in 0..P {
            let a = simd.splat_f64s(a[p]);
            for q in 0..Q {
                sums[p][q] = simd.mul_add_e_f64s(a, own[q], sums[p][q]);
            }
        }
    }
    for (p, sums) in sums.iter().enumerate() {
        let row = (i + p) * n + j;
        add(simd, &mut out[row..row + width], sums);
    }
    P
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

    /// Panels of two registers of columns, or one, for which C is copied side by side, with zeros up to the width of a register.
    #[inline(always)]
    fn with_simd<S: lanes::Simd>(mut self, simd: S) {
        let blocks = self.a;
        let (lanes, columns) = (S::F64_LANES, self.columns);
        let depth = self.c.len() / columns;
        let mut packed = Vec::with_capacity(depth * columns.next_multiple_of(lanes));
        let panels = || (0..columns).step_by(2 * lanes);
        for at in panels() {
            let end = (at + 2 * lanes).min(columns);
            for row in self.c.chunks_exact(columns) {
                packed.extend_from_slice(&row[at..end]);
                let width = (end - at).next_multiple_of(lanes);
                packed.resize(packed.len() + width - (end - at), 0.0);
            }
        }
        let rows = self.out.len() / columns;
        for first in (0..rows).step_by(PRODUCT_STRIP) {
            let strip = first..(first + PRODUCT_STRIP).min(rows);
            let mut done = 0;
            for a in blocks.chunks(BLOCKS) {
                let own = done..done + a.iter().map(|a| a.columns).sum::<usize>();
                done = own.end;
                for at in panels() {
                    let panel = &packed[at * depth..];
                    if columns - at > lanes {
                        let panel = &panel[2 * lanes * own.start..2 * lanes * own.end];
                        self.panel::<S, HALF, 2>(simd, a, strip.clone(), at, panel);
                    } else {
                        let panel = &panel[lanes * own.start..lanes * own.end];
                        self.panel::<S, SUMS, 1>(simd, a, strip.clone(), at, panel);
                    }
                }
            }
        }
    }
}

impl Product<'_> {
    /// `Q` registers of columns of a strip, `P` rows at a time.
    #[inline(always)]
    fn panel<S: lanes::Simd, const P: usize, const Q: usize>(
        &mut self,
        simd: S,
        a: &[Tall<'_>],
        strip: std::ops::Range<usize>,
        at: usize,
        packed: &[f64],
    ) {
        let mut row = strip.start;
        while row + P <= strip.end {
            self.tile::<S, P, Q>(simd, a, row, at, packed);
            row += P;
        }
        for row in row..strip.end {
            self.tile::<S, 1, Q>(simd, a, row, at, packed);
        }
    }

    /// `P` rows of `Q` registers of columns of the result.
    #[inline(always)]
    fn tile<S: lanes::Simd, const P: usize, const Q: usize>(
        &mut self,
        simd: S,
        a: &[Tall<'_>],
        row: usize,
        at: usize,
        packed: &[f64],
    ) {
        let mut sums = [[simd.splat_f64s(0.0); Q]; P];
        let mut c = S::as_simd_f64s(packed).0.as_chunks::<Q>().0;
        for block in a {
            let m = block.columns;
            let (own, more) = c.split_at(m);
            c = more;
            let a = &block.values[row * m..(row + P) * m];
            // The usual width, known to the compiler.
            if let (SUMS, Some(own)) = (m, own.first_chunk::<SUMS>()) {
                let a = &a.as_chunks::<SUMS>().0[..P];
                for k in 0..SUMS {
                    for p in 0..P {
                        let a = simd.splat_f64s(a[p][k]);
                        for q in 0..Q {
                            sums[p][q] = simd.mul_add_e_f64s(a, own[k][q], sums[p][q]);
                        }
                    }
                }
                continue;
            }
            for (k, own) in own.iter().enumerate() {
                for p in 0..P {
                    let a = simd.splat_f64s(a[p * m + k]);
                    for q in 0..Q {
                        sums[p][q] = simd.mul_add_e_f64s(a, own[q], sums[p][q]);
                    }
                }
            }
        }
        let scale = simd.splat_f64s(self.scale);
        let width = (Q * S::F64_LANES).min(self.columns - at);
        for (p, mut sums) in sums.into_iter().enumerate() {
            for sum in &mut sums {
                *sum = simd.mul_f64s(scale, *sum);
            }
            let first = (row + p) * self.columns + at;
            add(simd, &mut self.out[first..first + width], &sums);
        }
    }
}

/// The `q`-th register of some numbers, with zeros where there are no more.
#[inline(always)]
fn load<S: lanes::Simd>(simd: S, values: &[f64], q: usize) -> S::f64s {
    let (whole, rest) = S::as_simd_f64s(values);
    match whole.get(q) {
        Some(&register) => register,
        None => simd.partial_load_f64s(rest),
    }
}

/// Adds to as many numbers as there are, at most those of the registers.
#[inline(always)]
fn add<S: lanes::Simd, const Q: usize>(simd: S, out: &mut [f64], sums: &[S::f64s; Q]) {
    let (whole, rest) = S::as_mut_simd_f64s(out);
    for (q, &sum) in sums.iter().enumerate() {
        match whole.get_mut(q) {
            Some(register) => *register = simd.add_f64s(*register, sum),
            None => {
                let new = simd.add_f64s(simd.partial_load_f64s(rest), sum);
                simd.partial_store_f64s(rest, new);
            }
        }
    }
}
