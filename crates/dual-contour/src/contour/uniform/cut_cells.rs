//! Cells that are cut into tetrahedra, where all cells around are finest: their points and polygons without an
//! octree.

use geom_core::Point3;
use geom_core::mesh::{INTERIOR, Region, six_volume};
use rayon::prelude::*;

use super::batch::Batch;
use super::pattern::{FACE, LANES_OF_FACE, LANES_OF_PART, PART, PATTERNS, Pattern, is_positive};
use crate::complex::Split;
use crate::complex::collect::joined;
use crate::complex::cube::{
    APEX, AROUND, CORNERS, MIDDLE, QUADRANT, corner_of, diagonal_of, half_of, part_base,
};
use crate::dual::room::longest;
use crate::dual::{Probe, Sample, cut_samples, part_point};
use crate::kernel::{self, MOST, best_fan};
use crate::octree::{Samples, local};

/// What stands at a finest cell.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Place {
    /// Nothing: it is beyond the domain.
    Gone,
    /// A cell of one label, its point in its middle.
    Plain,
    /// A cell that is not cut, by the number of its vertex.
    Whole(u32),
    /// A cut cell, by its number among them.
    Cut(u32),
}

/// A cut cell among finest ones.
struct CutCell {
    origin: [i32; 3],
    split: Split,
    labels: [Region; 8],
    /// What stands beyond each face (2 · axis + side).
    sides: [Place; 6],
    /// Parts with corners of both labels: each has a vertex.
    carrying: u16,
    /// Number of the first of those among all.
    first: u32,
    /// Where parts want to stand, and how far they have come.
    targets: [Point3; 12],
    shares: [f64; 12],
}

/// All cut cells, in order, and the points of their parts.
pub(crate) struct CutCells<'a> {
    samples: &'a Samples<'a>,
    probe: &'a Probe<'a>,
    cells: Vec<CutCell>,
    parts: Vec<[Point3; 12]>,
    vertices: u32,
}

/// A cell that is not cut beside cut ones.
struct Neighbour {
    vertex: u32,
    cell: [i32; 3],
    target: Point3,
    share: f64,
    /// Cut cells, and which of their faces.
    beside: std::ops::Range<usize>,
}

