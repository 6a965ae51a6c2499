//! Cells that are cut into tetrahedra, where all cells around are finest: their points and polygons without an
//! octree.
//!
//! Twelve parts and up to twenty-six edges (twelve of the cell, six diagonals, eight to the middle) each: few cells in
//! a well resolved surface, and so told apart from the others, which take the fast way.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::mesh::{INTERIOR, Region, six_volume};

use super::batch::Batch;
use super::pattern::{PATTERNS, Pattern};
use crate::complex::Split;
use crate::complex::cube::{
    APEX, AROUND, CORNERS, QUADRANT, diagonal_of, faces_beside, half_of, part_base,
};
use crate::dual::{Probe, Sample, cut_samples, part_point};
use crate::kernel::{self, MOST, best_fan};
use crate::octree::{Samples, local};

/// What stands at a finest cell.
#[derive(Clone, Copy, Debug)]
pub(super) enum CellState {
    /// Nothing: it is beyond the domain.
    Beyond,
    /// A cell of one label, its point in its middle.
    Plain,
    /// A cell that is not cut, by the number of its vertex.
    Whole(u32),
    /// A cut cell, by its number among them.
    Cut(u32),
}

/// A cut cell among finest ones.
pub(super) struct CutCell {
    pub(super) origin: [i32; 3],
    pub(super) split: Split,
    labels: [Region; 8],
    /// What stands beyond each face (2 · axis + side).
    pub(super) sides: [CellState; 6],
    /// Parts with corners of both labels: each has a vertex.
    carrying: u16,
    /// Number of the first of those among all.
    first: u32,
    /// Where parts belong, and how far they have come on the way from their base.
    pub(super) targets: [Point3; 12],
    pub(super) shares: [f64; 12],
}

/// All cut cells, in order, and the points of their parts.
pub(super) struct CutCells<'a> {
    samples: &'a Samples<'a>,
    probe: &'a Probe<'a>,
    pub(super) cells: Vec<CutCell>,
    pub(super) parts: Vec<[Point3; 12]>,
    vertices: u32,
}

/// A polygon around an edge whose ends differ: numbers and points of its corners, counter-clockwise.
#[derive(Default)]
pub(super) struct Polygon {
    ids: [u32; MOST],
    points: [Point3; MOST],
    len: usize,
}

impl Polygon {
    fn push(&mut self, (id, x): (u32, Point3)) {
        self.ids[self.len] = id;
        self.points[self.len] = x;
        self.len += 1;
    }
    fn reverse(&mut self) {
        self.ids[..self.len].reverse();
        self.points[..self.len].reverse();
    }
}

impl CutCell {
    /// The finest cell at `o`, its parts at their base.
    fn new(
        samples: &Samples<'_>,
        probe: &Probe<'_>,
        o: [i32; 3],
        state: impl Fn([i32; 3]) -> CellState,
    ) -> Self {
        let labels = samples.corner_labels(o, 1);
        let split = Split::new(samples, o, &labels);
        let corners = cut_samples(samples, o, &labels, &split);
        let mut carrying = 0;
        let targets = std::array::from_fn(|part| match part_point(probe, &split, &corners, part) {
            Some(x) => {
                carrying |= 1 << part;
                x
            }
            None => part_base(split.diagonals, o, part),
        });
        Self {
            origin: o,
            split,
            labels,
            sides: std::array::from_fn(|face| state(beyond(o, face))),
            carrying,
            first: 0,
            targets,
            shares: [0.0; 12],
        }
    }

    /// What its diagonals say, from a table.
    pub(super) fn pattern(&self) -> &'static Pattern {
        &PATTERNS[usize::from(self.split.diagonals)]
    }

    /// The label of a corner, or of the middle.
    fn label(&self, i: usize) -> Region {
        if i == APEX {
            self.split.label
        } else {
            self.labels[i]
        }
    }

    /// A corner, or the middle.
    fn corner(&self, i: usize) -> Point3 {
        CORNERS[i] + local(self.origin).coords
    }
}

