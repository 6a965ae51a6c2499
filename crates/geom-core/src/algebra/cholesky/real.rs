//! The sweep of a substitution in real numbers, register by register.
//!
//! What [`substitution`](super::substitution) says for any scalar, the compiler turns into gathers, one right-hand side in a lane
//! only now and then. Here eight right-hand sides are a register (or two, or four, of narrower ones), and of a single one the rows
//! are. Sums have their terms in one order for every width of registers, but for the single one on the way up.

use std::ops::Range;

use super::multifrontal::Kept;
use super::substitution::{Direction, Supernodal, Sweep, Task};
use crate::compute::lanes::{Simd, WithSimd};

/// Columns of a triangle that are handled together: what they change is read and written once.
const BLOCK: usize = 4;

/// One sweep over the supernodes of a task.
pub(crate) struct Real<'a, const C: usize>(pub(crate) Sweep<'a, f64, C>);

impl<const C: usize> WithSimd for Real<'_, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (C, S::F64_LANES) {
            (8, _) => {
                let factor = (self.0.task, self.0.values);
                eight(simd, factor, self.0.x.as_flattened_mut(), self.0.direction);
            }
            (1, 2..) => self.single(simd),
            _ => self.0.with_simd(simd),
        }
    }
}

/// The sweep down for eight right-hand sides, with values as they are kept.
pub(super) struct Forward<'a, V> {
    pub(super) task: &'a Task,
    pub(super) values: &'a [V],
    pub(super) x: &'a mut [[f64; 8]],
}

impl<V: Kept> WithSimd for Forward<'_, V> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let factor = (self.task, self.values);
        eight(simd, factor, self.x.as_flattened_mut(), Direction::Down);
    }
}

/// With the eight of a row in as many registers as they need.
#[inline(always)]
fn eight<S: Simd, V: Kept>(simd: S, factor: (&Task, &[V]), x: &mut [f64], direction: Direction) {
    match S::F64_LANES {
        8 => wide::<S, V, 1, 8>(simd, factor, x, direction),
        4 => wide::<S, V, 2, 4>(simd, factor, x, direction),
        2 => wide::<S, V, 4, 2>(simd, factor, x, direction),
        _ => wide::<S, V, 8, 1>(simd, factor, x, direction),
    }
}

/// With the right-hand sides of a row in `R` registers, and the sums of `T` rows or columns in others.
#[inline(always)]
fn wide<S: Simd, V: Kept, const R: usize, const T: usize>(
    simd: S,
    (task, values): (&Task, &[V]),
    x: &mut [f64],
    direction: Direction,
) {
    let wide = Wide::<S, R, T> { simd };
    let x = S::as_mut_simd_f64s(x).0;
    let (x, _) = x.as_chunks_mut::<R>();
    let supernodes = task.supernodes();
    if direction == Direction::Down {
        for s in supernodes {
            let (head, below) = x.split_at_mut(s.columns.end);
            let own = &mut head[s.columns.clone()];
            // Of sparse right-hand sides most is zero still.
            let numbers: &[f64] = bytemuck::cast_slice(own.as_flattened());
            if numbers.iter().any(|&x| x != 0.0) {
                wide.forward(&Trapezoid::of(&s, values), own, below);
            }
        }
    } else {
        for s in supernodes.rev() {
            let (head, below) = x.split_at_mut(s.columns.end);
            wide.backward(
                &Trapezoid::of(&s, values),
                &mut head[s.columns.clone()],
                below,
            );
        }
    }
}

impl<const C: usize> Real<'_, C> {
    /// With a register of rows, or of terms.
    #[inline(always)]
    fn single<S: Simd>(self, simd: S) {
        let single = Single { simd };
        let Sweep {
            task,
            values,
            x,
            direction,
        } = self.0;
        let x = x.as_flattened_mut();
        let supernodes = task.supernodes();
        if direction == Direction::Down {
            for s in supernodes {
                let (head, below) = x.split_at_mut(s.columns.end);
                let own = &mut head[s.columns.clone()];
                if own.iter().any(|&x| x != 0.0) {
                    single.forward(&Trapezoid::of(&s, values), own, below);
                }
            }
        } else {
            let mut reached = Vec::new();
            for s in supernodes.rev() {
                let (head, below) = x.split_at_mut(s.columns.end);
                reached.clear();
                let rows = s.rows.iter();
                reached.extend(rows.map(|&row| below[row as usize - s.columns.end]));
                single.backward(
                    &Trapezoid::of(&s, values),
                    &mut head[s.columns.clone()],
                    &reached,
                );
            }
        }
    }
}

