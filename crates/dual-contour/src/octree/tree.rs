//! A strongly balanced octree in 16 bytes per block of 8 × 8 × 8 finest cells.
//!
//! A cell of size 2, 4 or 8 is *split* or not: one bit each, in Morton order inside its block. Cells
//! above the block size stand in arrays of their own, which are 1/7 of the blocks together. Whether a
//! finest cell lies in a leaf of size 1, 2 or 4, and the number of that leaf, follows from the bits by
//! counting them; no map is stored.
//!
//! Strong balance (ratio at most 2 across faces, edges and corners) is one pass from fine to coarse:
//! if a cell is split, the parents of its 26 neighbours must be.
//!
//! Bits within a block: `two` has one per cell of size 2, eight for each of the cells of size 4; `four` one per cell of
//! size 4. Leaves are numbered block by block, x fastest, and within a block in Morton order; a leaf of more than a
//! block where its first block stands.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use geom_core::compute::parallel;

/// Finest cells per side of a block, and its logarithm.
pub(crate) const BLOCK: i32 = 8;
pub(crate) const BLOCK_LOG: u8 = 3;
/// No leaf: beyond the domain.
pub(crate) const NONE: u32 = u32::MAX;

/// A cell that is not split: its lowest finest cell and the logarithm of its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Leaf {
    origin: [u16; 3],
    pub(crate) log: u8,
    /// Beyond the domain: only numbered, never used.
    pub(crate) void: bool,
}

impl Leaf {
    /// Its lowest corner, in finest cells.
    pub(crate) fn origin(&self) -> [i32; 3] {
        self.origin.map(i32::from)
    }
    pub(crate) fn size(&self) -> i32 {
        1 << self.log
    }
}

/// Which cells must be split, before balance.
#[derive(Clone)]
pub(crate) struct Splits {
    /// Per block, a bit for each of its cells of size 2: is it split into finest ones?
    pub(crate) two: Vec<u64>,
    /// The same for cells of size 4.
    pub(crate) four: Vec<u8>,
    /// Is the block itself split?
    pub(crate) eight: Vec<bool>,
    /// Blocks that may be leaves, but not parts of larger ones.
    pub(crate) alone: Vec<bool>,
    /// Leaves above this logarithm of their size are split.
    pub(crate) largest: u8,
}

impl Splits {
    /// Nothing but what the largest size asks for.
    pub(crate) fn none(blocks: [i32; 3], largest: u8) -> Self {
        let n = blocks.iter().map(|&b| b as usize).product();
        Self {
            two: vec![0; n],
            four: vec![0; n],
            eight: vec![largest < 3; n],
            alone: vec![false; n],
            largest,
        }
    }

    /// Asks for finest cells all around a finest cell.
    /// The 26 beside it, as far as there are any, and itself.
    pub(crate) fn surround(&mut self, cells: [i32; 3], cell: [i32; 3]) {
        let blocks = cells.map(|n| (n + BLOCK - 1) / BLOCK);
        let low = cell.map(|c| (c - 1).max(0));
        let high = [0, 1, 2].map(|k| (cell[k] + 1).min(cells[k] - 1));
        // The two ends along each axis name all cells of size 2 in between.
        for i in 0..8usize {
            let p = [0, 1, 2].map(|k| if i >> k & 1 == 0 { low[k] } else { high[k] });
            let (g, c) = morton(p);
            self.two[block_index(blocks, p.map(|c| c >> BLOCK_LOG))] |= 1 << (8 * g + c);
        }
    }

    /// Asks for the split of a leaf of size 2, 4 or 8.
    /// Those around need not be asked for: balance does.
    pub(crate) fn split(&mut self, blocks: [i32; 3], leaf: &Leaf) {
        let o = leaf.origin();
        let b = block_index(blocks, o.map(|c| c >> BLOCK_LOG));
        let (g, c) = morton(o);
        match leaf.log {
            1 => self.two[b] |= 1 << (8 * g + c),
            2 => self.four[b] |= 1 << g,
            _ => self.eight[b] = true,
        }
    }
}

#[derive(Clone, Copy)]
struct Node {
    two: u64,
    /// The number of the first leaf.
    base: u32,
    four: u8,
    /// 0 when the block is split, else the logarithm of the size of the leaf that holds it.
    level: u8,
}

/// So many leaves, more than allowed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TooManyLeaves(pub(crate) u64);

/// The leaves, and the way from a finest cell to its leaf.
pub(crate) struct Octree {
    pub(crate) cells: [i32; 3],
    pub(crate) blocks: [i32; 3],
    nodes: Vec<Node>,
    pub(crate) leaves: Vec<Leaf>,
}

