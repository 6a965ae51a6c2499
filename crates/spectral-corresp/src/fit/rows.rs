//! The nearest of many rows of numbers.
//!
//! Rows lie in the order of a k-d tree (Friedman, Bentley and Finkel, *An algorithm for finding best matches in
//! logarithmic expected time*, 1977), whose leaves are blocks that are looked at in lanes. A block, and a group of blocks,
//! whose box is farther away than a row that is known is passed by. No row is lost by that, not even by rounding: the
//! distance to a box is made of the same steps as that to a row within, and each of them is monotonic.

#![expect(
    clippy::needless_range_loop,
    reason = "what iterators call is not always inlined, and so compiled for the oldest processor"
)]

use geom_core::compute::lanes::autovectorized;

use crate::backend::{Nearest, Rows};

/// Rows side by side in a block, and blocks in a group.
const LANES: usize = 16;
/// Rows of a group.
const GROUP: usize = LANES * LANES;

type Lane = [f64; LANES];

/// Rows made ready to be looked through.
/// Rows that fill up the last block are infinitely far away and are never found.
pub(crate) struct Flat {
    width: usize,
    /// Blocks of [`LANES`] rows: all their first numbers, all their second ones, …
    blocks: Vec<Lane>,
    /// Which rows they are.
    rows: Vec<[u32; LANES]>,
    /// Boxes of the blocks, a group of them side by side: all their lowest first numbers, all their highest ones, all their
    /// lowest second numbers, …
    boxes: Vec<Lane>,
    /// The same of the groups.
    outer: Vec<Lane>,
}

/// The nearest row so far.
struct Best {
    square: f64,
    row: u32,
}

