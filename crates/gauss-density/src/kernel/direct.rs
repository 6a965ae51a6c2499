//! The density of a block of bricks in f32, straight from the kernels: where the powers are so moderate that
//! no kernel that matters leaves the range of f32 before its power is taken.
//!
//! No tree is culled. [`Reach`](crate::model::reach::Reach) gives one exponent `t` such that all atoms with
//! `q_a(x) > t` may be left out at `x`, whichever they are; it falls with the number of atoms that are left, so
//! it is taken again for the block, and for each eighth of it. In a brick an atom is also left out where another
//! one below the same node outweighs it at every point. What remains is a comparison per atom
//! and box, three tables of a separable exponential per atom and eighth, and the rows of points of each brick
//! that lie within its reach. (The culls of [`cull`](crate::kernel::cull) keep fewer atoms still, but cost more than they
//! save here.)
//!
//! The order of work is that of the functions: gather the atoms of a block, keep those of an eighth, look at its eight
//! bricks at once, leave out who is outweighed, and fill the bricks that may reach the floor. Sums are f32 and products
//! separable: the kernel of an atom at a point is the product of three numbers from its tables.

use std::ops::Range;

use geom_core::compute::lanes::autovectorized;
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Aabb, Point3};

use crate::backend::{BLOCK, Block, BlockValues, Job, place_in};
use crate::kernel::boxes::{bricks_box, middle};
use crate::kernel::math::{exp2, log2};
use crate::kernel::prepared::Prepared;

const LOG2_E: f64 = std::f64::consts::LOG2_E;
/// Exponents of f32 (of 2) that are safely normal.
const RANGE: f64 = 120.0;
/// Spacing times √κ beyond which offsets within an eighth of a block are too coarse in f32.
const WIDE: f64 = 10.0;

/// Can no sum of the model leave the range of f32 upwards, nor an offset its resolution?
/// If not, the block is sampled relative to reference atoms instead ([`relative`](crate::kernel::relative)).
fn fits(model: &Prepared<'_>, job: &Job) -> bool {
    let reach = &model.reach;
    reach.highest_sum() * LOG2_E <= RANGE
        && model.levels.len() <= MOST_LEVELS
        && job.lattice.spacing * reach.fastest_decay().sqrt() <= WIDE
}

/// What kernels down to 2 to the minus `exponent` must be raised by to be safely normal; `None` if a sum would
/// leave the range upwards then, or if what the powers make of them would leave it.
///
/// Each of the three factors of a kernel takes a third.
/// Only a sum with a power above it can be lifted, since that power takes the lift back: a model without levels that
/// would need one is left to the slower way.
fn lift(model: &Prepared<'_>, exponent: f64) -> Option<f32> {
    let farthest = exponent + model.reach.highest_kernel() * LOG2_E;
    let lift = 6.0 * ((farthest - RANGE).max(0.0) / 2.0).ceil();
    let sums = model.reach.highest_kernel_sum() * LOG2_E + lift;
    let fits = lift == 0.0 || !model.levels.is_empty() && sums <= RANGE;
    let deepest = farthest.max(0.0) * model.reach.steepest_below_the_top();
    (fits && deepest <= RANGE).then_some(lift as f32)
}

/// Levels of powers that a bound needs one number for.
const MOST_LEVELS: usize = 16;

/// Atoms in hierarchy order, as a structure of arrays.
#[derive(Debug, Default)]
struct Atoms {
    atom: Vec<u32>,
    center: [Vec<f64>; 3],
    /// `κ` in powers of 2.
    decay: Vec<f32>,
    /// `κ r²` in powers of 2.
    top: Vec<f32>,
    /// Node of the lowest level.
    node: Vec<u32>,
    /// `t`, above which a power distance does not matter, in powers of 2.
    exponent: f32,
    /// How far each atom matters at that, Å.
    reach: Vec<f32>,
    /// What kernels are raised by before they are summed, in powers of 2, so that the least that matter stay
    /// normal numbers; taken back with the first power.
    lift: f32,
    /// Per level, lowest first: an atom may be left out of a sum of this level where its share of it is less
    /// than 2 to the minus this.
    outweighed: Vec<f32>,
}

impl Atoms {
    fn clear(&mut self) {
        self.atom.clear();
        self.center.iter_mut().for_each(Vec::clear);
        self.decay.clear();
        self.top.clear();
        self.node.clear();
    }

