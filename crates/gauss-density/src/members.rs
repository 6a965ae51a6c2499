//! The atoms that matter in a box, with their tree: gathered from the model, then culled.
//!
//! [`Members::cull`] is the cut-off after the powers. It keeps, for a closed box, a part of the tree such
//! that `(1 − ε) G ≤ G̃ ≤ G` wherever `G` reaches `floor` in the box. The proof goes down the tree. Let a
//! node have the sum `S` over its children, the allowed relative error `ρ` of `S`, and a level `θ` below
//! which `S` does not matter. Where `S ≥ θ`:
//!
//! * children whose terms sum to at most `ρ S / 4` may be dropped (relative test): with a reference leaf
//!   `b` below the node, `S ≥ exp(−w q_b)`, and `D_c exp(w q_b)` is bounded over the box exactly, because
//!   the difference of two power distances is a sum of three one-dimensional quadratics;
//! * children whose terms sum to at most `ρ θ / 8` may be dropped (absolute test);
//! * a kept child (of `n`) does not matter where its term is below `ρ θ / 8n`, so its own level is the
//!   `1/P`-th power of that;
//! * a kept child may lose the share `ρ / 4` of its term, or `ρ / 4n` of the bound on its share of `S`,
//!   whichever is larger; a share `δ` of a sum becomes at most `max(1, P) δ` of its power.
//!
//! Together `ρ/4 + ρ/8 + ρ/8 + (ρ/4 + ρ/4) = ρ`.

use geom_core::{Aabb, Point3, Vector3};

use crate::model::Level;
use crate::plain::Compiled;

/// Some atoms of a model in hierarchy order, as a structure of arrays, with the part of the tree above
/// them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Members {
    /// Index of each atom in the model, ascending.
    pub(crate) atom: Vec<u32>,
    pub(crate) center: Vec<Point3>,
    pub(crate) decay: Vec<f64>,
    pub(crate) radius: Vec<f64>,
    /// Lowest first, as in the model, without the nodes that have no atom here.
    pub(crate) levels: Vec<Level>,
}

/// A closed box as centre and half edges.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    pub(crate) center: Point3,
    pub(crate) half: Vector3,
}

impl From<&Aabb> for Cell {
    fn from(b: &Aabb) -> Self {
        // A hair wider, so that rounding does not leave the box's own corners outside.
        let half = (b.max - b.min) * 0.5;
        Self {
            center: b.min + half,
            half: half * (1.0 + 1e-12) + Vector3::repeat(1e-9),
        }
    }
}

impl Members {
    /// Gathers atoms (ascending) from the model.
    pub(crate) fn gather(tree: &Compiled<'_>, atoms: &[u32]) -> Self {
        let model = tree.model;
        let mut members = Self {
            atom: atoms.to_vec(),
            center: Vec::with_capacity(atoms.len()),
            decay: Vec::with_capacity(atoms.len()),
            radius: Vec::with_capacity(atoms.len()),
            levels: Vec::with_capacity(tree.levels.len()),
        };
        for &a in atoms {
            members.center.push(model.centers()[a as usize]);
            members.decay.push(model.decays()[a as usize]);
            members.radius.push(model.radii()[a as usize]);
        }
        let mut below = atoms.to_vec();
        for (parent, level) in tree.parent.iter().zip(&tree.levels) {
            let mut nodes: Vec<u32> = Vec::new();
            let mut kept = Level {
                first_child: Vec::new(),
                power: Vec::new(),
            };
            for (i, &child) in below.iter().enumerate() {
                let node = parent[child as usize];
                if nodes.last() != Some(&node) {
                    nodes.push(node);
                    kept.first_child.push(i as u32);
                    kept.power.push(level.power[node as usize]);
                }
            }
            kept.first_child.push(below.len() as u32);
            members.levels.push(kept);
            below = nodes;
        }
        members
    }

    pub(crate) fn len(&self) -> usize {
        self.atom.len()
    }

    /// Children of the root: nodes of the topmost level, or atoms.
    fn top(&self) -> usize {
        self.levels.last().map_or(self.len(), Level::len)
    }

    /// The atoms with `keep`, and the nodes above them.
    fn select_into(&self, keep: &[bool], out: &mut Self) {
        out.atom.clear();
        out.center.clear();
        out.decay.clear();
        out.radius.clear();
        out.levels.resize_with(self.levels.len(), || Level {
            first_child: Vec::new(),
            power: Vec::new(),
        });
        for i in (0..self.len()).filter(|&i| keep[i]) {
            out.atom.push(self.atom[i]);
            out.center.push(self.center[i]);
            out.decay.push(self.decay[i]);
            out.radius.push(self.radius[i]);
        }
        // `count[c]`: how many of the first c children are kept, so starts are differences of it.
        let mut count: Vec<u32> = Vec::with_capacity(self.len() + 1);
        count.push(0);
        for i in 0..self.len() {
            count.push(count[i] + u32::from(keep[i]));
        }
        for (level, kept) in self.levels.iter().zip(&mut out.levels) {
            kept.first_child.clear();
            kept.power.clear();
            kept.first_child.push(0);
            let mut above = Vec::with_capacity(level.len() + 1);
            above.push(0);
            for v in 0..level.len() {
                let end = count[level.first_child[v + 1] as usize];
                let full = end > count[level.first_child[v] as usize];
                if full {
                    kept.first_child.push(end);
                    kept.power.push(level.power[v]);
                }
                above.push(above[v] + u32::from(full));
            }
            count = above;
        }
    }

