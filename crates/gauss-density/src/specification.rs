//! What every kernel of [`DensityBackend`](crate::DensityBackend) must give, as the equations read: plain
//! recursions over the tree of the model, in f64, that share nothing with the kernels.
//!
//! Sums are kept as logarithms, since small powers magnify what a plain `exp` would lose: 1e-45 to the power of
//! 0.05 is 0.006. Everything is summed from all atoms, without a cut. (For values anywhere in production there is
//! [`PointSampler`](crate::PointSampler), which is faster by orders of magnitude; so this stands behind the feature
//! `testing`.)

use geom_core::{Point3, Vector3};

use crate::backend::{RefitSums, SampleCell};
use crate::model::Model;

/// The density `G(x)` of a model (Eqs. 3.1–3.6): `D_v = (Σ_c D_c)^P_v` for every node, and at last the sum over
/// the topmost ones. The specification of `sample_blocks`.
pub fn nested_sum(model: &Model, x: &Point3) -> f64 {
    Tree {
        model,
        x: *x,
        left_out: None,
    }
    .ln_root()
    .exp()
}

/// The specification of `atom_errors` (Eq. 3.9 squared, corrected): every atom of a cell is left out in turn, and
/// the density of the others is summed anew. A cell must have all atoms of the model.
pub fn atom_errors(model: &Model, cells: &[SampleCell]) -> Vec<f64> {
    let mut errors = vec![0.0; model.atoms()];
    for cell in cells {
        for (x, target) in cell.points.iter().zip(&cell.target) {
            for &atom in &cell.atoms {
                let left_out = Some(atom as usize);
                let left = Tree {
                    model,
                    x: *x,
                    left_out,
                }
                .ln_root()
                .exp();
                let change = ((target - left) / target).max(0.0);
                errors[atom as usize] += change * change;
            }
        }
    }
    errors
}

/// The specification of `refit_sums` (Eqs. 3.11 and 3.13). A cell must have all atoms of the model.
pub fn refit_sums(model: &Model, cells: &[SampleCell]) -> RefitSums {
    let mut sums = RefitSums {
        gradient: vec![[0.0; 5]; model.atoms()],
        curvature: vec![[0.0; 5]; model.atoms()],
        ..RefitSums::default()
    };
    for cell in cells {
        for (x, exact) in cell.points.iter().zip(&cell.exact) {
            let g = nested_sum(model, x);
            let weight = 1.0 / (exact * exact);
            sums.objective += 0.5 * weight * (g - exact) * (g - exact);
            sums.worst = sums.worst.max((g - exact).abs() / exact);
            for (atom, slopes) in parameter_slopes(model, x).into_iter().enumerate() {
                for (p, slope) in slopes.into_iter().enumerate() {
                    sums.gradient[atom][p] += weight * (g - exact) * slope;
                    sums.curvature[atom][p] += weight * slope * slope;
                }
            }
        }
    }
    sums
}

/// `∂G/∂(x, y, z, r, κ)` of every atom at a point, by the chain rule: on the way up from an atom each node passes on
/// `∂D_v/∂D_c = P_v D_v / S_v`.
pub fn parameter_slopes(model: &Model, x: &Point3) -> Vec<[f64; 5]> {
    let tree = Tree {
        model,
        x: *x,
        left_out: None,
    };
    let depth = model.levels().len();
    let top = model.levels().last().map_or(model.atoms(), |l| l.len());
    let mut slopes = vec![[0.0; 5]; model.atoms()];
    for node in 0..top {
        tree.slopes_below(depth, node, 0.0, &mut slopes);
    }
    slopes
}

/// A model at a point, perhaps without one atom.
struct Tree<'a> {
    model: &'a Model,
    x: Point3,
    left_out: Option<usize>,
}

impl Tree<'_> {
    /// `ln G`.
    fn ln_root(&self) -> f64 {
        let levels = self.model.levels();
        let top = levels.last().map_or(self.model.atoms(), |l| l.len());
        ln_sum((0..top).map(|node| self.ln_value(levels.len(), node)))
    }

    /// `ln D` of a node: an atom's kernel (Eq. 3.1) at depth 0, a node of the lowest level at depth 1.
    fn ln_value(&self, depth: usize, node: usize) -> f64 {
        if depth == 0 {
            return self.ln_kernel(node);
        }
        self.model.levels()[depth - 1].powers()[node] * self.ln_sum_of(depth, node)
    }

    /// `ln S`, the sum over the children of a node.
    fn ln_sum_of(&self, depth: usize, node: usize) -> f64 {
        let children = self.model.levels()[depth - 1].children(node);
        ln_sum(children.map(|child| self.ln_value(depth - 1, child)))
    }

    fn ln_kernel(&self, atom: usize) -> f64 {
        if self.left_out == Some(atom) {
            return f64::NEG_INFINITY;
        }
        let (decay, radius) = (self.model.decays()[atom], self.model.radii()[atom]);
        -decay * (self.offset(atom).norm_squared() - radius * radius)
    }

    fn offset(&self, atom: usize) -> Vector3 {
        self.x - self.model.centers()[atom]
    }

    /// The slopes of the atoms below a node, given `ln ∂G/∂D` of the node.
    fn slopes_below(&self, depth: usize, node: usize, ln_slope: f64, slopes: &mut [[f64; 5]]) {
        if depth > 0 {
            let level = &self.model.levels()[depth - 1];
            let (power, ln_sum) = (level.powers()[node], self.ln_sum_of(depth, node));
            let below = ln_slope + power.ln() + (power - 1.0) * ln_sum;
            for child in level.children(node) {
                self.slopes_below(depth - 1, child, below, slopes);
            }
            return;
        }
        // ∂G/∂ ln g of the atom, and from there by ln g = −κ (|d|² − r²).
        let share = (ln_slope + self.ln_kernel(node)).exp();
        let (decay, radius) = (self.model.decays()[node], self.model.radii()[node]);
        let d = self.offset(node);
        let center = 2.0 * decay * share * d;
        slopes[node] = [
            center.x,
            center.y,
            center.z,
            2.0 * decay * share * radius,
            share * (radius * radius - d.norm_squared()),
        ];
    }
}

/// `ln Σ exp`.
fn ln_sum(terms: impl Iterator<Item = f64>) -> f64 {
    let terms: Vec<f64> = terms.collect();
    let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY {
        return top;
    }
    top + terms.iter().map(|t| (t - top).exp()).sum::<f64>().ln()
}