    /// Takes atoms of the model (ascending). Centres stay f64 until an eighth's middle is subtracted.
    fn gather(&mut self, tree: &Prepared<'_>, atoms: &[u32]) {
        self.clear();
        let model = tree.model;
        self.atom.extend_from_slice(atoms);
        for &a in atoms {
            let a = a as usize;
            let (center, kappa, r) = (model.centers()[a], model.decays()[a], model.radii()[a]);
            for k in 0..3 {
                self.center[k].push(center[k]);
            }
            self.decay.push((kappa * LOG2_E) as f32);
            self.top.push((kappa * r * r * LOG2_E) as f32);
            self.node.push(tree.parent.first().map_or(0, |p| p[a]));
        }
    }

    /// Takes some of another list, by their places in it.
    fn select(&mut self, from: &Self, kept: &[u32]) {
        self.clear();
        for &i in kept {
            let i = i as usize;
            self.atom.push(from.atom[i]);
            for k in 0..3 {
                self.center[k].push(from.center[k][i]);
            }
            self.decay.push(from.decay[i]);
            self.top.push(from.top[i]);
            self.node.push(from.node[i]);
        }
    }

    /// Takes `t` for these atoms: with `eps` of the density, where it reaches `floor`. With a `relative` share
    /// of the density beside it to lose where atoms outweigh others.
    fn limit(&mut self, model: &Prepared<'_>, eps: f64, relative: f64, floor: f64) {
        let children = most_children(model, &self.atom);
        let t = model.reach.exponent_among(&children, eps, floor);
        self.outweighed.clear();
        let shares = model.reach.outweighed_among(&children, relative);
        self.outweighed
            .extend(shares.map(|t| (t * LOG2_E + 1e-2) as f32));
        // A little more, for the rounding of what is compared with it.
        self.exponent = (t * LOG2_E + 1e-3) as f32;
        let within = |(top, decay): (&f32, &f32)| ((top + self.exponent) / decay).sqrt();
        self.reach.clear();
        self.reach
            .extend(self.top.iter().zip(&self.decay).map(within));
    }
}

/// `ln` of the largest number of children among these atoms (ascending) on each level, lowest first, and of
/// the root's.
/// One pass: a count per level, closed whenever the next atom lies under another node. At least 1 each, so that the
/// logarithms are not negative.
fn most_children(tree: &Prepared<'_>, atoms: &[u32]) -> Vec<f64> {
    let depth = tree.levels.len();
    let (mut run, mut most) = (vec![0u32; depth + 1], vec![1u32; depth + 1]);
    for (i, &a) in atoms.iter().enumerate() {
        run[0] += 1;
        for l in 0..tree.levels_that_end(a, atoms.get(i + 1).copied()) {
            most[l] = most[l].max(run[l]);
            run[l] = 0;
            run[l + 1] += 1;
        }
    }
    most[depth] = most[depth].max(run[depth]);
    most.into_iter().map(|n| f64::from(n).ln()).collect()
}

/// Bricks of an eighth of a block: the lanes of what is asked of all of them at once.
const LANES: usize = 8;
/// A number per brick of an eighth, x fastest.
type Lanes = [f32; LANES];
/// Points per side of an eighth.
const SIDE: usize = 2 * BRICK;

/// Lines that are summed together: half a plane, as many as fit the registers.
const ABREAST: usize = BRICK / 2;

/// The lines of points with `y` in `low[0]..high[0]`, whole multiples of [`ABREAST`], and `z` in
/// `low[1]..high[1]`.
#[derive(Clone, Copy, Debug)]
struct Lines {
    low: [u32; 2],
    high: [u32; 2],
}

impl Lines {
    const NONE: Self = Self {
        low: [BRICK as u32; 2],
        high: [0; 2],
    };

    fn include(&mut self, other: &Self) {
        for k in 0..2 {
            self.low[k] = self.low[k].min(other.low[k]);
            self.high[k] = self.high[k].max(other.high[k]);
        }
    }

    /// Points on them in a brick.
    fn points(&self) -> u64 {
        let side = |k: usize| u64::from(self.high[k].saturating_sub(self.low[k]));
        side(0) * side(1) * BRICK as u64
    }

