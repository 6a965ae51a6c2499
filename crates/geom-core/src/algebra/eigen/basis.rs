//! Orthonormal bases of tall vectors, shared by the two iterations.
//!
//! Lanczos needs `V` alone, Davidson `V` and `K V`; both work in whole blocks, since a product of tall matrices is
//! faster than as many of vectors.

use std::borrow::Cow;
use std::ops::Range;

use crate::compute::parallel;

use super::parts;
use crate::algebra::Mass;
use crate::algebra::dense::{self, Tall};
use crate::compute::random::{SplitMix64, symmetric};

/// Tall vectors, kept in the blocks in which they came. Blocks are not put together: a basis of hundreds of columns
/// would be copied each time that it grows.
pub(super) struct Columns {
    blocks: Vec<Block>,
    count: usize,
}

struct Block {
    first: usize,
    columns: usize,
    values: Vec<f64>,
}

impl Columns {
    pub(super) fn new() -> Self {
        Self {
            blocks: Vec::new(),
            count: 0,
        }
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// All of them, side by side.
    pub(super) fn tall(&self) -> Vec<Tall<'_>> {
        self.among(0, 0)
    }

    /// The blocks that begin before column `locked`, and those from column `near` on.
    fn among(&self, locked: usize, near: usize) -> Vec<Tall<'_>> {
        let wanted = |b: &&Block| b.first < locked || b.first >= near;
        let blocks = self.blocks.iter().filter(wanted);
        blocks.map(|b| Tall::of(&b.values, b.columns)).collect()
    }

    pub(super) fn last(&self) -> &[f64] {
        self.blocks.last().map_or(&[], |b| &b.values)
    }

    pub(super) fn push(&mut self, values: Vec<f64>, columns: usize) {
        self.blocks.push(Block {
            first: self.count,
            columns,
            values,
        });
        self.count += columns;
    }

    /// Becomes `keep` combinations of its columns: `y` has a row for each of them. The first `locked`
    /// become a block of their own. The step of a restart: a product of all columns with a small matrix, after which
    /// the old ones are dropped.
    pub(super) fn combine(&mut self, y: &[f64], keep: usize, locked: usize) {
        let mut blocks = Vec::new();
        for columns in [0..locked, locked..keep] {
            if !columns.is_empty() {
                let y: Vec<f64> = y
                    .chunks(keep)
                    .flat_map(|row| row[columns.clone()].iter().copied())
                    .collect();
                let values = dense::product(&self.tall(), &y, columns.len());
                blocks.push(Block {
                    first: columns.start,
                    columns: columns.len(),
                    values,
                });
            }
        }
        self.blocks = blocks;
        self.count = keep;
    }
}

/// Columns that are orthonormal in the product of a mass, or without one.
pub(super) struct Basis<'a> {
    mass: Option<&'a Mass>,
    pub(super) columns: Columns,
}

/// What an orthogonalization took off a block W: `W = V C + Q R`. V is the basis and Q the block as it is returned.
pub(super) struct Taken {
    /// A row for each column of the basis.
    pub(super) c: Vec<f64>,
    pub(super) r: Vec<f64>,
}

impl Taken {
    /// Nothing yet, of a block of `b` columns.
    pub(super) fn nothing(columns: usize, b: usize) -> Self {
        let one = |i: usize| f64::from(i.is_multiple_of(b + 1));
        Self {
            c: vec![0.0; columns * b],
            r: (0..b * b).map(one).collect(),
        }
    }
}

impl<'a> Basis<'a> {
    pub(super) fn new(mass: Option<&'a Mass>) -> Self {
        Self {
            mass,
            columns: Columns::new(),
        }
    }

