//! The factor L Lᵀ of a real matrix by the multifrontal method (Duff and Reid, 1983; Liu, 1992), subtrees of the elimination tree side by
//! side; or L S Lᵀ with signs S of the pivots where these may be negative (`SIGNED`). A column of the latter is kept times its sign,
//! so that the root of its pivot on the diagonal says which it is.
//!
//! The columns of a supernode and what they subtract from the rows below them are a *front*: a dense trapezoid over a
//! dense triangle. The triangle is added to the front above, and so on up to the root. All arithmetic is that of dense
//! products in registers. Tasks are those of the substitution, and each adds what its children left in their order, so
//! that the bits do not depend on the number of threads. Triangles wait for the front above packed, and no longer than
//! that: besides the factor there are no more of them than lie side by side in the tree, and a square per thread.

use std::ops::Range;

use super::tree::{Forest, Supernode};
use crate::compute::{lanes, parallel};

/// Columns that are updated together, for two registers of rows: eight sums hide the latency of a fused product.
const COLUMNS: usize = 4;
/// Columns after which those behind them are updated: a slab of that width stays in the cache.
const SLAB: usize = 64;
/// Columns of an update that are one piece of work.
const PIECE: usize = 32;
/// Products in an update from which on it is worth handing out in pieces.
const WORTH: usize = 1 << 20;

/// Why there is no factor.
pub(super) enum Failure {
    /// The pivot of this column of the factor is not positive, or zero where it may be negative.
    Pivot(usize),
    Memory,
}

/// What of a factorization depends on the pattern alone.
pub(super) struct Fronts {
    fronts: Vec<Front>,
    /// Places of the rows below a supernode in the front above it, one supernode after the other.
    relative: Vec<u32>,
}

struct Front {
    first: usize,
    width: usize,
    height: usize,
    /// Its part of [`Fronts::relative`].
    relative: Range<usize>,
    children: Vec<u32>,
    /// Entries of the upper half that belong to its columns, and where each goes.
    targets: Vec<(u32, u32)>,
}

/// What a supernode subtracts from the front above it: its number, and the columns of a lower triangle from the diagonal on.
type Triangle = (u32, Vec<f64>);

/// A task while it is worked on.
struct Work<'a, V> {
    /// The values of its supernodes.
    blocks: Vec<&'a mut [V]>,
    /// Triangles that tasks below have left for this one.
    waiting: Vec<Triangle>,
    /// Those for tasks above.
    left: Vec<Triangle>,
    failure: Option<Failure>,
}

