//! The density at the points of a small cube in f32, separably (Eq. 3.4 with a reference atom).
//!
//! A node's sum is written as `S_v = exp(−w q_b) R_v` with a leaf `b` below the node, the one that matters
//! most at the middle of the cube, so that nothing underflows before the powers. For a residue
//! `R = 1 + Σ_{a≠b} exp(q_b − q_a)`, and further up `R_v = Σ_c exp(w q_b − P_c w_c q_c) R_c^P_c`. Each exponent is
//! a quadratic without mixed terms, so its exponential is a product of three tables, one per axis.
//!
//! Products and sums are not fused, so the values do not depend on the instruction set.
//!
//! But for brute force a cull comes before, so that the members are few; what is left is three tables per atom and one
//! multiplication and addition per atom and point. Where the range of f32 would not do, which is known from bounds
//! before anything is summed, the caller takes the plain function.

use geom_core::compute::lanes::autovectorized;
use geom_core::{Point3, Vector3};

use crate::kernel::cull::{ActiveSet, Best, largest};
use crate::kernel::math::{exp2, log2};

/// Points of a cube, `SIDE` per axis, x fastest, then y; `PLANE = SIDE²`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cube {
    /// The middle of its points, not a point of the lattice if there is an even number of them.
    pub(crate) center: Point3,
    /// Å.
    pub(crate) spacing: f64,
    /// With tables where they fit, or one exponential per pair everywhere (the yardstick).
    pub(crate) separable: bool,
}

/// Reusable arrays.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    offset: Vec<Vector3>,
    q: Vec<f64>,
    /// Per level (atoms first): the leaf that matters most at the centre.
    best: Vec<Vec<Best>>,
    /// `R` of the open node per level.
    sums: Vec<Vec<f32>>,
    /// The open node per level, and the largest bound of its terms so far.
    open: Vec<(usize, f64)>,
}

/// Beyond this (in powers of 2) a table or a sum may leave the range of f32.
const RANGE: f64 = 115.0;
/// A term is never below 2^−126, so with a sum of at most this (in powers of 2) beside it the density is
/// resolved down to 2^−66, 1e-20.
const RAISED: f64 = 60.0;

/// Fills `out` with the densities at the points of the cube, with the instruction set at hand. `false` when
/// the numbers would leave the range of f32: then the plain function must do.
pub(crate) fn density<const SIDE: usize, const PLANE: usize>(
    active: &ActiveSet,
    cube: &Cube,
    scratch: &mut Scratch,
    out: &mut [f32],
) -> bool {
    autovectorized(
        #[inline(always)]
        || sum_tree::<SIDE, PLANE>(active, cube, scratch, out).is_some(),
    )
}

#[inline(always)]
fn sum_tree<const SIDE: usize, const PLANE: usize>(
    active: &ActiveSet,
    cube: &Cube,
    scratch: &mut Scratch,
    out: &mut [f32],
) -> Option<()> {
    assert!(PLANE == SIDE * SIDE && out.len() == PLANE * SIDE);
    prepare(active, cube, scratch);
    let depth = active.levels.len();
    scratch.sums.resize_with(depth, Vec::new);
    for sum in &mut scratch.sums {
        // Zeros also after an evaluation that was given up.
        sum.clear();
        sum.resize(PLANE * SIDE, 0.0);
    }
    let eval = Eval::<SIDE, PLANE> {
        active,
        cube,
        half: (SIDE as f64 - 1.0) * 0.5 * cube.spacing,
        offset: &scratch.offset,
        q: &scratch.q,
        best: &scratch.best,
    };
    out.fill(0.0);
    if depth == 0 {
        eval.atoms(0..active.len(), None, out).map(|_| ())
    } else {
        eval.tree(&mut scratch.sums, &mut scratch.open, out)
    }
}

