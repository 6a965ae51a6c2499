//! The sums of the tree of a cell at all of its points side by side: ready for "without this atom", and for
//! derivatives.
//!
//! Elimination asks, for every atom and point, what the density would be without that atom. Recomputing the tree costs as much
//! as all atoms; but only the nodes above the atom change. With the sums of all nodes at hand, each of these is its sum less
//! the old term plus the new one. The subtraction cancels where the atom is all there is, unless terms are kept relative to
//! their largest sibling, which is what [`Terms`] does.

use geom_core::Point3;
use geom_core::compute::lanes::autovectorized;

use crate::backend::{RefitSums, SampleCell};
use crate::kernel::math::{exp_all, ln_all, raise};
use crate::model::Model;

/// Points are taken in groups of this size, for the lanes of the processor.
const LANES: usize = 8;

/// The terms of the tree of a cell: each child's `D` relative to its largest sibling's, so that nothing
/// underflows before the powers, and sums without one child are exact. Every array has a row of `width` points
/// per child or node.
#[derive(Clone, Debug, Default)]
pub(crate) struct Terms {
    /// Number of points, rounded up to whole lanes; the last point is repeated.
    width: usize,
    /// Coordinates of the points.
    at: [Vec<f64>; 3],
    /// Per level (atoms first, children of the root last): the terms of the children.
    term: Vec<Vec<f64>>,
    /// Per level: `term = sum^P · factor` for each node.
    factor: Vec<Vec<f64>>,
    /// `ln` of the scale of the root's terms.
    top: Vec<f64>,
    ln: Vec<f64>,
    above: Vec<f64>,
    tops: Vec<f64>,
    tops_above: Vec<f64>,
}

impl Terms {
    /// Evaluates the tree at the points of the cell.
    /// The rows that an evaluation before has left are overwritten, not cleared. Coordinates and decays are the
    /// model's, the tree is the cell's: a refit moves the one and keeps the other.
    #[inline(always)]
    pub(crate) fn fill(&mut self, cell: &SampleCell, model: &Model) {
        // Whole lanes: the last point stands in for those that are missing, and is left out of every result.
        let n = cell.points.len().next_multiple_of(LANES).max(LANES);
        self.width = n;
        let last = cell.points.last().copied().unwrap_or(Point3::origin());
        for (k, at) in self.at.iter_mut().enumerate() {
            at.clear();
            at.extend(cell.points.iter().map(|x| x[k]));
            at.resize(n, last[k]);
        }
        let depth = cell.levels.len();
        self.term.resize_with(depth + 1, Vec::new);
        self.factor.resize_with(depth, Vec::new);
        self.ln.resize(cell.atoms.len() * n, 0.0);
        // Logarithms of the kernels: the terms of the lowest level before they are made relative.
        let [x, y, z] = [0, 1, 2].map(|k| &self.at[k][..n]);
        for (&a, ln) in cell.atoms.iter().zip(self.ln.chunks_exact_mut(n)) {
            let a = a as usize;
            let (center, r, kappa) = (model.centers()[a], model.radii()[a], model.decays()[a]);
            for (p, ln) in ln.iter_mut().enumerate() {
                let [x, y, z] = [x[p] - center.x, y[p] - center.y, z[p] - center.z];
                *ln = kappa * (r * r - (x * x + y * y + z * z));
            }
        }
        // Level by level: terms relative to the largest sibling, their sum, and the logarithm of its power, which is
        // the term of the level above.
        for (l, level) in cell.levels.iter().enumerate() {
            let term = &mut self.term[l];
            term.resize(self.ln.len(), 0.0);
            self.above.resize(level.len() * n, 0.0);
            self.tops_above.resize(level.len() * n, 0.0);
            for v in 0..level.len() {
                let children = level.children(v);
                let rows = children.start * n..children.end * n;
                let top = &mut self.tops_above[v * n..][..n];
                relative(&self.ln[rows.clone()], &mut term[rows.clone()], top);
                let sum = &mut self.above[v * n..][..n];
                sum.fill(0.0);
                for row in term[rows].chunks_exact(n) {
                    for (sum, t) in sum.iter_mut().zip(row) {
                        *sum += t;
                    }
                }
                ln_all(sum);
                for (sum, top) in sum.iter_mut().zip(&*top) {
                    *sum = level.power[v] * (*sum + top);
                }
                // The factors of the children, now that the scale of their terms is known.
                if l > 0 {
                    for c in children {
                        let power = cell.levels[l - 1].power[c];
                        let factor = &mut self.factor[l - 1][c * n..][..n];
                        scale_of(&self.tops[c * n..][..n], power, top, factor);
                    }
                }
            }
            self.factor[l].resize(level.len() * n, 0.0);
            std::mem::swap(&mut self.ln, &mut self.above);
            std::mem::swap(&mut self.tops, &mut self.tops_above);
        }
        // The root has no power: its terms are relative to the largest of all.
        self.top.resize(n, 0.0);
        let root = &mut self.term[depth];
        root.resize(self.ln.len(), 0.0);
        relative(&self.ln, root, &mut self.top);
        if let Some(level) = cell.levels.last() {
            for (c, &power) in level.power.iter().enumerate() {
                let factor = &mut self.factor[depth - 1][c * n..][..n];
                scale_of(&self.tops[c * n..][..n], power, &self.top, factor);
            }
        }
    }

