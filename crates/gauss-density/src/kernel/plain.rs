//! The specification: the density as the equation reads, in f64, with derivatives.
//!
//! All sums are kept as logarithms: with `L = ln D`, an atom has `L = −κ (d² − r²)` and a node
//! `L_v = P_v ln Σ_c exp L_c`. Small powers magnify terms that a plain `exp` would lose: 1e-45 to the power
//! of 0.05 is 0.006.

use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, Vector3};

use crate::model::{Level, Model};

/// A model made ready for evaluation: the levels that matter, and the way up from each atom.
#[derive(Clone, Debug)]
pub(crate) struct Compiled<'a> {
    pub(crate) model: &'a Model,
    pub(crate) levels: Vec<Level>,
    /// `parent[0]`: node on level 0 per atom; `parent[l]`: node on level `l` per node of level `l − 1`.
    pub(crate) parent: Vec<Vec<u32>>,
}

impl<'a> Compiled<'a> {
    pub(crate) fn new(model: &'a Model) -> Self {
        let levels = model.compiled_levels();
        let parent = levels
            .iter()
            .map(|level| {
                let mut parent = vec![0; level.first_child[level.len()] as usize];
                for node in 0..level.len() {
                    parent[level.children(node)].fill(node as u32);
                }
                parent
            })
            .collect();
        Self {
            model,
            levels,
            parent,
        }
    }

    /// `−q_a(x)`: the logarithm of the kernel of an atom.
    pub(crate) fn ln_kernel(&self, atom: usize, x: &Point3) -> f64 {
        let model = self.model;
        let r = model.radii()[atom];
        model.decays()[atom] * (r * r - (x - model.centers()[atom]).norm_squared())
    }

    /// How many levels end between two atoms: all up to the first that they share.
    pub(crate) fn levels_that_end(&self, atom: u32, next: Option<u32>) -> usize {
        let Some(next) = next else {
            return self.levels.len();
        };
        let (mut a, mut b) = (atom, next);
        for (level, parent) in self.parent.iter().enumerate() {
            (a, b) = (parent[a as usize], parent[b as usize]);
            if a == b {
                return level;
            }
        }
        self.levels.len()
    }
}

/// ln Σ eᵃ, one term at a time, and the weighted sums that derivatives need.
#[derive(Clone, Debug)]
struct LogSum<W> {
    top: f64,
    rest: f64,
    weighted: W,
}

/// What is averaged along with a sum: nothing, gradients, or gradients and Hessians of the terms.
trait Weighted: Clone {
    fn zero() -> Self;
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
fn fold<W: Weighted>(
    tree: &Compiled<'_>,
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
pub(crate) fn value(tree: &Compiled<'_>, members: impl Iterator<Item = u32>, x: &Point3) -> f64 {
    fold::<()>(tree, members, x).0.exp()
}

/// `G(x)` and its gradient, per Å.
pub(crate) fn value_gradient(
    tree: &Compiled<'_>,
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
    tree: &Compiled<'_>,
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
pub(crate) fn shares(tree: &Compiled<'_>, members: &[u32], x: &Point3) -> (f64, Vec<f64>) {
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

/// The density of the whole model at `x`, from all atoms: the specification that everything else is
/// tested against.
pub fn nested_sum(model: &Model, x: &Point3) -> f64 {
    let tree = Compiled::new(model);
    value(&tree, 0..model.atoms() as u32, x)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// n coincident atoms that meet below a level: `d² = r² + ln n / (κ Π powers below)`.
    #[test]
    fn coincident_atoms_give_the_closed_form_at_every_level() {
        let (r, kappa, p) = (1.7, 0.8, [0.5, 0.3, 1.7]);
        for n in [2u32, 5, 40] {
            for meet in 0..=3usize {
                // On level l: one node for all below `meet` levels, else one node per atom.
                let tree = (0..3)
                    .map(|l| {
                        if l < meet {
                            ((0..=n).collect(), vec![p[l]; n as usize])
                        } else if l == meet {
                            (vec![0, n], vec![p[l]])
                        } else {
                            (vec![0, 1], vec![p[l]])
                        }
                    })
                    .collect();
                let (centers, radii) = (vec![Point3::origin(); n as usize], vec![r; n as usize]);
                let model = Model::new(centers, radii, vec![kappa; n as usize], tree).unwrap();
                let below: f64 = p[..meet].iter().product();
                let d = (r * r + f64::from(n).ln() / (kappa * below)).sqrt();
                let g = nested_sum(&model, &Point3::new(d, 0.0, 0.0));
                assert!((g - 1.0).abs() < 1e-13, "{n} atoms, level {meet}: {g}");
            }
        }
    }

    #[test]
    fn one_atom_is_a_sphere_of_its_radius_for_every_decay_and_power() {
        for kappa in [0.1, 1.0, 5.0] {
            for power in [0.05, 0.5, 1.0, 3.0] {
                let tree = vec![(vec![0, 1], vec![power]); 2];
                let model =
                    Model::new(vec![Point3::origin()], vec![1.7], vec![kappa], tree).unwrap();
                let g = nested_sum(&model, &Point3::new(0.0, 1.7, 0.0));
                assert!((g - 1.0).abs() < 1e-14);
            }
        }
    }
}
