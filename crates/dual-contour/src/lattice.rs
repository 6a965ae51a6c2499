//! The second mesher: isosurface stuffing (Labelle & Shewchuk 2007) of the base tetrahedra.
//!
//! Corners and cell points stay where they are and carry labels; base tetrahedra with more than one
//! label are cut where labels change along their edges. A vertex with a cut close by is snapped onto
//! it, which keeps angles away from 0° and 180°, but only where the interface stays a manifold.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use geom_core::mesh::{FACES, INTERIOR, Region};
use geom_core::{Point3, Vector3};
use rayon::prelude::*;

use crate::build::Raw;
use crate::complex::{Cell, Complex, Corner};
use crate::dual::{Probe, Sample, ghosts};
use crate::emit::{Numbering, Vertex, distinct, kinds, seen};

/// Share of an edge within which a cut is too close: between points of one kind, and between a corner
/// and a cell (Labelle & Shewchuk, uniform and one-sided).
const LONG: f64 = 0.249_99;
const SHORT: f64 = 0.411_89;
/// Most neighbours of a vertex that may snap; no octree has more than 50.
const LINK: usize = 64;
/// No number yet.
const NONE: u32 = u32::MAX;

/// What the mesher did.
#[derive(Default)]
pub(crate) struct Counts {
    /// Vertices snapped onto the interface.
    pub(crate) snapped: usize,
    /// Vertices kept, because snapping would have pinched the interface; their cuts moved away.
    pub(crate) refused: usize,
}

/// The two labels that an interface parts.
type Pair = (Region, Region);

fn pair(a: Region, b: Region) -> Pair {
    (a.min(b), a.max(b))
}

/// The tetrahedra near interfaces, with vertices numbered among themselves.
struct Near {
    samples: Vec<Sample>,
    /// Corner or cell?
    is_corner: Vec<bool>,
    /// Planes of the box: bit `2 · axis + side`.
    planes: Vec<u8>,
    tets: Vec<[u32; 4]>,
    /// Tetrahedra around each vertex that may snap.
    around: Csr,
    /// Edges between different labels, sorted, and where the label changes from their lower end.
    edges: Vec<[u32; 2]>,
    cuts: Vec<f64>,
    edges_at: Csr,
    /// The interface a vertex has been snapped to.
    zero: Vec<Option<Pair>>,
    /// Where the lattice of the values begins.
    anchor: [i32; 3],
}