    /// The density at each point of the cell, into `values`.
    #[inline(always)]
    pub(crate) fn values_into(&self, cell: &SampleCell, values: &mut Vec<f64>) {
        values.clear();
        values.resize(self.width, 0.0);
        for row in self.term[cell.levels.len()].chunks_exact(self.width) {
            for (sum, t) in values.iter_mut().zip(row) {
                *sum += t;
            }
        }
        for (value, top) in values.iter_mut().zip(&self.top) {
            *value *= top.exp();
        }
        values.truncate(cell.points.len());
    }

    /// The density's derivative with respect to the logarithm of each kernel, a row per atom, into `shares`.
    /// From the root down: a child's share is its node's, times the node's power, times the child's part of the node's
    /// sum. (Reverse differentiation of the tree; ratios of terms are all that is needed, so nothing leaves the range.)
    #[inline(always)]
    fn shares_into(&self, cell: &SampleCell, shares: &mut Vec<f64>, below: &mut Vec<f64>) {
        let (depth, n) = (cell.levels.len(), self.width);
        shares.clear();
        let mut scale = self.top.clone();
        exp_all(&mut scale);
        for row in self.term[depth].chunks_exact(n) {
            shares.extend(row.iter().zip(&scale).map(|(t, scale)| t * scale));
        }
        for l in (0..depth).rev() {
            let level = &cell.levels[l];
            below.resize(self.term[l].len(), 0.0);
            for (v, share) in shares.chunks_exact(n).enumerate() {
                let children = level.children(v);
                let terms = &self.term[l][children.start * n..children.end * n];
                let out = &mut below[children.start * n..children.end * n];
                scale.fill(0.0);
                for row in terms.chunks_exact(n) {
                    for (sum, t) in scale.iter_mut().zip(row) {
                        *sum += t;
                    }
                }
                for (own, share) in scale.iter_mut().zip(share) {
                    *own = share * level.power[v] / *own;
                }
                for (out, row) in out.chunks_exact_mut(n).zip(terms.chunks_exact(n)) {
                    for ((out, t), own) in out.iter_mut().zip(row).zip(&scale) {
                        *out = t * own;
                    }
                }
            }
            std::mem::swap(shares, below);
        }
    }
}

/// `terms = exp(lns − top)` with the largest logarithm of each point as `top`; 0 without terms, as where no atom of the
/// cell matters.
#[inline(always)]
fn relative(lns: &[f64], terms: &mut [f64], top: &mut [f64]) {
    if lns.is_empty() {
        top.fill(0.0);
        return;
    }
    let n = top.len();
    top.copy_from_slice(&lns[..n]);
    for row in lns.chunks_exact(n) {
        for (top, &ln) in top.iter_mut().zip(row) {
            *top = if ln > *top { ln } else { *top };
        }
    }
    for (terms, lns) in terms.chunks_exact_mut(n).zip(lns.chunks_exact(n)) {
        for ((t, ln), top) in terms.iter_mut().zip(lns).zip(&*top) {
            *t = ln - top;
        }
    }
    exp_all(terms);
}