    /// The points, as runs of equal length: one if the lines are those of whole planes, else one per plane.
    #[inline(always)]
    fn runs(&self) -> impl Iterator<Item = Range<usize>> {
        const PLANE: usize = BRICK * BRICK;
        let [low, high] = [self.low, self.high].map(|of| of.map(|i| i as usize));
        let planes = high[1].saturating_sub(low[1]);
        let (count, first, length) = if low[0] == 0 && high[0] == BRICK {
            (planes.min(1), 0, planes * PLANE)
        } else {
            let length = high[0].saturating_sub(low[0]) * BRICK;
            (planes, low[0] * BRICK, length)
        };
        (0..count).map(move |i| {
            let start = (low[1] + i) * PLANE + first;
            start..start + length
        })
    }
}

/// Kernel of an atom along x, y and z, at the points of an eighth.
type Table = [[f32; SIDE]; 3];

/// Reusable arrays of one thread.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    of_block: Atoms,
    of_eighth: Atoms,
    /// Exponents of atoms in a box, and the places of the atoms that are kept.
    exponents: Vec<f32>,
    kept: Vec<u32>,
    eighth: Eighth,
}

/// An atom about the middle of each brick: exponent, decay and slopes. Exponents to base 2, lengths in Å: with an
/// offset `u` from the middle the exponent is `exponent + slope · u − decay |u|²`.
#[derive(Clone, Copy, Debug)]
struct About {
    exponent: Lanes,
    decay: Lanes,
    slope: [Lanes; 3],
}

impl About {
    const NOTHING: Self = Self {
        exponent: [f32::NEG_INFINITY; LANES],
        decay: [0.0; LANES],
        slope: [[0.0; LANES]; 3],
    };

    /// Becomes another one in the bricks where that one matters more.
    #[inline(always)]
    fn give_way(&mut self, other: &Self) {
        let (own, others) = (self.exponent, other.exponent);
        self.decay = larger(&own, &others, &self.decay, &other.decay);
        for k in 0..3 {
            self.slope[k] = larger(&own, &others, &self.slope[k], &other.slope[k]);
        }
        self.exponent = larger(&own, &others, &own, &others);
    }

    /// An upper bound of the difference of two exponents at the points of each brick.
    /// From the middle: the difference there, what the slopes can add on the way to a corner, and what the curvatures
    /// can, if the other one decays faster. `half` is half the distance of the outermost points, Å.
    #[inline(always)]
    fn most_beside(&self, other: &Self, half: f32) -> Lanes {
        let mut swing = [0.0; LANES];
        for k in 0..3 {
            let (own, others) = (self.slope[k], other.slope[k]);
            for lane in 0..LANES {
                swing[lane] += (own[lane] - others[lane]).abs();
            }
        }
        let (own, others) = (self.exponent, other.exponent);
        let (decay, decays) = (self.decay, other.decay);
        let mut most = [0.0; LANES];
        for lane in 0..LANES {
            let bend = 3.0 * half * half * (decays[lane] - decay[lane]).max(0.0);
            most[lane] = own[lane] - others[lane] + swing[lane] * half + bend;
        }
        most
    }
}

/// `y` where `b` is larger than `a`, else `x`. (Loops of one selection each, since others are not turned into
/// vector instructions.)
#[inline(always)]
fn larger(a: &Lanes, b: &Lanes, x: &Lanes, y: &Lanes) -> Lanes {
    let (a, b, x, y) = (*a, *b, *x, *y);
    let mut chosen = [0.0; LANES];
    for lane in 0..LANES {
        chosen[lane] = if b[lane] > a[lane] { y[lane] } else { x[lane] };
    }
    chosen
}

/// What is known of the atoms of an eighth in its bricks.
/// Arrays over its atoms, in their order, of which those with a lane per brick are filled eight bricks at a time.
#[derive(Debug, Default)]
struct Eighth {
    /// Offsets of the atoms from the middle.
    offset: [Vec<f32>; 3],
    /// Not negative in a brick where the atom is to be summed.
    /// It is the exponent at the point of the brick that is nearest to the atom, less the least that matters.
    margin: Vec<Lanes>,
    /// Exponents in the middle of each brick, and minus infinity where the atom is left out.
    at_middle: Vec<Lanes>,
    /// Node of the level at hand, and the product of the powers below it.
    node: Vec<u32>,
    weight: Vec<f32>,
    /// First and last line that an atom reaches, along y and z.
    lines: Vec<Lines>,
    /// Per atom, once it is needed: the kernel, and the kernel raised to the power of its node.
    tables: [Vec<Table>; 2],
    is_known: [Vec<bool>; 2],
    /// The places of the atoms of a brick.
    own: Vec<u32>,
    /// Per level, lowest first: the sum of the open node of a brick, 0 outside of the lines.
    sums: Vec<(Vec<f32>, Lines)>,
}