/// Lists of numbers per vertex.
#[derive(Default)]
struct Csr {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Csr {
    fn new(n: usize, pairs: impl Fn(&mut dyn FnMut(u32, u32))) -> Self {
        let mut starts = vec![0u32; n + 1];
        pairs(&mut |v, _| starts[v as usize + 1] += 1);
        for v in 0..n {
            starts[v + 1] += starts[v];
        }
        let mut at = starts.clone();
        let mut items = vec![0; starts[n] as usize];
        pairs(&mut |v, item| {
            items[at[v as usize] as usize] = item;
            at[v as usize] += 1;
        });
        Self { starts, items }
    }
    fn of(&self, v: u32) -> &[u32] {
        &self.items[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize]
    }
}

/// A base tetrahedron and the labels of its corners.
type Labelled = ([u32; 4], [Region; 4]);

/// Meshes by stuffing, always up to the box: what is snapped shall not depend on what is wanted. The
/// molecule may meet the box if `clipped`. `keep` says which regions are wanted; the molecule's surface
/// comes in any case.
pub(crate) fn mesh(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    clipped: bool,
    keep: impl Fn(Region) -> bool + Sync,
) -> (Raw, Counts) {
    let ghosts = ghosts(complex);
    let numbering = Numbering::new(complex, &ghosts, |_| true);
    let labels = cell_labels(complex, probe, &numbering, clipped);
    // Where the box cuts the molecule, its pieces close the surface.
    let needed = |r: Region| keep(r) || clipped && r == INTERIOR;
    let all = base_tets(complex, &numbering, &labels);
    // Vertices of tetrahedra with more than one label; whatever touches them may change.
    let hot: Vec<AtomicU8> = (0..numbering.len()).map(|_| AtomicU8::new(0)).collect();
    all.par_iter().with_min_len(4096).for_each(|(tet, labels)| {
        if labels.iter().any(|&l| l != labels[0]) {
            for &v in tet {
                hot[v as usize].store(1, Relaxed);
            }
        }
    });
    let hot: Vec<bool> = hot.into_iter().map(|h| h.into_inner() == 1).collect();
    let (near, far): (Vec<Labelled>, Vec<Labelled>) = all
        .into_par_iter()
        .with_min_len(4096)
        .filter(|(tet, labels)| needed(labels[0]) || tet.iter().any(|&v| hot[v as usize]))
        .partition(|(tet, _)| tet.iter().any(|&v| hot[v as usize]));
    let vertices: Vec<Vertex> = numbering.vertices().collect();
    let mut positions: Vec<Point3> = vertices
        .par_iter()
        .map(|v| match v {
            Vertex::Cell(cell) => complex.base_position(cell),
            Vertex::Corner(corner) => complex.corner_position(*corner),
        })
        .collect();
    let (mut near, ids) = Near::new(complex, probe, &vertices, &near, &hot, clipped);
    let counts = near.snap();
    for (sample, &id) in near.samples.iter().zip(&ids) {
        positions[id as usize] = sample.x;
    }
    let first = positions.len() as u32;
    let (cut, added) = near.cut(&ids, &mut positions);
    let mut on_surface = vec![false; first as usize];
    let mut meeting = vec![1; first as usize];
    for (zero, &id) in near.zero.iter().zip(&ids) {
        if let Some((a, b)) = zero {
            on_surface[id as usize] = true;
            meeting[id as usize] = distinct([*a, *b].map(|l| seen(l, &keep)));
        }
    }
    meeting.extend(
        added
            .iter()
            .map(|labels| distinct(labels.iter().map(|&l| seen(l, &keep)))),
    );

    let cells = complex.tree.cells;
    let mut out = Raw {
        kinds: kinds(&positions, &meeting, cells),
        added: added.len(),
        ..Raw::default()
    };
    // Faces that may belong to the surface: those of the molecule that no other tetrahedron of it has.
    let mut faces: Vec<([u32; 3], [u32; 3])> = Vec::new();
    let mut take = |tet: [u32; 4], region: Region, near: bool| {
        if region == INTERIOR && (near || clipped) {
            for face in FACES.map(|f| f.map(|k| tet[k])) {
                let surface = near && face.iter().all(|&v| v >= first || on_surface[v as usize]);
                let planes = |v: u32| planes_of(&positions[v as usize], cells);
                if surface || clipped && face.iter().fold(!0, |m, &v| m & planes(v)) != 0 {
                    let mut key = face;
                    key.sort_unstable();
                    faces.push((key, face));
                }
            }
        }
        if keep(region) {
            out.tets.push(tet);
            out.regions.push(region);
        }
    };
    for (tet, labels) in far {
        take(tet, labels[0], false);
    }
    for (tet, region) in cut {
        take(tet, region, true);
    }
    faces.par_sort_unstable();
    out.triangles = faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() == 1)
        .map(|group| group[0].1)
        .collect();
    out.positions = positions;
    (out, counts)
}

/// The planes of the box that hold a point: bit `2 · axis + side`.
fn planes_of(p: &Point3, cells: [i32; 3]) -> u8 {
    (0..3).fold(0, |m, k| {
        m | u8::from(p[k] == 0.0) << (2 * k) | u8::from(p[k] == f64::from(cells[k])) << (2 * k + 1)
    })
}

/// The middle of a leaf, or of a face on the box, with its label and value. Where all corners have one
/// label, so has the middle.
fn cell_sample(complex: &Complex<'_>, probe: &Probe<'_>, cell: &Cell, clipped: bool) -> Sample {
    let samples = complex.samples;
    let x = complex.base_position(cell);
    let (id, face) = match *cell {
        Cell::Leaf(id) => (id, None),
        Cell::Ghost(id, half) => (id, Some(usize::from(half / 2))),
        Cell::Part(..) => unreachable!("the lattice method splits no leaf"),
    };
    let leaf = complex.leaf(id);
    let (o, s) = (leaf.origin(), leaf.size());
    if s > 1 {
        // The middle is a lattice point; it has a value where a boundary is near.
        let p = [0, 1, 2].map(|k| x[k].round() as i32);
        let label = samples.label(if complex.is_interface(id) { p } else { o });
        let value = samples.value(p);
        return Sample { x, label, value };
    }
    let corners = crate::complex::corners_of(face);
    let points = corners
        .iter()
        .map(|&c| [0, 1, 2].map(|k| o[k] + crate::complex::corner_of(c)[k]));
    let first = samples.label(o);
    let (mut same, mut label, mut mean, mut n) = (true, None, 0.0, 0.0);
    for p in points {
        let l = samples.label(p);
        same &= *label.get_or_insert(l) == l;
        mean += samples.value(p);
        n += 1.0;
    }
    mean /= n;
    if same {
        let label = label.unwrap_or(first);
        return Sample {
            x,
            label,
            value: mean,
        };
    }
    let point = samples.domain.world(&x);
    let value = probe.value(&point).unwrap_or(mean);
    let label = samples.labels.at(value, &point);
    if label == INTERIOR && !clipped && complex.is_on_box(id) {
        // The surface stays off the box.
        let on_box = |c: &usize| {
            let p = [0, 1, 2].map(|k| o[k] + crate::complex::corner_of(*c)[k]);
            (planes_of(&crate::samples::local(p), complex.tree.cells) != 0).then_some(p)
        };
        let p = corners
            .iter()
            .find_map(on_box)
            .expect("a leaf on the box has a corner there");
        let (label, value) = (samples.label(p), samples.value(p));
        return Sample { x, label, value };
    }
    Sample { x, label, value }
}

