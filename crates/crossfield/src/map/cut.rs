//! The cut that opens a surface to a disk with all singular vertices on its rim.
//!
//! A short cut has few integers on it, and integers are what is hard. A tree of shortest paths reaches every vertex from the
//! boundary or from a singular vertex; the triangles are joined by a second tree over edges that the first does not use. The
//! edges of neither are 2 g for a closed surface of genus g: with the paths from their ends to the root, they are the loops
//! that open its handles. Ends that are neither singular nor on the boundary are then taken off.

use std::collections::VecDeque;

use geom_core::TriMesh;
use geom_core::compute::sets::DisjointSets;
use geom_core::surface::distance::{Graph, shortest_paths};

use crate::Error;
use crate::field::CrossField;
use crate::field::frames::{Frames, next};

const NONE: u32 = u32::MAX;

/// A connected surface cut open. Triangles not parted by the cut share one chart, their crosses combed: an
/// arm of the field is chosen in each triangle so that it passes without a turn over every edge that is
/// not cut.
#[derive(Clone, Debug)]
pub(crate) struct Cut {
    /// Quarter turns from the arm θ to the chosen arm, per triangle.
    /// 0…3, counter-clockwise.
    pub(crate) comb: Vec<u8>,
    /// Per half-edge: is its edge cut? Boundary edges are not.
    /// Both half-edges of an edge agree.
    pub(crate) is_cut: Vec<bool>,
    /// Quarter turns k of the chosen arms across each half-edge: coordinates turn by −k.
    /// `(comb_j − comb_i + p) mod 4` from triangle i to j, 0 on edges that are not cut and on boundaries.
    pub(crate) turn: Vec<u8>,
    /// Per corner (numbered like the half-edge out of it): which copy of its vertex.
    pub(crate) copy: Vec<u32>,
    /// Per copy, its vertex.
    pub(crate) vertex: Vec<u32>,
    /// Per half-edge of the cut: its chain, and whether it runs along it.
    /// Along a chain the turn is the same throughout, so that one translation of two integers belongs to it.
    pub(crate) chain: Vec<u32>,
    pub(crate) forward: Vec<bool>,
    /// Number of chains: maximal paths of the cut between its nodes.
    pub(crate) chains: usize,
    /// Nodes of the cut: ends, branches, singular and boundary vertices; the farthest from the root first.
    pub(crate) nodes: Vec<u32>,
    /// Distance of each vertex from the root of the cut, Å.
    /// Along edges; boundary vertices have 0, and on a closed surface the first singular vertex.
    pub(crate) depth: Vec<f64>,
}

impl Cut {
    /// A tree of shortest paths and the loops that a tree of the dual graph leaves over (Erickson and
    /// Whittlesey, *Greedy optimal homotopy and homology generators*, 2005), pruned to what singular vertices and handles
    /// need.
    pub(crate) fn of(mesh: &TriMesh, frames: &Frames, field: &CrossField) -> Result<Self, Error> {
        let singular: Vec<bool> = (0..field.index.len())
            .map(|v| field.index[v] != 0 && !frames.on_boundary(v))
            .collect();
        let (on_tree, depth) = shortest_path_tree(mesh, frames, &singular)?;
        let (mut is_cut, comb) = comb_dual_tree(frames, field, &on_tree);
        prune(frames, &singular, &mut is_cut);
        let turn = (0..frames.edges().len())
            .map(|h| match frames.twin(h) {
                Some(t) => {
                    let k = i32::from(comb[t / 3]) - i32::from(comb[h / 3]) + field.jump[h];
                    k.rem_euclid(4) as u8
                }
                None => 0,
            })
            .collect();
        let (copy, vertex) = copies(frames, &is_cut);
        let mut cut = Self {
            comb,
            is_cut,
            turn,
            copy,
            vertex,
            chain: vec![NONE; frames.edges().len()],
            forward: vec![false; frames.edges().len()],
            chains: 0,
            nodes: Vec::new(),
            depth,
        };
        cut.find_chains(frames, &singular);
        Ok(cut)
    }

    /// The half-edges out of a vertex, counter-clockwise, the first on the cut or the boundary if any is.
    /// So transitions met on a walk through it are those of the cut, each once; inside of a fan that is not cut there
    /// is none.
    pub(crate) fn fan(&self, frames: &Frames, vertex: usize) -> Vec<usize> {
        let mut fan: Vec<usize> = frames.around(vertex).collect();
        if !frames.on_boundary(vertex)
            && let Some(first) = fan.iter().position(|&h| self.is_cut[h])
        {
            fan.rotate_left(first);
        }
        fan
    }

    /// Splits the cut at its nodes, and orders these so that who goes through them has seen all nodes farther out
    /// before.
    fn find_chains(&mut self, frames: &Frames, singular: &[bool]) {
        let vertices = singular.len();
        let mut degree = vec![0u32; vertices];
        for (h, _) in frames.interior().filter(|&(h, _)| self.is_cut[h]) {
            degree[frames.from(h)] += 1;
            degree[frames.to(h)] += 1;
        }
        let is_node: Vec<bool> = (0..vertices)
            .map(|v| degree[v] > 0 && (degree[v] != 2 || singular[v] || frames.on_boundary(v)))
            .collect();
        self.nodes = (0..vertices as u32)
            .filter(|&v| is_node[v as usize])
            .collect();
        for node in self.nodes.clone() {
            let starts: Vec<usize> = out_of(frames, node as usize)
                .filter(|&h| self.is_cut[h] && self.chain[h] == NONE)
                .collect();
            for start in starts {
                if self.chain[start] == NONE {
                    self.follow_chain(frames, start, &is_node);
                }
            }
        }
        let depth = &self.depth;
        self.nodes.sort_by(|&a, &b| {
            depth[b as usize]
                .total_cmp(&depth[a as usize])
                .then(a.cmp(&b))
        });
    }