/// Samples a block, with the instruction set at hand, into `out`, whose arrays are used again. `false` if a
/// kernel that matters may leave the range of f32.
pub(crate) fn sample_block(
    model: &Prepared<'_>,
    job: &Job,
    block: &Block,
    scratch: &mut Scratch,
    out: &mut BlockValues,
) -> bool {
    autovectorized(
        #[inline(always)]
        || sample(model, job, block, scratch, out).is_some(),
    )
}

/// As [`sample_block`]; `None` where the range would not do, and then what is in `out` means nothing.
#[inline(always)]
fn sample(
    model: &Prepared<'_>,
    job: &Job,
    block: &Block,
    scratch: &mut Scratch,
    out: &mut BlockValues,
) -> Option<()> {
    let eps = job.cutoff.0;
    if !fits(model, job) {
        return None;
    }
    out.clear(block);
    // What was left out before has lost at most ε.
    let floor = job.floor * (1.0 - eps);
    let Scratch {
        of_block,
        of_eighth: atoms,
        exponents,
        kept,
        eighth: work,
    } = scratch;
    of_block.gather(model, &block.atoms);
    of_block.limit(model, eps / 8.0, 0.0, floor);
    const HALF: usize = BLOCK / 2;
    let spacing = job.lattice.spacing as f32;
    // By eighths: small enough for few atoms to matter, large enough for one look at all eight bricks, a lane each.
    for eighth in 0..LANES {
        let first = [eighth & 1, eighth >> 1 & 1, eighth >> 2].map(|b| b * HALF);
        let last = [0, 1, 2].map(|k| (first[k] + HALF).min(block.bricks[k]));
        if (0..3).any(|k| first[k] >= last[k]) {
            continue;
        }
        let low = [0, 1, 2].map(|k| block.brick[k] + first[k]);
        let high = [0, 1, 2].map(|k| block.brick[k] + last[k]);
        of_block.within(&bricks_box(&job.lattice, low, high), exponents, kept);
        atoms.select(of_block, kept);
        atoms.limit(model, 3.0 / 8.0 * eps, eps / 4.0, floor);
        atoms.lift = lift(model, f64::from(atoms.exponent))?;
        let middle = middle(&job.lattice, low.map(|b| b * BRICK), SIDE);
        let up = atoms.look(model, &middle, spacing, work);
        // A brick below the floor is exterior, even where the backend was asked for it.
        let wanted = |lane: usize| {
            let at = [lane & 1, lane >> 1 & 1, lane >> 2];
            let at = [0, 1, 2].map(|k| first[k] + at[k]);
            let within = (0..3).all(|k| at[k] < last[k]);
            let i = place_in(block.bricks, at);
            let reaches = f64::from(up[lane]) * (1.0 + 1e-4) >= floor;
            (within && reaches && block.wants(i)).then_some(i)
        };
        if (0..LANES).all(|lane| wanted(lane).is_none()) {
            continue;
        }
        atoms.leave_outweighed(model, spacing, work);
        for (lane, i) in (0..LANES).filter_map(|lane| Some((lane, wanted(lane)?))) {
            let start = out.values.len();
            out.values.resize(start + BRICK_POINTS, 0.0);
            let own = &mut out.values[start..];
            out.pairs += atoms.fill(model, spacing, lane, work, own);
            // Not `all`, which would stop early and so not use the lanes.
            let least = own.iter().fold(f32::INFINITY, |least, &v| least.min(v));
            out.kinds[i] = if f64::from(least) >= job.ceiling {
                out.values.truncate(start);
                Brick::Interior
            } else {
                Brick::Stored((start / BRICK_POINTS) as u32)
            };
        }
    }
    Some(())
}

/// `x`, `y` and `z` of the middles of the bricks of an eighth, from its own middle.
#[inline(always)]
pub(crate) fn middles(spacing: f32) -> [Lanes; 3] {
    const APART: f32 = BRICK as f32 / 2.0;
    let mut middles = [[-APART * spacing; LANES]; 3];
    for (k, of_axis) in middles.iter_mut().enumerate() {
        for (lane, middle) in of_axis.iter_mut().enumerate() {
            if lane >> k & 1 == 1 {
                *middle = APART * spacing;
            }
        }
    }
    middles
}

