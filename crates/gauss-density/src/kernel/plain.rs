//! The density at a point in f64, one term after another, with first and second derivatives; and the share of
//! each atom in it. For what is needed at few points: the faster kernels follow it.
//!
//! All sums are kept as logarithms: with `L = ln D`, an atom has `L = −κ (d² − r²)` and a node
//! `L_v = P_v ln Σ_c exp L_c`. Small powers magnify terms that a plain `exp` would lose: 1e-45 to the power
//! of 0.05 is 0.006.
//!
//! The atoms come as an ascending list and are folded one by one, with one open sum per level, so that neither an array
//! per node nor a recursion is needed. With the whole list it is what tests and the single points far from a molecule
//! go by; with the list of a cell, second derivatives.

use geom_core::nalgebra::Matrix3;
use geom_core::{Lattice, Point3, Vector3};

use crate::kernel::prepared::Prepared;

/// ln Σ eᵃ, one term at a time, and the weighted sums that derivatives need.
#[derive(Clone, Debug)]
struct LogSum<W> {
    /// The largest term so far, as a logarithm.
    top: f64,
    /// The sum of the terms relative to it, at least 1 once there is one.
    rest: f64,
    /// The derivatives of the terms, in the same weights.
    weighted: W,
}

/// What is averaged along with a sum: nothing, gradients, or gradients and Hessians of the terms.
trait Weighted: Clone {
    /// Of an empty sum.
    fn zero() -> Self;
    /// When a larger term becomes the one that others are relative to.
    fn scale(&mut self, factor: f64);
    /// Adds `w` times the derivatives of a term `L`.
    fn add(&mut self, w: f64, term: &Self);
    /// From sums over the terms to the derivatives of `P ln Σ`.
    fn finish(self, sum: f64, power: f64) -> Self;
    /// The derivatives of `−κ |x − x_a|²`.
    fn leaf(decay: f64, d: &Vector3) -> Self;
}

impl Weighted for () {
    fn zero() -> Self {}
    fn scale(&mut self, _: f64) {}
    fn add(&mut self, _: f64, _: &Self) {}
    fn finish(self, _: f64, _: f64) -> Self {}
    fn leaf(_: f64, _: &Vector3) -> Self {}
}

impl Weighted for Vector3 {
    fn zero() -> Self {
        Self::zeros()
    }
    fn scale(&mut self, factor: f64) {
        *self *= factor;
    }
    fn add(&mut self, w: f64, term: &Self) {
        *self += w * term;
    }
    fn finish(self, sum: f64, power: f64) -> Self {
        self * (power / sum)
    }
    fn leaf(decay: f64, d: &Vector3) -> Self {
        -2.0 * decay * d
    }
}

impl Weighted for (Vector3, Matrix3<f64>) {
    fn zero() -> Self {
        (Vector3::zeros(), Matrix3::zeros())
    }
    fn scale(&mut self, factor: f64) {
        self.0 *= factor;
        self.1 *= factor;
    }
    fn add(&mut self, w: f64, (gradient, hessian): &Self) {
        self.0 += w * gradient;
        self.1 += w * (hessian + gradient * gradient.transpose());
    }
    fn finish(self, sum: f64, power: f64) -> Self {
        let mean = self.0 / sum;
        let hessian = (self.1 / sum - mean * mean.transpose()) * power;
        (mean * power, hessian)
    }
    fn leaf(decay: f64, d: &Vector3) -> Self {
        (
            -2.0 * decay * d,
            Matrix3::from_diagonal_element(-2.0 * decay),
        )
    }
}

impl<W: Weighted> LogSum<W> {
    fn empty() -> Self {
        Self {
            top: f64::NEG_INFINITY,
            rest: 0.0,
            weighted: W::zero(),
        }
    }

    /// Adds a term, given as its logarithm. (Log-sum-exp in one pass: a new largest term rescales what is there.)
    fn add(&mut self, term: f64, derivatives: &W) {
        if term <= self.top {
            let w = (term - self.top).exp();
            self.rest += w;
            self.weighted.add(w, derivatives);
        } else {
            let old = (self.top - term).exp();
            self.rest = self.rest * old + 1.0;
            self.weighted.scale(old);
            self.weighted.add(1.0, derivatives);
            self.top = term;
        }
    }

    /// `P ln Σ` and its derivatives; empties the sum.
    fn take(&mut self, power: f64) -> (f64, W) {
        let sum = std::mem::replace(self, Self::empty());
        let ln = power * (sum.top + sum.rest.ln());
        (ln, sum.weighted.finish(sum.rest, power))
    }
}