/// Four-cell and two-cell (inside of it) of a finest cell, in Morton order.
fn morton([x, y, z]: [i32; 3]) -> (u32, u32) {
    let at = |shift: i32| (x >> shift & 1) | (y >> shift & 1) << 1 | (z >> shift & 1) << 2;
    (at(2) as u32, at(1) as u32)
}

/// Offsets of the corners of a cube, or of its eighths: bit 0 is x, bit 1 is y, bit 2 is z.
pub(crate) fn corner_of(i: usize) -> [i32; 3] {
    [i & 1, i >> 1 & 1, i >> 2 & 1].map(|c| c as i32)
}

pub(crate) fn block_index(blocks: [i32; 3], [a, b, c]: [i32; 3]) -> usize {
    (c as usize * blocks[1] as usize + b as usize) * blocks[0] as usize + a as usize
}

pub(super) fn block_coordinates(blocks: [i32; 3], b: usize) -> [i32; 3] {
    let [nx, ny, _] = blocks.map(|n| n as usize);
    [b % nx, b / nx % ny, b / (nx * ny)].map(|c| c as i32)
}

impl Octree {
    /// The coarsest balanced tree over `cells` finest cells in which all asked cells are split; `Err` with the
    /// number of its leaves if that is more than `most`, before any is made.
    /// Bottom-up, a pass per size: cells asked for, cells that cross the end of the domain, and parents of what balance
    /// wants. What is split in one pass is all that the next one needs to know, so there is no iteration. Time and
    /// memory go with the number of blocks, then of leaves.
    pub(crate) fn new(cells: [i32; 3], splits: &Splits, most: u64) -> Result<Self, TooManyLeaves> {
        let blocks = cells.map(|n| (n + BLOCK - 1) / BLOCK);
        let two = split_two(cells, blocks, splits);
        let four = split_four(cells, blocks, splits, &two);
        let coarse = Coarse::new(cells, blocks, splits, &four);
        let mut nodes: Vec<Node> = parallel::map(two.len(), |b| {
            match coarse.level(block_coordinates(blocks, b)) {
                0 => Node {
                    two: two[b],
                    base: 0,
                    four: four[b],
                    level: 0,
                },
                level => Node {
                    two: 0,
                    base: 0,
                    four: 0,
                    level,
                },
            }
        });
        let total = number(blocks, &mut nodes);
        if total > most {
            return Err(TooManyLeaves(total));
        }
        let leaves = parallel::flat_map(nodes.len(), |b| {
            leaves_of(&nodes[b], block_coordinates(blocks, b), cells)
        });
        Ok(Self {
            cells,
            blocks,
            nodes,
            leaves,
        })
    }

    /// The number of the leaf that holds a finest cell, and the logarithm of its size; [`NONE`]
    /// beyond the domain.
    /// A few counts of bits, whatever the depth of the tree.
    #[inline]
    pub(crate) fn find(&self, cell: [i32; 3]) -> (u32, u8) {
        if (0..3).any(|k| cell[k] < 0 || cell[k] >= self.cells[k]) {
            return (NONE, u8::MAX);
        }
        let node = &self.nodes[block_index(self.blocks, cell.map(|c| c >> BLOCK_LOG))];
        if node.level != 0 {
            return (node.base, node.level);
        }
        let (g, c) = morton(cell);
        let before = |bits: u64, i: u32| (bits & ((1u64 << i) - 1)).count_ones();
        let mut rank = g + 7 * before(u64::from(node.four), g);
        if node.four >> g & 1 == 0 {
            return (node.base + rank + 7 * before(node.two, 8 * g), 2);
        }
        rank += c + 7 * before(node.two, 8 * g + c);
        if node.two >> (8 * g + c) & 1 == 0 {
            return (node.base + rank, 1);
        }
        let leaf = (cell[0] & 1) | (cell[1] & 1) << 1 | (cell[2] & 1) << 2;
        (node.base + rank + leaf as u32, 0)
    }
}

impl Octree {
    /// The leaves that touch a leaf, some of them twice, and the leaf itself.
    /// By faces, edges and corners. Balance bounds their number: a shell of cells half as large has 56.
    pub(crate) fn touching(&self, id: u32) -> impl Iterator<Item = u32> + '_ {
        let leaf = &self.leaves[id as usize];
        let (o, s) = (leaf.origin(), leaf.size());
        // Those are at least half as large.
        let step = (s / 2).max(1);
        let last = s / step + 1;
        let at = move |k: usize, i: i32| {
            if i == 0 {
                o[k] - 1
            } else {
                o[k] + (i - 1) * step
            }
        };
        (0..=last)
            .flat_map(move |z| (0..=last).flat_map(move |y| (0..=last).map(move |x| [x, y, z])))
            .map(move |p| self.find([0, 1, 2].map(|k| at(k, p[k]))).0)
            .filter(|&other| other != NONE)
    }
}

