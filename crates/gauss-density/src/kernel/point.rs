//! The density and its gradient at one point, or at several that share their atoms: what
//! [`PointSampler`](crate::PointSampler) gives. It follows [`plain`](crate::kernel::plain).
//!
//! Level by level instead of depth first: all exponentials of a level are taken in one loop without a branch, which
//! becomes vector instructions. A term is a factor and an exponent, `m eᵉ`; raising a sum to a power raises the factor
//! and multiplies the exponent, so the scale of a node never goes through an exponential before it meets those of its
//! siblings.
//!
//! Points side by side ([`LANES`]) share the walk over the tree, and each step of it is a vector instruction, where one
//! point alone has only its exponentials. The arithmetic of a point is the same in both, so it has the same bits. Loops over
//! lanes are written out: what `array::map` and `from_fn` are given would not be compiled for the instruction set.

use std::array::from_fn;
use std::cell::RefCell;

use geom_core::compute::lanes::autovectorized;
use geom_core::{Point3, Vector3};

use crate::kernel::math::{exp_all, raise};
use crate::kernel::prepared::Prepared;

/// Points side by side: the f64 of the widest vectors.
pub(crate) const LANES: usize = 8;

/// A number for each of `L` points.
type Row<const L: usize> = [f64; L];

/// Reusable arrays of one thread. A child's term is `m exp(e)`, so that nothing underflows before the powers.
#[derive(Debug, Default)]
struct Arrays<const L: usize> {
    /// The factor of each term.
    m: Vec<Row<L>>,
    /// Its exponent.
    e: Vec<Row<L>>,
    /// Gradient of the logarithm of each term.
    slope: Vec<[Row<L>; 3]>,
    /// The atom or node that each term is of; written over from the front as a level shrinks to the next.
    node: Vec<u32>,
    /// Where the children of each node end, and the largest exponent among them.
    ends: Vec<(usize, Row<L>)>,
}

thread_local! {
    static ONE: RefCell<Arrays<1>> = RefCell::default();
    static SEVERAL: RefCell<Arrays<LANES>> = RefCell::default();
}

/// `G(x)` from the atoms in `active` (ascending); 0 for none.
pub(crate) fn value(tree: &Prepared<'_>, active: &[u32], x: &Point3) -> f64 {
    evaluate::<1, false>(tree, active, &[*x], &ONE).0[0]
}

/// `G(x)` and its gradient, per Å.
pub(crate) fn value_gradient(tree: &Prepared<'_>, active: &[u32], x: &Point3) -> (f64, Vector3) {
    let (value, gradient) = evaluate::<1, true>(tree, active, &[*x], &ONE);
    (value[0], gradient.map(|g| g[0]).into())
}

/// [`value`] at points that share their atoms.
pub(crate) fn values(tree: &Prepared<'_>, active: &[u32], x: &[Point3; LANES]) -> [f64; LANES] {
    evaluate::<LANES, false>(tree, active, x, &SEVERAL).0
}

/// [`value_gradient`] at points that share their atoms.
pub(crate) fn values_gradients(
    tree: &Prepared<'_>,
    active: &[u32],
    x: &[Point3; LANES],
) -> [(f64, Vector3); LANES] {
    let (value, gradient) = evaluate::<LANES, true>(tree, active, x, &SEVERAL);
    from_fn(|l| (value[l], gradient.map(|g| g[l]).into()))
}

/// With arrays of the thread, so that nothing is allocated once these are as large as the longest list of atoms.
fn evaluate<const L: usize, const SLOPES: bool>(
    tree: &Prepared<'_>,
    active: &[u32],
    x: &[Point3; L],
    arrays: &'static std::thread::LocalKey<RefCell<Arrays<L>>>,
) -> (Row<L>, [Row<L>; 3]) {
    arrays.with_borrow_mut(|work| {
        autovectorized(
            #[inline(always)]
            || sum_tree::<L, SLOPES>(tree, active, x, work),
        )
    })
}