impl Fronts {
    /// Supernodes in the order of the factor; the upper half of the matrix row by row; and the place of each of its
    /// rows in the factor.
    pub(super) fn of(
        supernodes: &[Supernode<'_>],
        forest: &Forest,
        (starts, indices): (&[u32], &[u32]),
        place: &[u32],
    ) -> Self {
        let mut fronts: Vec<Front> = Vec::with_capacity(supernodes.len());
        let mut at = 0;
        for s in supernodes {
            fronts.push(Front {
                first: s.columns.start,
                width: s.columns.len(),
                height: s.columns.len() + s.rows.len(),
                relative: at..at + s.rows.len(),
                children: Vec::new(),
                targets: Vec::new(),
            });
            at += s.rows.len();
        }
        for (s, &parent) in forest.parents.iter().enumerate() {
            if let Some(p) = parent {
                fronts[p].children.push(s as u32);
            }
        }
        let relative = parallel::flat_map(supernodes.len(), |s| {
            let above = forest.parents[s].map(|p| &supernodes[p]);
            let places = |row: &u32| above.map_or(0, |above| above.place(*row));
            supernodes[s].rows.iter().map(places).collect::<Vec<u32>>()
        });
        Self::aim(
            &mut fronts,
            supernodes,
            &forest.owner,
            (starts, indices),
            place,
        );
        Self { fronts, relative }
    }

    /// Finds where each entry of the upper half goes: entries by the column of the factor that they belong to, then by
    /// the places of its rows.
    fn aim(
        fronts: &mut [Front],
        supernodes: &[Supernode<'_>],
        owner: &[u32],
        (starts, indices): (&[u32], &[u32]),
        place: &[u32],
    ) {
        let n = owner.len();
        let ends = |i: usize, j: u32| {
            let (p, q) = (place[i], place[j as usize]);
            (p.min(q), p.max(q))
        };
        let row = |i: usize| starts[i] as usize..starts[i + 1] as usize;
        let mut counts = vec![0u32; n];
        for i in 0..n {
            for at in row(i) {
                counts[ends(i, indices[at]).0 as usize] += 1;
            }
        }
        let first = parallel::starts_of(&counts);
        let mut next = first.clone();
        let mut entries = vec![(0u32, 0u32); indices.len()];
        for i in 0..n {
            for at in row(i) {
                let (column, row) = ends(i, indices[at]);
                entries[next[column as usize]] = (at as u32, row);
                next[column as usize] += 1;
            }
        }
        let targets = parallel::map_init(
            supernodes.len(),
            || vec![0u32; n],
            |local, s| {
                let s = &supernodes[s];
                let rows = s.columns.clone().map(|c| c as u32);
                let rows = rows.chain(s.rows.iter().copied());
                rows.zip(0..).for_each(|(row, at)| local[row as usize] = at);
                let height = s.columns.len() + s.rows.len();
                let column = |(k, c): (usize, usize)| {
                    let entries = &entries[first[c]..first[c + 1]];
                    let at = (k * height) as u32;
                    entries.iter().map(move |&(entry, row)| (entry, at, row))
                };
                let all = s.columns.clone().enumerate().flat_map(column);
                all.map(|(entry, at, row)| (entry, at + local[row as usize]))
                    .collect()
            },
        );
        for (front, targets) in fronts.iter_mut().zip(targets) {
            front.targets = targets;
        }
    }

    /// The values of the factor, into zeros.
    pub(super) fn factor<V: Kept, const SIGNED: bool>(
        &self,
        forest: &Forest,
        upper: &[f64],
        values: &mut [V],
    ) -> Result<(), Failure> {
        let mut works: Vec<Work<'_, V>> = (0..forest.tasks.len())
            .map(|_| Work {
                blocks: Vec::new(),
                waiting: Vec::new(),
                left: Vec::new(),
                failure: None,
            })
            .collect();
        let mut rest = values;
        for (front, &task) in self.fronts.iter().zip(&forest.task_of) {
            let (own, more) = rest.split_at_mut(front.width * front.height);
            works[task].blocks.push(own);
            rest = more;
        }
        for level in &forest.levels {
            let own = &mut works[level.clone()];
            parallel::for_chunks(own, 1, |i, work| {
                let task = level.start + i;
                let made = self.run::<V, SIGNED>(forest, task, upper, &mut work[0]);
                work[0].failure = made.err();
            });
            // The first of the lowest level.
            let mut failures = own.iter_mut().filter_map(|work| work.failure.take());
            if let Some(first) = failures.next() {
                return Err(failures.fold(first, Failure::earlier));
            }
            let left: Vec<Triangle> = own.iter_mut().flat_map(|w| w.left.drain(..)).collect();
            for triangle in left {
                let above = forest.parents[triangle.0 as usize].expect("left for a front above");
                works[forest.task_of[above]].waiting.push(triangle);
            }
        }
        Ok(())
    }

    /// The supernodes of a task in their order.
    fn run<V: Kept, const SIGNED: bool>(
        &self,
        forest: &Forest,
        task: usize,
        upper: &[f64],
        work: &mut Work<'_, V>,
    ) -> Result<(), Failure> {
        let Work {
            blocks,
            waiting,
            left,
            ..
        } = work;
        let mut square = Vec::new();
        for (&s, block) in forest.tasks[task].iter().zip(blocks) {
            let front = &self.fronts[s];
            let rows = front.height - front.width;
            V::filled(block, |block| {
                for &(entry, at) in &front.targets {
                    block[at as usize] = upper[entry as usize];
                }
                square.clear();
                reserve(&mut square, rows * rows)?;
                square.resize(rows * rows, 0.0);
                for &child in &front.children {
                    if let Some(at) = waiting.iter().rposition(|w| w.0 == child) {
                        let (_, triangle) = waiting.remove(at);
                        self.add(child as usize, &triangle, front, block, &mut square);
                    }
                }
                eliminate::<SIGNED>(block, front, &mut square)
                    .map_err(|column| Failure::Pivot(front.first + column))
            })?;
            if let Some(above) = forest.parents[s] {
                let of = match forest.task_of[above] == task {
                    true => &mut *waiting,
                    false => &mut *left,
                };
                of.push((s as u32, lower(&square, rows)?));
            }
        }
        Ok(())
    }

    /// Adds the triangle that a child left to a front. Rows ascend in both, so that what lies below the diagonal stays
    /// there.
    fn add(
        &self,
        child: usize,
        triangle: &[f64],
        front: &Front,
        block: &mut [f64],
        update: &mut [f64],
    ) {
        let places = &self.relative[self.fronts[child].relative.clone()];
        let (width, height) = (front.width, front.height);
        let mut rest = triangle;
        for (j, &to) in places.iter().enumerate() {
            let (column, more) = rest.split_at(places.len() - j);
            rest = more;
            let to = to as usize;
            let (target, shift) = if to < width {
                (&mut block[to * height..][..height], 0)
            } else {
                let rows = height - width;
                (&mut update[(to - width) * rows..][..rows], width)
            };
            for (&place, &value) in places[j..].iter().zip(column) {
                target[place as usize - shift] += value;
            }
        }
    }
}

/// What values of a factor are kept in. They are made in f64 in any case, and what waits for the front above is: sums over many
/// fronts that nearly cancel are what decides whether a pivot is positive.
pub(super) trait Kept: Copy + Default + Send + Sync + Into<f64> {
    /// Keeps the columns of a front, zeros that are filled.
    fn filled(
        own: &mut [Self],
        fill: impl FnOnce(&mut [f64]) -> Result<(), Failure>,
    ) -> Result<(), Failure>;
}

impl Kept for f64 {
    fn filled(
        own: &mut [Self],
        fill: impl FnOnce(&mut [f64]) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        fill(own)
    }
}

impl Kept for f32 {
    fn filled(
        own: &mut [Self],
        fill: impl FnOnce(&mut [f64]) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let mut columns = Vec::new();
        reserve(&mut columns, own.len())?;
        columns.resize(own.len(), 0.0);
        fill(&mut columns)?;
        let columns = columns.into_iter();
        own.iter_mut()
            .zip(columns)
            .for_each(|(own, x)| *own = x as f32);
        Ok(())
    }
}

/// The lower triangle of a square, packed.
fn lower(square: &[f64], rows: usize) -> Result<Vec<f64>, Failure> {
    let mut packed = Vec::new();
    reserve(&mut packed, rows * (rows + 1) / 2)?;
    for j in 0..rows {
        packed.extend_from_slice(&square[j * rows + j..(j + 1) * rows]);
    }
    Ok(packed)
}

fn reserve(values: &mut Vec<f64>, count: usize) -> Result<(), Failure> {
    let reserved = values.try_reserve_exact(count);
    reserved.map_err(|_| Failure::Memory)
}

impl Failure {
    fn earlier(self, other: Self) -> Self {
        match (&self, &other) {
            (Self::Pivot(a), Self::Pivot(b)) if b < a => other,
            (Self::Memory, Self::Pivot(_)) => other,
            _ => self,
        }
    }
}

/// Factors the columns of a front, slab by slab, and takes the product of what lies below them off the triangle. The
/// column whose pivot is none is the error.
fn eliminate<const SIGNED: bool>(
    block: &mut [f64],
    front: &Front,
    update: &mut [f64],
) -> Result<(), usize> {
    let (width, height) = (front.width, front.height);
    for from in (0..width).step_by(SLAB) {
        let to = (from + SLAB).min(width);
        let (head, behind) = block.split_at_mut(to * height);
        let slab = &mut head[from * height..];
        let panels = Panels::<SIGNED> { slab, height, from };
        lanes::vectorized(panels).map_err(|column| from + column)?;
        let slab = Slab::<SIGNED> {
            values: slab,
            height,
            from,
        };
        slab.take_off(behind, height, (to, 0));
        slab.take_off(update, height - width, (width, width));
    }
    Ok(())
}

/// Columns of a front that are done, of which the first is that of row `from`.
#[derive(Clone, Copy)]
struct Slab<'a, const SIGNED: bool> {
    values: &'a [f64],
    height: usize,
    from: usize,
}

impl<'a, const SIGNED: bool> Slab<'a, SIGNED> {
    /// Subtracts its products from columns of which the first is that of row `row.0` of the front and whose values begin with
    /// row `row.1`.
    fn take_off(self, out: &mut [f64], length: usize, row: (usize, usize)) {
        if out.is_empty() {
            return;
        }
        let piece = |first: usize, out: &mut [f64]| {
            lanes::vectorized(Products {
                slab: self,
                out,
                length,
                first: row.0 + first,
                top: row.1,
            });
        };
        if self.values.len() / self.height * out.len() < WORTH {
            piece(0, out);
        } else {
            parallel::for_chunks(out, PIECE * length, |k, out| piece(k * PIECE, out));
        }
    }

