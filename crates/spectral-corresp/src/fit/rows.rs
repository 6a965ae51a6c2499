//! The nearest of many rows of numbers.
//!
//! Rows of six or more numbers in which none is much more telling than the others gain little from a tree: of some
//! thousand all are looked at, in lanes, which is several times as fast.

use geom_core::compute::lanes::autovectorized;

use crate::backend::{Nearest, Rows};

/// Rows side by side.
const LANES: usize = 16;

/// Rows made ready to be looked through.
pub(crate) struct Flat {
    /// Blocks of [`LANES`] rows: all their first numbers, all their second ones, …
    blocks: Vec<[f64; LANES]>,
    width: usize,
}

impl Flat {
    pub(crate) fn of(rows: Rows<'_>) -> Self {
        let width = rows.width.max(1);
        let count = rows.len().div_ceil(LANES);
        // Beyond the last row nothing is near.
        let mut blocks = vec![[f64::INFINITY; LANES]; count * width];
        for i in 0..rows.len() {
            for (c, &value) in rows.row(i).iter().enumerate() {
                blocks[i / LANES * width + c][i % LANES] = value;
            }
        }
        Self { blocks, width }
    }

    /// The nearest row to each of some queries, in their order, into `out`; of several the first.
    pub(crate) fn nearest(&self, queries: Rows<'_>, out: &mut [Nearest]) {
        // Compiled for the widths that there are most of.
        autovectorized(
            #[inline(always)]
            || match self.width {
                6 => self.nearest_of::<6>(queries, out),
                8 => self.nearest_of::<8>(queries, out),
                _ => self.nearest_of::<0>(queries, out),
            },
        );
    }

    /// `W` numbers per row; 0 for as many as there are. Plain indices: what iterators call is not always inlined, and so
    /// compiled for the oldest processor.
    #[expect(clippy::needless_range_loop, reason = "see above")]
    #[inline(always)]
    fn nearest_of<const W: usize>(&self, queries: Rows<'_>, out: &mut [Nearest]) {
        let width = if W == 0 { self.width } else { W };
        for q in 0..out.len() {
            let query = &queries.values[q * width..(q + 1) * width];
            // The best of each lane: a lane sees its rows in order, so that the first of several stays.
            let (mut least, mut places) = ([f64::INFINITY; LANES], [0u64; LANES]);
            for at in 0..self.blocks.len() / width {
                let block = &self.blocks[at * width..(at + 1) * width];
                let mut squares = [0.0; LANES];
                for c in 0..width {
                    let (values, x) = (&block[c], query[c]);
                    for l in 0..LANES {
                        let d = values[l] - x;
                        squares[l] += d * d;
                    }
                }
                for l in 0..LANES {
                    let nearer = squares[l] < least[l];
                    least[l] = if nearer { squares[l] } else { least[l] };
                    places[l] = if nearer { at as u64 } else { places[l] };
                }
            }
            let mut best = (f64::INFINITY, usize::MAX);
            for l in 0..LANES {
                let found = (least[l], places[l] as usize * LANES + l);
                if found.0 < best.0 || (found.0 == best.0 && found.1 < best.1) {
                    best = found;
                }
            }
            out[q] = Nearest {
                index: best.1 as u32,
                distance: best.0.sqrt(),
            };
        }
    }
}
