//! What lies around a vertex of the mesh of one level: its blocks, and beyond a boundary ghosts that make it whole.
//!
//! A star holds all that an extraction needs of one vertex: the inner Bézier points of the blocks around it, each a
//! combination of four vertices, and the rules of Catmull and Clark by which the vertices of the next finer level
//! follow. At a boundary a fan is not closed, and neither rule applies; with ghosts, which continue the net linearly
//! beyond it, both do.

use geom_core::{HalfedgeId, Point3, VertexId};

use crate::mesh::Block;
use crate::{Error, TMesh};

/// One block around a vertex, seen from it counter-clockwise. Vertices are numbers of [`Ghosts`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Sector {
    /// The fine half-edge that leaves the vertex with the block on its left; none of a ghost.
    pub(super) from: Option<HalfedgeId>,
    /// The far end of the edge with the block on its left.
    pub(super) along: u32,
    /// The opposite corner of the block.
    pub(super) diagonal: u32,
    /// The middles of that edge and of the block: vertices of the level below. Unused on level 0.
    pub(super) middle: u32,
    pub(super) centre: u32,
}

/// A vertex of the mesh of a level, with all that is around it.
#[derive(Clone, Debug)]
pub(super) struct Star {
    /// The vertex in the middle.
    pub(super) vertex: u32,
    /// Counter-clockwise, ghosts last.
    pub(super) sectors: Vec<Sector>,
}

/// A linear combination of vertices of the mesh of a level.
pub(super) type Mask = Vec<(u32, f64)>;

/// The weights of four corners in the point of a bicubic patch next to the first.
/// From the corner on around the block: the tensor product of (2/3, 1/3) with itself, as of uniform cubic B-splines.
pub(super) const FACE_POINT: [f64; 4] = [4.0 / 9.0, 2.0 / 9.0, 1.0 / 9.0, 2.0 / 9.0];

impl Star {
    pub(super) fn valence(&self) -> usize {
        self.sectors.len()
    }

    /// Counted on around the vertex.
    fn cyclic(&self, i: usize) -> &Sector {
        &self.sectors[i % self.sectors.len()]
    }

    /// The inner Bézier point of block `i` next to the vertex.
    pub(super) fn face_point(&self, i: usize) -> [(u32, f64); 4] {
        let (here, next) = (self.cyclic(i), self.cyclic(i + 1));
        let [v, a, d, b] = FACE_POINT;
        [
            (self.vertex, v),
            (here.along, a),
            (here.diagonal, d),
            (next.along, b),
        ]
    }

    /// Catmull and Clark's rules for the vertices of the level below: at the vertex, in the middle of each edge, in
    /// that of each block.
    ///
    /// Weights of each sum to one and are not negative. The same vertex is in the masks of several stars, with the same
    /// weights, so that who finds it first may be believed.
    pub(super) fn masks(&self) -> Vec<(u32, Mask)> {
        let n = self.valence();
        let real = n as f64;
        let mut vertex = vec![(self.vertex, 1.0 - 7.0 / (4.0 * real))];
        let mut masks = Vec::with_capacity(2 * n + 1);
        for i in 0..n {
            let (before, here, next) =
                (self.cyclic(i + n - 1), &self.sectors[i], self.cyclic(i + 1));
            vertex.push((here.along, 1.5 / (real * real)));
            vertex.push((here.diagonal, 0.25 / (real * real)));
            let edge = vec![
                (self.vertex, 0.375),
                (here.along, 0.375),
                (here.diagonal, 0.0625),
                (next.along, 0.0625),
                (before.diagonal, 0.0625),
                (before.along, 0.0625),
            ];
            masks.push((here.middle, edge));
            let corners = [self.vertex, here.along, here.diagonal, next.along];
            masks.push((here.centre, corners.map(|v| (v, 0.25)).to_vec()));
        }
        masks.push((self.vertex, vertex));
        masks
    }
}

/// Numbers of the vertices beyond boundaries. Below the number of fine vertices a number is one of these; above, three
/// belong to each vertex of a boundary: the ghost across the edge that leaves it, the one across the edge that arrives
/// (the same, where the boundary runs straight), and at a corner the one between.
#[derive(Clone, Debug)]
pub(super) struct Ghosts<'a> {
    mesh: &'a TMesh,
    fine: usize,
    /// Per vertex its number among those of boundaries.
    /// `u32::MAX` for those that are on none.
    rank: Vec<u32>,
    /// The vertices of boundaries.
    boundary: Vec<u32>,
}

/// Which ghost of a vertex of a boundary.
#[derive(Clone, Copy)]
enum Across {
    Leaving = 0,
    Arriving = 1,
    Between = 2,
}

impl<'a> Ghosts<'a> {
    pub(super) fn new(mesh: &'a TMesh) -> Self {
        let edges = mesh.fine_edges();
        let mut rank = vec![u32::MAX; edges.vertices()];
        let mut boundary = Vec::new();
        for v in 0..edges.vertices() as u32 {
            if edges.on_boundary(VertexId(v)) {
                rank[v as usize] = boundary.len() as u32;
                boundary.push(v);
            }
        }
        Self {
            mesh,
            fine: edges.vertices(),
            rank,
            boundary,
        }
    }