/// `factor = exp(power · below − top)`.
/// It is what a node's sum to its power must be multiplied by to be a term among its siblings.
#[inline(always)]
fn scale_of(below: &[f64], power: f64, top: &[f64], factor: &mut [f64]) {
    for ((factor, below), top) in factor.iter_mut().zip(below).zip(top) {
        *factor = power * below - top;
    }
    exp_all(factor);
}

/// The sums at the points of a cell, as they stand, in rows of `width` points.
/// Elimination holds those of every cell at once: so it keeps terms as f32, which take half the memory, and sums them in
/// f64. The sum of the root is f64 and changed by differences, which is safe, since what is left is never tiny beside it.
#[derive(Clone, Debug, Default)]
pub(crate) struct CellSums<T> {
    width: usize,
    /// Terms, level by level, atoms first.
    terms: Vec<T>,
    /// Factors of the nodes, level by level.
    factors: Vec<T>,
    /// The sum of the root's terms.
    total: Vec<f64>,
    /// The scale of the root's terms.
    scale: Vec<f64>,
}

/// A row of terms that a removal changes, and what it changes to.
#[derive(Clone, Debug, Default)]
pub(crate) struct ChangedRow {
    /// Its place among all rows, counted from the atoms up.
    row: usize,
    values: Vec<f64>,
}

/// A number that terms are kept as.
/// f64 to measure each atom once, f32 to keep what the loop of elimination changes.
pub(crate) trait Kept: Copy + Into<f64> {
    /// Rounded to the nearest.
    fn of(value: f64) -> Self;
}
impl Kept for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
}
impl Kept for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
}

impl<T: Kept> CellSums<T> {
    #[inline(always)]
    pub(crate) fn fill(&mut self, cell: &SampleCell, terms: &Terms) {
        self.width = terms.width;
        self.terms.clear();
        self.terms
            .extend(terms.term.iter().flatten().map(|&t| T::of(t)));
        self.factors.clear();
        self.factors
            .extend(terms.factor.iter().flatten().map(|&f| T::of(f)));
        self.scale.clear();
        self.scale.extend_from_slice(&terms.top);
        exp_all(&mut self.scale);
        self.total.clear();
        self.total.resize(self.width, 0.0);
        let first = (cell.nodes() - cell.children_of_root()) * self.width;
        for row in self.terms[first..].chunks_exact(self.width) {
            for (total, &t) in self.total.iter_mut().zip(row) {
                *total += t.into();
            }
        }
    }

    /// The density at the points with the term of atom `k` replaced by nothing, into `left`. Calls `note`
    /// with each row that changes on the way, and what it changes to.
    /// The siblings of each node on the way from the atom to the root are summed anew, so nothing is lost to
    /// cancellation: with a power of 0.05 an error of 1e-16 would become 0.16. The cost is the number of these
    /// siblings, times the points.
    #[inline(always)]
    pub(crate) fn without(
        &self,
        cell: &SampleCell,
        k: usize,
        left: &mut Vec<f64>,
        mut note: impl FnMut(usize, &[f64]),
    ) {
        let n = self.width;
        left.clear();
        left.resize(n, 0.0);
        let row = |i: usize| &self.terms[i * n..][..n];
        let (mut child, mut first, mut first_factor) = (k, 0, 0);
        for (l, level) in cell.levels.iter().enumerate() {
            note(first + child, left);
            let node = cell.parents[l][child] as usize;
            for c in level.children(node).filter(|&c| c != child) {
                for (sum, &t) in left.iter_mut().zip(row(first + c)) {
                    *sum += t.into();
                }
            }
            raise(left, level.power[node]);
            let factors = &self.factors[(first_factor + node) * n..][..n];
            for (value, &f) in left.iter_mut().zip(factors) {
                *value *= f.into();
            }
            first += *level.first_child.last().expect("starts with 0") as usize;
            first_factor += level.len();
            child = node;
        }
        note(first + child, left);
        // The root's terms are all of the density: what is left of it is never small beside it.
        let old = row(first + child);
        for (((value, &old), total), scale) in
            left.iter_mut().zip(old).zip(&self.total).zip(&self.scale)
        {
            *value = (total - old.into() + *value) * scale;
        }
        left.truncate(cell.points.len());
    }

