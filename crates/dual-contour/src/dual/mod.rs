//! Dual contouring: where the point of each cell stands, and from rings of cells to triangles and tetrahedra.
//!
//! Points first (`place`, with crossings from `probe`), each by itself; then those that would invert a tetrahedron are
//! stopped on their way (`positive`, by the rule in `room`); then every edge emits what stands around it (`emit`).
//! Nothing that is emitted moves a point any more.

use geom_core::Point3;
use geom_core::compute::parallel;

use crate::Error;
use crate::backend::ContourBackend;
use crate::complex::cube::part_base;
use crate::complex::{Cell, Complex};
use crate::octree::{Leaf, Octree};

mod emit;
mod place;
mod positive;
mod probe;
pub(crate) mod room;

pub(crate) use emit::{Emission, Emitter, Want};
pub(crate) use place::finest_points;
pub(crate) use probe::{Probe, Sample, cut_samples, depth_gradient, off_ends, part_point};

use place::{ghost_point, leaf_points};
use positive::Clamped;

/// How far off its place the point of a leaf larger than the finest may be clamped, in finest cells: more
/// would stick out of the surface, and the leaf is split instead.
const SPIKE: f64 = 0.5;

/// The points of all cells.
pub(crate) struct Duals {
    /// Per leaf: its place among the moved ones, or `u32::MAX`.
    rank: Vec<u32>,
    /// The points of moved leaves, in order.
    leaves: Vec<Point3>,
    /// The points of the half lattice that the point of each leaf larger than the finest follows from.
    frames: Vec<u32>,
    /// Twelve per cut leaf.
    parts: Vec<Point3>,
    /// Ghost cells in order, and their points.
    ghosts: Vec<(u32, u8)>,
    ghost_points: Vec<Point3>,
    /// Points that stopped on the way from their base to keep volumes positive, in order.
    clamped: Vec<Clamped>,
}

/// Where the mesh ends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ends {
    /// At the surface of the molecule, off the box.
    OffBox,
    /// At the box, whose faces carry ghost cells.
    AtBox,
}

impl Duals {
    /// All points: at their base, or on the surface. Leaves of the octree `before`, of which some have
    /// been split, keep the points that had arrived.
    pub(crate) fn new(
        complex: &Complex<'_>,
        probe: &Probe<'_>,
        ends: Ends,
        before: Option<&(Octree, Duals)>,
        backend: &dyn ContourBackend,
    ) -> Result<Self, Error> {
        let len = complex.tree.leaves.len();
        // Leaves with a surface have a point on it, unless their parts have.
        let moved: Vec<u32> = (0..len as u32)
            .filter(|&id| complex.is_interface(id) && !complex.is_split(id))
            .collect();
        let mut rank = vec![u32::MAX; len];
        for (i, &id) in moved.iter().enumerate() {
            rank[id as usize] = i as u32;
        }
        let frames: Vec<u32> = parallel::map_each(&moved, |&id| match complex.leaf(id).log {
            0 => 0,
            _ => complex.frame(id).used,
        });
        let leaves = known_or_found(complex, probe, &moved, &frames, before, backend)?;
        let mut out = Self {
            rank,
            leaves,
            frames,
            parts: part_points(complex, probe),
            ghosts: Vec::new(),
            ghost_points: Vec::new(),
            clamped: Vec::new(),
        };
        if ends == Ends::AtBox {
            out.ghosts = complex.ghosts();
            out.ghost_points = parallel::map_each(&out.ghosts, |&(id, half)| {
                ghost_point(complex, probe, id, half)
            });
        }
        out.keep_positive(complex);
        Ok(out)
    }

    /// The place of a ghost among all.
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
    /// A leaf of one label has it in its middle, which is not stored.
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
    pub(crate) fn clamped(&self) -> usize {
        self.clamped.len()
    }

