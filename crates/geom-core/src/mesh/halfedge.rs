//! Connectivity of triangles and quads as half-edges.
//!
//! The arrays are `u32` and as a GPU reads them. Nothing here changes a mesh: the remesher has a working mesh of its
//! own, with the same numbering, in which edges can be flipped, split and contracted.

use super::audit::sorted_edges;
use super::{MeshError, QuadMesh, TriMesh};
use crate::id::{FaceId, HalfedgeId, Id, VertexId};

const NONE: u32 = u32::MAX;

/// The half-edges of an oriented manifold mesh of triangles (`N = 3`) or quads (`N = 4`): no
/// positions, three flat arrays.
///
/// Half-edge `N f + k` runs along face `f` from its corner `k` to corner `k + 1`; next and previous
/// ones are arithmetic. A half-edge on a boundary has no twin.
///
/// ```
/// use geom_core::mesh::{Halfedges, shapes};
/// use geom_core::VertexId;
/// let sphere = shapes::icosphere(1.0, 2);
/// let edges = Halfedges::of(&sphere)?;
/// assert_eq!(edges.around(VertexId(0)).count(), 5); // a corner of the icosahedron
/// # Ok::<(), geom_core::MeshError>(())
/// ```
///
/// A closed mesh of `n` vertices has about `6 n` half-edges as triangles and `4 n` as quads, at 8 bytes each and 4 per
/// vertex. Queries take constant time, but for those that walk around a vertex. Ids of another mesh, or out of range,
/// make them panic or give another element's answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Halfedges<const N: usize> {
    twin: Vec<u32>,
    from: Vec<u32>,
    /// Per vertex one half-edge that leaves it; on a boundary the one without a twin before it in
    /// the fan, so that turning from there meets all faces.
    out: Vec<u32>,
}

impl Halfedges<3> {
    /// The half-edges of a triangle mesh.
    ///
    /// # Errors
    /// Those of [`Halfedges::new`]; [`surface::repair`](crate::surface) makes any triangles fit.
    pub fn of(mesh: &TriMesh) -> Result<Self, MeshError> {
        Self::new(mesh.positions().len(), mesh.triangles())
    }
}

impl Halfedges<4> {
    /// The half-edges of a quad mesh.
    ///
    /// # Errors
    /// Those of [`Halfedges::new`].
    pub fn of_quads(mesh: &QuadMesh) -> Result<Self, MeshError> {
        Self::new(mesh.positions().len(), mesh.quads())
    }
}

impl<const N: usize> Halfedges<N> {
    /// The half-edges of these faces, whose corners must lie below `vertices` and differ.
    ///
    /// # Errors
    /// [`MeshError::NonManifoldEdge`] if an edge has more than two faces or two in the same
    /// direction; [`MeshError::NonManifoldVertex`] if the faces around a vertex form more than one
    /// fan; [`MeshError::OutOfRange`], [`MeshError::Repeated`] and [`MeshError::TooMany`]. Of several faults of one
    /// kind the one with the lowest face or vertex is named. The edges are sorted; all else is linear.
    pub fn new(vertices: usize, faces: &[[u32; N]]) -> Result<Self, MeshError> {
        let count = N * faces.len();
        if count.max(vertices) > crate::id::MAX_ELEMENTS {
            return Err(MeshError::TooMany {
                count: count.max(vertices),
            });
        }
        super::check_corners(vertices, faces)?;
        let mut twin = vec![NONE; count];
        let mut wrong: Option<(u32, [u32; 2])> = None;
        // Edge by edge: two faces that run it opposite ways are twins, one face alone is a boundary.
        for group in sorted_edges(faces).chunk_by(|a, b| a.0 == b.0) {
            let [low, high] = [(group[0].0 >> 32) as u32, group[0].0 as u32];
            let halfedge = |f: u32| {
                let face = &faces[f as usize];
                let k = (0..N)
                    .find(|&k| {
                        let (a, b) = (face[k], face[(k + 1) % N]);
                        (a.min(b), a.max(b)) == (low, high)
                    })
                    .expect("the edge belongs to the face");
                (N as u32 * f + k as u32, face[k])
            };
            match *group {
                [_] => {}
                [(_, f), (_, g)] if halfedge(f).1 != halfedge(g).1 => {
                    let (a, b) = (halfedge(f).0, halfedge(g).0);
                    twin[a as usize] = b;
                    twin[b as usize] = a;
                }
                _ => {
                    // The lowest face that is one too many.
                    let later = group[group.len().min(3) - 1].1;
                    let (_, from) = halfedge(later);
                    let to = if from == low { high } else { low };
                    if wrong.is_none_or(|(face, _)| later < face) {
                        wrong = Some((later, [from, to]));
                    }
                }
            }
        }
        if let Some((face, [from, to])) = wrong {
            let face = face as usize;
            return Err(MeshError::NonManifoldEdge { face, from, to });
        }
        let mut edges = Self {
            twin,
            from: faces.as_flattened().to_vec(),
            out: vec![NONE; vertices],
        };
        // A vertex whose faces are not all met on the way around it joins several fans.
        let mut degree = vec![0u32; vertices];
        for h in 0..count as u32 {
            let v = edges.from[h as usize] as usize;
            degree[v] += 1;
            // On a boundary the fan starts where nothing lies on the right.
            if edges.out[v] == NONE || edges.twin[h as usize] == NONE {
                edges.out[v] = h;
            }
        }
        for (vertex, &faces) in (0u32..).zip(&degree) {
            if edges.around(VertexId(vertex)).count() != faces as usize {
                return Err(MeshError::NonManifoldVertex { vertex });
            }
        }
        Ok(edges)
    }