/// Labels of leaves and ghosts, by vertex number.
fn cell_labels(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    numbering: &Numbering<'_>,
    clipped: bool,
) -> Vec<Region> {
    let leaves = complex.tree.leaves.len() as u32;
    (0..leaves)
        .into_par_iter()
        .with_min_len(1024)
        .map(|id| {
            if complex.is_interface(id) {
                cell_sample(complex, probe, &Cell::Leaf(id), clipped).label
            } else {
                complex.samples.label(complex.leaf(id).origin())
            }
        })
        .chain(numbering.ghosts().par_iter().map(|&(id, half)| {
            if complex.is_interface(id) {
                cell_sample(complex, probe, &Cell::Ghost(id, half), clipped).label
            } else {
                complex.samples.label(complex.leaf(id).origin())
            }
        }))
        .collect()
}

/// All base tetrahedra with the labels of their corners.
fn base_tets(complex: &Complex<'_>, numbering: &Numbering<'_>, labels: &[Region]) -> Vec<Labelled> {
    (0..complex.tree.leaves.len() as u32)
        .into_par_iter()
        .with_min_len(1024)
        .flat_map_iter(|id| {
            let mut tets: Vec<Labelled> = Vec::new();
            complex.rings_of(
                id,
                |_, _| true,
                |ring| {
                    let [a, b] = [ring.a.0, ring.b.0].map(|c| numbering.corner(c));
                    let n = ring.cells.len();
                    for i in 0..if ring.open { n - 1 } else { n } {
                        let [c, d] = [i, (i + 1) % n].map(|i| numbering.cell(&ring.cells[i]));
                        let [lc, ld] = [c, d].map(|c| labels[c as usize]);
                        tets.push(([a, b, c, d], [ring.a.1, ring.b.1, lc, ld]));
                    }
                },
            );
            tets
        })
        .collect()
}

impl Near {
    /// Also gives the number that each vertex has among all.
    fn new(
        complex: &Complex<'_>,
        probe: &Probe<'_>,
        vertices: &[Vertex],
        labelled: &[Labelled],
        hot: &[bool],
        clipped: bool,
    ) -> (Self, Vec<u32>) {
        let mut local = vec![NONE; vertices.len()];
        for v in labelled.iter().flat_map(|t| t.0) {
            local[v as usize] = 0;
        }
        let mut ids = Vec::new();
        for (id, local) in local.iter_mut().enumerate().filter(|(_, l)| **l == 0) {
            *local = ids.len() as u32;
            ids.push(id as u32);
        }
        let samples: Vec<Sample> = ids
            .par_iter()
            .map(|&id| match vertices[id as usize] {
                Vertex::Cell(cell) => cell_sample(complex, probe, &cell, clipped),
                Vertex::Corner(Corner::Point(p)) => Sample {
                    x: crate::samples::local(p),
                    label: complex.samples.label(p),
                    value: complex.samples.value(p),
                },
                Vertex::Corner(Corner::Centre(_)) => {
                    unreachable!("the lattice method splits no leaf")
                }
            })
            .collect();
        let cells = complex.tree.cells;
        let planes = samples.iter().map(|s| planes_of(&s.x, cells)).collect();
        let is_corner = ids
            .iter()
            .map(|&id| matches!(vertices[id as usize], Vertex::Corner(_)))
            .collect();
        let tets: Vec<[u32; 4]> = labelled
            .par_iter()
            .map(|t| t.0.map(|v| local[v as usize]))
            .collect();
        let n = ids.len();
        let around = Csr::new(n, |f| {
            for (i, t) in tets.iter().enumerate() {
                for &v in t.iter().filter(|&&v| hot[ids[v as usize] as usize]) {
                    f(v, i as u32);
                }
            }
        });
        let mut edges: Vec<[u32; 2]> = tets
            .par_iter()
            .flat_map_iter(|t| {
                let ends = geom_core::mesh::EDGES.map(|e| e.map(|k| t[k]));
                let samples = &samples;
                ends.into_iter().filter_map(move |[a, b]| {
                    let differ = samples[a as usize].label != samples[b as usize].label;
                    differ.then_some([a.min(b), a.max(b)])
                })
            })
            .collect();
        edges.par_sort_unstable();
        edges.dedup();
        let cuts = edges
            .par_iter()
            .map(|e| {
                let [a, b] = e.map(|v| &samples[v as usize]);
                probe.exact_crossing(a, b).clamp(0.02, 0.98)
            })
            .collect();
        let edges_at = Csr::new(n, |f| {
            for (i, e) in edges.iter().enumerate() {
                e.iter().for_each(|&v| f(v, i as u32));
            }
        });
        let near = Self {
            samples,
            is_corner,
            planes,
            tets,
            around,
            edges,
            cuts,
            edges_at,
            zero: vec![None; n],
            anchor: complex.samples.domain.anchor,
        };
        (near, ids)
    }