    /// How far the point of a moved cell is from where it belongs.
    /// In finest cells; 0 if it has arrived.
    fn shortfall(&self, moved: usize) -> f64 {
        let found = self.clamped.binary_search_by_key(&moved, |c| c.moved);
        found.map_or(0.0, |i| self.clamped[i].shortfall)
    }

    /// Leaves larger than the finest whose points stay more than [`SPIKE`] off the surface.
    pub(crate) fn spikes(&self, complex: &Complex<'_>) -> Vec<u32> {
        let is_spike = |&id: &u32| {
            let shortfall = |rank| self.shortfall(rank as usize);
            complex.leaf(id).log > 0 && self.rank(id).map_or(0.0, shortfall) > SPIKE
        };
        (0..self.rank.len() as u32).filter(is_spike).collect()
    }

    /// Where the point of a leaf of an earlier octree has gone, if it arrived, and by the same frame.
    /// The frame says on which points the place depends: a neighbour that was split hangs new ones on the leaf, and
    /// then it is found anew.
    fn arrived(&self, tree: &Octree, leaf: &Leaf, frame: u32) -> Option<Point3> {
        let (id, _) = tree.find(leaf.origin());
        let same = tree.leaves.get(id as usize)?.log == leaf.log;
        let rank = self.rank(id).filter(|_| same)? as usize;
        (self.frames[rank] == frame && self.shortfall(rank) == 0.0).then(|| self.leaves[rank])
    }

    /// The point of a moved cell, by its place among them.
    fn at(&self, moved: usize) -> &Point3 {
        match moved.checked_sub(self.leaves.len()) {
            None => &self.leaves[moved],
            Some(part) => &self.parts[part],
        }
    }

    fn at_mut(&mut self, moved: usize) -> &mut Point3 {
        match moved.checked_sub(self.leaves.len()) {
            None => &mut self.leaves[moved],
            Some(part) => &mut self.parts[part],
        }
    }

    /// The place of a cell among the moved ones: leaves, then parts.
    fn moved(&self, cell: &Cell) -> Option<usize> {
        match *cell {
            Cell::Leaf(id) => self.rank(id).map(|r| r as usize),
            Cell::Part(k, part) => Some(self.leaves.len() + 12 * k as usize + part as usize),
            Cell::Ghost(..) => None,
        }
    }
}

/// The points of moved leaves: those that had arrived in the octree `before`, the rest found.
/// In the order of `moved`. Rounds after the first so place only what has changed.
fn known_or_found(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    moved: &[u32],
    frames: &[u32],
    before: Option<&(Octree, Duals)>,
    backend: &dyn ContourBackend,
) -> Result<Vec<Point3>, Error> {
    let mut known: Vec<(u32, Option<Point3>)> = parallel::map(moved.len(), |i| {
        let (id, frame) = (moved[i], frames[i]);
        let arrived =
            |(tree, duals): &(Octree, Duals)| duals.arrived(tree, complex.leaf(id), frame);
        (id, before.and_then(arrived))
    });
    let missing = known.iter().filter(|(_, x)| x.is_none());
    let missing: Vec<u32> = missing.map(|(id, _)| *id).collect();
    let found = leaf_points(complex, probe, &missing, backend)?;
    let missing = known.iter_mut().filter(|(_, x)| x.is_none());
    missing
        .zip(found)
        .for_each(|((_, x), found)| *x = Some(found));
    Ok(known.into_iter().filter_map(|(_, x)| x).collect())
}

/// The points of the parts of all cut cells; a part of one label stays at its base.
fn part_points(complex: &Complex<'_>, probe: &Probe<'_>) -> Vec<Point3> {
    parallel::flat_map(complex.splits.len(), |i| {
        let split = &complex.splits[i];
        let leaf = complex.leaf(complex.split_leaves[i]);
        let (o, labels) = (leaf.origin(), complex.corner_labels(leaf));
        let corners = cut_samples(complex.samples, o, &labels, split);
        (0..12).map(move |part| {
            part_point(probe, split, &corners, part)
                .unwrap_or_else(|| part_base(split.diagonals, o, part))
        })
    })
}
