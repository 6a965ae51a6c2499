//! The density of a block of bricks in f32, straight from the kernels: where the powers are so moderate that
//! no kernel that matters leaves the range of f32 before its power is taken.
//!
//! No tree is culled. [`Reach`](crate::reach::Reach) gives one exponent `t` such that all atoms with
//! `q_a(x) > t` may be left out at `x`, whichever they are; it falls with the number of atoms that are left, so
//! it is taken again for the block, and for each eighth of it. In a brick an atom is also left out where another
//! one below the same node outweighs it at every point. What remains is a comparison per atom
//! and box, and per atom and brick three tables of a separable exponential, and the rows of points that lie
//! within its reach. (The culls of [`members`](crate::members) keep fewer atoms still, but cost more than they
//! save here.)

use std::ops::Range;

use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Aabb, Point3};

use crate::backend::{BLOCK, Block, BlockValues, Job};
use crate::cpu::{bricks_box, middle};
use crate::fast::{exp2, log2};
use crate::lanes::{Work, with_lanes};
use crate::plain::Compiled;
use crate::prepared::Prepared;

const LOG2_E: f64 = std::f64::consts::LOG2_E;
/// Exponents of f32 (of 2) that are safely normal.
const RANGE: f64 = 120.0;
/// Spacing times √κ beyond which offsets within a brick are too coarse in f32.
const WIDE: f64 = 20.0;

/// Can no sum of the model leave the range of f32 upwards, nor an offset its resolution?
fn fits(model: &Prepared<'_>, job: &Job) -> bool {
    let reach = &model.reach;
    reach.highest_sum() * LOG2_E <= RANGE
        && model.tree.levels.len() <= MOST_LEVELS
        && job.lattice.spacing * reach.fastest_decay().sqrt() <= WIDE
}

/// What kernels down to 2 to the minus `exponent` must be raised by to be safely normal; `None` if a sum would
/// leave the range upwards then, or if what the powers make of them would leave it.
///
/// Each of the three factors of a kernel takes a third.
fn lift(model: &Prepared<'_>, exponent: f64) -> Option<f32> {
    let farthest = exponent + model.reach.highest_kernel() * LOG2_E;
    let lift = 6.0 * ((farthest - RANGE).max(0.0) / 2.0).ceil();
    let sums = model.reach.highest_kernel_sum() * LOG2_E + lift;
    let fits = lift == 0.0 || !model.tree.levels.is_empty() && sums <= RANGE;
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

    fn gather(&mut self, tree: &Compiled<'_>, atoms: &[u32]) {
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
        let children = most_children(&model.tree, &self.atom);
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
fn most_children(tree: &Compiled<'_>, atoms: &[u32]) -> Vec<f64> {
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

    fn points(&self) -> u64 {
        let side = |k: usize| u64::from(self.high[k].saturating_sub(self.low[k]));
        side(0) * side(1) * BRICK as u64
    }

    /// The points in each plane that has some.
    #[inline(always)]
    fn planes(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        let [low, high] = [self.low, self.high].map(|of| of.map(|i| i as usize));
        (low[1]..high[1]).map(move |z| {
            let plane = z * BRICK * BRICK;
            (
                z,
                plane + low[0] * BRICK..plane + high[0].max(low[0]) * BRICK,
            )
        })
    }
}

/// Reusable arrays of one thread.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    of_block: Atoms,
    of_eighths: [Atoms; 8],
    /// Exponents of atoms in a box, and the places of the atoms that are kept.
    exponents: Vec<f32>,
    kept: Vec<u32>,
    brick: BrickScratch,
    /// Values of the stored bricks.
    values: Vec<f32>,
}

/// An atom of a brick, about its middle, for comparison with others.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    place: u32,
    /// Node of the level at hand.
    node: u32,
    /// These times the powers below the level.
    decay: f32,
    exponent: f32,
    slope: [f32; 3],
}