impl Atoms {
    /// The places of the atoms that matter in a box, into `kept`.
    /// By the power distance at the point of the box that is nearest to each.
    #[inline(always)]
    fn within(&self, region: &Aabb, exponents: &mut Vec<f32>, kept: &mut Vec<u32>) {
        let n = self.atom.len();
        exponents.resize(n, 0.0);
        let center = region.center();
        let half = region.extent() * 0.5;
        let [x, y, z] = [0, 1, 2].map(|k| &self.center[k][..n]);
        let (decay, top, exponents) = (&self.decay[..n], &self.top[..n], &mut exponents[..n]);
        for i in 0..n {
            let gap = |x: f64, k: usize| ((x - center[k]).abs() - half[k]).max(0.0) as f32;
            let t = [gap(x[i], 0), gap(y[i], 1), gap(z[i], 2)];
            exponents[i] = top[i] - decay[i] * (t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
        }
        places(exponents.iter(), -self.exponent, kept);
    }

    /// Finds the atoms that matter in each brick of an eighth; gives an upper bound of the density in the box
    /// of each, which has one more cell on the low sides and ends at the next brick on the high sides: an edge
    /// of the lattice that changes sign between two bricks lies in the boxes of both, so neither can be
    /// exterior.
    #[inline(always)]
    fn look(&self, tree: &Prepared<'_>, middle: &Point3, spacing: f32, work: &mut Eighth) -> Lanes {
        let n = self.atom.len();
        for (k, offset) in work.offset.iter_mut().enumerate() {
            offset.clear();
            offset.extend(self.center[k].iter().map(|x| (x - middle[k]) as f32));
        }
        self.reach_lines(spacing, work);
        work.margin.resize(n, [0.0; LANES]);
        work.at_middle.resize(n, [0.0; LANES]);
        let depth = tree.levels.len();
        let middles = middles(spacing);
        let mut sums = [[0.0f32; LANES]; MOST_LEVELS + 1];
        for i in 0..n {
            let [mut middle, mut points, mut around] = [[0.0f32; LANES]; 3];
            for k in 0..3 {
                let (x, middles) = (work.offset[k][i], middles[k]);
                for lane in 0..LANES {
                    let t = (x - middles[lane]).abs();
                    let at = (t - 3.5 * spacing).max(0.0);
                    let of = (t - 4.5 * spacing).max(0.0);
                    middle[lane] += t * t;
                    points[lane] += at * at;
                    around[lane] += of * of;
                }
            }
            let (decay, top) = (self.decay[i], self.top[i]);
            let (exponent, lift) = (self.exponent, self.lift);
            let mut bounds = sums[0];
            for lane in 0..LANES {
                points[lane] = top - decay * points[lane] + exponent;
                let own = top - decay * middle[lane];
                let matters = points[lane] >= 0.0;
                middle[lane] = if matters { own } else { f32::NEG_INFINITY };
                bounds[lane] += exp2_or_zero(top - decay * around[lane] + lift);
            }
            (work.margin[i], work.at_middle[i], sums[0]) = (points, middle, bounds);
            let next = i + 1;
            if depth == 0 || next < n && self.node[next] == self.node[i] {
                continue;
            }
            let ends = match depth {
                1 => 1,
                _ => tree.levels_that_end(self.atom[i], self.atom.get(next).copied()),
            };
            let mut node = self.node[i] as usize;
            for l in 0..ends {
                let lift = if l == 0 { self.lift } else { 0.0 };
                let (lower, upper) = sums.split_at_mut(l + 1);
                let power = tree.levels[l].power[node] as f32;
                move_raised(&mut lower[l], &mut upper[0], power, lift);
                if l + 1 < ends {
                    node = tree.parent[l + 1][node] as usize;
                }
            }
        }
        sums[depth]
    }

    /// The lines of an eighth that each atom reaches.
    #[inline(always)]
    fn reach_lines(&self, spacing: f32, work: &mut Eighth) {
        const MIDDLE: f32 = 0.5 * (SIDE as f32 - 1.0);
        let n = self.atom.len();
        let per_spacing = 1.0 / spacing;
        work.lines.resize(n, Lines::NONE);
        let (y, z, reach) = (&work.offset[1][..n], &work.offset[2][..n], &self.reach[..n]);
        for (i, lines) in work.lines.iter_mut().enumerate() {
            for (k, x) in [y[i], z[i]].into_iter().enumerate() {
                lines.low[k] = ceil_to_side((x - reach[i]) * per_spacing + MIDDLE);
                lines.high[k] = ceil_to_side((x + reach[i]) * per_spacing + MIDDLE);
            }
        }
        for tables in &mut work.tables {
            if tables.len() < n {
                tables.resize(n, [[0.0; SIDE]; 3]);
            }
        }
        for known in &mut work.is_known {
            known.clear();
            known.resize(n, false);
        }
    }

    /// Adds the densities at the points of a brick of the eighth that was looked at; gives the number of pairs.
    #[inline(always)]
    fn fill(
        &self,
        tree: &Prepared<'_>,
        spacing: f32,
        lane: usize,
        work: &mut Eighth,
        out: &mut [f32],
    ) -> u64 {
        let mut own = std::mem::take(&mut work.own);
        places(work.margin.iter().map(|m| &m[lane]), 0.0, &mut own);
        let mut sums = std::mem::take(&mut work.sums);
        let depth = tree.levels.len();
        sums.resize_with(depth, || (vec![0.0; BRICK_POINTS], Lines::NONE));
        let mut pairs = 0;
        let mut start = 0;
        while start < own.len() {
            let end = match depth {
                0 => own.len(),
                _ => self.end_of_node(&own, start),
            };
            let mut node = self.node[own[start] as usize];
            let power = tree
                .levels
                .first()
                .map_or(1.0, |level| level.power[node as usize] as f32);
            // One atom: its kernel to the power, without a sum.
            let alone = depth > 0 && end == start + 1;
            let target = usize::from(alone);
            for &i in &own[start..end] {
                let (table, lines) = self.tabulated(i as usize, lane, alone, power, spacing, work);
                pairs += lines.points();
                match sums.get_mut(target) {
                    Some((sum, all)) => {
                        add_product(&table, &lines, sum);
                        all.include(&lines);
                    }
                    None => add_product(&table, &lines, out),
                }
            }
            if depth > 0 && !alone {
                close(&mut sums, 0, (power, self.lift), out);
            }
            if depth > 1 {
                let last = self.atom[own[end - 1] as usize];
                let next = own.get(end).map(|&i| self.atom[i as usize]);
                for l in 1..tree.levels_that_end(last, next) {
                    node = tree.parent[l][node as usize];
                    let power = tree.levels[l].power[node as usize] as f32;
                    close(&mut sums, l, (power, 0.0), out);
                }
            }
            start = end;
        }
        (work.own, work.sums) = (own, sums);
        pairs
    }

    /// Leaves those atoms out of a brick that another one outweighs at every point of it: the one that matters
    /// most at its middle, below the same node of some level. With `w` the product of the powers below
    /// the level, `w_a q_a − w_b q_b` is a quadratic, and linear for equal `w κ`, so its range is known.
    #[inline(always)]
    fn leave_outweighed(&self, tree: &Prepared<'_>, spacing: f32, work: &mut Eighth) {
        if self.outweighed.is_empty() {
            return;
        }
        let n = self.atom.len();
        let half = 3.5 * spacing;
        let middles = middles(spacing);
        let Eighth {
            offset,
            margin,
            at_middle,
            node,
            weight,
            ..
        } = work;
        let [x, y, z] = &*offset;
        node.clear();
        node.extend_from_slice(&self.node);
        weight.clear();
        weight.resize(n, 1.0);
        for (l, &least) in self.outweighed.iter().enumerate() {
            let mut start = 0;
            while start < n {
                let same = node[start..].iter().take_while(|&&v| v == node[start]);
                let end = start + same.count();
                if end == start + 1 {
                    start = end;
                    continue;
                }
                let mut best = About::NOTHING;
                for i in start..end {
                    let own =
                        self.about(i, weight[i], &[x[i], y[i], z[i]], &at_middle[i], &middles);
                    best.give_way(&own);
                }
                for i in start..end {
                    let own =
                        self.about(i, weight[i], &[x[i], y[i], z[i]], &at_middle[i], &middles);
                    let most = own.most_beside(&best, half);
                    // What is not a number, where both are left out, is not larger.
                    let least = [-least; LANES];
                    margin[i] = larger(&least, &most, &[-1.0; LANES], &margin[i]);
                    let left_out = [f32::NEG_INFINITY; LANES];
                    at_middle[i] = larger(&least, &most, &left_out, &at_middle[i]);
                }
                start = end;
            }
            if l + 1 < self.outweighed.len() {
                for (node, weight) in node.iter_mut().zip(&mut *weight) {
                    *weight *= tree.levels[l].power[*node as usize] as f32;
                    *node = tree.parent[l + 1][*node as usize];
                }
            }
        }
    }

    /// Exponent, decay and slopes of an atom, times a weight.
    #[inline(always)]
    fn about(
        &self,
        i: usize,
        weight: f32,
        offset: &[f32; 3],
        at_middle: &Lanes,
        middles: &[Lanes; 3],
    ) -> About {
        let decay = weight * self.decay[i];
        let mut own = About::NOTHING;
        own.decay = [decay; LANES];
        for (own, at) in own.exponent.iter_mut().zip(at_middle) {
            *own = weight * at;
        }
        for k in 0..3 {
            let (offset, middles) = (offset[k], middles[k]);
            let mut slope = [0.0; LANES];
            for lane in 0..LANES {
                slope[lane] = 2.0 * decay * (offset - middles[lane]);
            }
            own.slope[k] = slope;
        }
        own
    }

    /// Where the atoms of a node of the lowest level end, in a list of places.
    #[inline(always)]
    fn end_of_node(&self, own: &[u32], start: usize) -> usize {
        let node = self.node[own[start] as usize];
        let others = own[start + 1..].iter();
        start
            + 1
            + others
                .take_while(|&&i| self.node[i as usize] == node)
                .count()
    }

    /// The kernel of an atom along the axes of a brick, and the lines that it reaches. The kernel of an
    /// atom that is alone in its node is raised to the node's power, the others' are lifted.
    /// Made once per atom and eighth, when the first brick asks; the bricks beside it take other parts of the same
    /// tables.
    #[inline(always)]
    fn tabulated(
        &self,
        i: usize,
        lane: usize,
        alone: bool,
        power: f32,
        spacing: f32,
        work: &mut Eighth,
    ) -> ([[f32; BRICK]; 3], Lines) {
        const MIDDLE: f32 = 0.5 * (SIDE as f32 - 1.0);
        let of = usize::from(alone);
        let table = &mut work.tables[of][i];
        if !std::mem::replace(&mut work.is_known[of][i], true) {
            let (power, lift) = if alone {
                (power, 0.0)
            } else {
                (1.0, self.lift / 3.0)
            };
            let decay = power * self.decay[i];
            let constants = [lift, lift, power * self.top[i] + lift];
            for k in 0..3 {
                let offset = work.offset[k][i];
                for (j, e) in table[k].iter_mut().enumerate() {
                    let t = (j as f32 - MIDDLE) * spacing - offset;
                    *e = exp2_or_zero(constants[k] - decay * (t * t));
                }
            }
        }
        let at = [lane & 1, lane >> 1 & 1, lane >> 2].map(|b| b * BRICK);
        let all = &work.lines[i];
        let within = |line: u32, k: usize| line.saturating_sub(at[k] as u32).min(BRICK as u32);
        let mut lines = Lines {
            low: [within(all.low[0], 1), within(all.low[1], 2)],
            high: [within(all.high[0], 1), within(all.high[1], 2)],
        };
        lines.low[0] -= lines.low[0] % ABREAST as u32;
        lines.high[0] = lines.high[0].next_multiple_of(ABREAST as u32);
        let mut parts = [[0.0; BRICK]; 3];
        for k in 0..3 {
            parts[k].copy_from_slice(&table[k][at[k]..at[k] + BRICK]);
        }
        (parts, lines)
    }
}

/// The smallest whole number that is not below, in 0..=16.
#[inline(always)]
fn ceil_to_side(x: f32) -> u32 {
    // Adding 2²³ rounds to the nearest whole number, which then stands in the lowest bits.
    let up = x.clamp(0.0, SIDE as f32).ceil() + 8_388_608.0;
    up.to_bits() & 31
}

/// The places of the values that are not below `least`.
/// Written without a branch: each place is put down, and kept by counting on.
#[inline(always)]
fn places<'a>(values: impl ExactSizeIterator<Item = &'a f32>, least: f32, out: &mut Vec<u32>) {
    out.clear();
    out.resize(values.len(), 0);
    let mut count = 0;
    for (i, &value) in values.enumerate() {
        out[count] = i as u32;
        count += usize::from(value >= least);
    }
    out.truncate(count);
}