/// The cell beyond a face.
pub(super) fn beyond(cell: [i32; 3], face: usize) -> [i32; 3] {
    let mut out = cell;
    out[face / 2] += if face % 2 == 1 { 1 } else { -1 };
    out
}

impl<'a> CutCells<'a> {
    /// `state` says what stands at a cell.
    pub(super) fn new(
        samples: &'a Samples<'a>,
        probe: &'a Probe<'a>,
        cells: &[[i32; 3]],
        state: impl Fn([i32; 3]) -> CellState + Sync,
    ) -> Self {
        let mut cells: Vec<CutCell> =
            parallel::map_each(cells, |&o| CutCell::new(samples, probe, o, &state));
        let mut vertices = 0;
        for cell in &mut cells {
            cell.first = vertices;
            vertices += cell.carrying.count_ones();
        }
        let parts = cells
            .iter()
            .map(|c| std::array::from_fn(|part| part_base(c.split.diagonals, c.origin, part)))
            .collect();
        Self {
            samples,
            probe,
            cells,
            parts,
            vertices,
        }
    }

    /// The points of all vertices, in order.
    pub(super) fn points(&self, to_world: impl Fn(&Point3) -> Point3 + Sync) -> Vec<Point3> {
        let to_world = &to_world;
        parallel::flat_map(self.cells.len(), |k| {
            let (carrying, parts) = (self.cells[k].carrying, &self.parts[k]);
            let carries = move |part: &usize| carrying >> part & 1 == 1;
            (0..12).filter(carries).map(|part| to_world(&parts[part]))
        })
    }

    /// Number of vertices.
    pub(super) fn len(&self) -> u32 {
        self.vertices
    }

    /// Number, after those of the cells that are not cut, and point of a part.
    fn vertex(&self, k: u32, part: u8, points: &[Point3]) -> (u32, Point3) {
        let cell = &self.cells[k as usize];
        let before = cell.carrying & ((1 << part) - 1);
        (
            points.len() as u32 + cell.first + before.count_ones(),
            self.parts[k as usize][usize::from(part)],
        )
    }

    /// The cells in a quadrant around an edge from `p` to `q`, corners of the cell there, between the
    /// faces before and after it.
    fn push_quadrant(
        &self,
        state: CellState,
        [before, after]: [usize; 2],
        [p, q]: [usize; 2],
        points: &[Point3],
        out: &mut Polygon,
    ) {
        match state {
            CellState::Whole(v) => out.push((v, points[v as usize])),
            CellState::Cut(k) => {
                let diagonals = self.cells[k as usize].split.diagonals;
                for face in [before, after] {
                    out.push(self.vertex(k, half_of(diagonals, face, p, q), points));
                }
            }
            CellState::Plain | CellState::Beyond => {
                unreachable!("an edge whose ends differ is off the box, in cells with both labels")
            }
        }
    }

    /// The triangles around the edges from the lowest corner of a cell whose ends differ, and if it is
    /// cut itself around those within it and in its faces. `mask` are the signs of its corners, `points`
    /// those of the cells that are not cut.
    /// The same edges, in the same order, as [`Emitter::emit`](crate::dual::Emitter::emit) of the octree visits at this
    /// leaf.
    pub(super) fn emit(
        &self,
        low: [i32; 3],
        mask: u8,
        state: impl Fn([i32; 3]) -> CellState,
        points: &[Point3],
        out: &mut Batch,
    ) {
        let inside = |i: usize| mask >> i & 1 == 1;
        for axis in (0..3).filter(|axis| inside(1 << axis) != inside(0)) {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let [before, after] = faces_beside(axis);
            let mut polygon = Polygon::default();
            for (q, [du, dv]) in QUADRANT.into_iter().enumerate() {
                let mut cell = low;
                cell[u] += du;
                cell[v] += dv;
                let p = (-du as usize) << u | (-dv as usize) << v;
                let faces = [before[q], after[q]];
                self.push_quadrant(state(cell), faces, [p, p | 1 << axis], points, &mut polygon);
            }
            let mut high = low;
            high[axis] += 1;
            let start = if polygon.len == 4 {
                let low = local(low);
                kernel::diagonal([0, 1, 2, 3].map(|q| {
                    let x = polygon.points[q];
                    [u, v, axis].map(|k| x[k] - low[k])
                }))
            } else {
                let [a, b] = [low, high].map(local);
                best_fan(&polygon.points[..polygon.len], &a, &b, None)
            };
            let ends = || [low, high].map(|p| Sample::at(self.samples, p, self.samples.label(p)));
            self.fan(&polygon, start, inside(0), ends, out);
        }
        if let CellState::Cut(k) = state(low) {
            self.emit_inner(k, points, out);
        }
    }

