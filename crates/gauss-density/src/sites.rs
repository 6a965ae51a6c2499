//! Points near the surface where a change of the atoms is measured, in cells that share the atoms that
//! matter there; and the sums of the tree at such a point, ready for "without this atom".

use geom_core::grid::{BRICK, Brick};
use geom_core::{Aabb, BrickGrid, ImplicitField, Lattice, LatticeValues, Point3};
use rayon::prelude::*;

use crate::error::Error;
use crate::members::{self, Members};
use crate::model::{Level, Model};
use crate::point::PointSampler;
#[cfg(feature = "testing")]
use crate::prepared::Prepared;

/// Points that share the atoms that matter around them.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteCell {
    /// Atoms, ascending.
    pub atoms: Vec<u32>,
    /// The tree above them, lowest level first.
    pub(crate) levels: Vec<Level>,
    /// Per level: the node above each atom (level 0) or node.
    pub(crate) parents: Vec<Vec<u32>>,
    /// The points.
    pub points: Vec<Point3>,
    /// The density of all original atoms at each point.
    pub exact: Vec<f64>,
    /// What counts as the full density at each point: the density, or less in the interior.
    pub target: Vec<f64>,
}

impl SiteCell {
    /// The points whose density is at least `floor`.
    pub(crate) fn at_least(mut self, floor: f64) -> Self {
        let kept: Vec<usize> = (0..self.points.len())
            .filter(|&i| self.exact[i] >= floor)
            .collect();
        self.points = kept.iter().map(|&i| self.points[i]).collect();
        self.target = kept.iter().map(|&i| self.target[i]).collect();
        self.exact = kept.iter().map(|&i| self.exact[i]).collect();
        self
    }

    /// Nodes of all levels and atoms.
    pub(crate) fn nodes(&self) -> usize {
        self.atoms.len() + self.levels.iter().map(Level::len).sum::<usize>()
    }
}

/// Which points are wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wanted {
    /// Lattice points with a density in this band (open).
    pub(crate) band: [f64; 2],
    /// Both ends of the lattice edges that cross the surface.
    pub(crate) ends: bool,
    /// Every `n`-th lattice point, per axis, of the interior, with the upper end of the band as the target.
    pub(crate) interior: Option<usize>,
    /// The share of the density that the atoms left out may amount to.
    pub(crate) eps: f64,
    /// Most bytes that the cells may take.
    pub(crate) max_memory: u64,
}

/// Side of a cell, Å: small enough that most of its atoms matter at each of its points.
const CELL: f64 = 3.0;
/// Cells per side of a group that shares a first cull.
const GROUP: i64 = 6;

/// The wanted points of a sampled band, crossings of lattice edges included, in cells.
pub(crate) fn collect(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    wanted: &Wanted,
) -> Result<Vec<SiteCell>, Error> {
    let prepared = sampler.prepared();
    let lattice = *grid.lattice();
    let points = points_of(sampler, grid, wanted);
    let lists = points.len() as u128 * 600;
    if lists > u128::from(wanted.max_memory) {
        return Err(Error::TooManySites {
            sites: points.len(),
            bytes: lists,
            limit: wanted.max_memory,
        });
    }
    let origin = lattice.origin;
    let cell_of = |x: &Point3| -> [i64; 3] {
        std::array::from_fn(|k| ((x[k] - origin[k]) / CELL).floor() as i64)
    };
    let mut keyed: Vec<([i64; 3], [i64; 3], usize)> = points
        .iter()
        .enumerate()
        .map(|(i, x)| {
            let cell = cell_of(x);
            (cell.map(|c| c.div_euclid(GROUP)), cell, i)
        })
        .collect();
    keyed.par_sort_unstable();
    let groups: Vec<_> = keyed.chunk_by(|a, b| a.0 == b.0).collect();
    let floor = 0.5 * wanted.band[0];
    let reach = prepared.reach.radius(wanted.eps / 4.0, floor);
    let clusters = prepared.clusters();
    let cells: Vec<Vec<SiteCell>> = groups
        .par_iter()
        .map_init(members::Scratch::default, |scratch, group| {
            let cells: Vec<_> = group.chunk_by(|a, b| a.1 == b.1).collect();
            let around = Aabb::of_points(group.iter().map(|k| &points[k.2]));
            let near = prepared.near(&clusters, &around, reach);
            let all = Members::gather(&prepared.tree, &prepared.atoms_near(&near, &around, reach));
            let mut kept = Members::default();
            cells
                .into_iter()
                .map(|cell| {
                    let points: Vec<Point3> = cell.iter().map(|k| points[k.2]).collect();
                    let around = Aabb::of_points(&points);
                    let eps = 0.75 * wanted.eps;
                    all.cull_into(&(&around).into(), eps, floor, scratch, &mut kept);
                    SiteCell::new(kept.atom.clone(), kept.levels.clone(), points)
                })
                .collect()
        })
        .collect();
    let mut cells: Vec<SiteCell> = cells.into_iter().flatten().collect();
    let model = prepared.model();
    cells.par_iter_mut().for_each(|cell| {
        let mut terms = Terms::default();
        for i in 0..cell.points.len() {
            terms.fill(cell, model, &cell.points[i]);
            let exact = terms.value(cell);
            cell.exact.push(exact);
            let cap = match wanted.interior {
                Some(_) => wanted.band[1],
                None => f64::INFINITY,
            };
            cell.target.push(exact.min(cap));
        }
    });
    Ok(cells)
}