/// Power distances at the centre, and up the tree the leaf that matters most below each node: the reference that its
/// sum is relative to.
#[inline(always)]
fn prepare(active: &ActiveSet, cube: &Cube, scratch: &mut Scratch) {
    let n = active.len();
    scratch.offset.clear();
    scratch.q.clear();
    scratch.best.resize_with(active.levels.len() + 1, Vec::new);
    scratch.best[0].clear();
    for i in 0..n {
        let t = cube.center - active.center[i];
        let r = active.radius[i];
        let q = active.decay[i] * (t.norm_squared() - r * r);
        scratch.offset.push(t);
        scratch.q.push(q);
        scratch.best[0].push(Best {
            ln: -q,
            leaf: i as u32,
            weight: 1.0,
        });
    }
    for (l, level) in active.levels.iter().enumerate() {
        let (below, above) = scratch.best.split_at_mut(l + 1);
        above[0].clear();
        for v in 0..level.len() {
            let power = level.power[v];
            let top = largest(&below[l][level.children(v)]);
            above[0].push(Best {
                ln: power * top.ln,
                leaf: top.leaf,
                weight: power * top.weight,
            });
        }
    }
}

/// What the summation of one cube reads. `half` is the distance of its outermost points from the centre along an axis,
/// Å.
struct Eval<'a, const SIDE: usize, const PLANE: usize> {
    active: &'a ActiveSet,
    cube: &'a Cube,
    half: f64,
    offset: &'a [Vector3],
    q: &'a [f64],
    best: &'a [Vec<Best>],
}

/// A quadratic exponent without mixed terms, in powers of 2, about the centre of the cube.
#[derive(Clone, Copy)]
struct Exponent {
    /// At the centre.
    constant: f64,
    /// Per Å, along each axis.
    slope: Vector3,
    /// Per Å², the same along each axis, since an atom's kernel is round.
    curvature: f64,
}

/// The exponential of an exponent: `plane[j]` times `line[k]` at point `j` of plane `k`.
struct Tables<const SIDE: usize, const PLANE: usize> {
    plane: [f32; PLANE],
    line: [f32; SIDE],
}

