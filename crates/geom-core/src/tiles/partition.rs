//! Which tile a cell belongs to.
//!
//! Morton order keeps what is near in space near in number, and a range of 2ᵏ numbers that begins at a multiple of 2ᵏ
//! is a box: tiles are such boxes, found by halving. What makes a tile heavy is told by the caller, per root cell:
//! atoms, or points near a surface.

use std::collections::BinaryHeap;

use crate::{Point3, Vector3};

/// A box of root cells whose Morton numbers follow each other: so many low bits per axis are free.
///
/// At the lowest point all free bits are 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Range {
    low: [u32; 3],
    logs: [u8; 3],
}

impl Range {
    /// The first root beyond it, per axis.
    fn high(&self) -> [u32; 3] {
        [0, 1, 2].map(|k| self.low[k] + (1 << self.logs[k]))
    }

    /// Its two halves across the highest bit that is free.
    ///
    /// Of equal lengths the last axis, which has the highest bit of the Morton number.
    fn halves(&self) -> [Self; 2] {
        let axis = (0..3).max_by_key(|&k| self.logs[k]).unwrap_or(0);
        let mut half = *self;
        half.logs[axis] -= 1;
        let mut upper = half;
        upper.low[axis] += 1 << half.logs[axis];
        [half, upper]
    }
}

/// The bits of three numbers in turn, x lowest (Morton 1966).
///
/// 21 bits of each: as many roots per axis as 64 bits can tell.
fn morton(p: [u32; 3]) -> u64 {
    (0..21).fold(0, |code, bit| {
        (0..3).fold(code, |code, k| {
            code | u64::from(p[k] >> bit & 1) << (3 * bit + k)
        })
    })
}

/// A lattice of cells cut into tiles: each a box of root cells, cubes of cells, whose Morton numbers follow each other
/// but for those beyond the lattice.
///
/// Each cell is in one tile and no other. Tiles are numbered in the order of their Morton numbers, hence those that
/// follow each other are mostly neighbours, and a rank that has several ([`Deal`](super::exchange::Deal)) has a compact
/// part.
#[derive(Clone, Debug, PartialEq)]
pub struct Tiles {
    /// Cells per axis.
    cells: [usize; 3],
    /// Cells per side of a root cell.
    root: usize,
    /// How far root cells begin below the lattice, in cells, on every axis.
    shift: usize,
    /// In the order of their Morton numbers; none of a lattice without cells.
    ranges: Vec<Range>,
    /// The lowest Morton number of each.
    codes: Vec<u64>,
    /// Tiles that were asked for: those beyond the ranges have no cells.
    count: usize,
}

