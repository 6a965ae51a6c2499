//! Dual vertices: where the point of each cell stands.

use geom_core::mesh::{INTERIOR, Region, six_volume};
use geom_core::{ImplicitField, Point3, Vector3};
use rayon::prelude::*;

use crate::backend::ContourBackend;
use crate::complex::{
    Cell, Complex, Corner, Frame, MIDDLE, Split, corner_of, frame_of_corners, part_base,
};
use crate::cpu::within;
use crate::cut::APEX;
use crate::octree::{Leaf, Octree};
use crate::samples::{Samples, local};
use crate::{Error, Options, Placement};

/// Share of its cell within which a dual vertex stays.
const INSET: f64 = 0.98;
/// How far off its place the point of a leaf larger than the finest may be held, in finest cells: more
/// would stick out of the surface, and the leaf is split instead.
const SPIKE: f64 = 0.5;
/// A moved umbrella tetrahedron keeps at least this share of its volume.
pub(crate) const LEAST_VOLUME: f64 = 1e-3;

/// The points of all cells.
pub(crate) struct Duals {
    /// Per leaf: its place among the moved ones, or `u32::MAX`.
    rank: Vec<u32>,
    leaves: Vec<Point3>,
    /// The points of the half lattice that the point of each leaf larger than the finest follows from.
    frames: Vec<u32>,
    parts: Vec<Point3>,
    /// Ghost cells in order, and their points.
    ghosts: Vec<(u32, u8)>,
    ghost_points: Vec<Point3>,
    /// Cells that were pulled back towards their base to keep volumes positive: place among the moved
    /// ones in order, and how far they are from where they belong.
    held: Vec<(usize, f64)>,
}

/// Finds where edges cross interfaces, and the surface near a point.
pub(crate) struct Probe<'a> {
    pub(crate) samples: &'a Samples<'a>,
    pub(crate) field: Option<&'a dyn ImplicitField>,
    pub(crate) placement: Placement,
}

/// A corner as crossings see it: position in finest cells, label, value.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) x: Point3,
    pub(crate) label: Region,
    pub(crate) value: f64,
}

impl<'a> Probe<'a> {
    pub(crate) fn new(
        samples: &'a Samples<'a>,
        field: Option<&'a dyn ImplicitField>,
        options: &Options,
    ) -> Self {
        Self {
            samples,
            field,
            placement: options.placement,
        }
    }

    /// Is the interface between two labels the level set?
    fn on_level(p: Region, q: Region) -> bool {
        p == INTERIOR || q == INTERIOR
    }

    /// The parameter in `[0, 1]` where the label changes between two corners: linear on the values,
    /// by bisection on the shapes.
    pub(crate) fn crossing(&self, a: &Sample, b: &Sample) -> f64 {
        let level = self.samples.labels.level;
        if Self::on_level(a.label, b.label) {
            let t = (level - a.value) / (b.value - a.value);
            return if t.is_finite() {
                t.clamp(0.0, 1.0)
            } else {
                0.5
            };
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let t = 0.5 * (low + high);
            let x = self.samples.domain.world(&(a.x + (b.x - a.x) * t));
            if self.samples.labels.at(f64::NEG_INFINITY, &x) == a.label {
                low = t;
            } else {
                high = t;
            }
        }
        0.5 * (low + high)
    }

    /// Like [`Probe::crossing`], sharpened on the field if there is one.
    pub(crate) fn exact_crossing(&self, a: &Sample, b: &Sample) -> f64 {
        let t = self.crossing(a, b);
        let Some(field) = self.field.filter(|_| Self::on_level(a.label, b.label)) else {
            return t;
        };
        let level = self.samples.labels.level;
        let at = |t: f64| field.value(&self.samples.domain.world(&(a.x + (b.x - a.x) * t))) - level;
        // False position, with the kept end halved (Illinois): a handful of values instead of twenty.
        let (mut low, mut high) = ((0.0, a.value - level), (1.0, b.value - level));
        let (mut t, mut last) = (t, None);
        for _ in 0..16 {
            let f = at(t);
            let is_low = (f >= 0.0) == (a.value >= level);
            let (moved, kept) = if is_low {
                (&mut low, &mut high)
            } else {
                (&mut high, &mut low)
            };
            *moved = (t, f);
            if last == Some(is_low) {
                kept.1 *= 0.5;
            }
            last = Some(is_low);
            let next = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
            if !next.is_finite() || (next - t).abs() < 1e-4 {
                break;
            }
            t = next.clamp(low.0, high.0);
        }
        t
    }

