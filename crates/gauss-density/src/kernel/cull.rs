//! The atoms that matter in a box, with their tree: gathered from the model, then culled.
//!
//! [`ActiveSet::cull_into`] is the cut-off after the powers. It keeps, for a closed box, a part of the tree such
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
//!
//! All bounds are logarithms in f64. The cost is that of a pass over the members, of which most are dropped by a bound
//! that needs no exponential; the tree is never searched. Children are dropped by size and kept in the order of the
//! model, so that sums over what is kept do not depend on who culled.

use std::ops::Range;

use geom_core::{Point3, Vector3};

use crate::kernel::boxes::Cell;
use crate::kernel::prepared::Prepared;
use crate::model::Level;

/// Some atoms of a model in hierarchy order, as a structure of arrays, with the part of the tree above
/// them.
#[derive(Clone, Debug, Default)]
pub(crate) struct ActiveSet {
    /// Index of each atom in the model, ascending.
    pub(crate) atom: Vec<u32>,
    pub(crate) center: Vec<Point3>,
    pub(crate) decay: Vec<f64>,
    pub(crate) radius: Vec<f64>,
    /// Lowest first, as in the model, without the nodes that have no atom here.
    pub(crate) levels: Vec<Level>,
}

impl ActiveSet {
    /// Gathers atoms (ascending) from the model.
    /// A node appears if one of its atoms does, so the levels are found by one pass over the parents, level by level.
    pub(crate) fn gather(tree: &Prepared<'_>, atoms: &[u32]) -> Self {
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

    /// The atoms to keep, and the nodes above them.
    /// Reads `scratch.keep`, one flag per atom; nodes that are left without children go too, up to the top.
    fn select_into(&self, scratch: &mut Scratch, out: &mut Self) {
        let keep = &scratch.keep;
        out.atom.clear();
        out.center.clear();
        out.decay.clear();
        out.radius.clear();
        out.levels.resize_with(self.levels.len(), || Level {
            first_child: Vec::new(),
            power: Vec::new(),
        });
        // `count[c]`: how many of the first c children are kept, so starts are differences of it.
        let [count, above] = &mut scratch.places;
        count.clear();
        count.push(0);
        let mut kept = 0;
        for (i, &keep) in keep.iter().enumerate() {
            if keep {
                out.atom.push(self.atom[i]);
                out.center.push(self.center[i]);
                out.decay.push(self.decay[i]);
                out.radius.push(self.radius[i]);
                kept += 1;
            }
            count.push(kept);
        }
        for (level, kept) in self.levels.iter().zip(&mut out.levels) {
            kept.first_child.clear();
            kept.power.clear();
            kept.first_child.push(0);
            above.clear();
            above.push(0);
            let mut full = 0;
            let mut start = 0;
            for (&end, &power) in level.first_child[1..].iter().zip(&level.power) {
                let end = count[end as usize];
                if end > start {
                    kept.first_child.push(end);
                    kept.power.push(power);
                    full += 1;
                }
                start = end;
                above.push(full);
            }
            std::mem::swap(count, above);
        }
    }

    /// Keeps in `out` what matters in the box, see the module's page. Returns `ln` of an upper bound of the
    /// density of the members in the box.
    /// Where that is below `floor`, nothing is kept. With a floor of 0 nothing is so small that it does not matter, and
    /// only the relative test drops.
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
            let top = 0..self.top();
            Cull {
                members: self,
                cell,
                scratch,
            }
            .node(self.levels.len(), top, root);
        }
        self.select_into(scratch, out);
        up
    }
}

/// What a node may lose: a share of its sum, where the logarithm of the sum is at least `theta`.
/// A logarithm of minus infinity as `theta`: the share must hold however small the sum is.
#[derive(Clone, Copy)]
struct Budget {
    rho: f64,
    theta: f64,
}