    /// Its columns, and the signs of their pivots.
    #[inline(always)]
    fn columns(self) -> impl Iterator<Item = (&'a [f64], f64)> {
        let all = self.values.chunks_exact(self.height).zip(self.from..);
        all.map(|(column, pivot)| (column, sign::<SIGNED>(column, pivot)))
    }
}

/// Of a column's pivot, which may be its root already.
#[inline(always)]
fn sign<const SIGNED: bool>(column: &[f64], pivot: usize) -> f64 {
    if SIGNED && column[pivot] < 0.0 {
        -1.0
    } else {
        1.0
    }
}

/// The columns of a slab, of which the first is that of row `from` of the front.
struct Panels<'a, const SIGNED: bool> {
    slab: &'a mut [f64],
    height: usize,
    from: usize,
}

impl<const SIGNED: bool> lanes::WithSimd for Panels<'_, SIGNED> {
    type Output = Result<(), usize>;

    /// Some columns at a time: first what the columns of the slab before them subtract, then each by those beside it.
    #[inline(always)]
    fn with_simd<S: lanes::Simd>(self, simd: S) -> Self::Output {
        let (height, from) = (self.height, self.from);
        let width = self.slab.len() / height;
        for at in (0..width).step_by(COLUMNS) {
            let count = COLUMNS.min(width - at);
            let (done, panel) = self.slab.split_at_mut(at * height);
            let panel = &mut panel[..count * height];
            if at > 0 {
                let products = Products {
                    slab: Slab::<SIGNED> {
                        values: done,
                        height,
                        from,
                    },
                    out: panel,
                    length: height,
                    first: from + at,
                    top: 0,
                };
                products.with_simd(simd);
            }
            for c in 0..count {
                let row = from + at + c;
                let (own, others) = panel[c * height..].split_at_mut(height);
                let pivot = own[row];
                // NaN is not positive either.
                if !(pivot > 0.0 || SIGNED && pivot < 0.0) || !pivot.is_finite() {
                    return Err(at + c);
                }
                let sign = sign::<SIGNED>(own, row);
                let root = sign * (sign * pivot).sqrt();
                own[row] = root;
                let scale = sign / root;
                own[row + 1..].iter_mut().for_each(|x| *x *= scale);
                for (k, other) in others.chunks_exact_mut(height).enumerate() {
                    let first = row + 1 + k;
                    let factor = sign * own[first];
                    for (y, &x) in other[first..].iter_mut().zip(&own[first..]) {
                        *y -= x * factor;
                    }
                }
            }
        }
        Ok(())
    }
}

