//! The numbers of the vertices of a mesh on the complex.
//!
//! Every cell and corner has one whether the mesh uses it or not, so that numbers are found by counting instead of in a
//! table of those that are used; what is not used is left out at the end (`compact`).

use geom_core::compute::parallel;
use geom_core::mesh::Region;

use super::{Cell, Complex, Corner};
use crate::octree::{PointMarks, PointSet, corner_of};

/// The numbers of the vertices: cells (leaves, then parts), ghosts, lattice points, middles of split
/// leaves, added points.
pub(crate) struct Numbering<'a> {
    points: PointSet,
    ghosts: &'a [(u32, u8)],
    /// Where each group of vertices begins.
    first_part: u32,
    first_ghost: u32,
    first_corner: u32,
    first_centre: u32,
    len: u32,
}

impl<'a> Numbering<'a> {
    /// `corners` says by their labels which lattice points become vertices.
    /// Lattice points that are corners of some leaf: points inside of a large leaf are none.
    pub(crate) fn new(
        complex: &Complex<'_>,
        ghosts: &'a [(u32, u8)],
        corners: impl Fn(Region) -> bool + Sync,
    ) -> Self {
        let marks = PointMarks::new(complex.tree.cells);
        let leaves = &complex.tree.leaves;
        parallel::for_indices(leaves.len(), |id| {
            let leaf = &leaves[id];
            if leaf.void {
                return;
            }
            let (o, s) = (leaf.origin(), leaf.size());
            for (i, label) in complex.corner_labels(leaf).into_iter().enumerate() {
                if corners(label) {
                    let p = corner_of(i);
                    marks.mark([0, 1, 2].map(|k| o[k] + s * p[k]));
                }
            }
        });
        let points = marks.finish();
        let first_part = complex.tree.leaves.len() as u32;
        let first_ghost = first_part + 12 * complex.splits.len() as u32;
        let first_corner = first_ghost + ghosts.len() as u32;
        let first_centre = first_corner + points.len();
        Self {
            points,
            ghosts,
            first_part,
            first_ghost,
            first_corner,
            first_centre,
            len: first_centre + complex.splits.len() as u32,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.len as usize
    }

    pub(crate) fn ghosts(&self) -> &[(u32, u8)] {
        self.ghosts
    }

    /// The number of the point of a cell.
    pub(crate) fn cell(&self, cell: &Cell) -> u32 {
        match *cell {
            Cell::Leaf(id) => id,
            Cell::Part(k, part) => self.first_part + 12 * k + u32::from(part),
            Cell::Ghost(id, half) => {
                let i = self.ghosts.binary_search(&(id, half));
                self.first_ghost + i.expect("a ghost stands on the box") as u32
            }
        }
    }

    /// The number of a corner whose label was asked for.
    pub(crate) fn corner(&self, corner: Corner) -> u32 {
        match corner {
            Corner::Point(p) => self.first_corner + self.points.rank(p),
            Corner::Centre(k) => self.first_centre + k,
        }
    }

    /// All vertices in order.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = Vertex> {
        let parts = (0..self.first_ghost - self.first_part)
            .map(|i| Vertex::Cell(Cell::Part(i / 12, (i % 12) as u8)));
        (0..self.first_part)
            .map(|id| Vertex::Cell(Cell::Leaf(id)))
            .chain(parts)
            .chain(
                self.ghosts
                    .iter()
                    .map(|&(id, half)| Vertex::Cell(Cell::Ghost(id, half))),
            )
            .chain(
                self.points
                    .points()
                    .into_iter()
                    .map(|p| Vertex::Corner(Corner::Point(p))),
            )
            .chain((0..self.len - self.first_centre).map(|k| Vertex::Corner(Corner::Centre(k))))
    }
}

/// What a vertex stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Vertex {
    /// The point of a cell.
    Cell(Cell),
    /// A corner of the complex.
    Corner(Corner),
}