    /// Keeps in `out` what matters in the box, see the module's page. Returns `ln` of an upper bound of the
    /// density of the members in the box.
    pub(crate) fn cull_into(
        &self,
        cell: &Cell,
        eps: f64,
        floor: f64,
        scratch: &mut Scratch,
        out: &mut Self,
    ) -> f64 {
        let up = scratch.prepare(self, cell);
        if floor > 0.0 && up < (floor).ln() {
            // Nothing reaches the floor: everything may go.
            scratch.keep.clear();
            scratch.keep.resize(self.len(), false);
        } else {
            scratch.keep.clear();
            scratch.keep.resize(self.len(), true);
            let root = Budget {
                rho: eps,
                theta: floor.ln(),
            };
            let top = self.top() as u32;
            Cull {
                members: self,
                cell,
                scratch,
            }
            .node(self.levels.len(), 0..top, root);
        }
        self.select_into(&scratch.keep, out);
        up
    }
}

impl Members {
    /// Keeps in `out` the atoms whose kernel reaches `eps` somewhere in the box. Returns `ln` of an upper
    /// bound of the density of the members in the box.
    pub(crate) fn within_into(
        &self,
        cell: &Cell,
        eps: f64,
        scratch: &mut Scratch,
        out: &mut Self,
    ) -> f64 {
        let up = scratch.prepare(self, cell);
        scratch.keep.clear();
        scratch
            .keep
            .extend(scratch.up[0].iter().map(|&u| u >= eps.ln()));
        self.select_into(&scratch.keep, out);
        up
    }
}

/// What a node may lose: a share of its sum, where the logarithm of the sum is at least `theta`.
#[derive(Clone, Copy)]
struct Budget {
    rho: f64,
    theta: f64,
}

/// Reusable arrays of a cull.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Offset of the box centre from each atom, and the power distance there.
    offset: Vec<Vector3>,
    q: Vec<f64>,
    /// Per level: `ln` of the upper bound of `D` in the box, per node.
    up: Vec<Vec<f64>>,
    /// Per level: the leaf whose contribution at the box centre is largest, and `ln` of it, per node.
    best: Vec<Vec<(f64, u32, f64)>>,
    keep: Vec<bool>,
    order: Vec<(f64, u32)>,
}

impl Scratch {
    /// Fills the arrays for a box; returns `ln` of the upper bound of the root's sum.
    fn prepare(&mut self, members: &Members, cell: &Cell) -> f64 {
        let n = members.len();
        self.offset.clear();
        self.q.clear();
        let mut up = Vec::with_capacity(n);
        let mut best = Vec::with_capacity(n);
        for i in 0..n {
            let t = cell.center - members.center[i];
            let (kappa, r) = (members.decay[i], members.radius[i]);
            let q = kappa * (t.norm_squared() - r * r);
            let out = Vector3::new(
                (t.x.abs() - cell.half.x).max(0.0),
                (t.y.abs() - cell.half.y).max(0.0),
                (t.z.abs() - cell.half.z).max(0.0),
            );
            self.offset.push(t);
            self.q.push(q);
            up.push(kappa * (r * r - out.norm_squared()));
            best.push((-q, i as u32, 1.0));
        }
        self.up.clear();
        self.best.clear();
        self.up.push(up);
        self.best.push(best);
        for level in &members.levels {
            let (mut up, mut best) = (Vec::new(), Vec::new());
            let (below, best_below) = (self.up.last(), self.best.last());
            let (below, best_below) = (below.expect("pushed"), best_below.expect("pushed"));
            for v in 0..level.len() {
                let power = level.power[v];
                up.push(power * ln_sum(&below[level.children(v)]));
                let (ln, leaf, weight) = largest(&best_below[level.children(v)]);
                best.push((power * ln, leaf, power * weight));
            }
            self.up.push(up);
            self.best.push(best);
        }
        ln_sum(self.up.last().expect("pushed"))
    }
}

pub(crate) fn largest(of: &[(f64, u32, f64)]) -> (f64, u32, f64) {
    of.iter().copied().fold(
        (f64::NEG_INFINITY, 0, 1.0),
        |a, b| if b.0 > a.0 { b } else { a },
    )
}

fn ln_sum(terms: &[f64]) -> f64 {
    let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY || terms.len() == 1 {
        return top;
    }
    let far = top - 40.0;
    let sum: f64 = terms
        .iter()
        .filter(|&&t| t > far)
        .map(|t| (t - top).exp())
        .sum();
    // What is left out is below n e⁻⁴⁰.
    top + (sum + terms.len() as f64 * 4.3e-18).ln()
}

