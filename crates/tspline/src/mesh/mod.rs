//! T-meshes: elements of 2^l × 2^l quads of a fine mesh, with T-junctions where levels change.
//!
//! All counting is done on the fine mesh, in its quads' sides: knot intervals are integers, positions are never
//! compared.

mod audit;
mod balance;
mod blocks;
mod halfedges;
mod record;
mod refine;

pub use audit::Audit;
pub use blocks::{Block, NONE};
pub use halfedges::THalfedge;
pub use record::{FORMAT, Record};
pub use refine::refined;

use geom_core::mesh::Halfedges;
use geom_core::{HalfedgeId, Point3, QuadMesh, Vector3, VertexId};

use crate::options::MAX_LEVEL;
use crate::{Error, TMeshOptions};
use blocks::{Forest, is_regular, rows, straight};

/// An element of a T-mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Element {
    /// Vertices of the T-mesh at its corners, counter-clockwise seen from outside.
    pub corners: [u32; 4],
    /// Its level: 0 is fine.
    pub level: u8,
    /// Length of its sides in those of fine quads: 2^level.
    pub size: u32,
}

/// How a vertex of a T-mesh lies among its elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum VertexKind {
    /// A corner of four elements.
    Regular,
    /// A corner of two elements, in the middle of a side of a third.
    TJunction,
    /// Inside, a corner of so many elements, not four.
    Extraordinary(u32),
    /// On the boundary of an open surface.
    Boundary,
}

/// A quad mesh with T-junctions, on a fine conforming one.
///
/// ```
/// use tspline::{TMesh, TMeshOptions, geom_core::mesh::shapes};
/// let fine = shapes::quad_sphere(1.0, 16);
/// // The upper half may be four times as coarse.
/// let middle = |q: &[u32; 4]| q.iter().map(|&v| fine.positions()[v as usize].z).sum::<f64>();
/// let allowed: Vec<u8> = fine.quads().iter().map(|q| if middle(q) > 0.0 { 2 } else { 0 }).collect();
/// let mesh = TMesh::build(&fine, &allowed, &TMeshOptions::default())?;
/// assert!(mesh.elements().len() < 1000);
/// # Ok::<(), tspline::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TMesh {
    fine: QuadMesh,
    edges: Halfedges<4>,
    forest: Forest,
    elements: Vec<Element>,
    /// Per element its first fine half-edge of each side.
    starts: Vec<[HalfedgeId; 4]>,
    element_of: Vec<u32>,
    /// Fine quads of all elements, row-major; where those of each element begin.
    grid: Vec<u32>,
    grid_start: Vec<u32>,
    positions: Vec<Point3>,
    /// The fine vertex of each vertex, and back.
    fine_of: Vec<u32>,
    vertex_of: Vec<u32>,
    kinds: Vec<VertexKind>,
    /// Vertices along all sides; where those of side k of element e begin, at 4 e + k.
    along: Vec<u32>,
    side_start: Vec<u32>,
}

impl TMesh {
    /// The coarsest T-mesh of `fine` whose elements are at most of the level that each of their quads allows (0: keep
    /// the quad), whose neighbours differ by one level at most, and which is of one level around each extraordinary
    /// vertex.
    ///
    /// What is allowed is an upper bound: elements are smaller where blocks do not fit together, near a change of
    /// level, and where extraordinary vertices are near to each other. On a fine mesh that was made by [`refined`]
    /// blocks fit together everywhere, up to as many levels.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the quads are no oriented manifold; [`Error::Count`], [`Error::Level`], [`Error::Empty`],
    /// [`Error::Option`].
    pub fn build(fine: &QuadMesh, allowed: &[u8], options: &TMeshOptions) -> Result<Self, Error> {
        options.check()?;
        check_levels(fine, allowed)?;
        let edges = Halfedges::of_quads(fine)?;
        let forest = Forest::new(&edges, allowed);
        let level = balance::levels(&edges, &forest, options.rings);
        Ok(Self::of_levels(fine, edges, forest, &level))
    }

    /// The same T-mesh with some elements cut into four, those of level 0 left out, and whatever else must be cut then.
    ///
    /// Each of them is cut once, and others where the rules ask for it. Positions are those of the fine mesh as it is
    /// now.
    ///
    /// # Errors
    /// [`Error::Count`] for an element that does not exist; [`Error::Option`].
    pub fn cut(&self, elements: &[usize], options: &TMeshOptions) -> Result<Self, Error> {
        options.check()?;
        self.check_elements(elements)?;
        let mut elements = elements.to_vec();
        elements.sort_unstable();
        elements.dedup();
        let level = self.levels();
        let quads: Vec<u32> = elements.iter().map(|&e| self.fine_quads(e)[0]).collect();
        let level = balance::cut(&self.edges, &self.forest, level, &quads, options.rings);
        Ok(Self::of_levels(
            &self.fine,
            self.edges.clone(),
            self.forest.clone(),
            &level,
        ))
    }

