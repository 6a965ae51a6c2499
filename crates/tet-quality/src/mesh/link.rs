//! Links: what lies opposite an edge or a vertex in the tetrahedra around it, and whether the contraction
//! of an edge keeps the topology.
//!
//! The link of an inner vertex is a sphere of triangles, that of an inner edge a ring of edges. Contraction of ab glues the
//! links of a and b together. The result is a manifold again if they have nothing in common but the link of ab: `Lk a ∩ Lk b =
//! Lk ab`. On a boundary the links are disks and paths; a vertex at infinity, joined to all boundary faces, closes them, so that
//! one condition serves both.

use geom_core::mesh::{FACES, Region};

use crate::mesh::editable::EditableMesh;
use crate::mesh::incidence::NONE;

/// The vertex at infinity, joined to every face of the boundary.
pub(crate) const INFINITY: u32 = NONE;

/// An edge to be contracted.
/// Directed: contraction of `from` into `to` moves the tetrahedra of `from` only.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContractedEdge {
    /// The vertex that vanishes.
    pub(crate) from: u32,
    /// The vertex that it becomes.
    pub(crate) to: u32,
    /// Does the edge lie on an interface?
    pub(crate) on_surface: bool,
}

/// The link of an edge `ab`: the tetrahedra around it, in order, and the vertices opposite.
#[derive(Debug)]
pub(crate) struct EdgeLink {
    /// The vertices around the edge: tetrahedron `i` is `(a, b, vertices[i], vertices[i + 1])`,
    /// positive. One more than tetrahedra; the last equals the first when closed.
    pub(crate) vertices: Vec<u32>,
    pub(crate) tets: Vec<u32>,
    pub(crate) regions: Vec<Region>,
}

impl EdgeLink {
    /// The link, or `None` if the tetrahedra around the edge are not one fan.
    /// Around a boundary edge where two bodies touch there are two fans, which no triangulation of one ring replaces.
    /// Quadratic in their number, which is about five.
    pub(crate) fn new(mesh: &EditableMesh, a: u32, b: u32) -> Option<Self> {
        let mut links: Vec<(u32, u32, u32)> = Vec::with_capacity(8);
        for &t in mesh.incidence.of(a) {
            let tet = mesh.tets[t as usize];
            let Some(j) = tet.iter().position(|&v| v == b) else {
                continue;
            };
            let i = tet
                .iter()
                .position(|&v| v == a)
                .expect("a is a corner of what is around it");
            let [x, y] = OTHERS[i][j];
            links.push((tet[x], tet[y], t));
        }
        // An open link starts at the vertex that no link ends at.
        let first = links
            .iter()
            .position(|l| links.iter().all(|m| m.1 != l.0))
            .unwrap_or(0);
        let count = links.len();
        if count == 0 {
            return None;
        }
        links.swap(0, first);
        for i in 1..count {
            let end = links[i - 1].1;
            let next = (i..count).find(|&k| links[k].0 == end)?;
            links.swap(i, next);
        }
        let mut vertices: Vec<u32> = links.iter().map(|l| l.0).collect();
        vertices.push(links[count - 1].1);
        Some(Self {
            vertices,
            regions: links.iter().map(|l| mesh.regions[l.2 as usize]).collect(),
            tets: links.into_iter().map(|l| l.2).collect(),
        })
    }

    /// Are there tetrahedra all around? Else the edge lies on the boundary.
    pub(crate) fn closed(&self) -> bool {
        self.vertices[0] == self.vertices[self.tets.len()]
    }

    /// Is the edge inside one region?
    pub(crate) fn interior(&self) -> bool {
        self.closed() && self.regions.iter().all(|&r| r == self.regions[0])
    }