    /// The point where an edge is cut, away from its ends.
    pub(crate) fn cut(&self, a: &Sample, b: &Sample) -> Point3 {
        a.x + (b.x - a.x) * self.exact_crossing(a, b).clamp(0.05, 0.95)
    }

    /// The field at a point (Å) of the box of the given values, if there is one.
    pub(crate) fn value(&self, x: &Point3) -> Option<f64> {
        self.field
            .filter(|_| self.samples.bounds.contains(x))
            .map(|f| f.value(x))
    }

    /// Value minus level and gradient per finest cell.
    fn value_gradient(&self, cell: [i32; 3], x: &Point3) -> Option<(f64, Vector3)> {
        let level = self.samples.labels.level;
        match self.field {
            Some(field) => {
                let (v, g) = field.value_gradient(&self.samples.domain.world(x));
                Some((v - level, g * self.samples.domain.spacing))
            }
            None => self.samples.trilinear(cell, x).map(|(v, g)| (v - level, g)),
        }
    }

    /// The dual vertex of a box-shaped cell `[low, low + size]` from its crossings.
    fn place(&self, low: [i32; 3], size: f64, crossings: &[(Point3, bool)]) -> Point3 {
        let n = crossings.len() as f64;
        let mass = Point3::from(
            crossings
                .iter()
                .fold(Vector3::zeros(), |s, c| s + c.0.coords)
                / n,
        );
        let centre = local(low).map(|c| c + 0.5 * size);
        let reach = 0.5 * INSET * size;
        let clamp = |x: Point3| {
            Point3::from(
                centre
                    .coords
                    .zip_map(&x.coords, |c, v| v.clamp(c - reach, c + reach)),
            )
        };
        let start = clamp(mass);
        if self.placement == Placement::Mass || crossings.iter().any(|c| !c.1) {
            return start;
        }
        if self.placement == Placement::Qef {
            return clamp(self.nearest_to_planes(low, &mass, crossings));
        }
        let Some((first, mut gradient)) = self.value_gradient(low, &start) else {
            return start;
        };
        let (mut x, mut f) = (start, first);
        let mut best = (start, first.abs());
        for _ in 0..10 {
            let square = gradient.norm_squared();
            if square < 1e-24 {
                break;
            }
            let next = clamp(x - gradient * (f / square));
            let step = (next - x).norm();
            x = next;
            let Some(found) = self.value_gradient(low, &x) else {
                break;
            };
            (f, gradient) = found;
            if f.abs() < best.1 {
                best = (x, f.abs());
            }
            if step < 1e-6 * size || f.abs() < 1e-12 {
                break;
            }
        }
        best.0
    }

    /// Minimizes the squared distances to the tangent planes at the crossings, relative to the mass
    /// point; directions in which the planes say less than a tenth of the most are left out.
    fn nearest_to_planes(
        &self,
        cell: [i32; 3],
        mass: &Point3,
        crossings: &[(Point3, bool)],
    ) -> Point3 {
        let mut normal_matrix = geom_core::nalgebra::Matrix3::zeros();
        let mut right = Vector3::zeros();
        for (x, _) in crossings {
            let Some((f, g)) = self.value_gradient(cell, x) else {
                continue;
            };
            let Some(n) = g.try_normalize(1e-12) else {
                continue;
            };
            let offset = n.dot(&(x - mass)) - f / g.norm();
            normal_matrix += n * n.transpose();
            right += n * offset;
        }
        let eigen = geom_core::nalgebra::SymmetricEigen::new(normal_matrix);
        let most = eigen.eigenvalues.max();
        if most <= 0.0 {
            return *mass;
        }
        let mut x = *mass;
        for k in 0..3 {
            // Eigenvalues are squares of the singular values.
            if eigen.eigenvalues[k] > 0.01 * most {
                let direction = eigen.eigenvectors.column(k).into_owned();
                x += direction * (direction.dot(&right) / eigen.eigenvalues[k]);
            }
        }
        x
    }
}