    fn other(&self, edge: u32, v: u32) -> u32 {
        let [a, b] = self.edges[edge as usize];
        if a == v { b } else { a }
    }

    fn label(&self, v: u32) -> Region {
        self.samples[v as usize].label
    }

    /// Distance of a cut from one end, as a share of the edge.
    fn from(&self, edge: u32, v: u32) -> f64 {
        let t = self.cuts[edge as usize];
        if self.edges[edge as usize][0] == v {
            t
        } else {
            1.0 - t
        }
    }

    /// The smallest share of its edge at which a cut may stay.
    fn limit(&self, edge: u32) -> f64 {
        let [a, b] = self.edges[edge as usize].map(|v| self.is_corner[v as usize]);
        if a == b { LONG } else { SHORT }
    }

    /// The edges of a vertex whose cuts are too close to it.
    fn violated(&self, v: u32) -> impl Iterator<Item = (u32, f64)> {
        self.edges_at.of(v).iter().filter_map(move |&e| {
            let gone =
                self.zero[v as usize].is_some() || self.zero[self.other(e, v) as usize].is_some();
            let ratio = self.from(e, v) / self.limit(e);
            (!gone && ratio < 1.0).then_some((e, ratio))
        })
    }

    /// Snaps vertices onto close cuts, or moves the cuts away, until no cut is too close. Rounds take
    /// vertices that have no undecided neighbour of higher priority; what is decided depends on
    /// neighbours alone, so the result is that of a fixed order.
    fn snap(&mut self) -> Counts {
        // Scattered priorities make few rounds. They follow from the place among the values (twice the
        // coordinates are whole numbers), so that what else is meshed does not matter.
        let priority: Vec<u64> = self
            .samples
            .iter()
            .map(|s| {
                let key = (0..3).fold(0u64, |key, k| {
                    let place = (2.0 * s.x[k]) as i64 - 2 * i64::from(self.anchor[k]);
                    key << 20 | (place as u64 & 0xf_ffff)
                });
                key.wrapping_mul(0x9e37_79b9_7f4a_7c15)
            })
            .collect();
        let mut waiting: Vec<u32> = (0..self.samples.len() as u32)
            .into_par_iter()
            .filter(|&v| self.violated(v).next().is_some())
            .collect();
        let mut open = vec![false; self.samples.len()];
        for &v in &waiting {
            open[v as usize] = true;
        }
        let mut counts = Counts::default();
        while !waiting.is_empty() {
            let decided: Vec<(u32, Option<u32>)> = waiting
                .par_iter()
                .filter(|&&v| {
                    self.around.of(v).iter().all(|&t| {
                        self.tets[t as usize].iter().all(|&w| {
                            w == v
                                || !open[w as usize]
                                || priority[w as usize] < priority[v as usize]
                        })
                    })
                })
                .map(|&v| {
                    let target = self
                        .violated(v)
                        .filter(|&(e, _)| self.is_safe(v, self.other(e, v)))
                        .min_by(|x, y| x.1.total_cmp(&y.1));
                    (v, target.map(|(e, _)| e))
                })
                .collect();
            for &(v, target) in &decided {
                open[v as usize] = false;
                match target {
                    Some(e) => {
                        let w = self.other(e, v);
                        let (from, to) = (self.samples[v as usize].x, self.samples[w as usize].x);
                        self.samples[v as usize].x = from + (to - from) * self.from(e, v);
                        self.zero[v as usize] = Some(pair(self.label(v), self.label(w)));
                        counts.snapped += 1;
                    }
                    None => {
                        let close: Vec<u32> = self.violated(v).map(|(e, _)| e).collect();
                        counts.refused += usize::from(!close.is_empty());
                        for e in close {
                            let t = self.limit(e);
                            let low = self.edges[e as usize][0] == v;
                            self.cuts[e as usize] = if low { t } else { 1.0 - t };
                        }
                    }
                }
            }
            waiting.retain(|&v| open[v as usize]);
        }
        counts
    }