/// Reusable arrays of a cull. Per level means: atoms, nodes of level 0, nodes of level 1, …
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Offset of the box centre from each atom.
    offset: Vec<Vector3>,
    /// Power distance of each atom at the box centre.
    q: Vec<f64>,
    /// Per level: `ln` of an upper bound of `D` in the box, per node.
    up: Vec<Vec<f64>>,
    /// Per level above the atoms: the leaf whose contribution at the box centre is largest, per node.
    best: Vec<Vec<Best>>,
    /// Per atom: is it kept?
    keep: Vec<bool>,
    /// Bounds of the children of the nodes on the way from the root.
    bounds: Vec<f64>,
    /// Places of the kept ones among the children, for [`ActiveSet::select_into`].
    places: [Vec<u32>; 2],
}

/// The leaf below a node that contributes most at the centre of the box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    /// `ln` of its term there, `−weight · q`.
    pub(crate) ln: f64,
    pub(crate) leaf: u32,
    /// Product of the powers from the node (included) down to the leaf.
    pub(crate) weight: f64,
}

/// `ln n` for small `n`.
/// From a table, since every node of every cull asks; larger ones are computed.
fn ln_count(n: usize) -> f64 {
    static TABLE: std::sync::LazyLock<[f64; 64]> =
        std::sync::LazyLock::new(|| std::array::from_fn(|n| (n as f64).ln()));
    TABLE.get(n).copied().unwrap_or_else(|| (n as f64).ln())
}

impl Scratch {
    /// Fills the arrays for a box; returns `ln` of an upper bound of the root's sum.
    /// Upper bounds are monotone: each atom is taken at the point of the box that is nearest to it, and what sums and
    /// powers make of larger terms is larger. The points differ from atom to atom, so no point of the box need have
    /// that density.
    fn prepare(&mut self, members: &ActiveSet, cell: &Cell) -> f64 {
        let depth = members.levels.len();
        self.up.resize_with(depth + 1, Vec::new);
        self.best.resize_with(depth + 1, Vec::new);
        let n = members.len();
        // What is overwritten anyway need not be cleared.
        self.offset.resize(n, Vector3::zeros());
        self.q.resize(n, 0.0);
        self.up[0].resize(n, 0.0);
        let atoms = members
            .center
            .iter()
            .zip(&members.decay)
            .zip(&members.radius);
        let into = self.offset.iter_mut().zip(&mut self.q).zip(&mut self.up[0]);
        for (((center, &kappa), &r), ((offset, q), up)) in atoms.zip(into) {
            let t = cell.center - center;
            let out = Vector3::new(
                (t.x.abs() - cell.half.x).max(0.0),
                (t.y.abs() - cell.half.y).max(0.0),
                (t.z.abs() - cell.half.z).max(0.0),
            );
            *offset = t;
            *q = kappa * (t.norm_squared() - r * r);
            *up = kappa * (r * r - out.norm_squared());
        }
        for (l, level) in members.levels.iter().enumerate() {
            let (below, above) = self.up.split_at_mut(l + 1);
            let (up, below) = (&mut above[0], &below[l]);
            let (best_below, above) = self.best.split_at_mut(l + 1);
            let (best, best_below) = (&mut above[0], &best_below[l]);
            up.clear();
            best.clear();
            for (v, &power) in level.power.iter().enumerate() {
                let children = level.children(v);
                let sum = if l == 0 {
                    // Few terms: their number times the largest is near enough, and needs no exponential.
                    let terms = &below[children.clone()];
                    let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                    top + ln_count(terms.len())
                } else {
                    ln_sum(&below[children.clone()])
                };
                up.push(power * sum);
                let top = match l {
                    0 => nearest(&self.q, children),
                    _ => largest(&best_below[children]),
                };
                best.push(Best {
                    ln: power * top.ln,
                    leaf: top.leaf,
                    weight: power * top.weight,
                });
            }
        }
        ln_sum(&self.up[depth])
    }
}

/// The atom of a range that contributes most: the one with the smallest power distance.
fn nearest(q: &[f64], range: Range<usize>) -> Best {
    let (mut leaf, mut least) = (range.start, q[range.start]);
    for a in range {
        if q[a] < least {
            (leaf, least) = (a, q[a]);
        }
    }
    Best {
        ln: -least,
        leaf: leaf as u32,
        weight: 1.0,
    }
}