impl Duals {
    /// All points: at their base, or on the surface. Leaves of the octree `before`, of which some have
    /// been split, keep the points that had arrived.
    pub(crate) fn new<B: ContourBackend + ?Sized>(
        complex: &Complex<'_>,
        probe: &Probe<'_>,
        boxed: bool,
        before: Option<&(Octree, Duals)>,
        backend: &B,
    ) -> Result<Self, Error> {
        let len = complex.tree.leaves.len();
        let moved: Vec<u32> = (0..len as u32)
            .filter(|&id| complex.is_interface(id) && !complex.is_split(id))
            .collect();
        let mut rank = vec![u32::MAX; len];
        for (i, &id) in moved.iter().enumerate() {
            rank[id as usize] = i as u32;
        }
        let frames: Vec<u32> = moved
            .par_iter()
            .with_min_len(1024)
            .map(|&id| match complex.leaf(id).log {
                0 => 0,
                _ => complex.frame(id).used,
            })
            .collect();
        let mut known: Vec<(u32, Option<Point3>)> = moved
            .par_iter()
            .zip(&frames)
            .with_min_len(1024)
            .map(|(&id, &frame)| {
                let arrived =
                    |(tree, duals): &(Octree, Self)| duals.arrived(tree, complex.leaf(id), frame);
                (id, before.and_then(arrived))
            })
            .collect();
        let missing = known.iter().filter(|(_, x)| x.is_none());
        let missing: Vec<u32> = missing.map(|(id, _)| *id).collect();
        let found = leaf_points(complex, probe, &missing, backend)?;
        let missing = known.iter_mut().filter(|(_, x)| x.is_none());
        missing
            .zip(found)
            .for_each(|((_, x), found)| *x = Some(found));
        let leaves = known.into_iter().filter_map(|(_, x)| x).collect();
        let parts = complex
            .splits
            .par_iter()
            .zip(&complex.split_leaves)
            .flat_map_iter(|(split, &id)| {
                let leaf = complex.leaf(id);
                let (o, labels) = (leaf.origin(), complex.corner_labels(leaf));
                let corners = cut_samples(complex.samples, o, &labels, split);
                (0..12).map(move |part| {
                    part_point(probe, split, &corners, part)
                        .unwrap_or_else(|| part_base(split.diagonals, o, part))
                })
            })
            .collect();
        let mut out = Self {
            rank,
            leaves,
            frames,
            parts,
            ghosts: Vec::new(),
            ghost_points: Vec::new(),
            held: Vec::new(),
        };
        if boxed {
            out.ghosts = ghosts(complex);
            out.ghost_points = out
                .ghosts
                .par_iter()
                .map(|&(id, half)| ghost_point(complex, probe, id, half))
                .collect();
        }
        out.keep_positive(complex);
        Ok(out)
    }

    pub(crate) fn ghost_index(&self, id: u32, half: u8) -> u32 {
        self.ghosts
            .binary_search(&(id, half))
            .expect("a ghost stands on the box") as u32
    }

    pub(crate) fn ghosts(&self) -> &[(u32, u8)] {
        &self.ghosts
    }

    /// Place of a leaf among those with a moved point.
    pub(crate) fn rank(&self, leaf: u32) -> Option<u32> {
        Some(self.rank[leaf as usize]).filter(|&r| r != u32::MAX)
    }

    /// The point of a cell, in finest cells.
    #[inline]
    pub(crate) fn position(&self, complex: &Complex<'_>, cell: &Cell) -> Point3 {
        match *cell {
            Cell::Leaf(id) => match self.rank[id as usize] {
                u32::MAX => complex.base_position(cell),
                r => self.leaves[r as usize],
            },
            Cell::Part(k, part) => self.parts[12 * k as usize + part as usize],
            Cell::Ghost(id, half) => self.ghost_points[self.ghost_index(id, half) as usize],
        }
    }

    /// Number of points that do not arrive where they belong.
    pub(crate) fn held_back(&self) -> usize {
        self.held.len()
    }

    /// How far the point of a moved cell is from where it belongs.
    fn lag(&self, moved: usize) -> f64 {
        let place = self.held.binary_search_by_key(&moved, |held| held.0);
        place.map_or(0.0, |i| self.held[i].1)
    }

    /// Leaves larger than the finest whose points stay more than [`SPIKE`] off the surface.
    pub(crate) fn spikes(&self, complex: &Complex<'_>) -> Vec<u32> {
        let is_spike = |&id: &u32| {
            let lag = |rank| self.lag(rank as usize);
            complex.leaf(id).log > 0 && self.rank(id).map_or(0.0, lag) > SPIKE
        };
        (0..self.rank.len() as u32).filter(is_spike).collect()
    }