/// A supernode's values: columns of one height, a triangle over a rectangle.
struct Trapezoid<'a, V = f64> {
    values: &'a [V],
    width: usize,
    height: usize,
    /// The unknowns of the rectangle's rows, and the number of the first one below the supernode's own.
    rows: &'a [u32],
    end: usize,
}

impl<'a, V> Trapezoid<'a, V> {
    #[inline(always)]
    fn of(s: &Supernodal<'a>, values: &'a [V]) -> Self {
        let width = s.columns.len();
        Self {
            values: &values[s.values.clone()],
            width,
            height: width + s.rows.len(),
            rows: s.rows,
            end: s.columns.end,
        }
    }

    #[inline(always)]
    fn column(&self, c: usize) -> &'a [V] {
        &self.values[c * self.height..][..self.height]
    }

    /// Some rows of `N` columns.
    #[inline(always)]
    fn several<const N: usize>(&self, c: usize, rows: Range<usize>) -> [&'a [V]; N] {
        let mut columns: [&[V]; N] = [&[]; N];
        for (k, column) in columns.iter_mut().enumerate() {
            *column = &self.column(c + k)[rows.clone()];
        }
        columns
    }
}

/// Eight right-hand sides.
#[derive(Clone, Copy)]
struct Wide<S, const R: usize, const T: usize> {
    simd: S,
}

impl<S: Simd, const R: usize, const T: usize> Wide<S, R, T> {
    /// `sum + l · x`.
    #[inline(always)]
    fn add(self, mut sum: [S::f64s; R], l: impl Kept, x: [S::f64s; R]) -> [S::f64s; R] {
        let l = self.simd.splat_f64s(l.into());
        for r in 0..R {
            sum[r] = self.simd.mul_add_e_f64s(l, x[r], sum[r]);
        }
        sum
    }

    #[inline(always)]
    fn minus(self, mut x: [S::f64s; R], y: [S::f64s; R]) -> [S::f64s; R] {
        for r in 0..R {
            x[r] = self.simd.sub_f64s(x[r], y[r]);
        }
        x
    }

    #[inline(always)]
    fn scaled(self, mut x: [S::f64s; R], by: f64) -> [S::f64s; R] {
        let by = self.simd.splat_f64s(by);
        for x in &mut x {
            *x = self.simd.mul_f64s(*x, by);
        }
        x
    }

    #[inline(always)]
    fn zero(self) -> [S::f64s; R] {
        [self.simd.splat_f64s(0.0); R]
    }

    /// Solves with the triangle, then takes the product of the rectangle off the rows below.
    #[inline(always)]
    fn forward<V: Kept>(
        self,
        l: &Trapezoid<'_, V>,
        own: &mut [[S::f64s; R]],
        below: &mut [[S::f64s; R]],
    ) {
        let width = l.width;
        let mut c = 0;
        while c < width {
            // The unknowns of a block by themselves, so that those behind it are changed once by all of them.
            let block = BLOCK.min(width - c);
            for k in c..c + block {
                let column = &l.column(k)[..width];
                let solved = self.scaled(own[k], 1.0 / column[k].into());
                own[k] = solved;
                let minus = self.scaled(solved, -1.0);
                for row in k + 1..c + block {
                    own[row] = self.add(own[row], column[row], minus);
                }
            }
            if block == BLOCK {
                let columns = l.several::<BLOCK>(c, 0..width);
                let mut minus = [self.zero(); BLOCK];
                for k in 0..BLOCK {
                    minus[k] = self.scaled(own[c + k], -1.0);
                }
                for row in c + BLOCK..width {
                    let mut x = own[row];
                    for k in 0..BLOCK {
                        x = self.add(x, columns[k][row], minus[k]);
                    }
                    own[row] = x;
                }
            }
            c += block;
        }
        // The sums of a tile of rows stay in registers over all columns: rows below are far apart, and written once.
        let (tiles, rest) = l.rows.as_chunks::<T>();
        let mut at = width;
        for tile in tiles {
            let mut sums = [self.zero(); T];
            for (x, column) in own.iter().zip(l.values.chunks_exact(l.height)) {
                let l = &column[at..at + T];
                for q in 0..T {
                    sums[q] = self.add(sums[q], l[q], *x);
                }
            }
            for q in 0..T {
                let x = &mut below[tile[q] as usize - l.end];
                *x = self.minus(*x, sums[q]);
            }
            at += T;
        }
        for &row in rest {
            let mut sum = self.zero();
            for (x, column) in own.iter().zip(l.values.chunks_exact(l.height)) {
                sum = self.add(sum, column[at], *x);
            }
            let x = &mut below[row as usize - l.end];
            *x = self.minus(*x, sum);
            at += 1;
        }
    }