#[derive(Debug, Default)]
struct BrickScratch {
    /// Offsets of the atoms of the eighth from the middle of the brick.
    offset: [Vec<f32>; 3],
    /// Largest exponents of these atoms at the points of the brick, and in its box.
    at_points: Vec<f32>,
    in_box: Vec<f32>,
    /// The atoms that matter at points of the brick, and in its box.
    own: Vec<u32>,
    near: Vec<u32>,
    candidates: Vec<Candidate>,
    /// Per own atom: its kernel along x, y and z, and the lines that it reaches.
    tables: Vec<[[f32; BRICK]; 3]>,
    lines: Vec<Lines>,
    /// Per level, lowest first: the sum of the open node, 0 outside of the lines.
    sums: Vec<(Vec<f32>, Lines)>,
}

/// Samples a block, with the instruction set at hand. `None` if a kernel that matters may leave the range
/// of f32.
pub(crate) fn sample_block(
    model: &Prepared<'_>,
    job: &Job,
    eps: f64,
    block: &Block,
    scratch: &mut Scratch,
) -> Option<BlockValues> {
    with_lanes::<Sample, _>((model, job, eps, block, scratch))
}

struct Sample;
impl Work<(&Prepared<'_>, &Job, f64, &Block, &mut Scratch)> for Sample {
    type Output = Option<BlockValues>;
    #[inline(always)]
    fn run(
        (model, job, eps, block, scratch): (&Prepared<'_>, &Job, f64, &Block, &mut Scratch),
    ) -> Option<BlockValues> {
        if !fits(model, job) {
            return None;
        }
        let mut out = BlockValues {
            kinds: vec![Brick::Exterior; block.len()],
            ..BlockValues::default()
        };
        // What was left out before has lost at most ε.
        let floor = job.floor * (1.0 - eps);
        let Scratch {
            of_block,
            of_eighths,
            exponents,
            kept,
            brick: work,
            values,
        } = scratch;
        values.clear();
        of_block.gather(&model.tree, &block.atoms);
        of_block.limit(model, eps / 8.0, 0.0, floor);
        const HALF: usize = BLOCK / 2;
        for (eighth, atoms) in of_eighths.iter_mut().enumerate() {
            let first = [eighth & 1, eighth >> 1 & 1, eighth >> 2].map(|b| b * HALF);
            let last = [0, 1, 2].map(|k| (first[k] + HALF).min(block.bricks[k]));
            let low = [0, 1, 2].map(|k| block.brick[k] + first[k]);
            let high = [0, 1, 2].map(|k| block.brick[k] + last[k]);
            if (0..3).all(|k| first[k] < last[k]) {
                of_block.within(&bricks_box(job, low, high), exponents, kept);
                atoms.select(of_block, kept);
                atoms.limit(model, 3.0 / 8.0 * eps, eps / 4.0, floor);
                atoms.lift = lift(model, f64::from(atoms.exponent))?;
            }
        }
        let spacing = job.lattice.spacing as f32;
        for i in 0..block.len() {
            if !block.wants(i) {
                continue;
            }
            let brick = block.brick_at(i);
            let at = [0, 1, 2].map(|k| (brick[k] - block.brick[k]) / HALF);
            let atoms = &of_eighths[(at[2] * 2 + at[1]) * 2 + at[0]];
            let middle = middle(&job.lattice, brick.map(|b| b * BRICK), BRICK);
            let up = atoms.look(&model.tree, &middle, spacing, work);
            if f64::from(up) * (1.0 + 1e-4) < floor {
                continue;
            }
            let start = values.len();
            values.resize(start + BRICK_POINTS, 0.0);
            let own = &mut values[start..];
            out.pairs += atoms.fill(&model.tree, spacing, work, own);
            // Not `all`, which would stop early and so not use the lanes.
            let least = own.iter().fold(f32::INFINITY, |least, &v| least.min(v));
            out.kinds[i] = if f64::from(least) >= job.ceiling {
                values.truncate(start);
                Brick::Interior
            } else {
                Brick::Stored((start / BRICK_POINTS) as u32)
            };
        }
        out.values = values.as_slice().to_vec();
        Some(out)
    }
}

impl Atoms {
    /// The places of the atoms that matter in a box, into `kept`.
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
        places(exponents, -self.exponent, kept);
    }

    /// Finds the atoms that matter in a brick; gives an upper bound of the density in its box, which has
    /// one more cell on the low sides and ends at the next brick on the high sides: an edge of the lattice
    /// that changes sign between two bricks lies in the boxes of both, so neither can be exterior.
    #[inline(always)]
    fn look(
        &self,
        tree: &Compiled<'_>,
        middle: &Point3,
        spacing: f32,
        work: &mut BrickScratch,
    ) -> f32 {
        let n = self.atom.len();
        for (k, offset) in work.offset.iter_mut().enumerate() {
            offset.clear();
            offset.extend(self.center[k].iter().map(|x| (x - middle[k]) as f32));
        }
        work.at_points.resize(n, 0.0);
        work.in_box.resize(n, 0.0);
        let [x, y, z] = [0, 1, 2].map(|k| &work.offset[k][..n]);
        let (decay, top) = (&self.decay[..n], &self.top[..n]);
        for (out, half) in [
            (&mut work.at_points[..n], 3.5 * spacing),
            (&mut work.in_box[..n], 4.5 * spacing),
        ] {
            for i in 0..n {
                let [x, y, z] = [x[i], y[i], z[i]].map(|t| (t.abs() - half).max(0.0));
                out[i] = top[i] - decay[i] * (x * x + y * y + z * z);
            }
        }
        places(&work.at_points[..n], -self.exponent, &mut work.own);
        places(&work.in_box[..n], -self.exponent, &mut work.near);
        // Kernels in the box, in place: `near` ascends.
        let near = &work.near;
        for (to, &from) in near.iter().enumerate() {
            work.in_box[to] = work.in_box[from as usize];
        }
        let kernels = &mut work.in_box[..near.len()];
        for e in &mut *kernels {
            *e = exp2(*e + self.lift);
        }
        if tree.levels.is_empty() {
            return kernels.iter().sum();
        }
        let depth = tree.levels.len();
        work.sums.resize_with(depth, || (Vec::new(), Lines::NONE));
        // One number per level suffices here.
        let mut sums = [0.0f32; MOST_LEVELS + 1];
        for (at, &i) in near.iter().enumerate() {
            sums[0] += kernels[at];
            let i = i as usize;
            let next = near.get(at + 1).map(|&n| n as usize);
            if next.is_some_and(|n| self.node[n] == self.node[i]) {
                continue;
            }
            let ends = match next {
                Some(_) if depth == 1 => 1,
                next => tree.levels_that_end(self.atom[i], next.map(|n| self.atom[n])),
            };
            let mut node = self.node[i] as usize;
            for l in 0..ends {
                let mut sum = [sums[l]];
                let lift = if l == 0 { self.lift } else { 0.0 };
                raise(&mut sum, tree.levels[l].power[node] as f32, lift);
                sums[l] = 0.0;
                sums[l + 1] += sum[0];
                if l + 1 < ends {
                    node = tree.parent[l + 1][node] as usize;
                }
            }
        }
        sums[depth]
    }

    /// Adds the densities at the points of the brick that was looked at; gives the number of pairs.
    #[inline(always)]
    fn fill(
        &self,
        tree: &Compiled<'_>,
        spacing: f32,
        work: &mut BrickScratch,
        out: &mut [f32],
    ) -> u64 {
        self.leave_outweighed(tree, spacing, work);
        self.tabulate(tree, spacing, work);
        let BrickScratch {
            own,
            tables,
            lines,
            sums,
            ..
        } = work;
        let pairs = lines.iter().map(Lines::points).sum();
        let depth = tree.levels.len();
        if depth == 0 {
            for (table, lines) in tables.iter().zip(lines) {
                add_product(table, lines, out);
            }
            return pairs;
        }
        for (sum, lines) in sums.iter_mut() {
            sum.resize(BRICK_POINTS, 0.0);
            *lines = Lines::NONE;
        }
        let mut start = 0;
        while start < own.len() {
            let mut node = self.node[own[start] as usize];
            let end = self.end_of_node(own, start);
            if end == start + 1 {
                // One atom: its kernel to the power, without a sum.
                match sums.get_mut(1) {
                    Some((sum, all)) => {
                        add_product(&tables[start], &lines[start], sum);
                        all.include(&lines[start]);
                    }
                    None => add_product(&tables[start], &lines[start], out),
                }
            } else {
                let (sum, all) = &mut sums[0];
                for (table, lines) in tables[start..end].iter().zip(&lines[start..end]) {
                    add_product(table, lines, sum);
                    all.include(lines);
                }
                let power = tree.levels[0].power[node as usize] as f32;
                close(sums, 0, (power, self.lift), out);
            }
            if depth > 1 {
                let [last, next] =
                    [end - 1, end].map(|i| own.get(i).map(|&i| self.atom[i as usize]));
                let ends = tree.levels_that_end(last.expect("the last of a node"), next);
                for l in 1..ends {
                    node = tree.parent[l][node as usize];
                    let power = tree.levels[l].power[node as usize] as f32;
                    close(sums, l, (power, 0.0), out);
                }
            }
            start = end;
        }
        pairs
    }

    /// Leaves those of the brick's own atoms out that another one outweighs at every point of it: the one that
    /// matters most at its middle, below the same node of some level. With `w` the product of the powers below
    /// the level, `w_a q_a − w_b q_b` is a quadratic, and linear for equal `w κ`, so its range is known.
    #[inline(always)]
    fn leave_outweighed(&self, tree: &Compiled<'_>, spacing: f32, work: &mut BrickScratch) {
        let BrickScratch {
            offset,
            own,
            candidates,
            ..
        } = work;
        if self.outweighed.is_empty() {
            return;
        }
        let half = 3.5 * spacing;
        let [x, y, z] = &*offset;
        candidates.clear();
        candidates.extend(own.iter().map(|&i| {
            let at = i as usize;
            let offset = [x[at], y[at], z[at]];
            let squared = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
            Candidate {
                place: i,
                node: self.node[at],
                decay: self.decay[at],
                exponent: self.top[at] - self.decay[at] * squared,
                slope: offset.map(|o| 2.0 * self.decay[at] * o),
            }
        }));
        for (l, &least) in self.outweighed.iter().enumerate() {
            let (mut start, mut kept) = (0, 0);
            while start < candidates.len() {
                let node = candidates[start].node;
                let of_node = candidates[start..].iter().take_while(|c| c.node == node);
                let end = start + of_node.clone().count();
                let mut best = candidates[start];
                for c in of_node {
                    if c.exponent > best.exponent {
                        best = *c;
                    }
                }
                for i in start..end {
                    let c = candidates[i];
                    let swing: f32 = (0..3).map(|k| (c.slope[k] - best.slope[k]).abs()).sum();
                    let bend = 3.0 * half * half * (best.decay - c.decay).max(0.0);
                    let most = c.exponent - best.exponent + swing * half + bend;
                    candidates[kept] = c;
                    kept += usize::from(most >= -least);
                }
                start = end;
            }
            candidates.truncate(kept);
            if l + 1 < self.outweighed.len() {
                for c in &mut *candidates {
                    let power = tree.levels[l].power[c.node as usize] as f32;
                    c.node = tree.parent[l + 1][c.node as usize];
                    c.decay *= power;
                    c.exponent *= power;
                    c.slope = c.slope.map(|s| s * power);
                }
            }
        }
        own.clear();
        own.extend(candidates.iter().map(|c| c.place));
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

    /// The kernels of the brick's own atoms along the axes, and the lines that they reach. The kernel of an
    /// atom that is alone in its node is raised to the node's power.
    #[inline(always)]
    fn tabulate(&self, tree: &Compiled<'_>, spacing: f32, work: &mut BrickScratch) {
        let BrickScratch {
            offset,
            own,
            tables,
            lines,
            ..
        } = work;
        tables.clear();
        lines.clear();
        let steps: [f32; BRICK] = std::array::from_fn(|i| (i as f32 - 3.5) * spacing);
        let per_spacing = 1.0 / spacing;
        let mut start = 0;
        while start < own.len() {
            let (mut power, mut end) = (1.0, own.len());
            if let Some(level) = tree.levels.first() {
                end = self.end_of_node(own, start);
                if end == start + 1 {
                    power = level.power[self.node[own[start] as usize] as usize] as f32;
                }
            }
            for &i in &own[start..end] {
                let i = i as usize;
                let (decay, reach) = (power * self.decay[i], self.reach[i]);
                let lift = if end > start + 1 { self.lift } else { 0.0 };
                let constants = [lift / 3.0, lift / 3.0, power * self.top[i] + lift / 3.0];
                let mut exponents = [[0.0f32; BRICK]; 3];
                let mut own = Lines::NONE;
                for k in 0..3 {
                    let offset = offset[k][i];
                    let constant = constants[k];
                    for (e, step) in exponents[k].iter_mut().zip(&steps) {
                        let t = step - offset;
                        *e = constant - decay * (t * t);
                    }
                    if k > 0 {
                        own.low[k - 1] = ceil_to_brick((offset - reach) * per_spacing + 3.5);
                        own.high[k - 1] = ceil_to_brick((offset + reach) * per_spacing + 3.5);
                    }
                }
                own.low[0] -= own.low[0] % ABREAST as u32;
                own.high[0] = own.high[0].next_multiple_of(ABREAST as u32);
                tables.push(exponents);
                lines.push(own);
            }
            start = end;
        }
        for e in tables.as_flattened_mut().as_flattened_mut() {
            *e = exp2_or_zero(*e);
        }
    }
}

/// The smallest whole number that is not below, in 0..=8.
#[inline(always)]
fn ceil_to_brick(x: f32) -> u32 {
    // Adding 2²³ rounds to the nearest whole number, which then stands in the lowest bits.
    let up = x.clamp(0.0, BRICK as f32).ceil() + 8_388_608.0;
    up.to_bits() & 15
}

/// The places of the values that are not below `least`.
#[inline(always)]
fn places(values: &[f32], least: f32, out: &mut Vec<u32>) {
    out.clear();
    out.resize(values.len(), 0);
    let mut count = 0;
    for (i, &value) in values.iter().enumerate() {
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
    for (_, range) in done.planes() {
        let sum = &mut sum[range.clone()];
        raise(sum, power, lift);
        for (to, from) in target[range].iter_mut().zip(sum) {
            *to += *from;
            *from = 0.0;
        }
    }
}

/// Adds a kernel at the points of its lines.
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
            let line = k * BRICK + first;
            add_times(&mut out[line], &a, z);
            add_times(&mut out[line + 1], &b, z);
            add_times(&mut out[line + 2], &c, z);
            add_times(&mut out[line + 3], &d, z);
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

/// Raises numbers, lifted by so many powers of 2, to a power; what is too small to be normal becomes 0.
#[inline(always)]
fn raise(values: &mut [f32], power: f32, lift: f32) {
    if power == 1.0 && lift == 0.0 {
        return;
    }
    let normal = |v: f32, raised: f32| if v < f32::MIN_POSITIVE { 0.0 } else { raised };
    if power == 0.5 {
        let lower = exp2(-0.5 * lift);
        for v in values {
            *v = normal(*v, v.sqrt() * lower);
        }
        return;
    }
    for v in values {
        *v = normal(*v, exp2_or_zero(power * (log2(*v) - lift)));
    }
}