    /// Numbers in all.
    pub(super) fn len(&self) -> usize {
        self.fine + 3 * self.boundary.len()
    }

    /// The fine vertex of a number; of a ghost none.
    pub(super) fn real(&self, number: u32) -> Option<usize> {
        ((number as usize) < self.fine).then_some(number as usize)
    }

    /// The fine vertex to which a number belongs: itself, or that of which it is a ghost.
    pub(super) fn owner(&self, number: u32) -> u32 {
        match (number as usize).checked_sub(self.fine) {
            Some(ghost) => self.boundary[ghost / 3],
            None => number,
        }
    }

    /// The number of a ghost of a vertex of the boundary.
    fn of(&self, vertex: u32, across: Across) -> u32 {
        let straight = self.mesh.fine_edges().around(VertexId(vertex)).count() == 2;
        let kind = if straight { 0 } else { across as u32 };
        self.fine as u32 + 3 * self.rank[vertex as usize] + kind
    }

    /// The block of a level that has a corner where a fine half-edge begins, on its left, and which corner.
    fn block(&self, level: u8, h: HalfedgeId) -> Option<(&'a Block, usize)> {
        let quad = self.mesh.fine_edges().face(h).0 as usize;
        let block = &self.mesh.blocks(level)[self.mesh.block_of(level, quad)? as usize];
        let corner = block.sides.iter().position(|&side| side == h)?;
        Some((block, corner))
    }

    /// The star of a fine vertex in the mesh of a level; where the ghosts around it start is added
    /// to `places`.
    ///
    /// # Errors
    /// [`Error::Ring`] where a block of this level is missing.
    pub(super) fn star(
        &self,
        level: u8,
        vertex: u32,
        places: &mut Vec<(u32, Point3)>,
    ) -> Result<Star, Error> {
        let edges = self.mesh.fine_edges();
        let missing = Error::Ring { vertex, level };
        let around: Vec<HalfedgeId> = edges.around(VertexId(vertex)).collect();
        let mut sectors = Vec::with_capacity(around.len() + 3);
        let mut end = (vertex, vertex);
        for &h in &around {
            let (block, c) = self.block(level, h).ok_or(missing.clone())?;
            let corner = |k: usize| block.corners[(c + k) % 4];
            let mut sector = Sector {
                from: Some(h),
                along: corner(1),
                diagonal: corner(2),
                middle: corner(1),
                centre: corner(2),
            };
            end = (corner(3), corner(3));
            if level > 0 {
                let (child, c) = self.block(level - 1, h).ok_or(missing.clone())?;
                let corner = |k: usize| child.corners[(c + k) % 4];
                (sector.middle, sector.centre) = (corner(1), corner(2));
                end.1 = corner(3);
            }
            sectors.push(sector);
        }
        if edges.on_boundary(VertexId(vertex)) {
            self.close(vertex, end, &mut sectors, places);
        }
        Ok(Star { vertex, sectors })
    }

    /// Closes the fan of a vertex of a boundary by ghosts. `end`: the far end and the middle of the edge that arrives.
    ///
    /// Where the boundary goes straight on, two ghost blocks close the fan; at a corner of one block three do; where
    /// three blocks or more meet, one.
    fn close(
        &self,
        v: u32,
        end: (u32, u32),
        sectors: &mut Vec<Sector>,
        places: &mut Vec<(u32, Point3)>,
    ) {
        use Across::{Arriving, Between, Leaving};
        let position = |v: u32| self.mesh.fine().positions()[v as usize];
        let (first, count) = (sectors[0], sectors.len());
        let (start, start_middle) = (first.along, first.middle);
        let sector = |along: (u32, u32), diagonal: u32, centre: u32| Sector {
            from: None,
            along: along.0,
            diagonal,
            middle: along.1,
            centre,
        };
        let mut place = |number: u32, at: Point3| places.push((number, at));
        // The net goes on linearly: a parallelogram at each corner.
        let here = position(v);
        let opposite = |w: u32| here + (here - position(w));
        let shifted = |w: u32, by: Point3| position(w) + (by - here);
        let (before, after) = (self.of(end.0, Leaving), self.of(start, Arriving));
        let (centre_before, centre_after) =
            (self.of(end.1, Leaving), self.of(start_middle, Arriving));
        match count {
            1 | 2 => {
                let (arriving, leaving) = (self.of(v, Arriving), self.of(v, Leaving));
                let [across_arriving, across_leaving] = match count {
                    1 => [opposite(start), opposite(end.0)],
                    _ => [opposite(sectors[1].along); 2],
                };
                place(arriving, across_arriving);
                place(leaving, across_leaving);
                place(before, shifted(end.0, across_arriving));
                place(after, shifted(start, across_leaving));
                sectors.push(sector(end, before, centre_before));
                if count == 1 {
                    let between = self.of(v, Between);
                    place(between, across_arriving + (across_leaving - here));
                    sectors.push(sector((arriving, arriving), between, between));
                }
                sectors.push(sector((leaving, leaving), after, centre_after));
            }
            // A corner that points inwards: one ghost fills it.
            _ => {
                let between = self.of(v, Between);
                place(between, shifted(end.0, position(start)));
                sectors.push(sector(end, between, between));
            }
        }
    }
}