    /// First the product of the rectangle's transpose with the rows below, then the triangle from its last columns up.
    #[inline(always)]
    fn backward<V: Kept>(
        self,
        l: &Trapezoid<'_, V>,
        own: &mut [[S::f64s; R]],
        below: &[[S::f64s; R]],
    ) {
        let width = l.width;
        // A tile of columns at a time: each row below, which may be far from the next, is read once for all of them.
        let mut c = 0;
        while c + T <= width {
            let columns = l.several::<T>(c, width..l.height);
            let mut sums = [self.zero(); T];
            for (p, &row) in l.rows.iter().enumerate() {
                let x = below[row as usize - l.end];
                for q in 0..T {
                    sums[q] = self.add(sums[q], columns[q][p], x);
                }
            }
            for q in 0..T {
                own[c + q] = self.minus(own[c + q], sums[q]);
            }
            c += T;
        }
        // The columns that fill no tile.
        while c < width {
            let mut sum = self.zero();
            for (&value, &row) in l.column(c)[width..].iter().zip(l.rows) {
                sum = self.add(sum, value, below[row as usize - l.end]);
            }
            own[c] = self.minus(own[c], sum);
            c += 1;
        }
        // Blocks from the end: the first may be smaller.
        let mut end = width;
        while end > 0 {
            let block = if end.is_multiple_of(BLOCK) {
                BLOCK
            } else {
                end % BLOCK
            };
            let first = end - block;
            // What the unknowns behind a block take off it, before those within it do.
            if block == BLOCK {
                let columns = l.several::<BLOCK>(first, 0..width);
                let mut sums = [self.zero(); BLOCK];
                for row in end..width {
                    for k in 0..BLOCK {
                        sums[k] = self.add(sums[k], columns[k][row], own[row]);
                    }
                }
                for k in 0..BLOCK {
                    own[first + k] = self.minus(own[first + k], sums[k]);
                }
            }
            for k in (first..end).rev() {
                let column = &l.column(k)[..width];
                let mut sum = self.zero();
                for row in k + 1..end {
                    sum = self.add(sum, column[row], own[row]);
                }
                own[k] = self.scaled(self.minus(own[k], sum), 1.0 / column[k].into());
            }
            end = first;
        }
    }
}

/// One right-hand side.
#[derive(Clone, Copy)]
struct Single<S> {
    simd: S,
}

impl<S: Simd> Single<S> {
    /// `x ← x + l · by`.
    #[inline(always)]
    fn add(self, x: &mut [f64], l: &[f64], by: f64) {
        let splat = self.simd.splat_f64s(by);
        let (x, x_rest) = S::as_mut_simd_f64s(x);
        let (l, l_rest) = S::as_simd_f64s(l);
        for (x, &l) in x.iter_mut().zip(l) {
            *x = self.simd.mul_add_e_f64s(l, splat, *x);
        }
        for (x, &l) in x_rest.iter_mut().zip(l_rest) {
            *x = l.mul_add(by, *x);
        }
    }