    /// Are there vertices of both signs at the edges of the triangles that are taken, and are those of
    /// each sign connected by them?
    fn each_sign_connected(
        &self,
        sign: &[i8],
        triangles: &[[u8; 3]],
        takes: impl Fn(u8, u8) -> bool,
    ) -> bool {
        let mut group: [u8; LINK] = std::array::from_fn(|i| i as u8);
        let mut used = [false; LINK];
        for t in triangles {
            for (mut a, mut b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                if !takes(a, b) {
                    continue;
                }
                (used[a as usize], used[b as usize]) = (true, true);
                if sign[a as usize] == sign[b as usize] {
                    while group[a as usize] != a {
                        a = group[a as usize];
                    }
                    while group[b as usize] != b {
                        b = group[b as usize];
                    }
                    group[a.max(b) as usize] = a.min(b);
                }
            }
        }
        [1, -1].into_iter().all(|s| {
            let is_root = |i: &usize| used[*i] && sign[*i] == s && group[*i] as usize == *i;
            (0..sign.len()).filter(is_root).count() == 1
        })
    }

    /// May `v` become a point of the interface towards `w`?
    fn is_safe(&self, v: u32, w: u32) -> bool {
        // On the box only along it.
        let planes = self.planes[v as usize];
        if planes & !self.planes[w as usize] != 0 {
            return false;
        }
        let parted = pair(self.label(v), self.label(w));
        let mut sign = [0i8; LINK];
        let mut link = [NONE; LINK];
        let mut n = 0;
        let mut triangles = [[0u8; 3]; 2 * LINK];
        let mut m = 0;
        for &t in self.around.of(v) {
            let tet = self.tets[t as usize];
            for (k, u) in tet.into_iter().filter(|&u| u != v).enumerate() {
                let at = match link[..n].iter().position(|&l| l == u) {
                    Some(at) => at,
                    None => {
                        if n == link.len() {
                            return false;
                        }
                        sign[n] = match self.zero[u as usize] {
                            Some(p) if p != parted => return false,
                            Some(_) => 0,
                            None if self.label(u) == parted.0 => -1,
                            None if self.label(u) == parted.1 => 1,
                            None => return false,
                        };
                        link[n] = u;
                        n += 1;
                        n - 1
                    }
                };
                triangles[m][k] = at as u8;
            }
            let zero = |c: u8| sign[c as usize] == 0;
            if triangles[m].iter().all(|&c| zero(c)) {
                return false;
            }
            m += 1;
            if m == triangles.len() {
                return false;
            }
        }
        // The link's vertices of each sign are connected; so are, on the box, those of its rim.
        let rim = |a: u8, b: u8| {
            let [a, b] = [a, b].map(|c| self.planes[link[c as usize] as usize]);
            planes & a & b != 0
        };
        if planes != 0 && !self.each_sign_connected(&sign[..n], &triangles[..m], rim) {
            return false;
        }
        if !self.each_sign_connected(&sign[..n], &triangles[..m], |_, _| true) {
            return false;
        }
        // Around the edge to a neighbour on the interface, each sign has at most one arc.
        (0..n).filter(|&i| sign[i] == 0).all(|i| {
            for s in [1, -1] {
                // Arcs of a sign: its vertices in the edge's link, less the link's edges between them.
                let (mut vertices, mut edges) = (0u64, 0);
                for t in triangles[..m].iter().filter(|t| t.contains(&(i as u8))) {
                    let mut both = true;
                    for &c in t.iter().filter(|&&c| c as usize != i) {
                        if sign[c as usize] == s {
                            vertices |= 1 << c;
                        } else {
                            both = false;
                        }
                    }
                    edges += u32::from(both);
                }
                if vertices.count_ones() > edges + 1 {
                    return false;
                }
            }
            true
        })
    }