/// The split cells of size 2: those asked for, and those that cross the end of the domain.
fn split_two(cells: [i32; 3], blocks: [i32; 3], splits: &Splits) -> Vec<u64> {
    parallel::map(splits.two.len(), |b| {
        let low = block_coordinates(blocks, b).map(|c| c * BLOCK);
        let mut bits = splits.two[b];
        if splits.largest < 1 {
            bits = !0;
        }
        if (0..3).any(|k| low[k] + BLOCK > cells[k]) {
            for t in 0..64 {
                let (p, q) = (corner_of(t >> 3), corner_of(t & 7));
                let o = [0, 1, 2].map(|k| low[k] + 4 * p[k] + 2 * q[k]);
                bits |= u64::from(crosses(o, 2, cells)) << t;
            }
        }
        bits
    })
}

/// The split cells of size 4: those asked for, those that cross the end of the domain, and the parents of all
/// neighbours of a split cell of size 2.
fn split_four(cells: [i32; 3], blocks: [i32; 3], splits: &Splits, two: &[u64]) -> Vec<u8> {
    let four: Vec<AtomicU8> = splits.four.iter().map(|&f| AtomicU8::new(f)).collect();
    let reach = two_to_four();
    parallel::for_indices(two.len(), |b| {
        let at = block_coordinates(blocks, b);
        // What the split cells of size 2 ask for, in this block and one cell around it.
        let mut asked = 0u64;
        let mut bits = two[b];
        while bits != 0 {
            asked |= reach[bits.trailing_zeros() as usize];
            bits &= bits - 1;
        }
        while asked != 0 {
            let i = asked.trailing_zeros() as i32;
            asked &= asked - 1;
            let f = [i & 3, i >> 2 & 3, i >> 4].map(|c| c - 1);
            let to = [0, 1, 2].map(|k| at[k] + (f[k] >> 1));
            if (0..3).all(|k| (0..blocks[k]).contains(&to[k])) {
                let bit = (f[0] & 1) | (f[1] & 1) << 1 | (f[2] & 1) << 2;
                four[block_index(blocks, to)].fetch_or(1 << bit, Relaxed);
            }
        }
        if (0..3).any(|k| (at[k] + 1) * BLOCK > cells[k]) || splits.largest < 2 {
            let mut bits = 0;
            for g in 0..8 {
                let o = [0, 1, 2].map(|k| at[k] * BLOCK + 4 * corner_of(g)[k]);
                bits |= u8::from(crosses(o, 4, cells) || splits.largest < 2) << g;
            }
            four[b].fetch_or(bits, Relaxed);
        }
    });
    four.into_iter().map(AtomicU8::into_inner).collect()
}

/// Which cells of the size of a block and above are split: a bool per cell and level.
struct Coarse {
    split: Vec<Vec<bool>>,
    /// Cells per axis of each level.
    shape: Vec<[i32; 3]>,
}

impl Coarse {
    fn new(cells: [i32; 3], blocks: [i32; 3], splits: &Splits, four: &[u8]) -> Self {
        let mut out = Self {
            split: vec![split_eight(cells, blocks, splits, four)],
            shape: vec![blocks],
        };
        while out.last().1.iter().any(|&s| s > 1) {
            let (below, fine) = out.last();
            let coarse = fine.map(|s| (s + 1) / 2);
            let log = BLOCK_LOG + out.shape.len() as u8;
            let size = 1i32.checked_shl(u32::from(log)).unwrap_or(i32::MAX);
            // Too large, or crossing the end of the domain.
            let mut marks: Vec<bool> = (0..block_count(coarse))
                .map(|c| {
                    let low = block_coordinates(coarse, c).map(|v| v << log);
                    log > splits.largest || (0..3).any(|k| low[k] > cells[k] - size)
                })
                .collect();
            if out.shape.len() == 1 {
                for b in (0..splits.alone.len()).filter(|&b| splits.alone[b]) {
                    marks[block_index(coarse, block_coordinates(blocks, b).map(|c| c >> 1))] = true;
                }
            }
            // Balance: the parents of all neighbours of a split cell.
            for (i, _) in below.iter().enumerate().filter(|(_, s)| **s) {
                let at = block_coordinates(fine, i);
                let low = [0, 1, 2].map(|k| ((at[k] - 1) >> 1).max(0));
                let high = [0, 1, 2].map(|k| ((at[k] + 1) >> 1).min(coarse[k] - 1));
                for_box(low, high, |p| marks[block_index(coarse, p)] = true);
            }
            out.split.push(marks);
            out.shape.push(coarse);
        }
        out
    }