/// Products that are subtracted from columns of `length` values, from the diagonal on: see [`Slab::take_off`].
struct Products<'a, const SIGNED: bool> {
    slab: Slab<'a, SIGNED>,
    out: &'a mut [f64],
    length: usize,
    first: usize,
    top: usize,
}

impl<const SIGNED: bool> lanes::WithSimd for Products<'_, SIGNED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: lanes::Simd>(self, simd: S) {
        let (slab, length) = (self.slab, self.length);
        let mut first = self.first;
        for out in self.out.chunks_mut(COLUMNS * length) {
            let out = Columns {
                slab,
                count: out.len() / length,
                out,
                length,
                first,
                shift: first - self.top,
            };
            match out.count {
                COLUMNS => out.take::<S, COLUMNS>(simd),
                3 => out.take::<S, 3>(simd),
                2 => out.take::<S, 2>(simd),
                _ => out.take::<S, 1>(simd),
            }
            first += COLUMNS;
        }
    }
}

/// A few columns, from row `first` of the front on, which is number `shift` of each.
struct Columns<'a, const SIGNED: bool> {
    slab: Slab<'a, SIGNED>,
    out: &'a mut [f64],
    length: usize,
    first: usize,
    shift: usize,
    count: usize,
}

impl<const SIGNED: bool> Columns<'_, SIGNED> {
    #[inline(always)]
    fn take<S: lanes::Simd, const N: usize>(mut self, simd: S) {
        let mut row = self.first;
        while row + 2 * S::F64_LANES <= self.slab.height {
            self.tile::<S, N>(simd, row);
            row += 2 * S::F64_LANES;
        }
        while row < self.slab.height {
            let end = (row + S::F64_LANES).min(self.slab.height);
            self.rest::<S, N>(simd, row..end);
            row = end;
        }
    }

    /// Two registers of rows.
    #[inline(always)]
    fn tile<S: lanes::Simd, const N: usize>(&mut self, simd: S, row: usize) {
        let mut sums = [[simd.splat_f64s(0.0); 2]; N];
        for (column, sign) in self.slab.columns() {
            let a = S::as_simd_f64s(&column[row..row + 2 * S::F64_LANES]).0;
            let b = &column[self.first..self.first + N];
            let (a0, a1) = (a[0], a[1]);
            for c in 0..N {
                let factor = simd.splat_f64s(sign * b[c]);
                sums[c][0] = simd.mul_add_e_f64s(factor, a0, sums[c][0]);
                sums[c][1] = simd.mul_add_e_f64s(factor, a1, sums[c][1]);
            }
        }
        for (c, sum) in sums.into_iter().enumerate() {
            let at = c * self.length + self.shift + row - self.first;
            let out = S::as_mut_simd_f64s(&mut self.out[at..at + 2 * S::F64_LANES]).0;
            out[0] = simd.sub_f64s(out[0], sum[0]);
            out[1] = simd.sub_f64s(out[1], sum[1]);
        }
    }

    /// At most a register of rows.
    #[inline(always)]
    fn rest<S: lanes::Simd, const N: usize>(&mut self, simd: S, rows: Range<usize>) {
        let mut sums = [simd.splat_f64s(0.0); N];
        for (column, sign) in self.slab.columns() {
            let a = simd.partial_load_f64s(&column[rows.clone()]);
            let b = &column[self.first..self.first + N];
            for c in 0..N {
                sums[c] = simd.mul_add_e_f64s(simd.splat_f64s(sign * b[c]), a, sums[c]);
            }
        }
        for (c, sum) in sums.into_iter().enumerate() {
            let at = c * self.length + self.shift + rows.start - self.first;
            let out = &mut self.out[at..at + rows.len()];
            let new = simd.sub_f64s(simd.partial_load_f64s(out), sum);
            simd.partial_store_f64s(out, new);
        }
    }
}