/// A polygon around an edge whose ends differ: numbers and points of its corners, counter-clockwise.
#[derive(Default)]
pub(crate) struct Polygon {
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
    fn pattern(&self) -> &'static Pattern {
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

impl Neighbour {
    /// Its point at a share of the way to its place.
    fn at(&self, t: f64) -> Point3 {
        let base = MIDDLE + local(self.cell).coords;
        base + (self.target - base) * t
    }
}

/// A number that two cut cells, or two others, with a common face share only if they are one.
fn parity(cell: [i32; 3]) -> usize {
    (0..3).map(|k| ((cell[k] & 1) << k) as usize).sum()
}

fn beyond(cell: [i32; 3], face: usize) -> [i32; 3] {
    let mut out = cell;
    out[face / 2] += if face % 2 == 1 { 1 } else { -1 };
    out
}

impl<'a> CutCells<'a> {
    /// `place` says what stands at a cell.
    pub(crate) fn new(
        samples: &'a Samples<'a>,
        probe: &'a Probe<'a>,
        cells: &[[i32; 3]],
        place: impl Fn([i32; 3]) -> Place + Sync,
    ) -> Self {
        let mut cells: Vec<CutCell> = cells
            .par_iter()
            .with_min_len(64)
            .map(|&o| {
                let labels = std::array::from_fn(|i| {
                    samples.label([0, 1, 2].map(|k| o[k] + corner_of(i)[k]))
                });
                let split = Split::new(samples, o, &labels);
                let corners = cut_samples(samples, o, &labels, &split);
                let mut carrying = 0;
                let targets =
                    std::array::from_fn(|part| match part_point(probe, &split, &corners, part) {
                        Some(x) => {
                            carrying |= 1 << part;
                            x
                        }
                        None => part_base(split.diagonals, o, part),
                    });
                CutCell {
                    origin: o,
                    split,
                    labels,
                    sides: std::array::from_fn(|face| place(beyond(o, face))),
                    carrying,
                    first: 0,
                    targets,
                    shares: [0.0; 12],
                }
            })
            .collect();
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

    /// Lets the points of parts, and of the cells that share a face with a cut one, go from their base to
    /// their place as far as all umbrellas stay positive: in the order of the complex's own code.
    /// Returns how many do not arrive.
    pub(crate) fn keep_positive(&mut self, points: &mut [Point3]) -> usize {
        let mut beside: Vec<(usize, u32, u32, u8)> = self
            .cells
            .par_iter()
            .enumerate()
            .with_min_len(256)
            .flat_map_iter(|(k, cell)| {
                (0..6).filter_map(move |face| match cell.sides[face] {
                    Place::Whole(v) => {
                        Some((parity(beyond(cell.origin, face)), v, k as u32, face as u8))
                    }
                    _ => None,
                })
            })
            .collect();
        beside.par_sort_unstable();
        let starts: Vec<usize> = (0..beside.len())
            .into_par_iter()
            .with_min_len(4096)
            .filter(|&i| i == 0 || beside[i - 1].1 != beside[i].1)
            .collect();
        // By parity, as what is beside.
        let mut neighbours: Vec<Neighbour> = (0..starts.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let end = starts.get(i + 1).map_or(beside.len(), |&end| end);
                let (_, vertex, k, face) = beside[starts[i]];
                Neighbour {
                    vertex,
                    cell: beyond(self.cells[k as usize].origin, usize::from(face)),
                    target: points[vertex as usize],
                    share: 0.0,
                    beside: starts[i]..end,
                }
            })
            .collect();
        for n in &neighbours {
            points[n.vertex as usize] = n.at(0.0);
        }
        let mut of_parity: [Vec<u32>; 8] = Default::default();
        for (k, cell) in self.cells.iter().enumerate() {
            of_parity[parity(cell.origin)].push(k as u32);
        }
        for _ in 0..2 {
            for group in neighbours.chunk_by_mut(|n, m| parity(n.cell) == parity(m.cell)) {
                group.par_iter_mut().with_min_len(64).for_each(|n| {
                    if n.share < 1.0 {
                        n.share = self.neighbour_share(n, &beside[n.beside.clone()]);
                    }
                });
                for n in group {
                    points[n.vertex as usize] = n.at(n.share);
                }
            }
            for group in &of_parity {
                let moved: Vec<_> = group
                    .par_iter()
                    .with_min_len(32)
                    .filter(|&&k| self.cells[k as usize].shares.iter().any(|&s| s < 1.0))
                    .map(|&k| (k, self.moved(k as usize, points)))
                    .collect();
                for (k, (parts, shares)) in moved {
                    self.parts[k as usize] = parts;
                    self.cells[k as usize].shares = shares;
                }
            }
        }
        let short = |shares: &[f64]| shares.iter().filter(|&&s| s < 1.0).count();
        let parts: usize = self.cells.iter().map(|c| short(&c.shares)).sum();
        let whole = neighbours.iter().filter(|n| n.share < 1.0);
        parts + whole.count()
    }

    /// How far a cell that is not cut may go beside the cut ones.
    fn neighbour_share(&self, n: &Neighbour, beside: &[(usize, u32, u32, u8)]) -> f64 {
        let base = MIDDLE + local(n.cell).coords;
        let spare = |&(.., k, face): &(usize, u32, u32, u8), y: &Point3| {
            let cell = &self.cells[k as usize];
            let umbrellas = &cell.pattern().faces[usize::from(face)];
            let mut x = [[0.0; LANES_OF_FACE]; 3];
            for (half, of_half) in [0..FACE / 2, FACE / 2..FACE].into_iter().enumerate() {
                let part = &self.parts[k as usize][2 * usize::from(face) + half];
                (0..3).for_each(|c| x[c][of_half.clone()].fill(part[c]));
            }
            let y = [y.x, y.y, y.z].map(|c| [c; LANES_OF_FACE]);
            umbrellas.spare(cell.origin, &x, &y, &umbrellas.least[0])
        };
        if beside.iter().all(|b| is_positive(&spare(b, &n.target))) {
            return 1.0;
        }
        let spares = beside.iter().flat_map(|b| {
            let (first, last) = (spare(b, &base), spare(b, &n.target));
            (0..FACE).map(move |i| [first[i], last[i]])
        });
        longest(n.share, spares)
    }