    /// Where the point of a leaf of an earlier octree has gone, if it arrived, and by the same frame.
    fn arrived(&self, tree: &Octree, leaf: &Leaf, frame: u32) -> Option<Point3> {
        let (id, _) = tree.find(leaf.origin());
        let same = tree.leaves.get(id as usize)?.log == leaf.log;
        let rank = self.rank(id).filter(|_| same)? as usize;
        (self.frames[rank] == frame && self.lag(rank) == 0.0).then(|| self.leaves[rank])
    }

    fn at_mut(&mut self, moved: usize) -> &mut Point3 {
        match moved.checked_sub(self.leaves.len()) {
            None => &mut self.leaves[moved],
            Some(part) => &mut self.parts[part],
        }
    }

    fn moved(&self, cell: &Cell) -> Option<usize> {
        match *cell {
            Cell::Leaf(id) => self.rank(id).map(|r| r as usize),
            Cell::Part(k, part) => Some(self.leaves.len() + 12 * k as usize + part as usize),
            Cell::Ghost(..) => None,
        }
    }

    /// Lets points go from their base to their place only as far as every umbrella tetrahedron (an edge
    /// and two consecutive cells) stays positive. No harm can come from leaves of one size, nor from a
    /// leaf beside a larger one that stands at its base. The tetrahedra of all others are gathered
    /// once; then the points are placed, twice, colour by colour: no two of a colour share one.
    fn keep_positive(&mut self, complex: &Complex<'_>) {
        let harmful =
            |id: u32| complex.is_split(id) || complex.leaf(id).log > 0 && self.rank(id).is_some();
        let mut owners: Vec<u32> = (0..complex.tree.leaves.len() as u32)
            .into_par_iter()
            .with_min_len(4096)
            .filter(|&id| harmful(id))
            .flat_map_iter(|id| {
                // Off the box, of leaves of one size that around an edge emits whose corner begins it.
                let leaf = complex.leaf(id);
                let beyond = leaf.log == 0 && !complex.is_on_box(id);
                let low = leaf.origin();
                complex.tree.touching(id).filter(move |&other| {
                    let o = complex.leaf(other).origin();
                    !beyond || (0..3).all(|k| o[k] >= low[k])
                })
            })
            .collect();
        if owners.is_empty() {
            return;
        }
        owners.par_sort_unstable();
        owners.dedup();
        struct Tet {
            a: Point3,
            b: Point3,
            cells: [Cell; 2],
            least: f64,
        }
        let risky = |c: &Cell, d: &Cell| match (c, d) {
            (Cell::Leaf(i), Cell::Leaf(j)) => {
                let (p, q) = (complex.leaf(*i).log, complex.leaf(*j).log);
                p > q && self.rank(*i).is_some() || q > p && self.rank(*j).is_some()
            }
            (Cell::Ghost(..), _) | (_, Cell::Ghost(..)) => false,
            _ => true,
        };
        let tets: Vec<Tet> = owners
            .into_par_iter()
            .with_min_len(256)
            .flat_map_iter(|id| {
                let mut tets = Vec::new();
                complex.rings_of(
                    id,
                    |_, _| true,
                    |ring| {
                        let n = ring.cells.len();
                        for i in 0..if ring.open { n - 1 } else { n } {
                            let cells = [ring.cells[i], ring.cells[(i + 1) % n]];
                            if risky(&cells[0], &cells[1]) {
                                let a = complex.corner_position(ring.a.0);
                                let b = complex.corner_position(ring.b.0);
                                let [c, d] = [0, 1].map(|k| complex.base_position(&cells[k]));
                                tets.push(Tet {
                                    a,
                                    b,
                                    cells,
                                    least: LEAST_VOLUME * six_volume([a, b, c, d]),
                                });
                            }
                        }
                    },
                );
                tets
            })
            .collect();
        // Tetrahedra per moved point, points by colour.
        let mut around: Vec<(u16, u32, u32)> = tets
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .flat_map_iter(|(i, t)| {
                let moved = t
                    .cells
                    .iter()
                    .filter_map(|c| Some((colour(complex, c), self.moved(c)?)));
                moved.map(move |(colour, m)| (colour, m as u32, i as u32))
            })
            .collect();
        around.par_sort_unstable();
        struct Free<'a> {
            moved: usize,
            base: Point3,
            target: Point3,
            share: f64,
            tets: &'a [(u16, u32, u32)],
        }
        let mut points: Vec<Free<'_>> = around
            .chunk_by(|x, y| x.1 == y.1)
            .map(|group| {
                let moved = group[0].1 as usize;
                let of = |c: &&Cell| self.moved(c) == Some(moved);
                let cell = tets[group[0].2 as usize].cells.iter().find(of);
                Free {
                    moved,
                    base: complex.base_position(cell.expect("one of the two has moved")),
                    target: *self.at_mut(moved),
                    share: 0.0,
                    tets: group,
                }
            })
            .filter(|p| p.target != p.base)
            .collect();
        for p in &points {
            *self.at_mut(p.moved) = p.base;
        }
        for _ in 0..2 {
            for group in points.chunk_by_mut(|x, y| x.tets[0].0 == y.tets[0].0) {
                group.par_iter_mut().with_min_len(8).for_each(|p| {
                    if p.share == 1.0 {
                        return;
                    }
                    let ends = [&p.base, &p.target];
                    p.share = farthest(p.share, ends, p.tets.len(), |i, x| {
                        let tet = &tets[p.tets[i].2 as usize];
                        let [c, d] = [0, 1].map(|k| {
                            let cell = &tet.cells[k];
                            if self.moved(cell) == Some(p.moved) {
                                *x
                            } else {
                                self.position(complex, cell)
                            }
                        });
                        six_volume([tet.a, tet.b, c, d]) - tet.least
                    });
                });
                for p in group {
                    *self.at_mut(p.moved) = p.base + (p.target - p.base) * p.share;
                }
            }
        }
        self.held = points
            .iter()
            .filter(|p| p.share < 1.0)
            .map(|p| (p.moved, (1.0 - p.share) * (p.target - p.base).norm()))
            .collect();
        self.held.sort_unstable_by_key(|held| held.0);
    }
}