fn points_of(sampler: &PointSampler<'_>, grid: &BrickGrid, wanted: &Wanted) -> Vec<Point3> {
    let lattice = *grid.lattice();
    let [nx, ny, nz] = grid.bricks();
    let [low, high] = wanted.band;
    let lists: Vec<Vec<Point3>> = (0..nx * ny * nz)
        .into_par_iter()
        .map(|b| {
            let brick = grid.brick_coordinates(b);
            let mut found = Vec::new();
            let kind = grid.brick(brick);
            if kind == Brick::Exterior {
                return found;
            }
            if kind == Brick::Interior && wanted.interior.is_none() && !wanted.ends {
                return found;
            }
            for_points(&lattice, brick, |p| {
                let g = f64::from(grid.at(p));
                let stride = |n: usize| p.iter().all(|c| c % n == 0);
                let inside = wanted.interior.is_some_and(|n| g >= high && stride(n));
                let mut take = (g > low && g < high) || inside;
                for axis in 0..3 {
                    let mut q = p;
                    q[axis] += 1;
                    let crosses = |q: [usize; 3]| (f64::from(grid.at(q)) >= 1.0) != (g >= 1.0);
                    if q[axis] < lattice.counts[axis] && crosses(q) {
                        found.push(root_on_edge(sampler, &lattice, p, q));
                        take |= wanted.ends;
                    }
                    if wanted.ends && p[axis] > 0 {
                        q[axis] -= 2;
                        take |= crosses(q);
                    }
                }
                if take {
                    found.push(lattice.point(p));
                }
            });
            found
        })
        .collect();
    lists.concat()
}

/// The lattice points of a brick, x fastest.
pub(crate) fn for_points(lattice: &Lattice, brick: [usize; 3], mut f: impl FnMut([usize; 3])) {
    let first = brick.map(|b| b * BRICK);
    let last = [0, 1, 2].map(|k| (first[k] + BRICK).min(lattice.counts[k]));
    for z in first[2]..last[2] {
        for y in first[1]..last[1] {
            for x in first[0]..last[0] {
                f([x, y, z]);
            }
        }
    }
}

/// Where the density is 1 on a lattice edge that crosses the surface: regula falsi on its logarithm.
pub(crate) fn root_on_edge(
    sampler: &PointSampler<'_>,
    lattice: &Lattice,
    p: [usize; 3],
    q: [usize; 3],
) -> Point3 {
    let (mut a, mut b) = (lattice.point(p), lattice.point(q));
    let (mut fa, mut fb) = (sampler.value(&a).ln(), sampler.value(&b).ln());
    let mut x = a;
    for _ in 0..20 {
        let t = if (fa > 0.0) == (fb > 0.0) || !(fa - fb).is_normal() {
            0.5
        } else {
            (fa / (fa - fb)).clamp(0.05, 0.95)
        };
        x = a + (b - a) * t;
        let f = sampler.value(&x).ln();
        if f.abs() < 1e-9 {
            break;
        }
        if (f > 0.0) == (fa > 0.0) {
            (a, fa) = (x, f);
        } else {
            (b, fb) = (x, f);
        }
    }
    x
}

impl SiteCell {
    pub(crate) fn new(atoms: Vec<u32>, levels: Vec<Level>, points: Vec<Point3>) -> Self {
        let parents = levels
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
            atoms,
            levels,
            parents,
            exact: Vec::with_capacity(points.len()),
            target: Vec::with_capacity(points.len()),
            points,
        }
    }

    /// A cell of given points and atoms (ascending) of a model, for tests: the target is the density of these.
    #[cfg(feature = "testing")]
    pub fn of_points(model: &Prepared<'_>, atoms: &[u32], points: Vec<Point3>) -> Self {
        let members = Members::gather(&model.tree, atoms);
        let mut cell = Self::new(members.atom, members.levels, points);
        let mut terms = Terms::default();
        for i in 0..cell.points.len() {
            terms.fill(&cell, model.model(), &cell.points[i]);
            let exact = terms.value(&cell);
            cell.exact.push(exact);
            cell.target.push(exact);
        }
        cell
    }
}