/// The one that contributes most, the first of equal ones.
pub(crate) fn largest(of: &[Best]) -> Best {
    let mut top = of[0];
    for b in &of[1..] {
        if b.ln > top.ln {
            top = *b;
        }
    }
    top
}

/// `ln Σ exp`, or slightly more: terms that are 25 or more below the largest are counted as `e⁻²⁵ = 1.39e-11` each,
/// without an exponential.
fn ln_sum(terms: &[f64]) -> f64 {
    let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY || terms.len() == 1 {
        return top;
    }
    let far = top - 25.0;
    let (mut sum, mut left_out) = (0.0, 0);
    for &t in terms {
        if t > far {
            sum += (t - top).exp();
        } else {
            left_out += 1;
        }
    }
    top + (sum + f64::from(left_out) * 1.4e-11).ln()
}

/// The way down the tree for one box. A node drops children, then hands the rest what they may lose.
struct Cull<'a> {
    members: &'a ActiveSet,
    cell: &'a Cell,
    scratch: &'a mut Scratch,
}

impl Cull<'_> {
    /// Culls below a node whose children are `children` among the nodes of level `level − 1`, or among the
    /// atoms for `level` 0.
    /// Bounds of the children stay on a stack in the scratch while their own children are culled: a recursion as deep
    /// as the tree, without an allocation per node.
    fn node(&mut self, level: usize, children: Range<usize>, budget: Budget) {
        let n = children.len();
        if n == 1 {
            // Nothing to drop here: the child may lose what the node may.
            if level > 0 {
                let power = self.members.levels[level - 1].power[children.start];
                let below = Budget {
                    rho: budget.rho / power.max(1.0),
                    theta: budget.theta / power,
                };
                let grandchildren = self.members.levels[level - 1].children(children.start);
                self.node(level - 1, grandchildren, below);
            }
            return;
        }
        let top = match level {
            0 => nearest(&self.scratch.q, children.clone()),
            _ => largest(&self.scratch.best[level][children.clone()]),
        };
        let first = self.scratch.bounds.len();
        let ln_rho = budget.rho.ln();
        // Most children are so far that the extremes of both terms over the box are enough.
        let most = self.farthest(top.leaf as usize) * top.weight;
        let small = ln_rho - 4.0f64.ln() - ln_count(n);
        for c in children.clone() {
            let rough = self.scratch.up[level][c] + most;
            let bound = if rough <= small {
                rough
            } else {
                self.relative(level, c, top.weight, top.leaf as usize)
            };
            self.scratch.bounds.push(bound);
        }
        // Relative test: a dropped child gets the bound −∞ below.
        let mut test = Greedy::new(ln_rho - 4.0f64.ln(), n);
        for (i, c) in children.clone().enumerate() {
            let bound = self.scratch.bounds[first + i];
            if test.takes_small(bound) {
                self.drop(level, c);
                self.scratch.bounds[first + i] = f64::NEG_INFINITY;
            }
        }
        for (i, c) in children.clone().enumerate() {
            let bound = self.scratch.bounds[first + i];
            if bound > f64::NEG_INFINITY && test.takes(bound) {
                self.drop(level, c);
                self.scratch.bounds[first + i] = f64::NEG_INFINITY;
            }
        }
        // Absolute test.
        let ln_floor = ln_rho - 8.0f64.ln() + budget.theta;
        let mut kept = 0;
        let mut test = Greedy::new(ln_floor, n);
        for (i, c) in children.clone().enumerate() {
            if self.scratch.bounds[first + i] == f64::NEG_INFINITY {
                continue;
            }
            let up = self.scratch.up[level][c];
            if up <= ln_floor && test.takes(up) {
                self.drop(level, c);
                self.scratch.bounds[first + i] = f64::NEG_INFINITY;
            } else {
                kept += 1;
            }
        }
        if level > 0 {
            let own = &self.members.levels[level - 1];
            let ln_kept = ln_count(kept);
            for (i, c) in children.enumerate() {
                let bound = self.scratch.bounds[first + i];
                if bound == f64::NEG_INFINITY {
                    continue;
                }
                let grandchildren = own.children(c);
                if level == 1 && grandchildren.len() == 1 {
                    continue;
                }
                let power = own.power[c];
                // The larger of ρ/4 and ρ/4n over the bound on the child's share.
                let of_share = -ln_kept - bound;
                let more = if of_share > 0.0 { of_share.exp() } else { 1.0 };
                let below = Budget {
                    rho: (0.25 * budget.rho * more / power.max(1.0)).min(0.5),
                    theta: (ln_floor - ln_kept) / power,
                };
                self.node(level - 1, grandchildren, below);
            }
        }
        self.scratch.bounds.truncate(first);
    }

    /// Drops a child with all atoms below it, which are a run since children are contiguous.
    fn drop(&mut self, level: usize, c: usize) {
        let (mut first, mut end) = (c, c + 1);
        for l in (0..level).rev() {
            let starts = &self.members.levels[l].first_child;
            (first, end) = (starts[first] as usize, starts[end] as usize);
        }
        self.scratch.keep[first..end].fill(false);
    }

    /// The largest power distance of an atom in the box.
    /// At the corner that lies farthest from it.
    fn farthest(&self, a: usize) -> f64 {
        let t = self.scratch.offset[a].abs() + self.cell.half;
        let r = self.members.radius[a];
        self.members.decay[a] * (t.norm_squared() - r * r)
    }

    /// `ln` of an upper bound of `D_c exp(w q_b)` in the box, for child `c` of a node on `level`.
    /// With `D_c = S_c^P` it is the `P`-th power of `S_c exp(w/P q_b)`, which is at most the number of terms times the
    /// largest: so the bound of a node comes from those of its atoms, with `w` divided by each power on the way down.
    fn relative(&self, level: usize, c: usize, w: f64, b: usize) -> f64 {
        if level == 0 {
            return self.bracket(c, w, b);
        }
        let own = &self.members.levels[level - 1];
        let power = own.power[c];
        let children = own.children(c);
        let n = children.len();
        let mut top = f64::NEG_INFINITY;
        if level == 1 {
            let w = w / power;
            for a in children {
                top = top.max(self.bracket(a, w, b));
            }
        } else {
            for child in children {
                top = top.max(self.relative(level - 1, child, w / power, b));
            }
        }
        power * (top + ln_count(n))
    }

    /// The maximum of `w q_b − q_a` over the box, exactly.
    /// Along each axis a quadratic: at an end, or at its vertex where it is concave and the vertex lies inside.
    #[inline]
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