    /// Number of half-edges.
    pub fn len(&self) -> usize {
        self.from.len()
    }
    /// Is there no half-edge?
    pub fn is_empty(&self) -> bool {
        self.from.is_empty()
    }
    /// Number of faces.
    pub fn faces(&self) -> usize {
        self.from.len() / N
    }
    /// Number of vertices, unused ones included.
    pub fn vertices(&self) -> usize {
        self.out.len()
    }
    /// The half-edge on the other side; `None` on a boundary.
    pub fn twin(&self, h: HalfedgeId) -> Option<HalfedgeId> {
        some(self.twin[h.index()])
    }
    /// The vertex where it starts.
    pub fn from(&self, h: HalfedgeId) -> VertexId {
        VertexId(self.from[h.index()])
    }
    /// The vertex where it ends.
    pub fn to(&self, h: HalfedgeId) -> VertexId {
        self.from(self.next(h))
    }
    /// The face on its left.
    pub fn face(&self, h: HalfedgeId) -> FaceId {
        FaceId(h.0 / N as u32)
    }
    /// Half-edge `k` of a face. `k` counts around and around: `N` is 0 again.
    pub fn of_face(&self, face: FaceId, k: usize) -> HalfedgeId {
        HalfedgeId(face.0 * N as u32 + (k % N) as u32)
    }
    /// The next half-edge around its face.
    pub fn next(&self, h: HalfedgeId) -> HalfedgeId {
        let n = N as u32;
        HalfedgeId(if h.0 % n == n - 1 {
            h.0 + 1 - n
        } else {
            h.0 + 1
        })
    }
    /// The previous half-edge around its face.
    pub fn previous(&self, h: HalfedgeId) -> HalfedgeId {
        let n = N as u32;
        HalfedgeId(if h.0.is_multiple_of(n) {
            h.0 + n - 1
        } else {
            h.0 - 1
        })
    }
    /// A half-edge that leaves the vertex, on a boundary the first of its fan; `None` if no face
    /// uses the vertex. Inside of the surface it may be any of its half-edges, the same for the same mesh.
    pub fn out(&self, v: VertexId) -> Option<HalfedgeId> {
        some(self.out[v.index()])
    }
    /// Does the vertex lie on a boundary? A vertex of no face does not.
    pub fn on_boundary(&self, v: VertexId) -> bool {
        self.out(v).is_some_and(|h| self.twin(h).is_none())
    }
    /// The half-edges that leave a vertex, counter-clockwise seen from outside; one per face.
    ///
    /// A vertex inside has as many neighbours as half-edges here. One on a boundary has one more,
    /// `from(previous(last))` of the last of these: no half-edge leads there.
    pub fn around(&self, v: VertexId) -> impl Iterator<Item = HalfedgeId> + '_ {
        let first = self.out(v);
        std::iter::successors(first, move |&h| {
            let turned = self.twin(self.previous(h))?;
            (Some(turned) != first).then_some(turned)
        })
    }
    /// All half-edges.
    pub fn iter(&self) -> impl Iterator<Item = HalfedgeId> + use<N> {
        (0..self.from.len() as u32).map(HalfedgeId)
    }
    /// One half-edge per edge: the lower-numbered of the two. Boundary edges are among them, by their only half-edge.
    pub fn edges(&self) -> impl Iterator<Item = HalfedgeId> + '_ {
        self.iter()
            .filter(|&h| self.twin(h).is_none_or(|twin| h < twin))
    }
    /// The boundary loops: the vertices along each, with the surface on the left, by the
    /// lowest half-edge. A vertex is in at most one of them, since its faces form one fan; a closed mesh has none.
    pub fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        let mut seen = vec![false; self.from.len()];
        let mut loops = Vec::new();
        for start in self.iter() {
            if seen[start.index()] || self.twin(start).is_some() {
                continue;
            }
            let mut vertices = Vec::new();
            let mut h = start;
            while !seen[h.index()] {
                seen[h.index()] = true;
                vertices.push(self.from(h));
                // The boundary goes on with the first half-edge of the next vertex's fan.
                h = self.out(self.to(h)).expect("a used vertex");
            }
            loops.push(vertices);
        }
        loops
    }
    /// The other half-edge per half-edge, `u32::MAX` on a boundary: as a GPU reads it.
    pub fn twins(&self) -> &[u32] {
        &self.twin
    }
}

fn some(index: u32) -> Option<HalfedgeId> {
    (index != NONE).then_some(HalfedgeId(index))
}