    /// `M W`.
    pub(super) fn image<'w>(&self, w: &'w [f64], b: usize) -> Cow<'w, [f64]> {
        match self.mass {
            None => Cow::Borrowed(w),
            Some(mass) => Cow::Owned(parts::mass_times(mass, w, b)),
        }
    }

    /// Makes a block W orthonormal, and orthogonal to the columns before the first number and from the
    /// second on; adds to what was taken off it. A column that depends on the others is replaced by a
    /// random one, orthogonal to all, with a zero in R.
    pub(super) fn orthonormalize(
        &self,
        w: &mut [f64],
        b: usize,
        near: (usize, usize),
        taken: &mut Taken,
        random: &mut SplitMix64,
    ) {
        parallel::inside(|| self.orthonormalize_here(w, b, near, taken, random));
    }

    /// Block Gram–Schmidt, then Q R by Cholesky of the Gram matrix, over again until every column keeps a tenth of its
    /// length in a round: what rounding leaves of the others grows by the inverse of that share, and the next round
    /// removes it. Six rounds at most.
    fn orthonormalize_here(
        &self,
        w: &mut [f64],
        b: usize,
        (locked, mut near): (usize, usize),
        taken: &mut Taken,
        random: &mut SplitMix64,
    ) {
        for _ in 0..6 {
            let against = self.columns.among(locked, near);
            let more = dense::gram(&against, Tall::of(&self.image(w, b), b));
            let gram = if self.mass.is_none() {
                dense::subtract_product(w, b, &against, &more)
            } else {
                dense::add_product(w, b, &against, &more, -1.0);
                dense::gram(&[Tall::of(w, b)], Tall::of(&self.image(w, b), b))
            };
            let (factor, dead) = dense::upper_cholesky(&gram, b, 1e-14);
            dense::turn(w, b, &dense::upper_inverse(&factor, b));
            let add = dense::product(&[Tall::of(&more, b)], &taken.r, b);
            let rows = self.rows_among(locked, near);
            for (add, row) in add.chunks(b).zip(rows.into_iter().flatten()) {
                let c = &mut taken.c[row * b..][..b];
                c.iter_mut().zip(add).for_each(|(c, a)| *c += a);
            }
            taken.r = dense::product(&[Tall::of(&factor, b)], &taken.r, b);
            for &j in &dead {
                let fresh = random_block(w.len() / b, 1, random);
                for (row, x) in w.chunks_mut(b).zip(fresh) {
                    row[j] = x;
                }
                near = 0;
            }
            // What was left of each column: rounding grows by the inverse of its root.
            let clean = (0..b).all(|j| {
                let gone: f64 = more.iter().skip(j).step_by(b).map(|x| x * x).sum();
                let pivot = factor[j * b + j].powi(2);
                pivot > 1e-2 * (gone + gram[j * b + j])
            });
            if clean && dead.is_empty() {
                break;
            }
        }
    }

    /// Becomes `keep` combinations of its columns (see [`Columns::combine`]), orthonormal to the last digits again: what its
    /// blocks had of each other is in all of them, and would grow on.
    pub(super) fn restart(
        &mut self,
        y: &[f64],
        keep: usize,
        locked: usize,
        random: &mut SplitMix64,
    ) {
        self.columns.combine(y, keep, locked);
        if let Some(mut kept) = self.columns.blocks.pop() {
            let b = kept.columns;
            let mut taken = Taken::nothing(keep, b);
            self.orthonormalize(&mut kept.values, b, (0, 0), &mut taken, random);
            self.columns.blocks.push(kept);
        }
    }

    /// Takes out of the newest block of the basis and of the next, each of `b` columns, what rounding has brought back of all
    /// older ones: both at once, since the time goes into reading those. So little is taken that lengths stay.
    pub(super) fn reorthogonalize(&mut self, next: &mut [f64], b: usize) {
        let Some(mut newest) = self.columns.blocks.pop() else {
            return;
        };
        let older = self.columns.tall();
        let [image, other] = [&newest.values, &*next].map(|w| self.image(w, b));
        let [own, rest] = dense::gram_of_two(&older, [Tall::of(&image, b), Tall::of(&other, b)]);
        drop((image, other));
        dense::subtract_from_two([&mut newest.values, next], b, &older, [&own, &rest]);
        self.columns.blocks.push(newest);
    }

    /// The numbers of these columns, block after block, in the order of [`Columns::among`].
    fn rows_among(&self, locked: usize, near: usize) -> Vec<Range<usize>> {
        let wanted = |b: &&Block| b.first < locked || b.first >= near;
        let rows = |b: &Block| b.first..b.first + b.columns;
        self.columns
            .blocks
            .iter()
            .filter(wanted)
            .map(rows)
            .collect()
    }
}

/// Numbers in −1…1, one per row and column, each from its place alone.
pub(super) fn random_block(rows: usize, columns: usize, random: &mut SplitMix64) -> Vec<f64> {
    // The next block starts one number on: its numbers are those of this one but for the first.
    *random = random.skip(1);
    let random = random.clone();
    parallel::map(rows * columns, |i| symmetric(random.nth(i as u64)))
}