    /// The number of the edge between two vertices of different labels.
    fn edge(&self, a: u32, b: u32) -> u32 {
        let ends = [a.min(b), a.max(b)];
        *self
            .edges_at
            .of(a)
            .iter()
            .find(|&&e| self.edges[e as usize] == ends)
            .expect("an edge between different labels is listed")
    }

    /// Cuts all tetrahedra; adds the points of cuts, of faces and of cells where three labels meet, and
    /// gives the labels at each.
    #[expect(
        clippy::type_complexity,
        reason = "tetrahedra with regions, and labels"
    )]
    fn cut(
        &self,
        ids: &[u32],
        positions: &mut Vec<Point3>,
    ) -> (Vec<([u32; 4], Region)>, Vec<[Region; 4]>) {
        let mut added = Vec::new();
        let mut at = vec![NONE; self.edges.len()];
        for (e, at) in at.iter_mut().enumerate() {
            let [a, b] = self.edges[e];
            if self.zero[a as usize].is_none() && self.zero[b as usize].is_none() {
                let [p, q] = [a, b].map(|v| self.samples[v as usize].x);
                *at = positions.len() as u32;
                positions.push(p + (q - p) * self.cuts[e]);
                let [p, q] = [a, b].map(|v| self.label(v));
                added.push([p, p, q, q]);
            }
        }
        let cutter = Cutter {
            near: self,
            ids,
            at: &at,
        };
        let several: Vec<u32> = (0..self.tets.len() as u32)
            .into_par_iter()
            .filter(|&t| self.labels_of(t) > 2)
            .collect();
        // Points of faces with three labels, shared by the two tetrahedra of a face.
        let mut faces: Vec<[u32; 3]> = several
            .iter()
            .flat_map(|&t| FACES.map(|f| f.map(|k| self.tets[t as usize][k])))
            .filter(|f| {
                let [a, b, c] = f.map(|v| self.label(v));
                a != b && b != c && a != c
            })
            .map(|mut f| {
                f.sort_unstable();
                f
            })
            .collect();
        faces.sort_unstable();
        faces.dedup();
        let face_at = positions.len() as u32;
        for &[a, b, c] in &faces {
            let ends = [[a, b], [b, c], [c, a]].map(|[a, b]| cutter.point(a, b));
            positions.push(mean(ends.map(|v| positions[v as usize])));
            added.push([a, b, c, c].map(|v| self.label(v)));
        }
        let cell_at = positions.len() as u32;
        for &t in &several {
            let tet = self.tets[t as usize];
            let cuts: Vec<Point3> = geom_core::mesh::EDGES
                .iter()
                .map(|e| e.map(|k| tet[k]))
                .filter(|&[a, b]| self.label(a) != self.label(b))
                .map(|[a, b]| positions[cutter.point(a, b) as usize])
                .collect();
            positions.push(mean(cuts));
            added.push(tet.map(|v| self.label(v)));
        }
        let tets = (0..self.tets.len() as u32)
            .into_par_iter()
            .with_min_len(1024)
            .flat_map_iter(|t| {
                let mut out = Vec::with_capacity(6);
                match several.binary_search(&t) {
                    Ok(i) => cutter.several(t, cell_at + i as u32, &faces, face_at, &mut out),
                    Err(_) => cutter.two(t, &mut out),
                }
                out
            })
            .collect();
        (tets, added)
    }

    /// Number of labels among the corners of a tetrahedron that are not on an interface.
    fn labels_of(&self, t: u32) -> usize {
        let mut seen = [0; 4];
        let mut n = 0;
        for v in self.tets[t as usize] {
            if self.zero[v as usize].is_none() && !seen[..n].contains(&self.label(v)) {
                seen[n] = self.label(v);
                n += 1;
            }
        }
        n
    }
}

fn mean(points: impl IntoIterator<Item = Point3>) -> Point3 {
    let (sum, n) = points
        .into_iter()
        .fold((Vector3::zeros(), 0.0), |(s, n), p| (s + p.coords, n + 1.0));
    Point3::from(sum / n)
}

struct Cutter<'a> {
    near: &'a Near,
    ids: &'a [u32],
    /// Vertex of each cut edge.
    at: &'a [u32],
}

