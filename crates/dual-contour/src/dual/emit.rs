//! From rings to triangles and tetrahedra.
//!
//! An edge whose ends have one label gives a tetrahedron with each two neighbouring cells around it. One whose ends
//! differ gives a polygon of the interface: its triangles are fanned so that the worst tetrahedron is best, or, where
//! no fan is positive, stand around a point on the edge itself. Edges see only their own ring, so they are emitted in
//! any order and by any thread, and the mesh conforms.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::mesh::{INTERIOR, Region};

use super::Duals;
use super::probe::{Probe, sample_corner};
use crate::complex::collect::{ADDED, distinct, joined, seen};
use crate::complex::{Cell, Complex, Corner, Numbering, Ring, Vertex};
use crate::kernel;
use crate::octree::local;

/// Leaves per batch; batches are independent and joined in order.
const BATCH: usize = 2048;

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
    /// Or the surface alone.
    pub(crate) tets: bool,
    /// Which labels get tetrahedra.
    pub(crate) region: F,
    /// The box of finest cells that a leaf must touch to emit anything; `None`: all.
    pub(crate) near: Option<[[i32; 3]; 2]>,
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
    /// By vertex number; those that nothing uses are among them.
    pub(crate) fn positions(&self, added: &[Point3]) -> Vec<Point3> {
        let complex = self.complex;
        let vertices: Vec<Vertex> = self.numbering.vertices().collect();
        let mut out: Vec<Point3> = parallel::map_each(&vertices, |v| match v {
            Vertex::Cell(cell) => self.duals.position(complex, cell),
            Vertex::Corner(corner) => complex.corner_position(*corner),
        });
        out.extend(added);
        out
    }

    /// How many different labels meet at each vertex, as seen by the mesh: what is not kept is one.
    pub(crate) fn meeting(&self, added: usize, keep: impl Fn(Region) -> bool + Sync) -> Vec<u8> {
        let complex = self.complex;
        let vertices: Vec<Vertex> = self.numbering.vertices().collect();
        let mut out: Vec<u8> = parallel::map_each(&vertices, |v| match v {
            Vertex::Cell(cell) => {
                distinct(complex.labels_of(cell).into_iter().map(|l| seen(l, &keep)))
            }
            Vertex::Corner(_) => 1,
        });
        out.resize(out.len() + added, 2);
        out
    }

    /// Walks over all rings with a wanted end and emits.
    /// Batches of leaves number the points that they add from 0, marked by [`ADDED`]; when they are joined these follow
    /// all others.
    pub(crate) fn emit<F: Fn(Region) -> bool + Sync>(&self, want: &Want<F>) -> Emission {
        let leaves = self.complex.tree.leaves.len();
        let batches: Vec<Emission> = parallel::map(leaves.div_ceil(BATCH), |b| {
            let mut out = Emission::default();
            for id in b * BATCH..((b + 1) * BATCH).min(leaves) {
                // The surface passes edges between molecule and others; pieces of the box close it.
                let caps = !self.duals.ghosts().is_empty() && self.complex.is_on_box(id as u32);
                let asked = |p: Region, q: Region| {
                    let surface = (p == INTERIOR) != (q == INTERIOR);
                    let cap = caps && (p == INTERIOR || q == INTERIOR);
                    surface || cap || want.tets && ((want.region)(p) || (want.region)(q))
                };
                let silent = !want.tets && !caps && !self.complex.is_interface(id as u32);
                if silent || !self.complex.touches(id as u32, want.near) {
                    continue;
                }
                self.complex
                    .rings_of(id as u32, asked, |ring| self.ring(ring, want, &mut out));
            }
            out
        });
        let counts: Vec<u32> = batches.iter().map(|b| b.added.len() as u32).collect();
        let starts = parallel::starts_of(&counts);
        let shift = |batch: usize, v: u32| {
            if v & ADDED == 0 {
                v
            } else {
                self.numbering.len() as u32 + starts[batch] as u32 + (v & !ADDED)
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
    /// The triangles of a polygon are those of the surface only where one end is in the molecule; between two materials
    /// there are only tetrahedra.
    fn ring<F: Fn(Region) -> bool>(&self, ring: &Ring<'_>, want: &Want<F>, out: &mut Emission) {
        if ring.open && self.duals.ghosts().is_empty() {
            // The box is not part of the mesh, so nothing that is wanted reaches it.
            return;
        }
        if ring.a.1 == ring.b.1 {
            self.ring_within(ring, want, out);
            return;
        }
        let mut ids = [0; 10];
        for (id, cell) in ids.iter_mut().zip(ring.cells) {
            *id = self.numbering.cell(cell);
        }
        let ids = &ids[..ring.cells.len()];
        let sides = Sides::new(self, ring, want);
        // An open ring is always cut on the edge: its ends and the pieces of the box meet there.
        let start = if ring.open { None } else { self.best_fan(ring) };
        match start {
            Some(start) => sides.fan(ids, start, out),
            None => {
                let x = self.add_on_edge(ring, out);
                sides.cone(ids, ring.open, x, out);
                if ring.open && sides.surface {
                    self.cap(ring, |c| self.numbering.corner(c), Some(x), out);
                }
            }
        }
    }

    /// The edge tetrahedra of an edge whose ends have one label.
    fn ring_within<F: Fn(Region) -> bool>(
        &self,
        ring: &Ring<'_>,
        want: &Want<F>,
        out: &mut Emission,
    ) {
        let label = ring.a.1;
        if want.tets && (want.region)(label) {
            let [a, b] = [ring.a.0, ring.b.0].map(|c| self.numbering.corner(c));
            for cells in ring.neighbours() {
                let [c, d] = cells.map(|cell| self.numbering.cell(&cell));
                out.tets.push([a, b, c, d]);
                out.regions.push(label);
            }
        }
        if ring.open && label == INTERIOR {
            self.cap(ring, |c| self.numbering.corner(c), None, out);
        }
    }

    /// Adds the point where the edge itself is cut: with it all tetrahedra are positive, and both sides agree.
    /// It cuts the edge tetrahedra, which are positive, in two each.
    fn add_on_edge(&self, ring: &Ring<'_>, out: &mut Emission) -> u32 {
        let [p, q] = [ring.a, ring.b].map(|(c, label)| sample_corner(self.complex, c, label));
        let x = ADDED | out.added.len() as u32;
        out.added.push(self.probe.cut(&p, &q));
        x
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
    /// Their diagonal is found by the kernel of the mesher without an octree, so that both have the same bits.
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
            return kernel::diagonal(quad);
        }
        let [a, b] = [ring.a.0, ring.b.0].map(|c| self.complex.corner_position(c));
        kernel::best_fan(&x[..n], &a, &b, ring.reserved)
    }
}

/// What is wanted on the two sides of the polygon around an edge whose ends differ.
struct Sides {
    /// The ends that get tetrahedra, and their labels.
    a: Option<(u32, Region)>,
    b: Option<(u32, Region)>,
    /// Is the polygon part of the molecule's surface, and its lower end inside?
    surface: bool,
    inside: bool,
}

impl Sides {
    /// An end whose label is not wanted gets no tetrahedra, though the polygon may still be surface.
    fn new<F: Fn(Region) -> bool>(emitter: &Emitter<'_>, ring: &Ring<'_>, want: &Want<F>) -> Self {
        let end = |(corner, label): (Corner, Region)| {
            let keep = want.tets && (want.region)(label);
            keep.then(|| (emitter.numbering.corner(corner), label))
        };
        Self {
            a: end(ring.a),
            b: end(ring.b),
            surface: ring.a.1 == INTERIOR || ring.b.1 == INTERIOR,
            inside: ring.a.1 == INTERIOR,
        }
    }

    /// A triangle of the surface, given counter-clockwise about the edge, as seen from outside of the molecule.
    fn push_triangle(&self, t: [u32; 3], out: &mut Emission) {
        if self.surface {
            out.triangles
                .push(if self.inside { t } else { [t[0], t[2], t[1]] });
        }
    }

    /// The fan of triangles from corner `start`, with the tetrahedra on both sides.
    fn fan(&self, ids: &[u32], start: usize, out: &mut Emission) {
        let n = ids.len();
        for i in 1..n - 1 {
            let t = [ids[start], ids[(start + i) % n], ids[(start + i + 1) % n]];
            self.push_triangle(t, out);
            if let Some((a, label)) = self.a {
                out.tets.push([a, t[0], t[1], t[2]]);
                out.regions.push(label);
            }
            if let Some((b, label)) = self.b {
                out.tets.push([b, t[0], t[2], t[1]]);
                out.regions.push(label);
            }
        }
    }

    /// The triangles around a point `x` on the edge, with the tetrahedra on both sides.
    fn cone(&self, ids: &[u32], open: bool, x: u32, out: &mut Emission) {
        let n = ids.len();
        for i in 0..if open { n - 1 } else { n } {
            let (c, d) = (ids[i], ids[(i + 1) % n]);
            self.push_triangle([x, c, d], out);
            if let Some((a, label)) = self.a {
                out.tets.push([a, x, c, d]);
                out.regions.push(label);
            }
            if let Some((b, label)) = self.b {
                out.tets.push([x, b, c, d]);
                out.regions.push(label);
            }
        }
    }
}