/// Raises the sum of the open node on a level, without its lift, to its power, adds it to the node above, and clears it.
#[inline(always)]
fn close(sums: &mut [(Vec<f32>, Lines)], level: usize, (power, lift): (f32, f32), out: &mut [f32]) {
    let (lower, upper) = sums.split_at_mut(level + 1);
    let (sum, lines) = &mut lower[level];
    let done = std::mem::replace(lines, Lines::NONE);
    let target = match upper.first_mut() {
        Some((target, lines)) => {
            lines.include(&done);
            &mut target[..]
        }
        None => out,
    };
    for run in done.runs() {
        move_raised(&mut sum[run.clone()], &mut target[run], power, lift);
    }
}

/// Adds a kernel at the points of its lines.
/// Only of the halves of planes, and the planes, that the atom reaches.
#[inline(always)]
fn add_product([x, y, z]: &[[f32; BRICK]; 3], lines: &Lines, out: &mut [f32]) {
    // A copy, so that it may stay in a register.
    let x = *x;
    let (out, _) = out.as_chunks_mut::<BRICK>();
    for first in [0, ABREAST] {
        if lines.low[0] as usize > first || lines.high[0] as usize <= first {
            continue;
        }
        // One by one, not in a loop: the four stay in registers from plane to plane.
        let a = times(&x, y[first]);
        let b = times(&x, y[first + 1]);
        let c = times(&x, y[first + 2]);
        let d = times(&x, y[first + 3]);
        for k in lines.low[1] as usize..lines.high[1] as usize {
            let z = z[k];
            let lines = &mut out[k * BRICK + first..][..ABREAST];
            add_times(&mut lines[0], &a, z);
            add_times(&mut lines[1], &b, z);
            add_times(&mut lines[2], &c, z);
            add_times(&mut lines[3], &d, z);
        }
    }
}