/// Takes terms, given as logarithms, while their sum stays at or below a budget.
/// The relative test takes small ones first, those that would fit however many there were, and then, in order, what still
/// fits: two passes instead of a sort.
struct Greedy {
    ln_budget: f64,
    /// Terms up to this may all be taken, however many of `n` there are.
    small: f64,
    sum: f64,
}

impl Greedy {
    fn new(ln_budget: f64, n: usize) -> Self {
        Self {
            ln_budget,
            small: ln_budget - ln_count(n),
            sum: 0.0,
        }
    }

    /// Takes the term if it is so small that all `n` would fit.
    fn takes_small(&mut self, ln: f64) -> bool {
        ln <= self.small && self.takes(ln)
    }

    /// Takes the term if it still fits. Tiny ones are counted as slightly more than they are, without an exponential.
    fn takes(&mut self, ln: f64) -> bool {
        let off = ln - self.ln_budget;
        if off > 0.0 {
            return false;
        }
        let part = if off < -14.0 { 8.4e-7 } else { off.exp() };
        let fits = self.sum + part <= 1.0;
        if fits {
            self.sum += part;
        }
        fits
    }
}

/// [`Cull::bracket`] of two atoms in a box, for tests.
#[cfg(feature = "testing")]
pub(crate) fn bracket(tree: &Prepared<'_>, cell: &geom_core::Aabb, atoms: [u32; 2], w: f64) -> f64 {
    let members = ActiveSet::gather(tree, &atoms);
    let mut scratch = Scratch::default();
    let cell = cell.into();
    scratch.prepare(&members, &cell);
    let cull = Cull {
        members: &members,
        cell: &cell,
        scratch: &mut scratch,
    };
    cull.bracket(0, w, 1)
}
