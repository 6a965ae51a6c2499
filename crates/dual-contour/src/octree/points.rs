//! Lattice points in use, and their numbers.
//!
//! A bit per point and a count per block: the number of a point is the count of those before it, found by counting
//! bits. (Rank over a bit vector.) It takes 68 bytes per block, and no sorting and no hashing, and numbers follow from
//! the points alone.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use geom_core::compute::parallel;

use super::tree::{BLOCK, BLOCK_LOG, block_coordinates, block_count, block_index};

/// Lattice points marked as used, numbered in block order, 8 × 8 × 8 points per block.
pub(crate) struct PointSet {
    blocks: [i32; 3],
    /// A word per layer of a block, x fastest.
    bits: Vec<[u64; 8]>,
    /// How many points are marked in the blocks before.
    base: Vec<u32>,
    len: u32,
}

/// Marks points from many threads.
pub(crate) struct PointMarks {
    blocks: [i32; 3],
    bits: Vec<AtomicU64>,
}

impl PointMarks {
    /// For the points of so many cells, one more than cells per axis.
    pub(crate) fn new(cells: [i32; 3]) -> Self {
        let blocks = cells.map(|n| n / BLOCK + 1);
        let bits = (0..8 * block_count(blocks))
            .map(|_| AtomicU64::new(0))
            .collect();
        Self { blocks, bits }
    }

    /// Looks first, since most points are marked by eight cells, and a write would take the line from the other
    /// threads.
    pub(crate) fn mark(&self, p: [i32; 3]) {
        let b = block_index(self.blocks, p.map(|c| c >> BLOCK_LOG));
        let word = &self.bits[8 * b + (p[2] & 7) as usize];
        let bit = 1u64 << ((p[0] & 7) | (p[1] & 7) << 3);
        if word.load(Relaxed) & bit == 0 {
            word.fetch_or(bit, Relaxed);
        }
    }

    pub(crate) fn finish(self) -> PointSet {
        let bits: Vec<[u64; 8]> = self
            .bits
            .chunks_exact(8)
            .map(|w| std::array::from_fn(|i| w[i].load(Relaxed)))
            .collect();
        let mut len = 0;
        let base = bits
            .iter()
            .map(|words| {
                let base = len;
                len += words.iter().map(|w| w.count_ones()).sum::<u32>();
                base
            })
            .collect();
        PointSet {
            blocks: self.blocks,
            bits,
            base,
            len,
        }
    }
}

impl PointSet {
    pub(crate) fn len(&self) -> u32 {
        self.len
    }

    /// The number of a marked point.
    /// Of one that is not marked it is the number that the next one has.
    pub(crate) fn rank(&self, p: [i32; 3]) -> u32 {
        let b = block_index(self.blocks, p.map(|c| c >> BLOCK_LOG));
        let words = &self.bits[b];
        let w = (p[2] & 7) as usize;
        let bit = (p[0] & 7) | (p[1] & 7) << 3;
        let below: u32 = words[..w].iter().map(|w| w.count_ones()).sum();
        self.base[b] + below + (words[w] & ((1u64 << bit) - 1)).count_ones()
    }

    /// All marked points in the order of their numbers.
    pub(crate) fn points(&self) -> Vec<[i32; 3]> {
        parallel::flat_map(self.bits.len(), |b| {
            let low = block_coordinates(self.blocks, b).map(|c| c * BLOCK);
            let words = self.bits[b];
            (0..512i32).filter_map(move |i| {
                let d = [i & 7, i >> 3 & 7, i >> 6];
                (words[d[2] as usize] >> (i & 63) & 1 == 1)
                    .then(|| [0, 1, 2].map(|k| low[k] + d[k]))
            })
        })
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;
    use proptest::prelude::*;

    pub fn points_are_numbered_in_order() {
        proptest!(geom_core::testing::cases(24), |(points in prop::collection::btree_set(prop::array::uniform3(0..20i32), 0..60))| {
            let marks = PointMarks::new([19, 19, 19]);
            for p in &points { marks.mark(*p); }
            let set = marks.finish();
            prop_assert_eq!(set.len() as usize, points.len());
            let listed = set.points();
            prop_assert_eq!(listed.len(), points.len());
            for (i, p) in listed.iter().enumerate() {
                prop_assert!(points.contains(p));
                prop_assert_eq!(set.rank(*p) as usize, i);
            }
        });
    }
}