/// The terms of the tree of a cell at one point: each child's `D` relative to its largest sibling's, so
/// that nothing underflows before the powers, and sums without one child are exact.
#[derive(Clone, Debug, Default)]
pub(crate) struct Terms {
    /// Per level (atoms first): the term of each child.
    pub(crate) term: Vec<Vec<f64>>,
    /// Per level: `term = sum^P · factor` for each node.
    factor: Vec<Vec<f64>>,
    /// `ln` of the scale of the root's terms.
    top: f64,
    ln: Vec<f64>,
    above: Vec<f64>,
    tops: Vec<f64>,
    tops_above: Vec<f64>,
}

/// `sum^power`, fast for the powers that are common.
#[inline]
pub(crate) fn raised(sum: f64, power: f64) -> f64 {
    if power == 1.0 {
        sum
    } else if power == 0.5 {
        sum.sqrt()
    } else if power == 0.25 {
        sum.sqrt().sqrt()
    } else {
        sum.powf(power)
    }
}

impl Terms {
    /// Evaluates the tree at a point.
    pub(crate) fn fill(&mut self, cell: &SiteCell, model: &Model, x: &Point3) {
        let depth = cell.levels.len();
        self.term.resize_with(depth + 1, Vec::new);
        self.factor.resize_with(depth, Vec::new);
        let (centers, radii, decays) = (model.centers(), model.radii(), model.decays());
        self.ln.clear();
        self.ln.extend(cell.atoms.iter().map(|&a| {
            let a = a as usize;
            decays[a] * (radii[a] * radii[a] - (x - centers[a]).norm_squared())
        }));
        self.tops.clear();
        for (l, level) in cell.levels.iter().enumerate() {
            let term = &mut self.term[l];
            term.clear();
            self.above.clear();
            self.tops_above.clear();
            for v in 0..level.len() {
                let children = level.children(v);
                let lns = &self.ln[children.clone()];
                let top = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let mut sum = 0.0;
                for &ln in lns {
                    let t = (ln - top).exp();
                    term.push(t);
                    sum += t;
                }
                self.above.push(level.power[v] * (sum.ln() + top));
                self.tops_above.push(top);
                // The factors of the children, now that the scale of their terms is known.
                if l > 0 {
                    let below = &cell.levels[l - 1];
                    for c in children {
                        let own = below.power[c] * self.tops[c] - top;
                        self.factor[l - 1][c] = own.exp();
                    }
                }
            }
            self.factor[l].clear();
            self.factor[l].resize(level.len(), 0.0);
            std::mem::swap(&mut self.ln, &mut self.above);
            std::mem::swap(&mut self.tops, &mut self.tops_above);
        }
        self.top = self.ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let root = &mut self.term[depth];
        root.clear();
        root.extend(self.ln.iter().map(|ln| (ln - self.top).exp()));
        if let Some(level) = cell.levels.last() {
            for c in 0..level.len() {
                self.factor[depth - 1][c] = (level.power[c] * self.tops[c] - self.top).exp();
            }
        }
    }

    /// The density.
    pub(crate) fn value(&self, cell: &SiteCell) -> f64 {
        self.term[cell.levels.len()].iter().sum::<f64>() * self.top.exp()
    }

    /// `exp` of the scale of the root's terms.
    pub(crate) fn scale(&self) -> f64 {
        self.top.exp()
    }

    /// The factors of all nodes, level by level.
    pub(crate) fn factors(&self) -> impl Iterator<Item = f64> + '_ {
        self.factor.iter().flatten().copied()
    }

    /// Adds the density's derivative with respect to the logarithm of each kernel to `shares`.
    pub(crate) fn shares(&self, cell: &SiteCell, shares: &mut Vec<f64>, below: &mut Vec<f64>) {
        let depth = cell.levels.len();
        shares.clear();
        shares.extend(self.term[depth].iter().map(|t| t * self.top.exp()));
        for l in (0..depth).rev() {
            let level = &cell.levels[l];
            below.clear();
            for (v, &share) in shares.iter().enumerate() {
                let terms = &self.term[l][level.children(v)];
                let own = share * level.power[v] / terms.iter().sum::<f64>();
                below.extend(terms.iter().map(|t| t * own));
            }
            std::mem::swap(shares, below);
        }
    }
}