struct Cull<'a> {
    members: &'a Members,
    cell: &'a Cell,
    scratch: &'a mut Scratch,
}

impl Cull<'_> {
    /// Culls below a node whose children are `children` on level `level − 1` (atoms below level 0 … are
    /// "level −1", so `level` counts from 0 for residues).
    fn node(&mut self, level: usize, children: std::ops::Range<u32>, budget: Budget) {
        let n = children.len();
        if n == 0 {
            return;
        }
        let range = children.start as usize..children.end as usize;
        let (_, reference, weight) = largest(&self.scratch.best[level][range.clone()]);
        // Absolute test.
        let ln_floor = (budget.rho / 8.0).ln() + budget.theta;
        let mut order = std::mem::take(&mut self.scratch.order);
        order.clear();
        for c in range.clone() {
            let up = self.scratch.up[level][c];
            if up <= ln_floor {
                order.push((up, c as u32));
            }
        }
        let mut gone = drop_smallest(&mut order, ln_floor);
        for &(_, c) in &order[..gone] {
            self.drop(level, c as usize);
        }
        // Relative test.
        let ln_share = (budget.rho / 4.0).ln();
        let mut relative: Vec<(f64, u32)> = Vec::with_capacity(n);
        for c in range {
            if self.alive(level, c) {
                let bound = self.relative(level, c, weight, reference as usize);
                relative.push((bound, c as u32));
            }
        }
        order.clear();
        order.extend(relative.iter().filter(|r| r.0 <= ln_share));
        gone = drop_smallest(&mut order, ln_share);
        for &(_, c) in &order[..gone] {
            self.drop(level, c as usize);
        }
        self.scratch.order = order;
        if level == 0 {
            return;
        }
        let kept = relative.len() - gone;
        for (bound, c) in relative {
            let c = c as usize;
            if !self.alive(level, c) {
                continue;
            }
            let own = &self.members.levels[level - 1];
            let power = own.power[c];
            let share = (budget.rho / (4.0 * kept as f64) * (-bound).exp()).max(budget.rho / 4.0);
            let below = Budget {
                rho: (share / power.max(1.0)).min(0.5),
                theta: ((budget.rho / (8.0 * kept as f64)).ln() + budget.theta) / power,
            };
            let children = own.first_child[c]..own.first_child[c + 1];
            self.node(level - 1, children, below);
        }
    }

    /// Is anything kept below child `c` of a node on `level`?
    fn alive(&self, level: usize, c: usize) -> bool {
        let (first, _) = self.leaves(level, c);
        // Dropped whole or not at all at this stage.
        self.scratch.keep[first]
    }

    fn drop(&mut self, level: usize, c: usize) {
        let (first, end) = self.leaves(level, c);
        self.scratch.keep[first..end].fill(false);
    }

    /// The atoms below child `c` of a node on `level`.
    fn leaves(&self, level: usize, c: usize) -> (usize, usize) {
        let (mut first, mut end) = (c, c + 1);
        for l in (0..level).rev() {
            let starts = &self.members.levels[l].first_child;
            (first, end) = (starts[first] as usize, starts[end] as usize);
        }
        (first, end)
    }

    /// `ln` of an upper bound of `D_c exp(w q_b)` in the box, for child `c` of a node on `level`.
    fn relative(&self, level: usize, c: usize, w: f64, b: usize) -> f64 {
        if level == 0 {
            return self.bracket(c, w, b);
        }
        let own = &self.members.levels[level - 1];
        let power = own.power[c];
        let children = own.children(c);
        let n = children.len() as f64;
        let mut top = f64::NEG_INFINITY;
        for child in children {
            top = top.max(self.relative(level - 1, child, w / power, b));
        }
        power * (top + n.ln())
    }

    /// The maximum of `w q_b − q_a` over the box, exactly.
    fn bracket(&self, a: usize, w: f64, b: usize) -> f64 {
        let (s, m) = (&*self.scratch, self.members);
        let (ka, kb) = (m.decay[a], w * m.decay[b]);
        let curvature = kb - ka;
        let slope = (s.offset[b] * kb - s.offset[a] * ka) * 2.0;
        let mut value = w * s.q[b] - s.q[a];
        for k in 0..3 {
            let (slope, half) = (slope[k].abs(), self.cell.half[k]);
            value += if curvature < 0.0 && slope < -2.0 * curvature * half {
                slope * slope / (-4.0 * curvature)
            } else {
                (curvature * half + slope) * half
            };
        }
        value
    }
}

/// Sorts terms and says how many of the smallest may go while their sum stays at or below `exp(budget)`.
fn drop_smallest(terms: &mut [(f64, u32)], budget: f64) -> usize {
    terms.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut sum = 0.0;
    for (i, &(ln, _)) in terms.iter().enumerate() {
        sum += (ln - budget).exp();
        if sum > 1.0 {
            return i;
        }
    }
    terms.len()
}