    /// Walks from a node along the cut until the next node and numbers what lies between.
    fn follow_chain(&mut self, frames: &Frames, start: usize, is_node: &[bool]) {
        let chain = self.chains as u32;
        self.chains += 1;
        let mut h = start;
        loop {
            let twin = frames.twin(h).expect("cut edges are inside");
            self.chain[h] = chain;
            self.chain[twin] = chain;
            self.forward[h] = true;
            let at = frames.to(h);
            if is_node[at] {
                return;
            }
            let Some(on) = out_of(frames, at).find(|&g| self.is_cut[g] && self.chain[g] == NONE)
            else {
                return;
            };
            h = on;
        }
    }
}

/// The half-edges out of a vertex that have a twin.
fn out_of(frames: &Frames, vertex: usize) -> impl Iterator<Item = usize> + '_ {
    frames.around(vertex).filter(|&h| frames.twin(h).is_some())
}

/// Which half-edges (both of an edge) lie on shortest paths from the boundary, or from a singular vertex, to
/// everywhere.
///
/// With the distance of each vertex along edges, by Dijkstra's algorithm: n log n for n vertices.
fn shortest_path_tree(
    mesh: &TriMesh,
    frames: &Frames,
    singular: &[bool],
) -> Result<(Vec<bool>, Vec<f64>), Error> {
    let vertices = singular.len();
    let mut roots: Vec<(u32, f64)> = (0..vertices)
        .filter(|&v| frames.on_boundary(v))
        .map(|v| (v as u32, 0.0))
        .collect();
    if roots.is_empty() {
        let first = singular.iter().position(|&s| s).unwrap_or(0);
        roots.push((first as u32, 0.0));
    }
    let paths = shortest_paths(&Graph::of_edges(mesh)?, &roots, f64::INFINITY)?;
    let on_tree = (0..frames.edges().len())
        .map(|h| {
            let (a, b) = (frames.from(h), frames.to(h));
            paths.parent[a] as usize == b || paths.parent[b] as usize == a
        })
        .collect();
    Ok((on_tree, paths.distance))
}

/// A spanning tree of the dual graph that does not cross the other tree; what it does not cross is cut. Arms are
/// carried along it.
///
/// By breadth first from triangle 0. Over an edge of this tree the combed arms continue each other without a turn. Over
/// other edges whose turn is 0 as well they do, too: pruning takes off those that only end somewhere.
fn comb_dual_tree(frames: &Frames, field: &CrossField, on_tree: &[bool]) -> (Vec<bool>, Vec<u8>) {
    let mut is_cut: Vec<bool> = (0..frames.edges().len())
        .map(|h| frames.twin(h).is_some())
        .collect();
    let mut comb = vec![0u8; frames.faces()];
    let mut seen = vec![false; frames.faces()];
    let mut queue = VecDeque::from([0]);
    seen[0] = true;
    while let Some(face) = queue.pop_front() {
        for h in 3 * face..3 * face + 3 {
            let Some(t) = frames.twin(h) else { continue };
            if on_tree[h] || seen[t / 3] {
                continue;
            }
            seen[t / 3] = true;
            is_cut[h] = false;
            is_cut[t] = false;
            comb[t / 3] = (i32::from(comb[face]) - field.jump[h]).rem_euclid(4) as u8;
            queue.push_back(t / 3);
        }
    }
    (is_cut, comb)
}

/// Takes loose ends off the cut until they are singular or on the boundary.
///
/// Around a regular vertex where one cut ends, all turns but that of this edge are 0, and their sum is minus the index,
/// 0, up to multiples of four: so the edge has none either, and its triangles may share a chart.
fn prune(frames: &Frames, singular: &[bool], is_cut: &mut [bool]) {
    let vertices = singular.len();
    let mut degree = vec![0u32; vertices];
    for (h, _) in frames.interior().filter(|&(h, _)| is_cut[h]) {
        degree[frames.from(h)] += 1;
        degree[frames.to(h)] += 1;
    }
    let loose = |v: usize, degree: &[u32]| degree[v] == 1 && !singular[v] && !frames.on_boundary(v);
    let mut ends: Vec<usize> = (0..vertices).filter(|&v| loose(v, &degree)).collect();
    while let Some(v) = ends.pop() {
        if !loose(v, &degree) {
            continue;
        }
        let h = out_of(frames, v)
            .find(|&h| is_cut[h])
            .expect("of degree one");
        is_cut[h] = false;
        is_cut[frames.twin(h).expect("inside")] = false;
        let other = frames.to(h);
        degree[v] -= 1;
        degree[other] -= 1;
        ends.push(other);
    }
}

/// Corners joined over edges that are not cut.
///
/// Answers the copy of each corner and the vertex of each copy. A vertex where m edges of the cut meet has m copies
/// (one if m is 0), and on a boundary one more.
fn copies(frames: &Frames, is_cut: &[bool]) -> (Vec<u32>, Vec<u32>) {
    let corners = frames.edges().len();
    let mut sets = DisjointSets::new(corners);
    for (h, t) in frames.interior().filter(|&(h, _)| !is_cut[h]) {
        sets.join(h as u32, next(t) as u32);
        sets.join(next(h) as u32, t as u32);
    }
    let mut number = vec![NONE; corners];
    let mut vertex = Vec::new();
    let copy = sets
        .into_roots()
        .into_iter()
        .map(|root| {
            let slot = &mut number[root as usize];
            if *slot == NONE {
                *slot = vertex.len() as u32;
                vertex.push(frames.from(root as usize) as u32);
            }
            *slot
        })
        .collect();
    (copy, vertex)
}