impl Tiles {
    /// At most `count` tiles of a lattice with so many cells per axis, the heaviest halved until there are as many,
    /// and the rest without cells. `root` is the number of cells per side of a root cell, `shift` how far the roots begin
    /// below the lattice, less than `root`. `weight` is that of a root cell.
    ///
    /// ```
    /// use geom_core::tiles::Tiles;
    /// let tiles = Tiles::new([100, 60, 60], 32, 0, 3, |root| u64::from(root[0] == 0));
    /// assert_eq!(tiles.len(), 3);
    /// let [low, high] = tiles.cells_of(tiles.of_cell([99, 59, 59]));
    /// assert!(low[0] >= 64 && high == [100, 60, 60]);
    /// ```
    ///
    /// More tiles than root cells leave the rest empty. The cut is a greedy one: where root cells weigh the same, tiles
    /// differ by a factor of about two. Ties are broken by place, so that all ranks find the same tiles. `weight` is
    /// asked for a root cell at most once per halving of what it is in.
    ///
    /// Panics if `root` is 0.
    pub fn new(
        cells: [usize; 3],
        root: usize,
        shift: usize,
        count: usize,
        weight: impl Fn([u32; 3]) -> u64,
    ) -> Self {
        let roots = cells.map(|n| (n + shift).div_ceil(root) as u32);
        let log = |n: u32| n.next_power_of_two().trailing_zeros() as u8;
        // A cube, so that its bits come in turn.
        let logs = [roots.map(log).into_iter().max().unwrap_or(0); 3];
        let holds = |range: &Range| (0..3).all(|k| range.low[k] < roots[k]);
        let heavy = |range: &Range| -> u64 {
            let high = range.high();
            let [to_x, to_y, to_z] = [0, 1, 2].map(|k| high[k].min(roots[k]));
            (range.low[2]..to_z)
                .flat_map(|z| (range.low[1]..to_y).map(move |y| [y, z]))
                .map(|[y, z]| (range.low[0]..to_x).map(|x| weight([x, y, z])).sum::<u64>())
                .sum()
        };
        let mut done = Vec::new();
        let mut open = BinaryHeap::new();
        let all = Range { low: [0; 3], logs };
        if roots.iter().all(|&n| n > 0) {
            open.push((heavy(&all), all));
        }
        while done.len() + open.len() < count
            && let Some((weight, range)) = open.pop()
        {
            if range.logs == [0; 3] {
                done.push(range);
                continue;
            }
            let halves = range.halves();
            let mut inside = halves.iter().filter(|half| holds(half));
            match (inside.next(), inside.next()) {
                (Some(low), Some(high)) => {
                    open.push((heavy(low), *low));
                    open.push((heavy(high), *high));
                }
                (Some(only), None) => open.push((weight, *only)),
                _ => {}
            }
        }
        let mut ranges: Vec<Range> = done
            .into_iter()
            .chain(open.into_iter().map(|o| o.1))
            .collect();
        ranges.sort_by_key(|range| morton(range.low));
        Self {
            cells,
            root,
            shift,
            codes: ranges.iter().map(|range| morton(range.low)).collect(),
            ranges,
            count,
        }
    }

    /// Number of tiles, those without cells included.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Is there no tile?
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The cells of a tile, `low..high` per axis; `low == high` if it has none.
    ///
    /// Boxes at the ends of the lattice are cut off there, and the first ones by `shift`.
    pub fn cells_of(&self, tile: usize) -> [[usize; 3]; 2] {
        let Some(range) = self.ranges.get(tile) else {
            return [[0; 3]; 2];
        };
        let end = |p: [u32; 3]| {
            [0, 1, 2].map(|k| {
                (p[k] as usize * self.root)
                    .saturating_sub(self.shift)
                    .min(self.cells[k])
            })
        };
        [end(range.low), end(range.high())]
    }

    /// The tile of a cell. What lies beyond the lattice belongs to the tile of the nearest cell.
    ///
    /// O(log tiles).
    pub fn of_cell(&self, cell: [usize; 3]) -> usize {
        let nearest = [0, 1, 2].map(|k| cell[k].min(self.cells[k].saturating_sub(1)));
        let code = morton(nearest.map(|c| ((c + self.shift) / self.root) as u32));
        self.codes
            .partition_point(|&first| first <= code)
            .saturating_sub(1)
    }

    /// The tile of a point, given in cells from the origin of the lattice.
    ///
    /// Truncated to the cell that it is in; below the lattice it is the first cell of the axis.
    pub fn of_point(&self, x: &Vector3) -> usize {
        self.of_cell([0, 1, 2].map(|k| x[k].max(0.0) as usize))
    }

    /// The tile of a tetrahedron: that of its barycentre.
    ///
    /// `origin` and `spacing` are those of the lattice. A tetrahedron that crosses borders is thus in one tile, the
    /// same for all who ask.
    pub fn of_tet(&self, corners: [Point3; 4], origin: &Point3, spacing: f64) -> usize {
        let sum = corners
            .iter()
            .fold(Vector3::zeros(), |s, x| s + (x - origin));
        self.of_point(&(sum / (4.0 * spacing)))
    }
}
