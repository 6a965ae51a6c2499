//! Points near the surface where a change of the atoms is measured, in cells that share the atoms that
//! matter there.

use geom_core::grid::{BRICK, Brick};
use geom_core::{Aabb, BrickGrid, ImplicitField, Lattice, LatticeValues, Point3};
use rayon::prelude::*;

use crate::error::Error;
use crate::members::{self, Members};
use crate::model::{Level, Model};
use crate::point::PointSampler;
#[cfg(feature = "testing")]
use crate::prepared::Prepared;
use crate::terms;

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

    /// Nodes of the topmost level, or atoms.
    pub(crate) fn children_of_root(&self) -> usize {
        self.levels.last().map_or(self.atoms.len(), Level::len)
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
    let cap = match wanted.interior {
        Some(_) => wanted.band[1],
        None => f64::INFINITY,
    };
    cells
        .par_iter_mut()
        .for_each_init(terms::Scratch::default, |scratch, cell| {
            cell.exact = terms::values_of_cell(cell, model, scratch);
            cell.target = cell.exact.iter().map(|g| g.min(cap)).collect();
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
                        found.push(root_on_edge(sampler, grid, p, q));
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

/// Where the density is 1 on a lattice edge that crosses the surface, within 1e-6 of it: a bracket, and in it
/// inverse interpolation of the density's logarithm, from the grid's values at the ends.
pub(crate) fn root_on_edge(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    p: [usize; 3],
    q: [usize; 3],
) -> Point3 {
    let (start, end) = (grid.lattice().point(p), grid.lattice().point(q));
    let [first, last] = [p, q].map(|end| f64::from(grid.at(end)).max(1e-30).ln());
    // Places on the edge and the logarithms there; `before` was the last end of the bracket to go.
    let (mut low, mut high, mut before) = ((0.0, first), (1.0, last), None);
    let mut x = start;
    for round in 0..20 {
        let straight = interpolated(&[low, high]);
        let curved = before.and_then(|before| interpolated(&[low, high, before]));
        let within = |t: &f64| *t > low.0 && *t < high.0;
        let guess = curved.filter(within).or(straight.filter(within));
        let middle = 0.5 * (low.0 + high.0);
        // Halved now and then, should the guesses stay on one side.
        let t = guess.filter(|_| round % 6 < 5).unwrap_or(middle);
        x = start + (end - start) * t;
        let f = sampler.value(&x).ln();
        if f.abs() < 1e-6 {
            break;
        }
        // As the callers have it, 0 is inside.
        let gone = if (f >= 0.0) == (low.1 >= 0.0) {
            std::mem::replace(&mut low, (t, f))
        } else {
            std::mem::replace(&mut high, (t, f))
        };
        before = Some(gone);
    }
    x
}

/// Where a function is 0, given places and its values there, by the polynomial that has the places as its values;
/// `None` if two values are the same.
fn interpolated(known: &[(f64, f64)]) -> Option<f64> {
    let weighted = known.iter().enumerate().map(|(i, (place, own))| {
        let others = known.iter().enumerate().filter(|(j, _)| *j != i);
        let weights = others.map(|(_, (_, f))| f / (f - own));
        place * weights.product::<f64>()
    });
    Some(weighted.sum()).filter(|t: &f64| t.is_finite())
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
        cell.exact = terms::values_of_cell(&cell, model.model(), &mut terms::Scratch::default());
        cell.target = cell.exact.clone();
        cell
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Cutoff, Options};
    use crate::testing::globule;
    use geom_core::{Cpu, Run};

    #[test]
    fn interpolation_finds_zeros() {
        assert_eq!(interpolated(&[(0.0, 1.0), (2.0, -1.0)]), Some(1.0));
        assert_eq!(interpolated(&[(0.0, 1.0), (2.0, 1.0)]), None);
        // Places that are quadratic in the values: 3 + f − f²/2.
        let known = [-1.0, 0.5, 2.0].map(|f: f64| (3.0 + f - 0.5 * f * f, f));
        let zero = interpolated(&known).unwrap();
        assert!((zero - 3.0).abs() < 1e-12, "{zero}");
    }

    /// Where the density is 1, within what the cut-offs of grid and sampler allow.
    #[test]
    fn roots_lie_on_the_surface() {
        let structure = globule(2, 40, 5);
        for residue_power in [1.0, 0.25] {
            let levels = crate::Levels {
                residue_power,
                decay: 0.5,
                ..crate::Levels::default()
            };
            let model = Model::uniform(&structure, &levels).unwrap();
            let cutoff = Cutoff::AfterPowers(1e-7);
            let sampler = PointSampler::above(0.25, &model, cutoff).unwrap();
            let options = Options {
                spacing: 1.0,
                cutoff,
                ..Options::default()
            };
            let grid = crate::sample_band(&model, &options, Run::on(&Cpu))
                .unwrap()
                .grid;
            let (mut roots, counts) = (0, grid.lattice().counts);
            for b in 0..grid.bricks().iter().product() {
                for_points(grid.lattice(), grid.brick_coordinates(b), |p| {
                    for axis in 0..3 {
                        let mut q = p;
                        q[axis] += 1;
                        if q[axis] < counts[axis] && (grid.at(p) >= 1.0) != (grid.at(q) >= 1.0) {
                            let root = root_on_edge(&sampler, &grid, p, q);
                            let off = sampler.value(&root).ln().abs();
                            assert!(off < 1e-6, "{off:e} between {p:?} and {q:?}");
                            roots += 1;
                        }
                    }
                });
            }
            assert!(roots > 1000, "{roots} roots");
        }
    }

    /// A sample right on the surface counts as inside, and is the root.
    #[test]
    fn roots_may_be_samples() {
        let mut exact = 0;
        for decay in [0.3, 0.5, 0.7, 1.0, 1.3] {
            let mut structure = globule(1, 1, 5).filter(|atom| atom == 0);
            for atom in structure.atoms_mut() {
                (atom.position, atom.radius) = (Point3::origin(), 2.0);
            }
            let levels = crate::Levels {
                decay,
                ..crate::Levels::default()
            };
            let model = Model::uniform(&structure, &levels).unwrap();
            let [min, max] = [-6.0, 6.0].map(|x| Point3::from([x; 3]));
            let options = Options {
                spacing: 1.0,
                bounds: Some(geom_core::Aabb::new(min, max)),
                ..Options::default()
            };
            let sampler = PointSampler::above(0.25, &model, options.cutoff).unwrap();
            let sampled = crate::sample_band(&model, &options, Run::on(&Cpu));
            let grid = sampled.unwrap().grid;
            let [p, q] = [[8, 6, 6], [9, 6, 6]];
            if grid.at(p) >= 1.0 {
                let root = root_on_edge(&sampler, &grid, p, q);
                assert!((root - Point3::new(2.0, 0.0, 0.0)).norm() < 1e-5, "{root}");
                exact += usize::from(grid.at(p) == 1.0);
            }
        }
        assert!(exact > 0, "no sample is right on the surface");
    }
}