/// How far a point may go from its base to its place: the longest of some shares of the way, beyond
/// `share`, at which none of `n` tetrahedra lacks volume; else `share` itself. `spare(i, x)` is what
/// tetrahedron `i` has above its least volume with the point at `x`: linear on the way.
pub(crate) fn farthest(
    share: f64,
    [base, target]: [&Point3; 2],
    n: usize,
    spare: impl Fn(usize, &Point3) -> f64,
) -> f64 {
    if (0..n).all(|i| spare(i, target) > 0.0) {
        return 1.0;
    }
    longest(share, (0..n).map(|i| [base, target].map(|x| spare(i, x))))
}

/// The longest of some shares of the way beyond `share`, given what tetrahedra have above their least
/// volumes at its ends, if not all have some at its end.
pub(crate) fn longest(share: f64, spares: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for [first, last] in spares {
        if first <= 0.0 && last <= 0.0 {
            return share;
        }
        let t = first / (first - last);
        if last <= 0.0 {
            high = high.min(t);
        } else if first <= 0.0 {
            low = low.max(t);
        }
    }
    let mut t = 0.75;
    while t > share + 1e-3 && t >= 0.05 {
        if low < t && t < high {
            return t;
        }
        t *= 0.75;
    }
    share
}

/// A number that two cells with a common edge share only if they are one: leaves by size and parity,
/// parts by the parity of their leaf, then their place in it.
fn colour(complex: &Complex<'_>, cell: &Cell) -> u16 {
    let of = |id: u32| {
        let leaf = complex.leaf(id);
        let parity = (0..3)
            .map(|k| (leaf.origin()[k] >> leaf.log & 1) << k)
            .sum::<i32>();
        (parity as u16, u16::from(leaf.log))
    };
    match *cell {
        Cell::Leaf(id) | Cell::Ghost(id, _) => {
            let (parity, log) = of(id);
            8 * log + parity
        }
        Cell::Part(k, part) => {
            let (parity, _) = of(complex.split_leaves[k as usize]);
            8 * 32 + 12 * parity + u16::from(part)
        }
    }
}

/// The ghost cells of a box that is part of the mesh, in order.
pub(crate) fn ghosts(complex: &Complex<'_>) -> Vec<(u32, u8)> {
    (0..complex.tree.leaves.len() as u32)
        .into_par_iter()
        .with_min_len(1024)
        .flat_map_iter(|id| {
            let leaf = complex.leaf(id);
            let (o, s) = (leaf.origin(), leaf.size());
            let halves = if complex.is_split(id) { 2 } else { 1 };
            let outer = move |face: usize| {
                let (axis, side) = (face / 2, face % 2);
                !leaf.void
                    && if side == 0 {
                        o[axis] == 0
                    } else {
                        o[axis] + s == complex.tree.cells[axis]
                    }
            };
            (0..6usize)
                .filter(move |&f| outer(f))
                .flat_map(move |f| (0..halves).map(move |h| (id, (2 * f + h) as u8)))
        })
        .collect()
}