    /// The coarsest level so far, and its cells per axis.
    fn last(&self) -> (&[bool], [i32; 3]) {
        let last = self.shape.len() - 1;
        (&self.split[last], self.shape[last])
    }

    /// 0 if a block is split, else the logarithm of the size of the leaf that holds it.
    fn level(&self, block: [i32; 3]) -> u8 {
        (0..self.split.len())
            .rev()
            .find(|&j| !self.split[j][block_index(self.shape[j], block.map(|c| c >> j))])
            .map_or(0, |j| BLOCK_LOG + j as u8)
    }
}

/// The split blocks: those asked for, those that cross the end of the domain, and those around a split cell of size 4.
fn split_eight(cells: [i32; 3], blocks: [i32; 3], splits: &Splits, four: &[u8]) -> Vec<bool> {
    let mut split = splits.eight.clone();
    for b in 0..split.len() {
        let at = block_coordinates(blocks, b);
        if crosses(at.map(|c| c * BLOCK), BLOCK, cells) {
            split[b] = true;
        }
        for g in (0..8).filter(|g| four[b] >> g & 1 == 1) {
            let low = [0, 1, 2].map(|k| (corner_of(g)[k] - 1) >> 1);
            let high = [0, 1, 2].map(|k| (corner_of(g)[k] + 1) >> 1);
            for_box(low, high, |d| {
                let to = [0, 1, 2].map(|k| at[k] + d[k]);
                if (0..3).all(|k| (0..blocks[k]).contains(&to[k])) {
                    split[block_index(blocks, to)] = true;
                }
            });
        }
    }
    split
}

/// Gives each node the number of its first leaf; a leaf larger than a block has the number of its first block.
/// Returns how many leaves there are; numbers mean nothing if there are more than `u32` can name.
fn number(blocks: [i32; 3], nodes: &mut [Node]) -> u64 {
    let mut total = 0u64;
    for b in 0..nodes.len() {
        let at = block_coordinates(blocks, b);
        let node = nodes[b];
        if node.level == 0 {
            nodes[b].base = total as u32;
            total += u64::from(8 + 7 * node.four.count_ones() + 7 * node.two.count_ones());
        } else {
            let first = at.map(|c| c >> (node.level - BLOCK_LOG) << (node.level - BLOCK_LOG));
            if first == at {
                nodes[b].base = total as u32;
                total += 1;
            } else {
                nodes[b].base = nodes[block_index(blocks, first)].base;
            }
        }
    }
    total
}

/// The leaves that are numbered at a block, in order: none where a larger leaf began at another block.
fn leaves_of(node: &Node, at: [i32; 3], cells: [i32; 3]) -> Vec<Leaf> {
    let mut out = Vec::new();
    let mut push = |o: [i32; 3], log: u8| {
        out.push(Leaf {
            origin: o.map(|c| c as u16),
            log,
            void: (0..3).any(|k| o[k] >= cells[k]),
        });
    };
    let low = at.map(|c| c * BLOCK);
    if node.level != 0 {
        let shift = node.level - BLOCK_LOG;
        if at.iter().all(|c| c >> shift << shift == *c) {
            push(low, node.level);
        }
        return out;
    }
    for g in 0..8 {
        let o = [0, 1, 2].map(|k| low[k] + 4 * corner_of(g)[k]);
        if node.four >> g & 1 == 0 {
            push(o, 2);
            continue;
        }
        for c in 0..8 {
            let o = [0, 1, 2].map(|k| o[k] + 2 * corner_of(c)[k]);
            if node.two >> (8 * g + c) & 1 == 0 {
                push(o, 1);
            } else {
                for i in 0..8 {
                    push([0, 1, 2].map(|k| o[k] + corner_of(i)[k]), 0);
                }
            }
        }
    }
    out
}

/// Does a cell begin inside of the domain and end beyond it?
fn crosses(origin: [i32; 3], size: i32, cells: [i32; 3]) -> bool {
    (0..3).all(|k| origin[k] < cells[k]) && (0..3).any(|k| origin[k] + size > cells[k])
}

pub(super) fn block_count(shape: [i32; 3]) -> usize {
    shape.iter().map(|&s| s as usize).product()
}

