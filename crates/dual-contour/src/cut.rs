//! Cells that are cut into tetrahedra: what follows from the diagonals of their faces alone, and, where
//! all cells around are finest, the points and polygons of the whole complex without an octree.

use std::sync::LazyLock;

use geom_core::Point3;
use geom_core::mesh::{INTERIOR, Region, six_volume};
use rayon::prelude::*;

use crate::complex::{
    MIDDLE, Split, corner_of, diagonal_of, half_of, part_base, parts_around, triangle_of,
};
use crate::dual::{LEAST_VOLUME, Probe, Sample, cut_samples, longest, part_point};
use crate::emit::joined;
use crate::lanes::{self, MOST, Rows};
use crate::quality::best_fan;
use crate::samples::{Samples, local};
use crate::uniform::Batch;

/// Number of the middle among the corners of a cut cell.
pub(crate) const APEX: usize = 8;

/// The corners of the unit cube and its middle.
const CORNERS: [Point3; 9] = {
    let mut out = [MIDDLE; 9];
    let mut i = 0;
    while i < APEX {
        out[i] = Point3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        i += 1;
    }
    out
};

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

/// Umbrellas of a part, [`PART`] of them, in twos of eight lanes.
const LANES_OF_PART: usize = 16;
const PART: usize = 12;
/// Umbrellas of a face, of both of its parts, in eight lanes.
const LANES_OF_FACE: usize = 8;
const FACE: usize = 6;

/// Tetrahedra of an edge, a part and what stands beyond one of its faces.
struct Umbrellas<const N: usize> {
    shape: lanes::Umbrellas<N>,
    /// Their least volumes: beyond stands a whole cell, or a part. Exact in f32 but for the factor.
    least: [[f64; N]; 2],
}

/// What the diagonals of a cut cell say.
pub(crate) struct Pattern {
    /// Of each part: the edges of its triangle, then those of the faces between it and its mates.
    parts: [Umbrellas<LANES_OF_PART>; 12],
    /// Of the triangles of both parts at each face.
    faces: [Umbrellas<LANES_OF_FACE>; 6],
    /// The parts beyond the three inner faces.
    mates: [[u8; 3]; 12],
    /// Parts around the edge from the middle to each corner, counter-clockwise about it.
    pub(crate) around: [Vec<u8>; 8],
}

/// By the six diagonals.
pub(crate) static PATTERNS: LazyLock<Vec<Pattern>> =
    LazyLock::new(|| (0..64).map(Pattern::new).collect());

/// An edge `a → b`, and what [`Umbrellas`] say of it.
#[derive(Clone, Copy)]
struct Umbrella {
    edge: [usize; 2],
    first: bool,
    base: [f64; 2],
}

impl<const N: usize> Umbrellas<N> {
    /// Lanes beyond these umbrellas never lack volume.
    fn new(umbrellas: &[Umbrella]) -> Self {
        let mut out = Self {
            shape: lanes::Umbrellas {
                a: [[0.0; N]; 3],
                b: [[0.0; N]; 3],
                first: [0.0; N],
            },
            least: [[f64::NEG_INFINITY; N]; 2],
        };
        for (i, umbrella) in umbrellas.iter().enumerate() {
            let [a, b] = umbrella.edge.map(|i| CORNERS[i]);
            for k in 0..3 {
                (out.shape.a[k][i], out.shape.b[k][i]) = (a[k], b[k]);
            }
            out.shape.first[i] = f64::from(u8::from(umbrella.first));
            for (least, base) in out.least.iter_mut().zip(umbrella.base) {
                least[i] = LEAST_VOLUME * base;
            }
        }
        out
    }
}

impl<const N: usize> Umbrellas<N> {
    /// What the tetrahedra have above their least volumes with parts at `x` and what is beyond at `y`.
    fn spare(&self, cell: &CutCell, x: &Rows<N>, y: &Rows<N>, least: &[f64; N]) -> [f64; N] {
        self.shape.spare(cell.origin.map(f64::from), x, y, least)
    }
}

fn is_positive(spares: &[f64]) -> bool {
    spares.iter().all(|&s| s > 0.0)
}

impl Pattern {
    fn new(diagonals: u8) -> Self {
        let base = |part: usize| part_base(diagonals, [0; 3], part);
        let mut umbrellas: [Vec<Umbrella>; 12] = Default::default();
        let mut mates = [[0; 3]; 12];
        for part in 0..12 {
            let t = triangle_of(diagonals, part);
            let face = part / 2;
            let diagonal = diagonal_of(diagonals, face);
            let mut over = MIDDLE;
            over[face / 2] += if face % 2 == 1 { 1.0 } else { -1.0 };
            let sum = t.iter().fold(over.coords, |s, &i| s + CORNERS[i].coords);
            let outer = [over, Point3::from(sum / 4.0)];
            let umbrella = |[a, b]: [usize; 2], beyond: [Point3; 2]| {
                let volume =
                    beyond.map(|x| six_volume([CORNERS[a], CORNERS[b], base(part), x]) as f32);
                Umbrella {
                    edge: [a, b],
                    first: volume[0] > 0.0,
                    base: volume.map(|v| f64::from(v.abs())),
                }
            };
            let mut inner = Vec::new();
            for i in 0..3 {
                let (p, q) = (t[i], t[(i + 1) % 3]);
                // Along the axis, or as the ring of the diagonal goes.
                let edge = if diagonal.contains(&p) && diagonal.contains(&q) {
                    diagonal
                } else {
                    [p.min(q), p.max(q)]
                };
                umbrellas[part].push(umbrella(edge, outer));
                let has = |other: &usize| {
                    let t = triangle_of(diagonals, *other);
                    *other != part && t.contains(&p) && t.contains(&q)
                };
                let mate = (0..12).find(has).expect("two triangles meet in an edge");
                mates[part][i] = mate as u8;
                let edges = [edge, [APEX, p], [APEX, q]];
                inner.extend(edges.map(|e| umbrella(e, [base(mate); 2])));
            }
            umbrellas[part].extend(inner);
        }
        Self {
            parts: std::array::from_fn(|part| Umbrellas::new(&umbrellas[part])),
            faces: std::array::from_fn(|face| {
                let [p, q] = [0, 1].map(|half| &umbrellas[2 * face + half][..FACE / 2]);
                Umbrellas::new(&[p, q].concat())
            }),
            mates,
            around: std::array::from_fn(|corner| parts_around(diagonals, corner)),
        }
    }
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
            umbrellas.spare(cell, &x, &y, &umbrellas.least[0])
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
                umbrellas.spare(cell, &x, &y, &least)
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
        // Quadrants about the axis: 0 (−,−), 1 (+,−), 2 (+,+), 3 (−,+).
        const QUADRANT: [[i32; 2]; 4] = [[-1, -1], [0, -1], [0, 0], [-1, 0]];
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
                lanes::diagonal([0, 1, 2, 3].map(|q| {
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
            for &part in &cell.pattern().around[corner] {
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