    /// The same T-mesh with one element for each four that are all among these, where a block allows that, and without
    /// those that then break a rule: the reverse of [`cut`](Self::cut).
    ///
    /// Only groups of four that an element of the next level would cover go together, all of the same level and all
    /// named, and none beyond what their quads allow.
    ///
    /// # Errors
    /// [`Error::Count`] for an element that does not exist; [`Error::Option`].
    pub fn merge(&self, elements: &[usize], options: &TMeshOptions) -> Result<Self, Error> {
        options.check()?;
        self.check_elements(elements)?;
        let mut marked = vec![false; self.element_of.len()];
        for &q in elements.iter().flat_map(|&e| self.fine_quads(e)) {
            marked[q as usize] = true;
        }
        let (edges, forest) = (&self.edges, &self.forest);
        let level = balance::merged(edges, forest, self.levels(), &marked, options.rings);
        Ok(Self::of_levels(
            &self.fine,
            edges.clone(),
            forest.clone(),
            &level,
        ))
    }

    fn check_elements(&self, elements: &[usize]) -> Result<(), Error> {
        let expected = self.elements.len();
        let what = "as the number of an element";
        match elements.iter().find(|&&e| e >= expected) {
            None => Ok(()),
            Some(&found) => Err(Error::Count {
                what,
                found,
                expected,
            }),
        }
    }

    /// Some elements and those that share a vertex with them.
    pub(crate) fn with_those_around(&self, elements: &[usize]) -> Vec<usize> {
        let vertices = |e: usize| (0..4).flat_map(move |side| self.side(e, side));
        let mut near = vec![false; self.positions.len()];
        for &v in elements.iter().flat_map(|&e| vertices(e)) {
            near[v as usize] = true;
        }
        let reached = |e: &usize| vertices(*e).any(|&v| near[v as usize]);
        (0..self.elements.len()).filter(reached).collect()
    }

    /// The level of the element at each fine quad.
    pub fn levels(&self) -> Vec<u8> {
        let of_quad = |&e: &u32| self.elements[e as usize].level;
        self.element_of.iter().map(of_quad).collect()
    }

    /// The T-mesh whose element at each fine quad is the block of this level there.
    fn of_levels(fine: &QuadMesh, edges: Halfedges<4>, forest: Forest, level: &[u8]) -> Self {
        let mut mesh = Self {
            element_of: vec![NONE; level.len()],
            vertex_of: vec![NONE; edges.vertices()],
            fine: fine.clone(),
            forest,
            edges,
            elements: Vec::new(),
            starts: Vec::new(),
            grid: Vec::with_capacity(level.len()),
            grid_start: vec![0],
            positions: Vec::new(),
            fine_of: Vec::new(),
            kinds: Vec::new(),
            along: Vec::new(),
            side_start: vec![0],
        };
        for (quad, &l) in level.iter().enumerate() {
            if mesh.element_of[quad] == NONE {
                mesh.add_element(quad, l);
            }
        }
        mesh.number_vertices();
        mesh.find_sides();
        mesh.find_kinds();
        mesh
    }

    fn add_element(&mut self, quad: usize, level: u8) {
        let blocks = &self.forest.levels[usize::from(level)];
        let block = blocks.list[blocks.of_quad[quad] as usize];
        let size = 1 << level;
        for h in rows(&self.edges, block.sides[0], size).flatten() {
            let q = self.edges.face(h).0;
            self.element_of[q as usize] = self.elements.len() as u32;
            self.grid.push(q);
        }
        self.grid_start.push(self.grid.len() as u32);
        self.starts.push(block.sides);
        self.elements.push(Element {
            // Fine vertices, until those of the T-mesh have numbers.
            corners: block.corners,
            level,
            size,
        });
    }

    /// Corners of elements are the vertices, in the order of the fine ones.
    fn number_vertices(&mut self) {
        for v in self.elements.iter().flat_map(|e| e.corners) {
            self.vertex_of[v as usize] = 0;
        }
        for (v, number) in self.vertex_of.iter_mut().enumerate() {
            if *number == 0 {
                *number = self.fine_of.len() as u32;
                self.fine_of.push(v as u32);
                self.positions.push(self.fine.positions()[v]);
            }
        }
        for element in &mut self.elements {
            element.corners = element.corners.map(|v| self.vertex_of[v as usize]);
        }
    }