/// Without `SLOPES` the gradients are 0 and cost nothing. Where the density underflows, far from all atoms, value and
/// gradient are 0.
#[inline(always)]
fn sum_tree<const L: usize, const SLOPES: bool>(
    tree: &Prepared<'_>,
    active: &[u32],
    x: &[Point3; L],
    work: &mut Arrays<L>,
) -> (Row<L>, [Row<L>; 3]) {
    kernels::<L, SLOPES>(tree, active, x, work);
    let Arrays {
        m,
        e,
        slope,
        node,
        ends,
    } = work;
    for (parent, level) in tree.parent.iter().zip(&tree.levels) {
        // Runs of children with one parent; exponents relative to the largest of the run, so that the
        // exponentials can be taken of all runs at once and none of them underflows.
        ends.clear();
        let mut start = 0;
        while start < node.len() {
            let own = parent[node[start] as usize];
            let mut end = start;
            while end < node.len() && parent[node[end] as usize] == own {
                end += 1;
            }
            let top = relative_to_largest(&mut e[start..end]);
            node[ends.len()] = own;
            ends.push((end, top));
            start = end;
        }
        exp_all(e.as_flattened_mut());
        // Each run becomes a child of the level above: the power of its sum as the factor, that of its scale as
        // the exponent.
        let mut start = 0;
        for (v, &(end, top)) in ends.iter().enumerate() {
            let power = level.power[node[v] as usize];
            let (sum, gradient) = sum_of::<L, SLOPES>(m, e, slope, start..end);
            m[v] = sum;
            raise(&mut m[v], power);
            for l in 0..L {
                e[v][l] = power * top[l];
            }
            if SLOPES {
                for k in 0..3 {
                    for l in 0..L {
                        slope[v][k][l] = gradient[k][l] * (power / sum[l]);
                    }
                }
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
    let top = relative_to_largest(e);
    exp_all(e.as_flattened_mut());
    let (mut sum, mut gradient) = sum_of::<L, SLOPES>(m, e, slope, 0..e.len());
    for l in 0..L {
        let scale = top[l].exp();
        // Nothing where there is no density, not nothing times what is no number.
        let scale = |of: f64| {
            if sum[l] * scale > 0.0 {
                of * scale
            } else {
                0.0
            }
        };
        let value = scale(sum[l]);
        for of in &mut gradient {
            of[l] = scale(of[l]);
        }
        sum[l] = value;
    }
    (sum, gradient)
}

/// The kernels: exponents, each with a factor of 1.
#[inline(always)]
fn kernels<const L: usize, const SLOPES: bool>(
    tree: &Prepared<'_>,
    active: &[u32],
    x: &[Point3; L],
    work: &mut Arrays<L>,
) {
    let model = tree.model;
    let mut at = [[0.0; L]; 3];
    for l in 0..L {
        for k in 0..3 {
            at[k][l] = x[l][k];
        }
    }
    work.m.clear();
    work.m.resize(active.len(), [1.0; L]);
    work.e.clear();
    work.slope.clear();
    for &a in active {
        let a = a as usize;
        let (c, r, kappa) = (model.centers()[a], model.radii()[a], model.decays()[a]);
        let (mut d, mut e) = ([[0.0; L]; 3], [0.0; L]);
        for l in 0..L {
            for k in 0..3 {
                d[k][l] = at[k][l] - c[k];
            }
            let square = d[0][l] * d[0][l] + d[1][l] * d[1][l] + d[2][l] * d[2][l];
            e[l] = kappa * (r * r - square);
        }
        work.e.push(e);
        if SLOPES {
            for d in d.as_flattened_mut() {
                *d *= -2.0 * kappa;
            }
            work.slope.push(d);
        }
    }
    work.node.clear();
    work.node.extend_from_slice(active);
}

/// Takes the largest exponent of each point from its exponents, and gives it; minus infinity for none.
#[inline(always)]
fn relative_to_largest<const L: usize>(e: &mut [Row<L>]) -> Row<L> {
    let mut top = [f64::NEG_INFINITY; L];
    for e in &*e {
        for l in 0..L {
            top[l] = top[l].max(e[l]);
        }
    }
    for e in e {
        for l in 0..L {
            e[l] -= top[l];
        }
    }
    top
}

/// The sum of some terms, and of their gradients.
#[inline(always)]
fn sum_of<const L: usize, const SLOPES: bool>(
    m: &[Row<L>],
    e: &[Row<L>],
    slope: &[[Row<L>; 3]],
    range: std::ops::Range<usize>,
) -> (Row<L>, [Row<L>; 3]) {
    let (mut sum, mut gradient) = ([0.0; L], [[0.0; L]; 3]);
    for i in range {
        for l in 0..L {
            let term = m[i][l] * e[i][l];
            sum[l] += term;
            if SLOPES {
                for k in 0..3 {
                    gradient[k][l] += slope[i][k][l] * term;
                }
            }
        }
    }
    (sum, gradient)
}
