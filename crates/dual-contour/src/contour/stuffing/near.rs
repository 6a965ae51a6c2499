//! The tetrahedra near interfaces.
//!
//! All that snapping and cutting ask for, numbered anew and gathered once: what stands around a vertex, which edges
//! change labels, and where. Points away from interfaces have no part in it.

use geom_core::compute::lists::Lists;
use geom_core::compute::parallel::{self, sorted_by_number};
use geom_core::mesh::{EDGES, Region};

use super::base::{Base, BaseTet, planes_of};
use crate::Error;
use crate::complex::Vertex;
use crate::dual::{Probe, Sample, off_ends};

/// No number yet.
pub(super) const NONE: u32 = u32::MAX;

/// Share of an edge within which a cut is too close: between points of one kind, and between a corner
/// and a cell (Labelle & Shewchuk, uniform and one-sided).
const LONG: f64 = 0.249_99;
const SHORT: f64 = 0.411_89;
/// The two labels that an interface parts.
pub(super) type Pair = (Region, Region);

pub(super) fn pair(a: Region, b: Region) -> Pair {
    (a.min(b), a.max(b))
}

/// The tetrahedra near interfaces, with vertices numbered among themselves.
pub(super) struct Near {
    /// The number that each vertex has among all.
    pub(super) ids: Vec<u32>,
    pub(super) samples: Vec<Sample>,
    /// Corner or cell?
    pub(super) is_corner: Vec<bool>,
    /// Planes of the box: bit `2 · axis + side`.
    pub(super) planes: Vec<u8>,
    pub(super) tets: Vec<[u32; 4]>,
    /// Tetrahedra around each vertex that may snap.
    pub(super) around: Lists<u32>,
    /// Edges between different labels, sorted, and where the label changes from their lower end.
    pub(super) edges: Vec<[u32; 2]>,
    pub(super) cuts: Vec<f64>,
    pub(super) edges_at: Lists<u32>,
    /// The interface a vertex has been snapped to.
    pub(super) zero: Vec<Option<Pair>>,
    /// Vertices that have stepped aside from the boundary of a material.
    pub(super) moved: Vec<bool>,
    /// Where the lattice of the values begins.
    pub(super) anchor: [i32; 3],
}

impl Near {
    /// `hot` are the vertices that may snap.
    ///
    /// # Errors
    /// What a field on a device says of the cuts.
    pub(super) fn new(base: &Base<'_>, tets: &[BaseTet], hot: &[bool]) -> Result<Self, Error> {
        let vertices: Vec<Vertex> = base.numbering.vertices().collect();
        // Vertices get numbers of their own, in order: arrays are short, and neighbours near each other.
        let mut local = vec![NONE; vertices.len()];
        for v in tets.iter().flat_map(|t| t.corners) {
            local[v as usize] = 0;
        }
        let mut ids = Vec::new();
        for (id, local) in local.iter_mut().enumerate().filter(|(_, l)| **l == 0) {
            *local = ids.len() as u32;
            ids.push(id as u32);
        }
        let tets: Vec<[u32; 4]> =
            parallel::map_each(tets, |t| t.corners.map(|v| local[v as usize]));
        let samples: Vec<Sample> =
            parallel::map_each(&ids, |&id| base.sample(vertices[id as usize]));
        let cells = base.complex.tree.cells;
        let planes = samples.iter().map(|s| planes_of(&s.x, cells)).collect();
        let is_corner = ids
            .iter()
            .map(|&id| matches!(vertices[id as usize], Vertex::Corner(_)))
            .collect();
        // Only vertices that may snap ask for what stands around them.
        let is_hot = |&(v, _): &(u32, u32)| hot[ids[v as usize] as usize];
        let corners = || (0u32..).zip(&tets).flat_map(|(i, t)| t.map(|v| (v, i)));
        let around = Lists::of(ids.len(), || corners().filter(is_hot));
        // Each edge that will be cut is shared by several tetrahedra and has one cut.
        let edges = edges_between_labels(&tets, &samples);
        let ends: Vec<(&Sample, &Sample)> = edges
            .iter()
            .map(|e| (&samples[e[0] as usize], &samples[e[1] as usize]))
            .collect();
        let mut cuts = base.probe.exact_crossings(&ends)?;
        for (cut, (a, b)) in cuts.iter_mut().zip(&ends) {
            *cut = kept_off_ends(*cut, a.label, b.label);
        }
        let tips = || (0u32..).zip(&edges).flat_map(|(i, e)| e.map(|v| (v, i)));
        let edges_at = Lists::of(ids.len(), tips);
        Ok(Self {
            zero: vec![None; ids.len()],
            moved: vec![false; ids.len()],
            anchor: base.complex.samples.domain.anchor,
            ids,
            samples,
            is_corner,
            planes,
            tets,
            around,
            edges,
            cuts,
            edges_at,
        })
    }