    /// The triangles around the diagonals of a cut cell's faces and the edges to its middle.
    fn emit_inner(&self, k: u32, points: &[Point3], out: &mut Batch) {
        let cell = &self.cells[k as usize];
        let diagonals = cell.split.diagonals;
        let mut emit = |edge: [usize; 2], polygon: &Polygon| {
            let [a, b] = edge.map(|i| cell.corner(i));
            let start = best_fan(&polygon.points[..polygon.len], &a, &b, None);
            let ends = || {
                let all = cut_samples(self.samples, cell.origin, &cell.labels, &cell.split);
                edge.map(|i| all[i])
            };
            self.fan(polygon, start, cell.label(edge[0]) == INTERIOR, ends, out);
        };
        for face in 0..6 {
            let edge = diagonal_of(diagonals, face);
            let shared = matches!(cell.sides[face], CellState::Cut(_));
            // A diagonal between two cut cells belongs to the lower.
            if cell.label(edge[0]) == cell.label(edge[1]) || shared && face % 2 == 0 {
                continue;
            }
            let halves = [2 * face as u8, 2 * face as u8 + 1];
            let mut polygon = Polygon::default();
            halves
                .into_iter()
                .for_each(|half| polygon.push(self.vertex(k, half, points)));
            match cell.sides[face] {
                CellState::Whole(v) => polygon.push((v, points[v as usize])),
                CellState::Cut(j) => [halves[1], halves[0]]
                    .into_iter()
                    .for_each(|half| polygon.push(self.vertex(j, half ^ 2, points))),
                CellState::Plain | CellState::Beyond => {
                    unreachable!("a face with both labels is off the box, between cells with both")
                }
            }
            let [a, b] = edge.map(|i| cell.corner(i));
            let [x, y] = halves.map(|half| part_base(diagonals, cell.origin, usize::from(half)));
            if six_volume([a, b, x, y]) < 0.0 {
                polygon.reverse();
            }
            emit(edge, &polygon);
        }
        for corner in (0..8).filter(|&i| cell.label(i) != cell.label(APEX)) {
            let mut polygon = Polygon::default();
            for &part in &AROUND[usize::from(diagonals)][corner] {
                polygon.push(self.vertex(k, part, points));
            }
            emit([APEX, corner], &polygon);
        }
    }

    /// The triangles of a polygon: a fan, or around a point on the edge itself.
    /// `ends` are asked for only if a point must be added.
    fn fan(
        &self,
        polygon: &Polygon,
        start: Option<usize>,
        inside: bool,
        ends: impl FnOnce() -> [Sample; 2],
        out: &mut Batch,
    ) {
        let n = polygon.len;
        let id = |i: usize| polygon.ids[i % n];
        match start {
            Some(s) => {
                (1..n - 1).for_each(|i| out.push([id(s), id(s + i), id(s + i + 1)], inside));
            }
            None => {
                let [a, b] = ends();
                let x = out.add(self.probe.cut(&a, &b));
                (0..n).for_each(|i| out.push([x, id(i), id(i + 1)], inside));
            }
        }
    }
}