    fn find_sides(&mut self) {
        let (edges, vertex_of) = (&self.edges, &self.vertex_of);
        for (element, starts) in self.elements.iter().zip(&self.starts) {
            for (k, &start) in starts.iter().enumerate() {
                let inner = straight(edges, start, element.size).skip(1);
                let vertices = inner.map(|h| vertex_of[edges.from(h).0 as usize]);
                self.along.push(element.corners[k]);
                self.along.extend(vertices.filter(|&v| v != NONE));
                self.along.push(element.corners[(k + 1) % 4]);
                self.side_start.push(self.along.len() as u32);
            }
        }
    }

    fn find_kinds(&mut self) {
        let mut hung = vec![false; self.positions.len()];
        for side in self.side_start.windows(2) {
            let along = &self.along[side[0] as usize..side[1] as usize];
            for &v in &along[1..along.len() - 1] {
                hung[v as usize] = true;
            }
        }
        let kind = |(&fine, hung): (&u32, bool)| {
            let count = self.edges.around(VertexId(fine)).count() as u32;
            if self.edges.on_boundary(VertexId(fine)) {
                VertexKind::Boundary
            } else if count != 4 {
                VertexKind::Extraordinary(count)
            } else if hung {
                VertexKind::TJunction
            } else {
                VertexKind::Regular
            }
        };
        self.kinds = self.fine_of.iter().zip(hung).map(kind).collect();
    }

    /// Puts the vertices elsewhere. Those of the fine mesh between them move along: on the sides of elements in
    /// proportion to the ends, inside as a Coons patch of the sides says; then to where `onto` says, by number and place.
    ///
    /// # Errors
    /// [`Error::Count`] unless there is one position per vertex; [`Error::Mesh`] if one is not finite. The mesh is as before
    /// then.
    pub fn move_to(
        &mut self,
        positions: Vec<Point3>,
        onto: impl Fn(u32, &Point3) -> Point3 + Sync,
    ) -> Result<(), Error> {
        use rayon::prelude::*;
        let (found, expected) = (positions.len(), self.positions.len());
        if found != expected {
            let what = "positions";
            return Err(Error::Count {
                what,
                found,
                expected,
            });
        }
        let by: Vec<Vector3> = positions
            .iter()
            .zip(&self.positions)
            .map(|(a, b)| a - b)
            .collect();
        let mut moved = self.fine.positions().to_vec();
        for e in 0..self.elements.len() {
            for (v, to) in self.displaced(e, &by) {
                moved[v as usize] = self.fine.positions()[v as usize] + to;
            }
        }
        let pulled = moved.par_iter().enumerate().with_min_len(256);
        let mut moved: Vec<Point3> = pulled.map(|(v, p)| onto(v as u32, p)).collect();
        for (&fine, p) in self.fine_of.iter().zip(&positions) {
            moved[fine as usize] = *p;
        }
        self.fine = QuadMesh::new(moved, self.fine.quads().to_vec())?;
        self.positions = positions;
        Ok(())
    }