impl<const SIDE: usize, const PLANE: usize> Eval<'_, SIDE, PLANE> {
    /// `w_b q_b − w_a q_a` in powers of 2; without `b`, `−w_a q_a`.
    #[inline(always)]
    fn exponent(&self, b: Option<(u32, f64)>, a: u32, wa: f64) -> Exponent {
        const LOG2E: f64 = std::f64::consts::LOG2_E;
        let a = a as usize;
        let ka = wa * self.active.decay[a];
        let mut e = Exponent {
            constant: -wa * self.q[a],
            slope: self.offset[a] * (-2.0 * ka),
            curvature: -ka,
        };
        if let Some((b, wb)) = b {
            let b = b as usize;
            let kb = wb * self.active.decay[b];
            e.constant += wb * self.q[b];
            e.slope += self.offset[b] * (2.0 * kb);
            e.curvature += kb;
        }
        Exponent {
            constant: e.constant * LOG2E,
            slope: e.slope * LOG2E,
            curvature: e.curvature * LOG2E,
        }
    }

    /// An upper bound of the exponent in the cube, and whether its tables stay in the range of f32.
    #[inline(always)]
    fn bound(&self, e: &Exponent) -> (f64, bool) {
        let bend = e.curvature * self.half * self.half;
        let swing = [0, 1, 2].map(|k| e.slope[k].abs() * self.half);
        let rise = swing[0] + swing[1] + swing[2] + 3.0 * bend.max(0.0);
        let top = e.constant + rise;
        // The plane's table has no constant, the line's has.
        let plane = swing[0] + swing[1] + 2.0 * bend.abs();
        let line = e.constant.abs() + swing[2] + bend.abs();
        let fits = plane <= RANGE && line <= RANGE;
        (top, fits && self.cube.separable)
    }

    /// Three runs of `SIDE` exponentials, two of which are multiplied out to a plane, so that a point costs one
    /// product.
    #[inline(always)]
    fn tables(&self, e: &Exponent) -> Tables<SIDE, PLANE> {
        let h = self.cube.spacing as f32;
        let first = -0.5 * (SIDE as f32 - 1.0);
        let (sx, sy, sz) = (e.slope.x as f32, e.slope.y as f32, e.slope.z as f32);
        let (c, constant) = (e.curvature as f32, e.constant as f32);
        let (mut x, mut y, mut line) = ([0.0f32; SIDE], [0.0f32; SIDE], [0.0f32; SIDE]);
        for i in 0..SIDE {
            let u = (first + i as f32) * h;
            x[i] = u * (sx + c * u);
            y[i] = u * (sy + c * u);
            line[i] = constant + u * (sz + c * u);
        }
        for table in [&mut x, &mut y, &mut line] {
            for value in table {
                *value = exp2(*value);
            }
        }
        let mut plane = [0.0f32; PLANE];
        for (row, y) in plane.chunks_exact_mut(SIDE).zip(y) {
            for (value, x) in row.iter_mut().zip(x) {
                *value = x * y;
            }
        }
        Tables { plane, line }
    }

    /// Adds the exponential of an exponent, times `own` if there is one.
    #[inline(always)]
    fn add(&self, e: &Exponent, separable: bool, own: Option<&[f32]>, out: &mut [f32]) {
        if separable {
            let t = self.tables(e);
            match own {
                None => add_tables(out, &t),
                Some(own) => add_product(out, &t, own),
            }
            return;
        }
        // Steep over a wide cube: point by point.
        let h = self.cube.spacing as f32;
        let first = -0.5 * (SIDE as f32 - 1.0);
        let (sx, sy, sz) = (e.slope.x as f32, e.slope.y as f32, e.slope.z as f32);
        let (c, constant) = (e.curvature as f32, e.constant as f32);
        let mut line = [0.0f32; SIDE];
        for (row, out) in out.chunks_exact_mut(SIDE).enumerate() {
            let y = (first + (row % SIDE) as f32) * h;
            let z = (first + (row / SIDE) as f32) * h;
            let yz = constant + (y * (sy + c * y) + z * (sz + c * z));
            for (i, value) in line.iter_mut().enumerate() {
                let x = (first + i as f32) * h;
                *value = exp2(yz + x * (sx + c * x));
            }
            match own {
                None => {
                    for (v, line) in out.iter_mut().zip(line) {
                        *v += line;
                    }
                }
                Some(own) => {
                    let own = &own[row * SIDE..][..SIDE];
                    for ((v, line), own) in out.iter_mut().zip(line).zip(own) {
                        *v += line * own;
                    }
                }
            }
        }
    }

    /// The nodes in hierarchy order: a node's sum is complete after its last child, then its term goes into
    /// the sum of the node above, and so on. `None` if something leaves the range. (Not a recursion, which
    /// could not be inlined into code for the instruction set at hand.)
    #[inline(always)]
    fn tree(
        &self,
        sums: &mut [Vec<f32>],
        open: &mut Vec<(usize, f64)>,
        out: &mut [f32],
    ) -> Option<()> {
        let levels = &self.active.levels;
        let depth = levels.len();
        open.clear();
        open.resize(depth, (0, f64::NEG_INFINITY));
        for lowest in 0..levels[0].len() {
            let (mut level, mut node) = (0, lowest);
            let children = levels[0].children(lowest);
            let leaf = self.best[1][lowest].leaf;
            // A residue of one atom is that atom's kernel to the power, without a sum.
            let mut sum_bound = if children.len() == 1 {
                None
            } else {
                Some(self.atoms(children, Some((leaf, 1.0)), &mut sums[0])?)
            };
            loop {
                let power = levels[level].power[node];
                let Best { leaf, weight, .. } = self.best[level + 1][node];
                // Where the term goes: into the node above, relative to the leaf that this one refers to, or out.
                let above = level + 1;
                let (lower, upper) = sums.split_at_mut(above);
                let own = &mut lower[level];
                let (target, reference) = if above == depth {
                    (&mut *out, None)
                } else {
                    let parent = open[above].0;
                    let Best { leaf, weight, .. } = self.best[above + 1][parent];
                    let own = weight / levels[above].power[parent];
                    (&mut upper[0][..], Some((leaf, own)))
                };
                let is_reference = reference.is_some_and(|r| r.0 == leaf);
                let e = self.exponent(reference, leaf, weight);
                let (mut bound, separable) = match is_reference {
                    true => (0.0, true),
                    false => self.bound(&e),
                };
                // A node that has the reference below it needs no exponential: its factor is 1.
                match sum_bound {
                    None if is_reference => add_one(target),
                    None => self.add(&e, separable, None, target),
                    Some(sum) => {
                        let raised = (power * sum).max(0.0);
                        bound += raised;
                        if bound > RANGE || raised > RAISED {
                            return None;
                        }
                        raise(own, power);
                        if is_reference {
                            add_rows(target, own);
                        } else {
                            self.add(&e, separable, Some(own), target);
                        }
                        own.fill(0.0);
                    }
                }
                if above == depth {
                    break;
                }
                // The node above is complete after its last child; then it is its turn to go up.
                let (parent, top) = &mut open[above];
                *top = top.max(bound);
                let siblings = levels[above].children(*parent);
                if node + 1 < siblings.end {
                    break;
                }
                let bound = *top + (siblings.len() as f64).log2();
                if bound > RANGE {
                    return None;
                }
                (level, node, sum_bound) = (above, *parent, Some(bound));
                *parent += 1;
                *top = f64::NEG_INFINITY;
            }
        }
        Some(())
    }

    /// Adds `exp(q_b − q_a)` for the atoms of a range and the reference `b`, or their kernels without one.
    /// Gives an upper bound of the sum in powers of 2, `None` if something leaves the range.
    #[inline(always)]
    fn atoms(
        &self,
        range: std::ops::Range<usize>,
        reference: Option<(u32, f64)>,
        out: &mut [f32],
    ) -> Option<f64> {
        let mut top = f64::NEG_INFINITY;
        let n = range.len() as f64;
        for a in range {
            if reference.is_some_and(|r| r.0 as usize == a) {
                top = top.max(0.0);
                add_one(out);
                continue;
            }
            let e = self.exponent(reference, a as u32, 1.0);
            let (bound, separable) = self.bound(&e);
            top = top.max(bound);
            self.add(&e, separable, None, out);
        }
        let bound = top + n.log2();
        (bound <= RANGE).then_some(bound)
    }
}