    /// The points of the parts of a cell after each has gone as far as it may, one after the other.
    fn moved(&self, k: usize, points: &[Point3]) -> ([Point3; 12], [f64; 12]) {
        let cell = &self.cells[k];
        let pattern = cell.pattern();
        let (mut parts, mut shares) = (self.parts[k], cell.shares);
        for part in 0..12 {
            let base = part_base(cell.split.diagonals, cell.origin, part);
            let target = cell.targets[part];
            if shares[part] >= 1.0 || target == base {
                shares[part] = 1.0;
                continue;
            }
            let face = part / 2;
            let outer = match cell.sides[face] {
                Place::Gone => None,
                Place::Plain => Some((MIDDLE + local(beyond(cell.origin, face)).coords, 0)),
                Place::Whole(v) => Some((points[v as usize], 0)),
                // The two halves of a face have the same numbers on both sides.
                Place::Cut(j) => Some((self.parts[j as usize][part ^ 2], 1)),
            };
            let mates = pattern.mates[part].map(|mate| parts[usize::from(mate)]);
            let umbrellas = &pattern.parts[part];
            let mut least = umbrellas.least[outer.map_or(0, |(_, kind)| kind)];
            if outer.is_none() {
                least[..3].fill(f64::NEG_INFINITY);
            }
            let outer = outer.map_or(base, |(x, _)| x);
            let mut y = [[0.0; LANES_OF_PART]; 3];
            for (beyond, x) in [outer, mates[0], mates[1], mates[2]].iter().enumerate() {
                (0..3).for_each(|c| y[c][3 * beyond..3 * beyond + 3].fill(x[c]));
            }
            let spare = |x: &Point3| {
                let x = [x.x, x.y, x.z].map(|c| [c; LANES_OF_PART]);
                umbrellas.spare(cell.origin, &x, &y, &least)
            };
            let last = spare(&target);
            shares[part] = if is_positive(&last) {
                1.0
            } else {
                let first = spare(&base);
                longest(shares[part], (0..PART).map(|i| [first[i], last[i]]))
            };
            parts[part] = base + (target - base) * shares[part];
        }
        (parts, shares)
    }

    /// The points of all vertices, in order.
    pub(crate) fn points(&self, to_world: impl Fn(&Point3) -> Point3 + Sync) -> Vec<Point3> {
        let lists = self.cells.par_chunks(256).zip(self.parts.par_chunks(256));
        let lists = lists.map(|(cells, parts)| {
            let carried = cells.iter().zip(parts).flat_map(|(cell, parts)| {
                let carries = |part: &usize| cell.carrying >> part & 1 == 1;
                (0..12).filter(carries).map(|part| to_world(&parts[part]))
            });
            carried.collect()
        });
        joined(lists.collect(), |_, x| x)
    }

    /// Number of vertices.
    pub(crate) fn len(&self) -> u32 {
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
        place: Place,
        [before, after]: [usize; 2],
        [p, q]: [usize; 2],
        points: &[Point3],
        out: &mut Polygon,
    ) {
        match place {
            Place::Whole(v) => out.push((v, points[v as usize])),
            Place::Cut(k) => {
                let diagonals = self.cells[k as usize].split.diagonals;
                for face in [before, after] {
                    out.push(self.vertex(k, half_of(diagonals, face, p, q), points));
                }
            }
            Place::Plain | Place::Gone => {
                unreachable!("an edge whose ends differ is off the box, in cells with both labels")
            }
        }
    }

    /// The triangles around the edges from the lowest corner of a cell whose ends differ, and if it is
    /// cut itself around those within it and in its faces. `mask` are the signs of its corners, `points`
    /// those of the cells that are not cut.
    pub(crate) fn emit(
        &self,
        low: [i32; 3],
        mask: u8,
        place: impl Fn([i32; 3]) -> Place,
        points: &[Point3],
        out: &mut Batch,
    ) {
        let inside = |i: usize| mask >> i & 1 == 1;
        for axis in (0..3).filter(|axis| inside(1 << axis) != inside(0)) {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let before = [2 * v + 1, 2 * u, 2 * v, 2 * u + 1];
            let after = [2 * u + 1, 2 * v + 1, 2 * u, 2 * v];
            let mut polygon = Polygon::default();
            for (q, [du, dv]) in QUADRANT.into_iter().enumerate() {
                let mut cell = low;
                cell[u] += du;
                cell[v] += dv;
                let p = (-du as usize) << u | (-dv as usize) << v;
                let faces = [before[q], after[q]];
                self.push_quadrant(place(cell), faces, [p, p | 1 << axis], points, &mut polygon);
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
            let ends = || {
                [low, high].map(|p| Sample {
                    x: local(p),
                    label: self.samples.label(p),
                    value: self.samples.value(p),
                })
            };
            self.fan(&polygon, start, inside(0), ends, out);
        }
        if let Place::Cut(k) = place(low) {
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
            let shared = matches!(cell.sides[face], Place::Cut(_));
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
                Place::Whole(v) => polygon.push((v, points[v as usize])),
                Place::Cut(j) => [halves[1], halves[0]]
                    .into_iter()
                    .for_each(|half| polygon.push(self.vertex(j, half ^ 2, points))),
                Place::Plain | Place::Gone => {
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
