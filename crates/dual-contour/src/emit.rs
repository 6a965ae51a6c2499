//! From rings to triangles and tetrahedra.

use geom_core::mesh::{INTERIOR, OUTSIDE, Region, VertexKind};
use geom_core::{Point3, parallel};
use rayon::prelude::*;

use crate::complex::{Cell, Complex, Corner, Ring};
use crate::dual::{Duals, Probe, sample_corner};
use crate::lanes;
use crate::octree::{PointMarks, PointSet};
use crate::quality::best_fan;
use crate::samples::local;

/// Leaves per batch; batches are independent and joined in order.
const BATCH: usize = 2048;
/// Marks a vertex that a batch has added on an edge, by its number within the batch.
pub(crate) const ADDED: u32 = 1 << 31;

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
    pub(crate) fn new(
        complex: &Complex<'_>,
        ghosts: &'a [(u32, u8)],
        corners: impl Fn(Region) -> bool + Sync,
    ) -> Self {
        let marks = PointMarks::new(complex.tree.cells);
        complex
            .tree
            .leaves
            .par_iter()
            .with_min_len(1024)
            .for_each(|leaf| {
                if leaf.void {
                    return;
                }
                let (o, s) = (leaf.origin(), leaf.size());
                for (i, label) in complex.corner_labels(leaf).into_iter().enumerate() {
                    if corners(label) {
                        let p = crate::complex::corner_of(i);
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

/// Everything that emission reads.
pub(crate) struct Emitter<'a> {
    pub(crate) complex: &'a Complex<'a>,
    pub(crate) duals: &'a Duals,
    pub(crate) probe: &'a Probe<'a>,
    pub(crate) numbering: Numbering<'a>,
}

/// What is emitted, in vertex numbers of the emitter.
#[derive(Default)]
pub(crate) struct Emission {
    pub(crate) tets: Vec<[u32; 4]>,
    pub(crate) regions: Vec<Region>,
    /// Triangles of the boundary of the molecule, seen from outside of it.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Points added on edges, in finest cells.
    pub(crate) added: Vec<Point3>,
}

/// What to emit.
#[derive(Clone, Copy)]
pub(crate) struct Want<F> {
    pub(crate) tets: bool,
    pub(crate) region: F,
}

impl<'a> Emitter<'a> {
    /// `corners` says whether lattice points become vertices.
    pub(crate) fn new(
        complex: &'a Complex<'a>,
        duals: &'a Duals,
        probe: &'a Probe<'a>,
        corners: impl Fn(Region) -> bool + Sync,
    ) -> Self {
        Self {
            complex,
            duals,
            probe,
            numbering: Numbering::new(complex, duals.ghosts(), corners),
        }
    }

    /// Positions (finest cells) of all vertices, added ones included.
    pub(crate) fn positions(&self, added: &[Point3]) -> Vec<Point3> {
        let complex = self.complex;
        let vertices: Vec<Vertex> = self.numbering.vertices().collect();
        let mut out: Vec<Point3> = vertices
            .par_iter()
            .with_min_len(1024)
            .map(|v| match v {
                Vertex::Cell(cell) => self.duals.position(complex, cell),
                Vertex::Corner(corner) => complex.corner_position(*corner),
            })
            .collect();
        out.extend(added);
        out
    }

    /// How many different labels meet at each vertex, as seen by the mesh: what is not kept is one.
    pub(crate) fn meeting(&self, added: usize, keep: impl Fn(Region) -> bool + Sync) -> Vec<u8> {
        let complex = self.complex;
        let vertices: Vec<Vertex> = self.numbering.vertices().collect();
        let mut out: Vec<u8> = vertices
            .par_iter()
            .with_min_len(1024)
            .map(|v| match v {
                Vertex::Cell(cell) => {
                    distinct(complex.labels_of(cell).into_iter().map(|l| seen(l, &keep)))
                }
                Vertex::Corner(_) => 1,
            })
            .collect();
        out.resize(out.len() + added, 2);
        out
    }

    /// Walks over all rings with a wanted end and emits.
    pub(crate) fn emit<F: Fn(Region) -> bool + Sync>(&self, want: &Want<F>) -> Emission {
        let leaves = self.complex.tree.leaves.len();
        let batches: Vec<Emission> = (0..leaves.div_ceil(BATCH))
            .into_par_iter()
            .map(|b| {
                let mut out = Emission::default();
                for id in b * BATCH..((b + 1) * BATCH).min(leaves) {
                    // The surface passes edges between molecule and others; pieces of the box close it.
                    let caps = !self.duals.ghosts().is_empty() && self.complex.is_on_box(id as u32);
                    let asked = |p: Region, q: Region| {
                        let surface = (p == INTERIOR) != (q == INTERIOR);
                        let cap = caps && (p == INTERIOR || q == INTERIOR);
                        surface || cap || want.tets && ((want.region)(p) || (want.region)(q))
                    };
                    if !want.tets && !caps && !self.complex.is_interface(id as u32) {
                        continue;
                    }
                    self.complex
                        .rings_of(id as u32, asked, |ring| self.ring(ring, want, &mut out));
                }
                out
            })
            .collect();
        let counts: Vec<u32> = batches.iter().map(|b| b.added.len() as u32).collect();
        let starts = parallel::starts_of(&counts);
        let shift = |batch: usize, v: u32| {
            if v & ADDED == 0 {
                v
            } else {
                self.numbering.len + starts[batch] as u32 + (v & !ADDED)
            }
        };
        let (mut tets, mut regions, mut triangles, mut added) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for batch in batches {
            tets.push(batch.tets);
            regions.push(batch.regions);
            triangles.push(batch.triangles);
            added.push(batch.added);
        }
        Emission {
            tets: joined(tets, |b, t| t.map(|v| shift(b, v))),
            regions: joined(regions, |_, r| r),
            triangles: joined(triangles, |b, t| t.map(|v| shift(b, v))),
            added: added.concat(),
        }
    }

    /// Emits what stands around one edge.
    pub(crate) fn ring<F: Fn(Region) -> bool>(
        &self,
        ring: &Ring<'_>,
        want: &Want<F>,
        out: &mut Emission,
    ) {
        let n = ring.cells.len();
        let sides = if ring.open { n - 1 } else { n };
        let (la, lb) = (ring.a.1, ring.b.1);
        let keep = |label: Region| want.tets && (want.region)(label);
        let mut ids = [0; 10];
        if ring.open && self.duals.ghosts().is_empty() {
            // The box is not part of the mesh, so nothing that is wanted reaches it.
            return;
        }
        if la == lb {
            if keep(la) {
                for (id, cell) in ids.iter_mut().zip(ring.cells) {
                    *id = self.numbering.cell(cell);
                }
                let [a, b] = [ring.a.0, ring.b.0].map(|c| self.numbering.corner(c));
                for i in 0..sides {
                    out.tets.push([a, b, ids[i], ids[(i + 1) % n]]);
                    out.regions.push(la);
                }
            }
            if ring.open && la == INTERIOR {
                self.cap(ring, |c| self.numbering.corner(c), None, out);
            }
            return;
        }
        for (id, cell) in ids.iter_mut().zip(ring.cells) {
            *id = self.numbering.cell(cell);
        }
        let ids = &ids[..n];
        let surface = la == INTERIOR || lb == INTERIOR;
        // Seen from outside of the molecule.
        let facing = |t: [u32; 3]| {
            if la == INTERIOR {
                t
            } else {
                [t[0], t[2], t[1]]
            }
        };
        let a = keep(la).then(|| self.numbering.corner(ring.a.0));
        let b = keep(lb).then(|| self.numbering.corner(ring.b.0));
        if !ring.open
            && let Some(start) = self.best_fan(ring)
        {
            for i in 1..n - 1 {
                let t = [ids[start], ids[(start + i) % n], ids[(start + i + 1) % n]];
                if surface {
                    out.triangles.push(facing(t));
                }
                if let Some(a) = a {
                    out.tets.push([a, t[0], t[1], t[2]]);
                    out.regions.push(la);
                }
                if let Some(b) = b {
                    out.tets.push([b, t[0], t[2], t[1]]);
                    out.regions.push(lb);
                }
            }
            return;
        }
        // A point on the edge itself: always positive, and both sides agree.
        let [p, q] = [ring.a, ring.b].map(|(c, label)| sample_corner(self.complex, c, label));
        let x = ADDED | out.added.len() as u32;
        out.added.push(self.probe.cut(&p, &q));
        for i in 0..sides {
            let (c, d) = (ids[i], ids[(i + 1) % n]);
            if surface {
                out.triangles.push(facing([x, c, d]));
            }
            if let Some(a) = a {
                out.tets.push([a, x, c, d]);
                out.regions.push(la);
            }
            if let Some(b) = b {
                out.tets.push([x, b, c, d]);
                out.regions.push(lb);
            }
        }
        if ring.open && surface {
            self.cap(ring, |c| self.numbering.corner(c), Some(x), out);
        }
    }

    /// The pieces of the box beside an edge in it that close the molecule: `a`, `b` (or the added
    /// point, where only one of them is inside) and the ghosts.
    fn cap(
        &self,
        ring: &Ring<'_>,
        vertex: impl Fn(Corner) -> u32,
        added: Option<u32>,
        out: &mut Emission,
    ) {
        let first = self.numbering.cell(&ring.cells[0]);
        let last = self.numbering.cell(&ring.cells[ring.cells.len() - 1]);
        let (a, b) = match added {
            None => (vertex(ring.a.0), vertex(ring.b.0)),
            Some(x) if ring.a.1 == INTERIOR => (vertex(ring.a.0), x),
            Some(x) => (x, vertex(ring.b.0)),
        };
        out.triangles.push([a, first, b]);
        out.triangles.push([a, b, last]);
    }

    /// The axis of an edge between four finest leaves that are not split.
    fn uniform(&self, ring: &Ring<'_>) -> Option<usize> {
        let finest = |c: &Cell| matches!(*c, Cell::Leaf(id) if self.complex.leaf(id).log == 0);
        let (Corner::Point(a), Corner::Point(b)) = (ring.a.0, ring.b.0) else {
            return None;
        };
        (ring.cells.len() == 4 && ring.cells.iter().all(finest))
            .then(|| (0..3).find(|&k| a[k] != b[k]))?
    }

    /// Where the fan of triangles over a closed ring begins so that the worst tetrahedron on either
    /// side is best; `None` if none keeps all of them positive.
    fn best_fan(&self, ring: &Ring<'_>) -> Option<usize> {
        let n = ring.cells.len();
        let mut x = [Point3::origin(); 10];
        for (x, cell) in x.iter_mut().zip(ring.cells) {
            *x = self.duals.position(self.complex, cell);
        }
        if let Some(axis) = self.uniform(ring) {
            let (Corner::Point(low), [u, v]) = (ring.a.0, [(axis + 1) % 3, (axis + 2) % 3]) else {
                unreachable!("an edge between leaves joins lattice points");
            };
            let low = local(low);
            let quad = [0, 1, 2, 3].map(|q| [u, v, axis].map(|k| x[q][k] - low[k]));
            return lanes::diagonal(quad);
        }
        let [a, b] = [ring.a.0, ring.b.0].map(|c| self.complex.corner_position(c));
        best_fan(&x[..n], &a, &b, ring.taken)
    }
}

/// One list of all, in order; `f` sees the number of the list that an item comes from.
pub(crate) fn joined<T: Copy + Default + Send + Sync>(
    lists: Vec<Vec<T>>,
    f: impl Fn(usize, T) -> T + Sync,
) -> Vec<T> {
    let mut out = vec![T::default(); lists.iter().map(Vec::len).sum()];
    let mut rest = out.as_mut_slice();
    let mut parts = Vec::with_capacity(lists.len());
    for list in lists {
        let (part, others) = std::mem::take(&mut rest).split_at_mut(list.len());
        rest = others;
        parts.push((part, list));
    }
    parts
        .into_par_iter()
        .enumerate()
        .for_each(|(i, (part, list))| {
            for (to, &from) in part.iter_mut().zip(&list) {
                *to = f(i, from);
            }
        });
    out
}

/// A label as the mesh sees it: regions that are not kept are all the outside.
pub(crate) fn seen(label: Region, keep: impl Fn(Region) -> bool) -> Region {
    if keep(label) { label } else { OUTSIDE }
}

/// The number of different labels, up to three.
pub(crate) fn distinct(labels: impl IntoIterator<Item = Region>) -> u8 {
    let mut found = [0; 2];
    let mut n = 0;
    for l in labels {
        if !found[..n].contains(&l) {
            if n == 2 {
                return 3;
            }
            found[n] = l;
            n += 1;
        }
    }
    n as u8
}

/// How vertices may move: where they stand on the box, and how many labels meet there.
pub(crate) fn kinds(positions: &[Point3], meeting: &[u8], cells: [i32; 3]) -> Vec<VertexKind> {
    positions
        .par_iter()
        .zip(meeting)
        .with_min_len(4096)
        .map(|(p, &labels)| match (box_kind(p, cells), labels) {
            (kind, 0 | 1) => kind,
            (VertexKind::Interior, 2) => VertexKind::Surface,
            _ => VertexKind::Fixed,
        })
        .collect()
}

/// How a vertex at `p` (finest cells) may move if the domain has `cells` cells.
fn box_kind(p: &Point3, cells: [i32; 3]) -> VertexKind {
    let on = [0, 1, 2].map(|k| p[k] == 0.0 || p[k] == f64::from(cells[k]));
    match on.iter().filter(|&&o| o).count() {
        0 => VertexKind::Interior,
        1 => VertexKind::BoxFace {
            axis: on.iter().position(|&o| o).expect("one axis") as u8,
        },
        2 => VertexKind::BoxEdge {
            axis: on.iter().position(|&o| !o).expect("one axis") as u8,
        },
        _ => VertexKind::Fixed,
    }
}

/// The vertices that elements use, in order; renumbers the elements in place.
pub(crate) fn compact<const N: usize>(vertices: usize, elements: &mut [[u32; N]]) -> Vec<u32> {
    let mut used = vec![false; vertices];
    for &v in elements.iter().flatten() {
        used[v as usize] = true;
    }
    let mut number = vec![u32::MAX; vertices];
    let mut kept = Vec::new();
    for (v, _) in used.iter().enumerate().filter(|(_, u)| **u) {
        number[v] = kept.len() as u32;
        kept.push(v as u32);
    }
    elements
        .par_iter_mut()
        .with_min_len(4096)
        .for_each(|e| *e = e.map(|v| number[v as usize]));
    kept
}
