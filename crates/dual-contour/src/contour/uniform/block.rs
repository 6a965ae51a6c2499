//! The cells of a block that carry the surface, as bits.
//!
//! A word holds the cells of an eighth of the block, 4³ of them, in Morton order: so numbers by counting bits come in
//! the order that the leaves of an octree have.

/// The cells of a stored block that carry the surface, as bits in the order of the octree's leaves.
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// Its lowest finest cell.
    pub(super) low: [i32; 3],
    /// Those with corners of both signs.
    pub(super) carrying: [u64; 8],
    /// Those that are not cut into tetrahedra: each has a vertex.
    pub(super) simple: [u64; 8],
    /// Number of the first vertex of each word.
    pub(super) first: [u32; 8],
    /// Number of the first cut cell.
    pub(super) first_cut: u32,
}

/// Word and bit of a cell within its block.
#[inline]
pub(super) fn bit_of([x, y, z]: [i32; 3]) -> (usize, u32) {
    let at = |shift: i32| (x >> shift & 1) | (y >> shift & 1) << 1 | (z >> shift & 1) << 2;
    (at(2) as usize, (at(1) << 3 | at(0)) as u32)
}

/// The inverse of [`bit_of`].
#[inline]
pub(super) const fn cell_at(word: usize, bit: u32) -> [i32; 3] {
    let (g, c, i) = (word as i32, bit as i32 >> 3, bit as i32 & 7);
    let mut out = [0; 3];
    let mut k = 0;
    while k < 3 {
        out[k] = (g >> k & 1) << 2 | (c >> k & 1) << 1 | (i >> k & 1);
        k += 1;
    }
    out
}

impl Block {
    /// `masks` of all cells, x fastest.
    /// Numbers come later, when those of all blocks before are known. Rows without a surface, which are most, are
    /// passed over at once.
    pub(super) fn new(low: [i32; 3], masks: &[u8], simple: &[bool; 256]) -> Self {
        let mut out = Self {
            low,
            carrying: [0; 8],
            simple: [0; 8],
            first: [0; 8],
            first_cut: 0,
        };
        for (row, masks) in masks.chunks_exact(8).enumerate() {
            if masks.iter().all(|&m| m == 0) || masks.iter().all(|&m| m == 255) {
                continue;
            }
            for (x, &mask) in masks.iter().enumerate() {
                if mask != 0 && mask != 255 {
                    let (word, bit) = bit_of([x as i32, (row & 7) as i32, (row >> 3) as i32]);
                    out.carrying[word] |= 1 << bit;
                    out.simple[word] |= u64::from(simple[usize::from(mask)]) << bit;
                }
            }
        }
        out
    }

    /// Those that are cut.
    pub(super) fn cut(&self) -> [u64; 8] {
        std::array::from_fn(|w| self.carrying[w] & !self.simple[w])
    }

    /// The number of the vertex of a cell that is not cut.
    #[inline]
    pub(super) fn vertex(&self, (word, bit): (usize, u32)) -> Option<u32> {
        (self.simple[word] >> bit & 1 == 1).then(|| self.number(word, bit))
    }

    /// The same for a cell that is known not to be cut.
    #[inline]
    pub(super) fn number(&self, word: usize, bit: u32) -> u32 {
        let below = self.simple[word] & ((1 << bit) - 1);
        self.first[word] + below.count_ones()
    }
}

/// The cells with a bit set, in order.
pub(super) fn cells_of(words: &[u64; 8]) -> impl Iterator<Item = [i32; 3]> + '_ {
    words.iter().enumerate().flat_map(|(word, &bits)| {
        let mut bits = bits;
        std::iter::from_fn(move || {
            (bits != 0).then(|| {
                let bit = bits.trailing_zeros();
                bits &= bits - 1;
                cell_at(word, bit)
            })
        })
    })
}