/// All cells from `low` to `high`, both included, x fastest.
fn for_box(low: [i32; 3], high: [i32; 3], mut f: impl FnMut([i32; 3])) {
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            for x in low[0]..=high[0] {
                f([x, y, z]);
            }
        }
    }
}

/// For each cell of size 2 of a block: the cells of size 4 that its split asks for, as bits of the
/// 4 × 4 × 4 of them that begin one before the block.
fn two_to_four() -> [u64; 64] {
    std::array::from_fn(|t| {
        let (p, q) = (corner_of(t >> 3), corner_of(t & 7));
        let at = [0, 1, 2].map(|k| 2 * p[k] + q[k]);
        let mut bits = 0;
        for_box(at.map(|c| (c - 1) >> 1), at.map(|c| (c + 1) >> 1), |f| {
            bits |= 1 << ((f[0] + 1) + 4 * (f[1] + 1) + 16 * (f[2] + 1))
        });
        bits
    })
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;
    use proptest::prelude::*;

    /// The tree by definition: split top-down, then repeat "a leaf with a neighbour less than half
    /// its size is split" until nothing changes.
    fn brute(cells: [i32; 3], asked: &[[i32; 3]]) -> Vec<([i32; 3], i32)> {
        let top = (*cells.iter().max().unwrap() as u32)
            .next_power_of_two()
            .max(8) as i32;
        let mut leaves = vec![([0, 0, 0], top)];
        loop {
            let far = |o: [i32; 3], s: i32, p: [i32; 3], t: i32| {
                (0..3).any(|k| o[k] > p[k] + t || p[k] > o[k] + s)
            };
            let mut next = Vec::new();
            for &(o, s) in &leaves {
                let wanted = s > 1
                    && (asked
                        .iter()
                        .any(|a| (0..3).all(|k| (o[k]..o[k] + s).contains(&a[k])))
                        || crosses(o, s, cells)
                        || leaves.iter().any(|&(p, t)| 2 * t < s && !far(o, s, p, t)));
                if wanted {
                    let half = s / 2;
                    next.extend(
                        (0..8).map(|i| ([0, 1, 2].map(|k| o[k] + half * corner_of(i)[k]), half)),
                    );
                } else {
                    next.push((o, s));
                }
            }
            next.retain(|(o, _)| (0..3).all(|k| o[k] < cells[k]));
            if next.len() == leaves.len() {
                next.sort_unstable();
                return next;
            }
            leaves = next;
        }
    }

    /// Compares the tree with [`brute`], and looks up every cell in it.
    fn check_tree(cells: [i32; 3], asked: &[[f64; 3]]) {
        let asked: Vec<[i32; 3]> = asked
            .iter()
            .map(|a| [0, 1, 2].map(|k| (a[k] * f64::from(cells[k])) as i32))
            .collect();
        let blocks = cells.map(|n| (n + BLOCK - 1) / BLOCK);
        let mut splits = Splits::none(blocks, 30);
        for a in &asked {
            let b = block_index(blocks, a.map(|c| c >> BLOCK_LOG));
            let (g, c) = morton(*a);
            splits.two[b] |= 1 << (8 * g + c);
        }
        let tree = Octree::new(cells, &splits, u64::MAX).unwrap();
        let mut ours: Vec<_> = tree
            .leaves
            .iter()
            .filter(|l| !l.void)
            .map(|l| (l.origin(), l.size()))
            .collect();
        ours.sort_unstable();
        assert_eq!(ours, brute(cells, &asked));
        for_box([0; 3], cells.map(|n| n - 1), |p| {
            let (id, log) = tree.find(p);
            let leaf = tree.leaves[id as usize];
            assert_eq!(leaf.log, log);
            assert!(
                (0..3).all(|k| (leaf.origin()[k]..leaf.origin()[k] + leaf.size()).contains(&p[k]))
            );
        });
    }

    pub fn the_tree_is_the_coarsest_balanced_one() {
        proptest!(geom_core::testing::cases(24), |(
            cells in prop::array::uniform3(3..40i32),
            asked in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 1..4),
        )| {
            check_tree(cells, &asked);
        });
    }

    /// Large enough for leaves of 16 cells and more, which are balanced level by level.
    pub fn large_leaves_are_balanced_too() {
        proptest!(geom_core::testing::cases(6), |(
            sizes in prop::array::uniform3(2..5i32),
            asked in prop::collection::vec(prop::array::uniform3(0.0..1.0f64), 1..3),
        )| {
            check_tree(sizes.map(|n| 32 * n), &asked);
        });
    }
}