    /// How far the fine vertices of an element move with its vertices.
    fn displaced(&self, element: usize, by: &[Vector3]) -> Vec<(u32, Vector3)> {
        let size = self.elements[element].size as usize;
        let corners = self.elements[element].corners.map(|v| by[v as usize]);
        // Along side k, a part from its first corner on.
        let on_side = |k: usize, step: usize| {
            let along = self.side(element, k);
            let spans = along.len() - 1;
            let at = step * spans;
            let (span, part) = ((at / size).min(spans - 1), at as f64 / size as f64);
            let [a, b] = [along[span], along[span + 1]].map(|v| by[v as usize]);
            a + (b - a) * (part - span as f64)
        };
        let mut all = self.fine_vertices(element).into_iter();
        let mut out = Vec::with_capacity((size + 1) * (size + 1));
        for j in 0..=size {
            for (i, v) in (0..=size).zip(&mut all) {
                let (s, t) = (i as f64 / size as f64, j as f64 / size as f64);
                let across = on_side(0, i) * (1.0 - t) + on_side(2, size - i) * t;
                let up = on_side(3, size - j) * (1.0 - s) + on_side(1, j) * s;
                let [a, b, c, d] = corners;
                let flat = (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t;
                out.push((v, across + up - flat));
            }
        }
        out
    }

    /// Vertices, Å.
    pub fn positions(&self) -> &[Point3] {
        &self.positions
    }
    /// Elements.
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }
    /// All vertices along a side of an element, both corners included, in order; side `k` runs from corner `k` to
    /// corner `k + 1`.
    ///
    /// Two vertices, or three where smaller elements lie beyond. An element that does not exist makes it panic, like
    /// all that asks for one by number.
    pub fn side(&self, element: usize, side: usize) -> &[u32] {
        let at = 4 * element + side;
        &self.along[self.side_start[at] as usize..self.side_start[at + 1] as usize]
    }
    /// The fine conforming mesh.
    /// Its vertices have moved along with those of the T-mesh.
    pub fn fine(&self) -> &QuadMesh {
        &self.fine
    }
    /// Who is whose neighbour in the fine mesh.
    pub fn fine_edges(&self) -> &Halfedges<4> {
        &self.edges
    }
    /// The element in which a fine quad lies.
    pub fn element_of(&self, fine_quad: usize) -> u32 {
        self.element_of[fine_quad]
    }
    /// The `size × size` fine quads of an element: row by row from corner 0, along side 0.
    pub fn fine_quads(&self, element: usize) -> &[u32] {
        let [a, b] = [element, element + 1].map(|e| self.grid_start[e] as usize);
        &self.grid[a..b]
    }
    /// The `(size + 1)²` fine vertices of an element: row by row from corner 0, along side 0.
    pub fn fine_vertices(&self, element: usize) -> Vec<u32> {
        let size = self.elements[element].size;
        let edges = &self.edges;
        let rows: Vec<Vec<_>> = rows(edges, self.starts[element][0], size)
            .map(Iterator::collect)
            .collect();
        let mut vertices = Vec::with_capacity((size as usize + 1).pow(2));
        for row in &rows {
            vertices.extend(row.iter().map(|&h| edges.from(h).0));
            vertices.extend(row.last().map(|&h| edges.to(h).0));
        }
        // The upper side of the last row.
        if let Some(row) = rows.last() {
            let upper = |&h: &HalfedgeId| edges.to(edges.next(edges.next(h))).0;
            vertices.extend(row.iter().map(upper));
            vertices.extend(row.last().map(|&h| edges.to(edges.next(h)).0));
        }
        vertices
    }
    /// The vertex of the T-mesh at a fine vertex.
    pub fn vertex_of_fine(&self, fine_vertex: u32) -> Option<u32> {
        let v = self.vertex_of[fine_vertex as usize];
        (v != NONE).then_some(v)
    }
    /// The fine vertex at a vertex of the T-mesh.
    pub fn fine_of_vertex(&self, vertex: usize) -> u32 {
        self.fine_of[vertex]
    }
    /// How a vertex lies among the elements.
    /// On a boundary all are [`VertexKind::Boundary`], corners included.
    pub fn kind(&self, vertex: usize) -> VertexKind {
        self.kinds[vertex]
    }
    /// The elements as polygons, T-junctions among their corners: where each ends, and the vertices of all; for writers of
    /// files.
    pub fn polygons(&self) -> (Vec<u32>, Vec<u32>) {
        let (mut ends, mut corners) = (Vec::new(), Vec::new());
        for e in 0..self.elements.len() {
            for k in 0..4 {
                let side = self.side(e, k);
                corners.extend(&side[..side.len() - 1]);
            }
            ends.push(corners.len() as u32);
        }
        (ends, corners)
    }
    /// The highest level of which there are blocks (not necessarily elements).
    pub fn top_level(&self) -> u8 {
        (self.forest.levels.len() - 1) as u8
    }
    /// All blocks of a level that the fine mesh has, whether or not they are elements: the squares of `2^level` quads
    /// that fit together into the coarse mesh of that level where it exists.
    pub fn blocks(&self, level: u8) -> &[Block] {
        let of_level = self.forest.levels.get(usize::from(level));
        of_level.map_or(&[], |l| &l.list)
    }
    /// The block of a level in which a fine quad lies.
    pub fn block_of(&self, level: u8, fine_quad: usize) -> Option<u32> {
        let block = *self
            .forest
            .levels
            .get(usize::from(level))?
            .of_quad
            .get(fine_quad)?;
        (block != NONE).then_some(block)
    }
    /// Is the vertex of the fine mesh extraordinary: inside with other than four quads, or on the boundary with other
    /// than one or two?
    pub fn is_extraordinary(&self, fine_vertex: u32) -> bool {
        is_extraordinary(&self.edges, fine_vertex)
    }
}

/// One level per quad, none too high.
pub(crate) fn check_levels(fine: &QuadMesh, levels: &[u8]) -> Result<(), Error> {
    let (found, expected) = (levels.len(), fine.quads().len());
    if expected == 0 {
        return Err(Error::Empty);
    }
    if found != expected {
        let what = "levels";
        return Err(Error::Count {
            what,
            found,
            expected,
        });
    }
    match levels.iter().position(|&l| l > MAX_LEVEL) {
        Some(quad) => Err(Error::Level {
            quad,
            level: levels[quad],
        }),
        None => Ok(()),
    }
}

/// Corners of open surfaces have one quad; lines of the mesh end there as they should.
fn is_extraordinary(edges: &Halfedges<4>, v: u32) -> bool {
    !is_regular(edges, v) && edges.around(VertexId(v)).count() > 1
}
