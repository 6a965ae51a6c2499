//! Orthonormal bases of tall vectors, shared by the two iterations.

use rayon::prelude::*;

use super::Pencil;
use crate::linalg::dense::{self, Tall};

/// Tall vectors side by side, row after row, with room for more.
pub(super) struct Columns {
    values: Vec<f64>,
    room: usize,
    count: usize,
}

impl Columns {
    pub(super) fn new(rows: usize, room: usize) -> Self {
        Self {
            values: vec![0.0; rows * room],
            room,
            count: 0,
        }
    }

    pub(super) fn tall(&self) -> Tall<'_> {
        self.from(0)
    }

    /// The columns from `first` on.
    fn from(&self, first: usize) -> Tall<'_> {
        Tall {
            values: &self.values,
            width: self.room,
            first,
            columns: self.count - first,
        }
    }

    pub(super) fn column(&self, j: usize) -> Vec<f64> {
        self.values[j..]
            .iter()
            .step_by(self.room)
            .copied()
            .collect()
    }

    pub(super) fn push(&mut self, block: &[f64], columns: usize) {
        let at = self.count;
        self.values
            .par_chunks_mut(self.room)
            .zip(block.par_chunks(columns))
            .with_min_len(4096)
            .for_each(|(row, new)| row[at..at + columns].copy_from_slice(new));
        self.count += columns;
    }

    /// Becomes `keep` combinations of its columns: `y` has a row for each of them.
    pub(super) fn combine(&mut self, y: &[f64], keep: usize) {
        let kept = dense::product(self.tall(), y, keep);
        self.count = 0;
        self.push(&kept, keep);
    }
}

/// Columns that are orthonormal in the product of M.
pub(super) struct Basis<'a> {
    pencil: &'a Pencil<'a>,
    pub(super) columns: Columns,
}

impl<'a> Basis<'a> {
    pub(super) fn new(pencil: &'a Pencil<'a>, room: usize) -> Self {
        Self {
            pencil,
            columns: Columns::new(pencil.rows(), room),
        }
    }

    pub(super) fn columns(&self) -> usize {
        self.columns.count
    }

    pub(super) fn push(&mut self, block: &[f64], columns: usize) {
        self.columns.push(block, columns);
    }

    /// Makes a block W orthonormal and orthogonal to the basis V: `W = V C + Q R`; Q replaces W. A
    /// column that depends on the others is replaced by a random one, with a zero in R. But for
    /// rounding, W overlaps with the columns from `near` on only: they are taken off first, so that
    /// one pass over all the others cleans up.
    pub(super) fn orthonormalize(
        &self,
        w: &mut Vec<f64>,
        b: usize,
        near: usize,
        seed: &mut u64,
    ) -> (Vec<f64>, Vec<f64>) {
        let m = self.columns.count;
        let mut c = vec![0.0; m * b];
        let mut r: Vec<f64> = (0..b * b)
            .map(|i| f64::from(i.is_multiple_of(b + 1)))
            .collect();
        for pass in 0..6 {
            let first = if pass == 0 { near } else { 0 };
            let image = self.pencil.mass_times(w, b);
            let more = dense::gram(self.columns.from(first), Tall::of(&image, b));
            dense::add_product(w, b, self.columns.from(first), &more, -1.0);
            let image = self.pencil.mass_times(w, b);
            let gram = dense::gram(Tall::of(w, b), Tall::of(&image, b));
            let (factor, dead) = dense::upper_cholesky(&gram, b, 1e-14);
            *w = dense::product(Tall::of(w, b), &dense::upper_inverse(&factor, b), b);
            let add = dense::product(Tall::of(&more, b), &r, b);
            c[first * b..]
                .iter_mut()
                .zip(add)
                .for_each(|(c, a)| *c += a);
            r = dense::product(Tall::of(&factor, b), &r, b);
            for &j in &dead {
                let fresh = random_block(self.pencil.rows(), 1, seed);
                for (row, x) in w.chunks_mut(b).zip(fresh) {
                    row[j] = x;
                }
            }
            // What was left of each column: rounding grows by the inverse of its root.
            let clean = (0..b).all(|j| {
                let gone: f64 = more.iter().skip(j).step_by(b).map(|x| x * x).sum();
                let pivot = factor[j * b + j].powi(2);
                pivot > 1e-2 * (gone + gram[j * b + j])
            });
            if pass > 0 && clean && dead.is_empty() {
                break;
            }
        }
        (c, r)
    }
}

/// Numbers in −1…1, one per row and column, from a counter: the same on every machine.
pub(super) fn random_block(rows: usize, columns: usize, seed: &mut u64) -> Vec<f64> {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let base = *seed;
    (0..(rows * columns) as u64)
        .into_par_iter()
        .map(|i| {
            // SplitMix64.
            let mut z = base.wrapping_add((i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^= z >> 31;
            (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
        .collect()
}