    /// The other end of an edge.
    pub(super) fn other(&self, edge: u32, v: u32) -> u32 {
        let [a, b] = self.edges[edge as usize];
        if a == v { b } else { a }
    }

    /// Distance of a cut from one end, as a share of the edge.
    pub(super) fn from(&self, edge: u32, v: u32) -> f64 {
        self.turned(edge, v, self.cuts[edge as usize])
    }

    /// A share of an edge from its lower end as one from its end `v`, and back.
    pub(super) fn turned(&self, edge: u32, v: u32, share: f64) -> f64 {
        if self.edges[edge as usize][0] == v {
            share
        } else {
            1.0 - share
        }
    }

    /// The smallest share of its edge at which a cut may stay.
    pub(super) fn limit(&self, edge: u32) -> f64 {
        let [a, b] = self.edges[edge as usize].map(|v| self.is_corner[v as usize]);
        if a == b { LONG } else { SHORT }
    }

    /// The edges of a vertex whose cuts are too close to it.
    pub(super) fn violated(&self, v: u32) -> impl Iterator<Item = (u32, f64)> {
        self.edges_at.list(v as usize).iter().filter_map(move |&e| {
            let gone =
                self.zero[v as usize].is_some() || self.zero[self.other(e, v) as usize].is_some();
            let ratio = self.from(e, v) / self.limit(e);
            (!gone && ratio < 1.0).then_some((e, ratio))
        })
    }

    pub(super) fn label(&self, v: u32) -> Region {
        self.samples[v as usize].label
    }

    /// The number of the edge between two vertices of different labels.
    /// A search in the edges of one of them, of which there are a few dozen at most.
    pub(super) fn edge(&self, a: u32, b: u32) -> u32 {
        let ends = [a.min(b), a.max(b)];
        *self
            .edges_at
            .list(a as usize)
            .iter()
            .find(|&&e| self.edges[e as usize] == ends)
            .expect("an edge between different labels is listed")
    }

    /// Number of labels among the corners of a tetrahedron that are not on an interface.
    pub(super) fn labels_of(&self, t: u32) -> usize {
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

/// A cut of the isosurface, kept off the ends of its edge. One of a material's boundary stays where it is, since planes
/// shall come out plane: vertices make room for it.
pub(super) fn kept_off_ends(cut: f64, p: Region, q: Region) -> f64 {
    if Probe::on_level(p, q) {
        off_ends(cut)
    } else {
        cut
    }
}

/// The edges between different labels, sorted.
/// By ascending ends, each once though several tetrahedra have it.
fn edges_between_labels(tets: &[[u32; 4]], samples: &[Sample]) -> Vec<[u32; 2]> {
    let edges: Vec<[u32; 2]> = parallel::flat_map(tets.len(), |t| {
        let ends = EDGES.map(|e| e.map(|k| tets[t][k]));
        ends.into_iter().filter_map(move |[a, b]| {
            let differ = samples[a as usize].label != samples[b as usize].label;
            differ.then_some([a.min(b), a.max(b)])
        })
    });
    let mut edges = sorted_by_number(edges.len(), |i| edges[i], |edge| edge[0]);
    edges.dedup();
    edges
}