#[inline(always)]
fn times(line: &[f32; BRICK], factor: f32) -> [f32; BRICK] {
    let mut product = *line;
    for value in &mut product {
        *value *= factor;
    }
    product
}

#[inline(always)]
fn add_times(sum: &mut [f32; BRICK], line: &[f32; BRICK], factor: f32) {
    let mut new = *sum;
    for i in 0..BRICK {
        new[i] += line[i] * factor;
    }
    *sum = new;
}

#[inline(always)]
fn exp2_or_zero(x: f32) -> f32 {
    let value = exp2(x);
    if x < -126.0 { 0.0 } else { value }
}

/// Raises numbers, lifted by so many powers of 2, to a power, and moves them into a sum; what is too small to be
/// normal counts as 0.
#[inline(always)]
fn move_raised(from: &mut [f32], to: &mut [f32], power: f32, lift: f32) {
    let numbers = to.iter_mut().zip(from);
    if power == 1.0 && lift == 0.0 {
        for (to, from) in numbers {
            *to += std::mem::take(from);
        }
        return;
    }
    let normal = |v: f32, raised: f32| if v < f32::MIN_POSITIVE { 0.0 } else { raised };
    if power == 0.5 {
        let lower = exp2(-0.5 * lift);
        for (to, from) in numbers {
            let v = std::mem::take(from);
            *to += normal(v, v.sqrt() * lower);
        }
        return;
    }
    for (to, from) in numbers {
        let v = std::mem::take(from);
        *to += normal(v, exp2_or_zero(power * (log2(v) - lift)));
    }
}

/// [`About::most_beside`] of two atoms, for tests.
#[cfg(feature = "testing")]
pub(crate) fn most_beside(atoms: [([f32; 3], f32, Lanes); 2], spacing: f32) -> Lanes {
    let middles = middles(spacing);
    let both = Atoms {
        decay: atoms.iter().map(|atom| atom.1).collect(),
        ..Atoms::default()
    };
    let [own, other] = [0, 1].map(|i| {
        let (offset, _, at_middle) = &atoms[i];
        both.about(i, 1.0, offset, at_middle, &middles)
    });
    own.most_beside(&other, 3.5 * spacing)
}