/// `ln G` at `x` and its derivatives, from the atoms in `members` (ascending).
/// Minus infinity without atoms.
fn fold<W: Weighted>(
    tree: &Prepared<'_>,
    members: impl Iterator<Item = u32>,
    x: &Point3,
) -> (f64, W) {
    let depth = tree.levels.len();
    let mut sums: Vec<LogSum<W>> = vec![LogSum::empty(); depth + 1];
    let mut members = members.peekable();
    while let Some(atom) = members.next() {
        let a = atom as usize;
        let d = x - tree.model.centers()[a];
        let leaf = W::leaf(tree.model.decays()[a], &d);
        sums[0].add(tree.ln_kernel(a, x), &leaf);
        let mut node = atom;
        // A node is complete when the next atom lies under another one.
        for level in 0..tree.levels_that_end(atom, members.peek().copied()) {
            node = tree.parent[level][node as usize];
            let (ln, derivatives) = sums[level].take(tree.levels[level].power[node as usize]);
            sums[level + 1].add(ln, &derivatives);
        }
    }
    sums[depth].take(1.0)
}

/// `G(x)` from the atoms in `members` (ascending); 0 for none.
pub(crate) fn value(tree: &Prepared<'_>, members: impl Iterator<Item = u32>, x: &Point3) -> f64 {
    fold::<()>(tree, members, x).0.exp()
}

/// `G(x)` and its gradient, per Å.
pub(crate) fn value_gradient(
    tree: &Prepared<'_>,
    members: impl Iterator<Item = u32>,
    x: &Point3,
) -> (f64, Vector3) {
    let (ln, gradient) = fold::<Vector3>(tree, members, x);
    let value = ln.exp();
    if value == 0.0 {
        // Also where every term underflows: ln may be −∞ and the gradient undefined.
        return (0.0, Vector3::zeros());
    }
    (value, gradient * value)
}

/// `G(x)`, its gradient (per Å) and Hessian (per Å²).
pub(crate) fn value_gradient_hessian(
    tree: &Prepared<'_>,
    members: impl Iterator<Item = u32>,
    x: &Point3,
) -> (f64, Vector3, Matrix3<f64>) {
    let (ln, (gradient, hessian)) = fold::<(Vector3, Matrix3<f64>)>(tree, members, x);
    let value = ln.exp();
    if value == 0.0 {
        return (0.0, Vector3::zeros(), Matrix3::zeros());
    }
    let curved = hessian + gradient * gradient.transpose();
    (value, gradient * value, curved * value)
}

/// `G(x)` and, per member, the share `∂G/∂ ln g_a`: the density times, on the way up, each power and each
/// child's part of its node's sum.
/// In the order of the members. Their sum over the atoms of a tree without powers is the density itself.
pub(crate) fn shares(tree: &Prepared<'_>, members: &[u32], x: &Point3) -> (f64, Vec<f64>) {
    // Logarithm of the term of each child that is present, and of the sums of the nodes above.
    let mut children: Vec<(u32, f64)> = members
        .iter()
        .map(|&a| (a, tree.ln_kernel(a as usize, x)))
        .collect();
    // Per member: its place among the children, and the logarithm of its part so far.
    let mut of_member: Vec<(usize, f64)> = (0..members.len()).map(|i| (i, 0.0)).collect();
    for (parent, level) in tree.parent.iter().zip(&tree.levels) {
        let mut nodes: Vec<(u32, LogSum<()>)> = Vec::new();
        let mut place = Vec::with_capacity(children.len());
        for &(child, ln) in &children {
            let node = parent[child as usize];
            if nodes.last().is_none_or(|n| n.0 != node) {
                nodes.push((node, LogSum::empty()));
            }
            place.push(nodes.len() - 1);
            nodes.last_mut().expect("just pushed").1.add(ln, &());
        }
        let sums: Vec<(u32, f64)> = nodes
            .into_iter()
            .map(|(node, mut sum)| (node, sum.take(1.0).0))
            .collect();
        for (child, part) in &mut of_member {
            let (node, sum) = sums[place[*child]];
            *part += children[*child].1 - sum + level.power[node as usize].ln();
            *child = place[*child];
        }
        children = sums
            .into_iter()
            .map(|(node, sum)| (node, level.power[node as usize] * sum))
            .collect();
    }
    let g = children.iter().map(|c| c.1.exp()).sum();
    let share = |&(child, part): &(usize, f64)| (part + children[child].1).exp();
    (g, of_member.iter().map(share).collect())
}

/// The densities at the points of a cube of a lattice, x fastest, from the atoms in `active` (ascending), as
/// finite f32.
pub(crate) fn plain_cube(
    model: &Prepared<'_>,
    lattice: &Lattice,
    first: [usize; 3],
    side: usize,
    active: &[u32],
    out: &mut [f32],
) {
    for (p, out) in out.iter_mut().enumerate().take(side * side * side) {
        let local = [p % side, p / side % side, p / (side * side)];
        let x = lattice.point([0, 1, 2].map(|k| first[k] + local[k]));
        *out = narrow(value(model, active.iter().copied(), &x));
    }
}

/// To f32, finite.
/// What is larger than f32 holds becomes its largest number: grids refuse infinity, and the middle of many atoms may be
/// that dense.
pub(crate) fn narrow(value: f64) -> f32 {
    (value as f32).min(f32::MAX)
}