/// Newton steps of the kernel: more change nothing that a picture could show.
const STEPS: u32 = 4;

/// The dual vertices of leaves: finest ones in a density grid by the backend's kernel.
fn leaf_points<B: ContourBackend + ?Sized>(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    leaves: &[u32],
    backend: &B,
) -> Result<Vec<Point3>, Error> {
    let samples = complex.samples;
    let kernel = probe.field.is_none() && probe.placement == Placement::Newton;
    // Where the molecule meets one other region, labels are signs.
    let by_kernel = |id: u32| {
        kernel && complex.leaf(id).log == 0 && {
            let labels = complex.corner_labels(complex.leaf(id));
            let other = labels.iter().find(|&&l| l != INTERIOR);
            labels.contains(&INTERIOR) && labels.iter().all(|l| *l == INTERIOR || Some(l) == other)
        }
    };
    let (fine, rest): (Vec<u32>, Vec<u32>) = leaves
        .par_iter()
        .with_min_len(1024)
        .partition(|&&id| by_kernel(id));
    let cells: Vec<[f32; 8]> = fine
        .par_iter()
        .with_min_len(256)
        .map(|&id| samples.corners_over_level(complex.leaf(id).origin()))
        .collect();
    let fine_points = backend.dual_vertices(&cells, STEPS)?;
    let rest_points: Vec<Point3> = rest
        .par_iter()
        .with_min_len(256)
        .map(|&id| leaf_point(complex, probe, id))
        .collect();
    // Both lists are in order: merge them.
    let mut fine = fine.iter().zip(fine_points).peekable();
    let mut rest = rest_points.into_iter();
    let next = |id: &u32| match fine.next_if(|(other, _)| *other == id) {
        Some((_, x)) => within(complex.leaf(*id).origin(), x),
        None => rest.next().expect("one point per leaf"),
    };
    Ok(leaves.iter().map(next).collect())
}

/// The points of finest cells of plain labels, given with the place of their block among the stored.
pub(crate) fn finest_points<B: ContourBackend + ?Sized>(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    cells: &[(u32, [i32; 3])],
    backend: &B,
    out: &mut [Point3],
) -> Result<(), Error> {
    debug_assert_eq!(out.len(), cells.len());
    let all = out.par_iter_mut().zip(cells);
    if probe.field.is_none() && probe.placement == Placement::Newton {
        let values: Vec<[f32; 8]> = cells
            .par_iter()
            .with_min_len(4096)
            .map(|&(slot, cell)| samples.corners_in(slot as usize, cell))
            .collect();
        let points = backend.dual_vertices(&values, STEPS)?;
        all.zip(points)
            .with_min_len(4096)
            .for_each(|((out, &(_, cell)), x)| *out = within(cell, x));
    } else {
        all.with_min_len(256).for_each(|(out, &(_, cell))| {
            let labels = std::array::from_fn(|i| {
                samples.label([0, 1, 2].map(|k| cell[k] + corner_of(i)[k]))
            });
            *out = cell_point(samples, probe, cell, 1, &frame_of_corners(&labels));
        });
    }
    Ok(())
}

fn leaf_point(complex: &Complex<'_>, probe: &Probe<'_>, id: u32) -> Point3 {
    let leaf = complex.leaf(id);
    let frame = complex.frame(id);
    cell_point(complex.samples, probe, leaf.origin(), leaf.size(), &frame)
}

/// The dual vertex of a cell from the labels on its half lattice.
fn cell_point(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    o: [i32; 3],
    s: i32,
    frame: &Frame,
) -> Point3 {
    let sample = |i: usize| {
        let p = [i % 3, i / 3 % 3, i / 9].map(|c| c as i32);
        let p = [0, 1, 2].map(|k| o[k] + p[k] * s / 2);
        Sample {
            x: local(p),
            label: frame.labels[i],
            value: samples.value(p),
        }
    };
    let mut crossings = Vec::with_capacity(12);
    frame.edges(|i, j| {
        if frame.labels[i] != frame.labels[j] {
            let (a, b) = (sample(i), sample(j));
            let x = a.x + (b.x - a.x) * probe.crossing(&a, &b);
            crossings.push((x, Probe::on_level(a.label, b.label)));
        }
    });
    probe.place(o, f64::from(s), &crossings)
}