    /// The corners opposite the edge in the faces of interfaces that meet at it: two on an interface, three on a curve
    /// in which three regions meet.
    pub(crate) fn wings(&self) -> Vec<u32> {
        let n = self.tets.len();
        let last = self.regions.last();
        let closing = !self.closed() || last != self.regions.first();
        let mut wings: Vec<u32> = (1..n)
            .filter(|&i| self.regions[i] != self.regions[i - 1])
            .map(|i| self.vertices[i])
            .collect();
        if closing {
            wings.push(self.vertices[0]);
        }
        if !self.closed() {
            wings.push(self.vertices[n]);
        }
        wings.sort_unstable();
        wings
    }

    /// Around an edge of the interface of exactly two regions: the link turned so that it starts at
    /// an interface face.
    /// `None` inside one region, where three regions meet, and where two bodies touch along the edge.
    pub(crate) fn at_interface(mut self) -> Option<InterfaceLink> {
        let n = self.tets.len();
        if self.closed() {
            let changes: Vec<usize> = (0..n)
                .filter(|&i| self.regions[i] != self.regions[(i + n - 1) % n])
                .collect();
            let &[first, second] = changes.as_slice() else {
                return None;
            };
            self.vertices.pop();
            self.vertices.rotate_left(first);
            self.tets.rotate_left(first);
            self.regions.rotate_left(first);
            self.vertices.push(self.vertices[0]);
            let first = second - first;
            Some(InterfaceLink { link: self, first })
        } else {
            let single = self.regions.iter().all(|&r| r == self.regions[0]);
            single.then_some(InterfaceLink {
                link: self,
                first: n,
            })
        }
    }
}

/// The link of an edge between two regions, or on the boundary of one.
/// On the boundary there is one side only: `first` then counts all tetrahedra, and the second side is empty.
pub(crate) struct InterfaceLink {
    /// Starts at an interface face.
    pub(crate) link: EdgeLink,
    /// The number of tetrahedra up to the other interface face.
    pub(crate) first: usize,
}

/// Corners `x`, `y` such that `(i, j, x, y)` is an even permutation.
const OTHERS: [[[usize; 2]; 4]; 4] = [
    [[0, 0], [2, 3], [3, 1], [1, 2]],
    [[3, 2], [0, 0], [0, 3], [2, 0]],
    [[1, 3], [3, 0], [0, 0], [0, 1]],
    [[2, 1], [0, 2], [1, 0], [0, 0]],
];

/// What lies opposite a vertex in the simplices around it, all lists sorted.
/// With infinity, if the vertex lies on the boundary: its link is then closed, too.
#[derive(Default)]
pub(crate) struct VertexLink {
    pub(crate) vertices: Vec<u32>,
    pub(crate) edges: Vec<[u32; 2]>,
    triangles: Vec<[u32; 3]>,
    /// The edges opposite the vertex in the interface triangles around it.
    pub(crate) surface: Vec<[u32; 2]>,
}

impl VertexLink {
    pub(crate) fn of(mesh: &EditableMesh, v: u32) -> Self {
        let star = mesh.incidence.of(v);
        let mut link = Self::default();
        let mut sides = Vec::with_capacity(3 * star.len());
        for &t in star {
            let tet = mesh.tets[t as usize];
            let k = tet.iter().position(|&u| u == v).expect("a corner");
            let mut f = FACES[k].map(|i| tet[i]);
            f.sort_unstable();
            let region = mesh.regions[t as usize];
            link.triangles.push(f);
            sides.extend([[f[0], f[1]], [f[0], f[2]], [f[1], f[2]]].map(|e| (e, region)));
        }
        sides.sort_unstable();
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            let edge = group[0].0;
            link.edges.push(edge);
            // One tetrahedron: a face of the boundary, which has one more beyond, with infinity.
            if group.len() == 1 {
                link.triangles.push([edge[0], edge[1], INFINITY]);
                link.edges.extend(edge.map(|u| [u, INFINITY]));
            }
            if group.len() == 1 || group[0].1 != group[1].1 {
                link.surface.push(edge);
            }
        }
        link.edges.sort_unstable();
        link.edges.dedup();
        link.triangles.sort_unstable();
        link.vertices = link.edges.iter().flatten().copied().collect();
        link.vertices.sort_unstable();
        link.vertices.dedup();
        link
    }

    /// The neighbours along interfaces, sorted.
    fn surface_vertices(&self) -> Vec<u32> {
        let mut out: Vec<u32> = self.surface.iter().flatten().copied().collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// The neighbours along curves in which three interfaces meet, sorted.
    fn curve_vertices(&self) -> Vec<u32> {
        let mut ends: Vec<u32> = self.surface.iter().flatten().copied().collect();
        ends.sort_unstable();
        let shared = ends.chunk_by(|a, b| a == b).filter(|group| group.len() > 2);
        shared.map(|group| group[0]).collect()
    }
}