/// A vertex within a tetrahedron: one of its corners, or the cut between two of them.
#[derive(Clone, Copy)]
enum Spot {
    Corner(usize),
    Cut(usize, usize),
}

/// Twice the determinant of barycentric coordinates, up to a factor: positive if the four spots stand
/// as the corners of their tetrahedron do, wherever the cuts are.
fn hand(spots: &[Spot; 4]) -> i32 {
    let rows = spots.map(|s| {
        let mut row = [0i32; 4];
        match s {
            Spot::Corner(i) => row[i] = 2,
            Spot::Cut(i, j) => (row[i], row[j]) = (1, 1),
        }
        row
    });
    let minor =
        |i: usize, j: usize, k: usize, l: usize| rows[i][k] * rows[j][l] - rows[i][l] * rows[j][k];
    minor(0, 1, 0, 1) * minor(2, 3, 2, 3) - minor(0, 1, 0, 2) * minor(2, 3, 1, 3)
        + minor(0, 1, 0, 3) * minor(2, 3, 1, 2)
        + minor(0, 1, 1, 2) * minor(2, 3, 0, 3)
        - minor(0, 1, 1, 3) * minor(2, 3, 0, 2)
        + minor(0, 1, 2, 3) * minor(2, 3, 0, 1)
}

/// Cuts a tetrahedron whose corners, in ascending order of their numbers, are `below` and `above` an
/// interface or `on` it. Quads are cut from the corner of the lowest number, so that neighbours agree.
fn stencil(below: &[usize], above: &[usize], on: &[usize], mut emit: impl FnMut([Spot; 4], bool)) {
    use Spot::{Corner as P, Cut as C};
    // A single corner is cut off; what remains has one or two quads per further corner.
    let mut cut_off = |p: usize, rest: &[usize], side: bool| match (rest, on) {
        (&[m], &[y, z]) => {
            emit([P(p), C(p, m), P(y), P(z)], side);
            emit([P(m), C(p, m), P(y), P(z)], !side);
        }
        (&[m, n], &[z]) => {
            emit([P(p), C(p, m), C(p, n), P(z)], side);
            emit([P(m), C(p, m), C(p, n), P(z)], !side);
            emit([P(m), P(n), C(p, n), P(z)], !side);
        }
        (&[l, m, n], &[]) => {
            emit([P(p), C(p, l), C(p, m), C(p, n)], side);
            emit([P(l), C(p, l), C(p, m), C(p, n)], !side);
            emit([P(l), P(m), C(p, m), C(p, n)], !side);
            emit([P(l), P(m), P(n), C(p, n)], !side);
        }
        _ => unreachable!("a tetrahedron has four corners"),
    };
    match (below, above) {
        (&[p], rest) => cut_off(p, rest, false),
        (rest, &[p]) => cut_off(p, rest, true),
        (&[p, q], &[m, n]) => {
            for (p, q, m, n, side) in [(p, q, m, n, false), (m, n, p, q, true)] {
                emit([P(p), P(q), C(q, m), C(q, n)], side);
                // The quad of the interface has its diagonal from (p, n) to (q, m).
                emit([P(p), C(p, m), C(p, n), C(q, m)], side);
                emit([P(p), C(p, n), C(q, m), C(q, n)], side);
            }
        }
        _ => unreachable!("a tetrahedron has four corners"),
    }
}