/// The reference itself: `exp(0)` at every point.
#[inline(always)]
fn add_one(out: &mut [f32]) {
    for v in out {
        *v += 1.0;
    }
}

#[inline(always)]
fn add_tables<const SIDE: usize, const PLANE: usize>(out: &mut [f32], t: &Tables<SIDE, PLANE>) {
    for (plane, &z) in out.chunks_exact_mut(PLANE).zip(&t.line) {
        for (v, &xy) in plane.iter_mut().zip(&t.plane) {
            *v += xy * z;
        }
    }
}

#[inline(always)]
fn add_rows(out: &mut [f32], own: &[f32]) {
    for (v, &own) in out.iter_mut().zip(own) {
        *v += own;
    }
}

#[inline(always)]
fn add_product<const SIDE: usize, const PLANE: usize>(
    out: &mut [f32],
    t: &Tables<SIDE, PLANE>,
    own: &[f32],
) {
    let planes = out.chunks_exact_mut(PLANE).zip(own.chunks_exact(PLANE));
    for ((plane, own), &z) in planes.zip(&t.line) {
        for ((v, &own), &xy) in plane.iter_mut().zip(own).zip(&t.plane) {
            *v += xy * z * own;
        }
    }
}

/// Raises positive numbers to a power.
#[inline(always)]
fn raise(values: &mut [f32], power: f64) {
    if power == 1.0 {
        return;
    }
    if power == 0.5 {
        for v in values {
            *v = v.sqrt();
        }
    } else if power == 0.25 {
        for v in values {
            *v = v.sqrt().sqrt();
        }
    } else {
        let power = power as f32;
        for v in values {
            *v = exp2(power * log2(*v));
        }
    }
}