impl Flat {
    /// `O(n log n)`; a copy of the rows, so that the caller's may go.
    pub(crate) fn of(rows: Rows<'_>) -> Self {
        let width = rows.width.max(1);
        let mut order: Vec<u32> = (0..rows.len() as u32).collect();
        sort(rows, &mut order);
        let count = order.len().div_ceil(LANES);
        // Beyond the last row nothing is near.
        let mut blocks = vec![[f64::INFINITY; LANES]; count * width];
        let mut places = vec![[u32::MAX; LANES]; count];
        for (at, &row) in order.iter().enumerate() {
            let (block, lane) = (at / LANES, at % LANES);
            places[block][lane] = row;
            for (c, &value) in rows.row(row as usize).iter().enumerate() {
                blocks[block * width + c][lane] = value;
            }
        }
        Self {
            width,
            blocks,
            rows: places,
            boxes: boxes(rows, &order, LANES),
            outer: boxes(rows, &order, GROUP),
        }
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

    /// `W` numbers per row; 0 for as many as there are.
    #[inline(always)]
    fn nearest_of<const W: usize>(&self, queries: Rows<'_>, out: &mut [Nearest]) {
        let width = if W == 0 { self.width } else { W };
        let mut bounds = vec![[0.0; LANES]; self.outer.len() / (2 * width)];
        for q in 0..out.len() {
            let query = &queries.values[q * width..(q + 1) * width];
            let mut best = Best {
                square: f64::INFINITY,
                row: u32::MAX,
            };
            let (mut nearest, mut first) = (f64::INFINITY, 0);
            for g in 0..bounds.len() {
                bounds[g] = to_boxes(&self.outer, g, query, width);
                let near = least(&bounds[g]);
                if near < nearest {
                    (nearest, first) = (near, g * LANES + place(&bounds[g], near));
                }
            }
            self.search(first, query, width, &mut best);
            for g in 0..bounds.len() {
                for l in 0..LANES {
                    if bounds[g][l] <= best.square && g * LANES + l != first {
                        self.search(g * LANES + l, query, width, &mut best);
                    }
                }
            }
            out[q] = Nearest {
                // None is nearest to what is not finite.
                index: if best.row == u32::MAX { 0 } else { best.row },
                distance: best.square.sqrt(),
            };
        }
    }

    /// Looks through a group, its nearest block first.
    /// A block at exactly the best distance is still looked at: an earlier row may be in it.
    #[inline(always)]
    fn search(&self, group: usize, query: &[f64], width: usize, best: &mut Best) {
        if group * LANES >= self.rows.len() {
            return;
        }
        let bounds = to_boxes(&self.boxes, group, query, width);
        let first = place(&bounds, least(&bounds));
        for k in 0..LANES {
            let lane = (first + k) % LANES;
            let block = group * LANES + lane;
            if bounds[lane] <= best.square && block < self.rows.len() {
                self.look(block, query, width, best);
            }
        }
    }

    /// Looks at a block.
    #[inline(always)]
    fn look(&self, block: usize, query: &[f64], width: usize, best: &mut Best) {
        let values = &self.blocks[block * width..(block + 1) * width];
        let mut squares = [0.0; LANES];
        for c in 0..width {
            let (values, x) = (&values[c], query[c]);
            for l in 0..LANES {
                let d = values[l] - x;
                squares[l] += d * d;
            }
        }
        if least(&squares) > best.square {
            return;
        }
        let rows = &self.rows[block];
        for l in 0..LANES {
            let nearer = squares[l] < best.square;
            if nearer || (squares[l] == best.square && rows[l] < best.row) {
                (best.square, best.row) = (squares[l], rows[l]);
            }
        }
    }
}

/// The squares of the distances to a group of boxes.
#[inline(always)]
fn to_boxes(boxes: &[Lane], group: usize, query: &[f64], width: usize) -> Lane {
    let ends = &boxes[2 * group * width..2 * (group + 1) * width];
    let mut squares = [0.0; LANES];
    for c in 0..width {
        let (low, high, x) = (&ends[2 * c], &ends[2 * c + 1], query[c]);
        for l in 0..LANES {
            let (below, above) = (low[l] - x, x - high[l]);
            let d = if below > above { below } else { above };
            let d = if d > 0.0 { d } else { 0.0 };
            squares[l] += d * d;
        }
    }
    squares
}

/// The smallest number.
/// By halves, which vectors do side by side.
#[inline(always)]
fn least(numbers: &Lane) -> f64 {
    let mut least = *numbers;
    let mut half = LANES / 2;
    while half > 0 {
        for l in 0..half {
            let other = least[l + half];
            least[l] = if other < least[l] { other } else { least[l] };
        }
        half /= 2;
    }
    least[0]
}

/// The first place of a number.
#[inline(always)]
fn place(numbers: &Lane, number: f64) -> usize {
    let mut place = 0;
    for l in (0..LANES).rev() {
        place = if numbers[l] == number { l } else { place };
    }
    place
}

/// Puts rows into the order of a tree: halves, and halves of those, along the axis that is longest; whole groups, then whole
/// blocks.
fn sort(rows: Rows<'_>, order: &mut [u32]) {
    if order.len() <= LANES {
        return;
    }
    let value = |row: u32, axis: usize| rows.row(row as usize)[axis];
    let extent = |axis: usize| {
        let ends = order
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |e, &row| {
                let x = value(row, axis);
                [e[0].min(x), e[1].max(x)]
            });
        ends[1] - ends[0]
    };
    let extents: Vec<f64> = (0..rows.width).map(extent).collect();
    let longest = (1..rows.width).fold(0, |best, axis| {
        if extents[axis] > extents[best] {
            axis
        } else {
            best
        }
    });
    let unit = if order.len() > GROUP { GROUP } else { LANES };
    let half = (order.len() / 2).next_multiple_of(unit);
    order.select_nth_unstable_by(half, |&a, &b| {
        let by_value = value(a, longest).total_cmp(&value(b, longest));
        by_value.then(a.cmp(&b))
    });
    let (low, high) = order.split_at_mut(half);
    sort(rows, low);
    sort(rows, high);
}

/// Boxes around each `size` of the rows, side by side in lanes; empty ones are nowhere.
fn boxes(rows: Rows<'_>, order: &[u32], size: usize) -> Vec<Lane> {
    let groups = order.len().div_ceil(size * LANES);
    let nowhere = [[f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]];
    let mut out = nowhere.repeat(groups * rows.width);
    for (at, &row) in order.iter().enumerate() {
        let (group, lane) = (at / size / LANES, at / size % LANES);
        for (c, &x) in rows.row(row as usize).iter().enumerate() {
            let place = 2 * (group * rows.width + c);
            out[place][lane] = out[place][lane].min(x);
            out[place + 1][lane] = out[place + 1][lane].max(x);
        }
    }
    out
}