/// Label, value and position of a corner.
pub(crate) fn sample_corner(complex: &Complex<'_>, corner: Corner, label: Region) -> Sample {
    match corner {
        Corner::Point(p) => Sample {
            x: local(p),
            label,
            value: complex.samples.value(p),
        },
        Corner::Centre(k) => Sample {
            x: complex.corner_position(corner),
            label,
            value: complex.splits[k as usize].value,
        },
    }
}

/// The corners of a finest cell that is cut, and its middle.
pub(crate) fn cut_samples(
    samples: &Samples<'_>,
    o: [i32; 3],
    labels: &[Region; 8],
    split: &Split,
) -> [Sample; 9] {
    std::array::from_fn(|i| {
        if i == APEX {
            return Sample {
                x: MIDDLE + local(o).coords,
                label: split.label,
                value: split.value,
            };
        }
        let p = [0, 1, 2].map(|k| o[k] + corner_of(i)[k]);
        Sample {
            x: local(p),
            label: labels[i],
            value: samples.value(p),
        }
    })
}

/// The mean of the crossings of a tetrahedron of a cut cell, away from its corners; `None` if it has
/// none.
pub(crate) fn part_point(
    probe: &Probe<'_>,
    split: &Split,
    corners: &[Sample; 9],
    part: usize,
) -> Option<Point3> {
    let [p, q, r] = split.triangle(part).map(|i| corners[i]);
    mean_of_crossings(probe, &[corners[APEX], p, q, r])
}

/// The mean of the crossings of a face on the box.
fn ghost_point(complex: &Complex<'_>, probe: &Probe<'_>, id: u32, half: u8) -> Point3 {
    let base = complex.base_position(&Cell::Ghost(id, half));
    if !complex.is_interface(id) {
        return base;
    }
    let leaf = complex.leaf(id);
    let (o, s) = (leaf.origin(), leaf.size());
    if complex.is_split(id) {
        let split = &complex.splits[complex.split_of(id) as usize];
        let labels = complex.corner_labels(leaf);
        let corners: Vec<Sample> = split
            .triangle(half as usize)
            .iter()
            .map(|&i| {
                let p = corner_of(i);
                sample_corner(
                    complex,
                    Corner::Point([0, 1, 2].map(|k| o[k] + p[k])),
                    labels[i],
                )
            })
            .collect();
        return mean_of_crossings(probe, &corners).unwrap_or(base);
    }
    let (axis, side) = (usize::from(half / 4), 2 * usize::from(half / 2 % 2));
    let frame = complex.frame(id);
    let place = |i: usize| [i % 3, i / 3 % 3, i / 9];
    let (mut sum, mut n) = (Vector3::zeros(), 0.0);
    frame.edges(|i, j| {
        if place(i)[axis] == side && place(j)[axis] == side && frame.labels[i] != frame.labels[j] {
            let [a, b] = [i, j].map(|i| {
                let p = place(i).map(|c| c as i32);
                sample_corner(
                    complex,
                    Corner::Point([0, 1, 2].map(|k| o[k] + p[k] * s / 2)),
                    frame.labels[i],
                )
            });
            sum += (a.x + (b.x - a.x) * probe.crossing(&a, &b)).coords;
            n += 1.0;
        }
    });
    if n == 0.0 {
        return base;
    }
    let reach = 0.5 * INSET * f64::from(s);
    let mut x = Point3::from(
        base.coords
            .zip_map(&(sum / n), |c, v| v.clamp(c - reach, c + reach)),
    );
    x[axis] = base[axis];
    x
}

fn mean_of_crossings(probe: &Probe<'_>, corners: &[Sample]) -> Option<Point3> {
    let (mut sum, mut n) = (Vector3::zeros(), 0.0);
    for (i, a) in corners.iter().enumerate() {
        for b in &corners[i + 1..] {
            if a.label != b.label {
                let t = probe.crossing(a, b).clamp(0.02, 0.98);
                sum += (a.x + (b.x - a.x) * t).coords;
                n += 1.0;
            }
        }
    }
    (n > 0.0).then(|| Point3::from(sum / n))
}