impl Cutter<'_> {
    /// The vertex where the edge between two corners is cut.
    fn point(&self, a: u32, b: u32) -> u32 {
        self.at[self.near.edge(a, b) as usize]
    }

    /// Cuts a tetrahedron with one or two labels and any number of corners on their interface.
    fn two(&self, t: u32, out: &mut Vec<([u32; 4], Region)>) {
        let near = self.near;
        let tet = near.tets[t as usize];
        let mut order = [0, 1, 2, 3];
        order.sort_unstable_by_key(|&k| tet[k]);
        let zero = |k: usize| near.zero[tet[k] as usize].is_some();
        let labels = || {
            order
                .iter()
                .filter(|&&k| !zero(k))
                .map(|&k| near.label(tet[k]))
        };
        let (Some(low), Some(high)) = (labels().min(), labels().max()) else {
            unreachable!("snapping leaves no tetrahedron on the interface as a whole");
        };
        if low == high {
            out.push((tet.map(|v| self.ids[v as usize]), low));
            return;
        }
        let of = |keep: &dyn Fn(usize) -> bool| -> Vec<usize> {
            order.iter().copied().filter(|&k| keep(k)).collect()
        };
        let below = of(&|k| !zero(k) && near.label(tet[k]) == low);
        let above = of(&|k| !zero(k) && near.label(tet[k]) == high);
        let on = of(&zero);
        stencil(&below, &above, &on, |mut spots, side| {
            if hand(&spots) < 0 {
                spots.swap(2, 3);
            }
            let ids = spots.map(|s| match s {
                Spot::Corner(k) => self.ids[tet[k] as usize],
                Spot::Cut(i, j) => self.point(tet[i], tet[j]),
            });
            out.push((ids, if side { high } else { low }));
        });
    }

    /// Cuts a tetrahedron with three or four labels, none of whose corners is on an interface: cones
    /// from a point inside over the pieces of its faces.
    fn several(
        &self,
        t: u32,
        apex: u32,
        faces: &[[u32; 3]],
        face_at: u32,
        out: &mut Vec<([u32; 4], Region)>,
    ) {
        let near = self.near;
        let tet = near.tets[t as usize];
        for f in FACES {
            let face = f.map(|k| tet[k]);
            let [la, lb, lc] = face.map(|v| near.label(v));
            let mut emit = |t: [u32; 3], label| out.push(([apex, t[0], t[1], t[2]], label));
            let id = |v: u32| self.ids[v as usize];
            if la == lb && lb == lc {
                emit(face.map(id), la);
            } else if la != lb && lb != lc && la != lc {
                let mut key = face;
                key.sort_unstable();
                let middle = faces.binary_search(&key).expect("its point has been added");
                let middle = face_at + middle as u32;
                for k in 0..3 {
                    let [a, b, c] = [0, 1, 2].map(|i| face[(k + i) % 3]);
                    let (next, last) = (self.point(a, b), self.point(c, a));
                    emit([id(a), next, middle], near.label(a));
                    emit([id(a), middle, last], near.label(a));
                }
            } else {
                // The corner alone, then the quad of the other two.
                let k = (0..3)
                    .find(|&k| {
                        let [a, b, c] = [0, 1, 2].map(|i| near.label(face[(k + i) % 3]));
                        a != b && a != c
                    })
                    .expect("one of three labels differs from the other two");
                let [p, m, n] = [0, 1, 2].map(|i| face[(k + i) % 3]);
                let (x, y) = (self.point(p, m), self.point(p, n));
                emit([id(p), x, y], near.label(p));
                if m < n {
                    emit([id(m), id(n), y], near.label(m));
                    emit([id(m), y, x], near.label(m));
                } else {
                    emit([id(n), y, x], near.label(n));
                    emit([id(n), x, id(m)], near.label(n));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geom_core::mesh::six_volume;

    /// Every way in which corners can lie below, above and on an interface.
    #[test]
    fn stencils_fill_their_tetrahedron() {
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(Point3::from);
        for code in 0..81 {
            let class: [usize; 4] = std::array::from_fn(|k| code / 3usize.pow(k as u32) % 3);
            let of = |c: usize| -> Vec<usize> { (0..4).filter(|&k| class[k] == c).collect() };
            let (below, above, on) = (of(0), of(1), of(2));
            if below.is_empty() || above.is_empty() {
                continue;
            }
            let (mut sum, mut n) = (0.0, 0);
            stencil(&below, &above, &on, |mut spots, side| {
                if hand(&spots) < 0 {
                    spots.swap(2, 3);
                }
                let points = spots.map(|s| match s {
                    Spot::Corner(k) => {
                        assert_ne!(class[k], usize::from(!side), "a corner on its own side");
                        corners[k]
                    }
                    Spot::Cut(i, j) => {
                        assert_eq!(class[i] + class[j], 1, "cuts part the two sides");
                        let (i, j) = if class[i] == 0 { (i, j) } else { (j, i) };
                        corners[i] + (corners[j] - corners[i]) * 0.3
                    }
                });
                let volume = six_volume(points);
                assert!(volume > 1e-6, "{class:?}: {volume}");
                sum += volume;
                n += 1;
            });
            assert!((sum - 1.0).abs() < 1e-14, "{class:?} fills {sum} of 1");
            assert_eq!(
                n,
                [2, 3, 4, 6][match (below.len(), above.len()) {
                    (1, 1) => 0,
                    (1, 2) | (2, 1) => 1,
                    (2, 2) => 3,
                    _ => 2,
                }]
            );
        }
    }
}