    /// `a · b`, with four sums of each lane.
    #[inline(always)]
    fn dot(self, a: &[f64], b: &[f64]) -> f64 {
        let (a, a_rest) = S::as_simd_f64s(a);
        let (b, b_rest) = S::as_simd_f64s(b);
        let mut sums = [self.simd.splat_f64s(0.0); 4];
        let (a, a_last) = a.as_chunks::<4>();
        let (b, b_last) = b.as_chunks::<4>();
        for (a, b) in a.iter().zip(b) {
            for k in 0..4 {
                sums[k] = self.simd.mul_add_e_f64s(a[k], b[k], sums[k]);
            }
        }
        for (&a, &b) in a_last.iter().zip(b_last) {
            sums[0] = self.simd.mul_add_e_f64s(a, b, sums[0]);
        }
        let [s0, s1, s2, s3] = sums;
        let sum = self
            .simd
            .add_f64s(self.simd.add_f64s(s0, s1), self.simd.add_f64s(s2, s3));
        let mut total = self.simd.reduce_sum_f64s(sum);
        for (&a, &b) in a_rest.iter().zip(b_rest) {
            total = a.mul_add(b, total);
        }
        total
    }

    #[inline(always)]
    fn forward(self, l: &Trapezoid<'_>, own: &mut [f64], below: &mut [f64]) {
        let width = l.width;
        for c in 0..width {
            let column = &l.column(c)[..width];
            let (head, after) = own[c..].split_first_mut().expect("a column");
            *head *= 1.0 / column[c];
            self.add(after, &column[c + 1..], -*head);
        }
        let (lanes, mut at) = (S::F64_LANES, 0);
        while at + 2 * lanes <= l.rows.len() {
            let [first, second] = self.two_products(l, own, at);
            self.take(first, l, at..at + lanes, below);
            self.take(second, l, at + lanes..at + 2 * lanes, below);
            at += 2 * lanes;
        }
        while at < l.rows.len() {
            let end = (at + lanes).min(l.rows.len());
            let product = self.product(l, own, at..end);
            self.take(product, l, at..end, below);
            at = end;
        }
    }

    /// Of two registers of the rectangle's rows with the unknowns.
    #[inline(always)]
    fn two_products(self, l: &Trapezoid<'_>, own: &[f64], at: usize) -> [S::f64s; 2] {
        let (lanes, at) = (S::F64_LANES, l.width + at);
        let (mut first, mut second) = (self.simd.splat_f64s(0.0), self.simd.splat_f64s(0.0));
        for (c, &x) in own.iter().enumerate() {
            let rows = &l.column(c)[at..at + 2 * lanes];
            let rows = S::as_simd_f64s(rows).0;
            let x = self.simd.splat_f64s(x);
            first = self.simd.mul_add_e_f64s(rows[0], x, first);
            second = self.simd.mul_add_e_f64s(rows[1], x, second);
        }
        [first, second]
    }

    /// Of at most a register of them.
    #[inline(always)]
    fn product(self, l: &Trapezoid<'_>, own: &[f64], rows: Range<usize>) -> S::f64s {
        let rows = l.width + rows.start..l.width + rows.end;
        let mut sum = self.simd.splat_f64s(0.0);
        for (c, &x) in own.iter().enumerate() {
            let values = self.simd.partial_load_f64s(&l.column(c)[rows.clone()]);
            sum = self
                .simd
                .mul_add_e_f64s(values, self.simd.splat_f64s(x), sum);
        }
        sum
    }

    /// Takes sums off the unknowns of some rows.
    #[inline(always)]
    fn take(self, sums: S::f64s, l: &Trapezoid<'_>, rows: Range<usize>, below: &mut [f64]) {
        let sums: &[f64] = bytemuck::cast_slice(std::slice::from_ref(&sums));
        for (&row, sum) in l.rows[rows].iter().zip(sums) {
            below[row as usize - l.end] -= sum;
        }
    }

    /// `reached` are the unknowns of the rectangle's rows.
    #[inline(always)]
    fn backward(self, l: &Trapezoid<'_>, own: &mut [f64], reached: &[f64]) {
        let width = l.width;
        for c in (0..width).rev() {
            let column = l.column(c);
            let (head, after) = own[c..].split_first_mut().expect("a column");
            let sum = self.dot(&column[width..], reached) + self.dot(&column[c + 1..width], after);
            *head = (*head - sum) * (1.0 / column[c]);
        }
    }
}