    /// Does the atom matter at any point?
    /// A removed one does not, and one whose terms are 0 in f32 never did.
    #[inline(always)]
    fn matters(&self, k: usize) -> bool {
        let mut row = self.terms[k * self.width..][..self.width].iter();
        row.any(|&t| t.into() > 0.0)
    }
}

impl CellSums<f32> {
    /// The largest share of its target that a point of the cell loses without atom `k`; `left` is for reuse.
    /// 0 for an atom that does not matter here, and where the density stays above the target.
    pub(crate) fn loss_without(&self, cell: &SampleCell, k: usize, left: &mut Vec<f64>) -> f64 {
        autovectorized(
            #[inline(always)]
            || loss(self, cell, k, left),
        )
    }

    /// Removes atom `k`; `left` and `changed` are for reuse.
    /// Every row that [`CellSums::without`] notes is replaced, the atom's own by zeros. Scales and factors stay those
    /// of the start: terms only fall, from a largest of 1.
    pub(crate) fn remove(
        &mut self,
        cell: &SampleCell,
        k: usize,
        left: &mut Vec<f64>,
        changed: &mut Vec<ChangedRow>,
    ) {
        autovectorized(
            #[inline(always)]
            || remove(self, cell, k, left, changed),
        );
    }
}

/// As [`CellSums::remove`], to be compiled for the instruction set at hand; so are the functions of the same kind
/// below.
#[inline(always)]
fn remove(
    sums: &mut CellSums<f32>,
    cell: &SampleCell,
    k: usize,
    left: &mut Vec<f64>,
    changed: &mut Vec<ChangedRow>,
) {
    let n = sums.width;
    if !sums.matters(k) {
        return;
    }
    let mut count = 0;
    sums.without(cell, k, left, |row, values| {
        if count == changed.len() {
            changed.push(ChangedRow::default());
        }
        let own = &mut changed[count];
        own.row = row;
        own.values.clear();
        own.values.extend_from_slice(values);
        count += 1;
    });
    let changed = &changed[..count];
    let last = changed.last().expect("the root has a child").row;
    let old = &sums.terms[last * n..][..n];
    for (total, &old) in sums.total.iter_mut().zip(old) {
        *total -= f64::from(old);
    }
    for ChangedRow { row, values } in changed {
        for (t, &value) in sums.terms[row * n..][..n].iter_mut().zip(values) {
            *t = value as f32;
        }
    }
    let new = &sums.terms[last * n..][..n];
    for (total, &new) in sums.total.iter_mut().zip(new) {
        *total += f64::from(new);
    }
}

#[inline(always)]
fn loss(sums: &CellSums<f32>, cell: &SampleCell, k: usize, left: &mut Vec<f64>) -> f64 {
    if !sums.matters(k) {
        return 0.0;
    }
    sums.without(cell, k, left, |_, _| ());
    let points = left.iter().zip(&cell.target);
    points.fold(0.0, |worst: f64, (left, target)| {
        worst.max((target - left) / target)
    })
}

/// Reusable arrays of one thread.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    terms: Terms,
    sums: CellSums<f64>,
    left: Vec<f64>,
    below: Vec<f64>,
}

#[inline(always)]
fn sums(cell: &SampleCell, model: &Model, scratch: &mut Scratch) -> CellSums<f32> {
    let mut sums = CellSums::default();
    scratch.terms.fill(cell, model);
    sums.fill(cell, &scratch.terms);
    sums
}

/// The sums of a cell, ready for removals.
/// 4 bytes per point and atom, and 8 per point and node above the atoms: a term and a factor.
pub(crate) fn sums_of_cell(
    cell: &SampleCell,
    model: &Model,
    scratch: &mut Scratch,
) -> CellSums<f32> {
    autovectorized(
        #[inline(always)]
        || sums(cell, model, scratch),
    )
}

#[inline(always)]
fn values(cell: &SampleCell, model: &Model, scratch: &mut Scratch) -> Vec<f64> {
    scratch.terms.fill(cell, model);
    scratch.terms.values_into(cell, &mut scratch.left);
    scratch.left.clone()
}