/// What two sorted lists have in common, in order.
pub(crate) fn common<T: Ord + Copy>(a: &[T], b: &[T]) -> Vec<T> {
    a.iter()
        .copied()
        .filter(|v| b.binary_search(v).is_ok())
        .collect()
}

/// The link condition (Dey et al. 1999) with the boundary closed at infinity, and the same for the
/// interface: contraction then keeps the topology of all regions. `link` is that of the edge.
///
/// The two conditions on the surface are not the same as the one in space: a bubble of a tetrahedron's shape may pass
/// the latter, and its contraction would leave two triangles back to back.
pub(crate) fn keeps_topology(mesh: &EditableMesh, edge: ContractedEdge, link: &EdgeLink) -> bool {
    let [from, to] = [edge.from, edge.to].map(|v| VertexLink::of(mesh, v));
    // lk(a) ∩ lk(b) = lk(ab), simplices of all dimensions.
    let mut vertices = link.vertices.clone();
    let mut edges: Vec<[u32; 2]> = link
        .vertices
        .windows(2)
        .map(|w| [w[0].min(w[1]), w[0].max(w[1])])
        .collect();
    if !link.closed() {
        vertices.push(INFINITY);
        let last = link.vertices.len() - 1;
        edges.extend([0, last].map(|i| [link.vertices[i], INFINITY]));
    }
    if common(&from.vertices, &to.vertices)
        .iter()
        .any(|v| !vertices.contains(v))
        || common(&from.edges, &to.edges)
            .iter()
            .any(|e| !edges.contains(e))
        || !common(&from.triangles, &to.triangles).is_empty()
    {
        return false;
    }
    if !edge.on_surface {
        return true;
    }
    // On interfaces the wings are the only common neighbours, and no two of them close a triangle. On a curve none is.
    let wings = common(&from.surface_vertices(), &to.surface_vertices());
    if wings != link.wings() {
        return false;
    }
    let pairs = || (0..wings.len()).flat_map(|j| (0..j).map(move |i| [i, j]));
    match wings.len() {
        2 => {}
        3 if common(&from.curve_vertices(), &to.curve_vertices()).is_empty() => {}
        _ => return false,
    }
    [&from, &to].iter().all(|l| {
        pairs().all(|pair| {
            let [w, z] = pair.map(|i| wings[i]);
            l.surface.binary_search(&[w, z]).is_err()
        })
    })
}

/// Does a contraction that was judged before still keep the topology?
pub(crate) fn still_contracts(mesh: &EditableMesh, edge: ContractedEdge) -> bool {
    EdgeLink::new(mesh, edge.from, edge.to).is_some_and(|link| keeps_topology(mesh, edge, &link))
}

/// The faces that only one of the tetrahedra has.
/// Oriented as in their tetrahedra, in the order of their sorted corners. For a patch this is its surface; for the star
/// of a vertex its link and the boundary there.
pub(crate) fn hull(tets: impl Iterator<Item = [u32; 4]>) -> Vec<[u32; 3]> {
    let mut faces: Vec<([u32; 3], [u32; 3])> = tets
        .flat_map(|tet| {
            FACES.map(|f| {
                let face = f.map(|i| tet[i]);
                let mut key = face;
                key.sort_unstable();
                (key, face)
            })
        })
        .collect();
    faces.sort_unstable();
    faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() == 1)
        .map(|group| group[0].1)
        .collect()
}
