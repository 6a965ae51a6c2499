//! The density and its gradient at one point, many exponentials at a time: what
//! [`PointSampler`](crate::PointSampler) gives. It follows [`plain`](crate::kernel::plain).
//!
//! Level by level instead of depth first: all exponentials of a level are taken in one loop without a branch, which
//! becomes vector instructions. A term is a factor and an exponent, `m eᵉ`; raising a sum to a power raises the factor
//! and multiplies the exponent, so the scale of a node never goes through an exponential before it meets those of its
//! siblings.

use std::cell::RefCell;

use geom_core::compute::lanes::autovectorized;
use geom_core::{Point3, Vector3};

use crate::kernel::math::{exp_all, raised};
use crate::kernel::prepared::Prepared;

/// Reusable arrays of one thread. A child's term is `m exp(e)`, so that nothing underflows before the powers.
#[derive(Debug, Default)]
struct Arrays {
    /// The factor of each term.
    m: Vec<f64>,
    /// Its exponent.
    e: Vec<f64>,
    /// Gradient of the logarithm of each term.
    slope: Vec<Vector3>,
    /// The atom or node that each term is of; written over from the front as a level shrinks to the next.
    node: Vec<u32>,
    /// Where the children of each node end, and the largest exponent among them.
    ends: Vec<(usize, f64)>,
}

thread_local! {
    static WORK: RefCell<Arrays> = RefCell::default();
}

/// `G(x)` from the atoms in `active` (ascending); 0 for none.
pub(crate) fn value(tree: &Prepared<'_>, active: &[u32], x: &Point3) -> f64 {
    evaluate::<false>(tree, active, x).0
}

/// `G(x)` and its gradient, per Å.
pub(crate) fn value_gradient(tree: &Prepared<'_>, active: &[u32], x: &Point3) -> (f64, Vector3) {
    evaluate::<true>(tree, active, x)
}

/// With arrays of the thread, so that nothing is allocated once these are as large as the longest list of atoms.
fn evaluate<const SLOPES: bool>(tree: &Prepared<'_>, active: &[u32], x: &Point3) -> (f64, Vector3) {
    WORK.with_borrow_mut(|work| {
        autovectorized(
            #[inline(always)]
            || sum_tree::<SLOPES>(tree, active, x, work),
        )
    })
}

/// Without `SLOPES` the gradient is 0 and costs nothing. Where the density underflows, far from all atoms, value and
/// gradient are 0.
#[inline(always)]
fn sum_tree<const SLOPES: bool>(
    tree: &Prepared<'_>,
    active: &[u32],
    x: &Point3,
    work: &mut Arrays,
) -> (f64, Vector3) {
    let Arrays {
        m,
        e,
        slope,
        node,
        ends,
    } = work;
    // The kernels: exponents, each with a factor of 1.
    let model = tree.model;
    m.clear();
    m.resize(active.len(), 1.0);
    e.clear();
    slope.clear();
    for &a in active {
        let a = a as usize;
        let (d, r, kappa) = (x - model.centers()[a], model.radii()[a], model.decays()[a]);
        e.push(kappa * (r * r - d.norm_squared()));
        if SLOPES {
            slope.push(d * (-2.0 * kappa));
        }
    }
    node.clear();
    node.extend_from_slice(active);
    for (parent, level) in tree.parent.iter().zip(&tree.levels) {
        // Runs of children with one parent; exponents relative to the largest of the run, so that the
        // exponentials can be taken of all runs at once and none of them underflows.
        ends.clear();
        let mut start = 0;
        while start < node.len() {
            let own = parent[node[start] as usize];
            let (mut end, mut top) = (start, f64::NEG_INFINITY);
            while end < node.len() && parent[node[end] as usize] == own {
                top = top.max(e[end]);
                end += 1;
            }
            for e in &mut e[start..end] {
                *e -= top;
            }
            node[ends.len()] = own;
            ends.push((end, top));
            start = end;
        }
        exp_all(e);
        // Each run becomes a child of the level above: the power of its sum as the factor, that of its scale as
        // the exponent.
        let mut start = 0;
        for (v, &(end, top)) in ends.iter().enumerate() {
            let power = level.power[node[v] as usize];
            let (sum, gradient) = sum_of::<SLOPES>(m, e, slope, start..end);
            m[v] = raised(sum, power);
            e[v] = power * top;
            if SLOPES {
                slope[v] = gradient * (power / sum);
            }
            start = end;
        }
        let nodes = ends.len();
        m.truncate(nodes);
        e.truncate(nodes);
        node.truncate(nodes);
        if SLOPES {
            slope.truncate(nodes);
        }
    }
    // The root has no power.
    let top = e.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY {
        return (0.0, Vector3::zeros());
    }
    for e in &mut *e {
        *e -= top;
    }
    exp_all(e);
    let (sum, gradient) = sum_of::<SLOPES>(m, e, slope, 0..e.len());
    let scale = top.exp();
    if sum * scale == 0.0 {
        return (0.0, Vector3::zeros());
    }
    (sum * scale, gradient * scale)
}

/// The sum of some terms, and of their gradients.
#[inline(always)]
fn sum_of<const SLOPES: bool>(
    m: &[f64],
    e: &[f64],
    slope: &[Vector3],
    range: std::ops::Range<usize>,
) -> (f64, Vector3) {
    let (mut sum, mut gradient) = (0.0, Vector3::zeros());
    for i in range {
        let term = m[i] * e[i];
        sum += term;
        if SLOPES {
            gradient += slope[i] * term;
        }
    }
    (sum, gradient)
}