/// The density at the points of a cell.
pub(crate) fn values_of_cell(cell: &SampleCell, model: &Model, scratch: &mut Scratch) -> Vec<f64> {
    autovectorized(
        #[inline(always)]
        || values(cell, model, scratch),
    )
}

#[inline(always)]
fn errors(cell: &SampleCell, model: &Model, scratch: &mut Scratch) -> Vec<f64> {
    let Scratch {
        terms, sums, left, ..
    } = scratch;
    terms.fill(cell, model);
    sums.fill(cell, terms);
    (0..cell.atoms.len())
        .map(|k| {
            sums.without(cell, k, left, |_, _| ());
            let changes = left.iter().zip(&cell.target).map(|(left, target)| {
                let change = ((target - left) / target).max(0.0);
                change * change
            });
            changes.sum()
        })
        .collect()
}

/// Squared relative changes of the density without each atom, summed over the points of a cell
/// (Eq. 3.9 squared, corrected).
/// One per atom of the cell; where the density without an atom is still above the target nothing is counted.
pub(crate) fn errors_of_cell(cell: &SampleCell, model: &Model, scratch: &mut Scratch) -> Vec<f64> {
    autovectorized(
        #[inline(always)]
        || errors(cell, model, scratch),
    )
}

#[inline(always)]
fn refit(cell: &SampleCell, model: &Model, scratch: &mut Scratch) -> RefitSums {
    let atoms = cell.atoms.len();
    let mut sums = RefitSums {
        gradient: vec![[0.0; 5]; atoms],
        curvature: vec![[0.0; 5]; atoms],
        ..RefitSums::default()
    };
    let Scratch {
        terms,
        left: values,
        below,
        ..
    } = scratch;
    terms.fill(cell, model);
    terms.values_into(cell, values);
    let n = terms.width;
    // Points that are there for the lanes have no weight.
    let (mut off, mut weight) = (vec![0.0; n], vec![0.0; n]);
    for (p, (value, exact)) in values.iter().zip(&cell.exact).enumerate() {
        off[p] = (value - exact) / exact;
        weight[p] = 1.0 / exact;
        sums.objective += 0.5 * off[p] * off[p];
        sums.worst = sums.worst.max(off[p].abs());
    }
    let shares = values;
    terms.shares_into(cell, shares, below);
    let [x, y, z] = [0, 1, 2].map(|k| &terms.at[k][..n]);
    for (i, (&a, shares)) in cell.atoms.iter().zip(shares.chunks_exact(n)).enumerate() {
        let a = a as usize;
        let (center, r, kappa) = (model.centers()[a], model.radii()[a], model.decays()[a]);
        let (mut gradient, mut curvature) = ([[0.0f64; LANES]; 5], [[0.0f64; LANES]; 5]);
        for start in (0..n).step_by(LANES) {
            let lanes = start..start + LANES;
            let (x, y, z) = (&x[lanes.clone()], &y[lanes.clone()], &z[lanes.clone()]);
            let (off, weight) = (&off[lanes.clone()], &weight[lanes.clone()]);
            let shares = &shares[lanes];
            for p in 0..LANES {
                let share = shares[p] * weight[p];
                let d = [x[p] - center.x, y[p] - center.y, z[p] - center.z];
                let pull = 2.0 * kappa * share;
                let inside = r * r - (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
                let slopes = [
                    pull * d[0],
                    pull * d[1],
                    pull * d[2],
                    pull * r,
                    share * inside,
                ];
                for k in 0..5 {
                    gradient[k][p] += off[p] * slopes[k];
                    curvature[k][p] += slopes[k] * slopes[k];
                }
            }
        }
        sums.gradient[i] = gradient.map(|lanes| lanes.iter().sum());
        sums.curvature[i] = curvature.map(|lanes| lanes.iter().sum());
    }
    sums
}

/// The sums of one cell, per atom of the cell.
pub(crate) fn refit_of_cell(cell: &SampleCell, model: &Model, scratch: &mut Scratch) -> RefitSums {
    autovectorized(
        #[inline(always)]
        || refit(cell, model, scratch),
    )
}