/// The sum at the root, in units of the root's scale, with the term of atom `k` replaced by nothing.
/// `terms` and `factors` are flat, level by level. Calls `note` with each changed term on the way.
pub(crate) fn without<T: Copy + Into<f64>>(
    cell: &SiteCell,
    terms: &[T],
    factors: &[T],
    k: usize,
    mut note: impl FnMut(usize, f64),
) -> f64 {
    let (mut child, mut value) = (k, 0.0);
    let (mut first, mut first_factor) = (0, 0);
    let width = |l: usize| {
        if l == 0 {
            cell.atoms.len()
        } else {
            cell.levels[l - 1].len()
        }
    };
    for (l, level) in cell.levels.iter().enumerate() {
        note(first + child, value);
        let node = cell.parents[l][child] as usize;
        let mut sum = 0.0;
        for c in level.children(node) {
            sum += if c == child {
                value
            } else {
                terms[first + c].into()
            };
        }
        value = raised(sum, level.power[node]) * factors[first_factor + node].into();
        first += width(l);
        first_factor += level.len();
        child = node;
    }
    note(first + child, value);
    let mut sum = 0.0;
    for c in 0..width(cell.levels.len()) {
        sum += if c == child {
            value
        } else {
            terms[first + c].into()
        };
    }
    sum
}

/// Squared relative changes of the density without each atom, summed over the points of a cell
/// (Eq. 3.9 squared, corrected).
pub(crate) fn errors_of_cell(cell: &SiteCell, model: &Model) -> Vec<f64> {
    let mut sums = vec![0.0; cell.atoms.len()];
    let mut terms = Terms::default();
    let (mut flat, mut factors) = (Vec::new(), Vec::new());
    for (x, &target) in cell.points.iter().zip(&cell.target) {
        terms.fill(cell, model, x);
        flat.clear();
        flat.extend(terms.term.iter().flatten().copied());
        factors.clear();
        factors.extend(terms.factors());
        let scale = terms.scale();
        for (k, sum) in sums.iter_mut().enumerate() {
            let left = without(cell, &flat, &factors, k, |_, _| ()) * scale;
            let change = ((target - left) / target).max(0.0);
            *sum += change * change;
        }
    }
    sums
}

/// What a refit step needs from a set of points: see [`DensityBackend`](crate::DensityBackend).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RefitSums {
    /// `½ Σ w (G − G0)²` with `w = 1 / G0²`.
    pub objective: f64,
    /// The largest `|G − G0| / G0`.
    pub worst: f64,
    /// Per atom: `Σ w (G − G0) ∂G/∂p` for p = x, y, z, r, κ.
    pub gradient: Vec<[f64; 5]>,
    /// Per atom: `Σ w (∂G/∂p)²`.
    pub curvature: Vec<[f64; 5]>,
}

/// The sums of one cell, per atom of the cell.
pub(crate) fn refit_of_cell(cell: &SiteCell, model: &Model) -> RefitSums {
    let n = cell.atoms.len();
    let mut sums = RefitSums {
        gradient: vec![[0.0; 5]; n],
        curvature: vec![[0.0; 5]; n],
        ..RefitSums::default()
    };
    let mut terms = Terms::default();
    let (mut shares, mut below) = (Vec::new(), Vec::new());
    for (x, &exact) in cell.points.iter().zip(&cell.exact) {
        terms.fill(cell, model, x);
        let off = (terms.value(cell) - exact) / exact;
        sums.objective += 0.5 * off * off;
        sums.worst = sums.worst.max(off.abs());
        terms.shares(cell, &mut shares, &mut below);
        for (i, &a) in cell.atoms.iter().enumerate() {
            let slopes = slopes(model, a as usize, x, shares[i] / exact);
            for (p, slope) in slopes.into_iter().enumerate() {
                sums.gradient[i][p] += off * slope;
                sums.curvature[i][p] += slope * slope;
            }
        }
    }
    sums
}

/// `∂G/∂(x, y, z, r, κ)` of an atom at a point, from its share `∂G/∂ ln g`.
pub(crate) fn slopes(model: &Model, a: usize, x: &Point3, share: f64) -> [f64; 5] {
    let (decay, radius) = (model.decays()[a], model.radii()[a]);
    let d = x - model.centers()[a];
    let pull = 2.0 * decay * share;
    [
        pull * d.x,
        pull * d.y,
        pull * d.z,
        pull * radius,
        share * (radius * radius - d.norm_squared()),
    ]
}

/// Adds the sums of cells, in their order, to the sums per atom of the model.
pub(crate) fn scatter<T, const N: usize>(
    cells: &[SiteCell],
    parts: &[T],
    atoms: usize,
    values: impl Fn(&T, usize) -> [f64; N],
) -> Vec<[f64; N]> {
    let mut sums = vec![[0.0; N]; atoms];
    for (cell, part) in cells.iter().zip(parts) {
        for (i, &a) in cell.atoms.iter().enumerate() {
            for (sum, value) in sums[a as usize].iter_mut().zip(values(part, i)) {
                *sum += value;
            }
        }
    }
    sums
}
