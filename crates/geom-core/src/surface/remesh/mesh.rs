//! The working mesh: half-edges that can be flipped, split and contracted.
//!
//! All changes are local, take constant time but for walks around a vertex, and leave no gaps to be mended: twins,
//! marks and the first half-edge of each fan are right after every one. Triangles are never renumbered, only marked
//! dead, so that lists of half-edges stay good as long as the caller looks whether an edge is still the one that it
//! was.

use crate::mesh::Halfedges;
use crate::{MeshError, Point3, TriMesh, Vector3};

pub(super) const NONE: u32 = u32::MAX;

/// Least cosine between a triangle's normal and the surface's at its corners. A triangle that turns farther away than
/// 72° is a fold.
pub(super) const FACING: f64 = 0.3;

/// How a vertex may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// Along the surface.
    Smooth,
    /// Along a feature or boundary.
    Curve,
    /// Not at all.
    Corner,
}

/// What an edge is kept for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Mark {
    /// It is not kept.
    Free,
    /// A line on a smooth surface: the boundary, or where labels meet.
    Line,
    /// The surface has a crease there.
    Crease,
}

/// A vertex with what belongs to its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vertex {
    pub(super) position: Point3,
    /// Unit normal of the surface here, on its outer side.
    pub(super) normal: Vector3,
    /// Wanted length of the edges here, Å: what was asked for, or shorter.
    pub(super) size: f64,
    /// What was asked for, Å.
    pub(super) wanted: f64,
    /// Did `size` change since the last rounds?
    pub(super) active: bool,
    pub(super) kind: Kind,
}

/// A manifold surface. Half-edge `3 t + k` runs from corner `k` of triangle `t` to the next.
/// Dead triangles name [`NONE`]; dead vertices have no half-edge. Labels are one per triangle and follow it through
/// splits and flips; an edge between labels is kept, so no flip mixes them.
#[derive(Clone)]
pub(super) struct Mesh {
    pub(super) vertices: Vec<Vertex>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// One per triangle.
    pub(super) labels: Vec<u32>,
    twin: Vec<u32>,
    /// Is the edge kept? Both halves agree; boundary edges always are.
    marks: Vec<Mark>,
    /// Per vertex a half-edge that leaves it: on a boundary the first of the fan.
    out: Vec<u32>,
}

pub(super) fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}
pub(super) fn previous(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

/// Twice the area of a triangle along its normal.
pub(super) fn doubled_normal([a, b, c]: [Point3; 3]) -> Vector3 {
    (b - a).cross(&(c - a))
}

/// How well a triangle faces the way the surface does at its corners: the least cosine; 1 if none
/// of its corners knows a normal, −1 if it has no area.
pub(super) fn facing(corners: [&Vertex; 3]) -> f64 {
    let Some(normal) = doubled_normal(corners.map(|v| v.position)).try_normalize(0.0) else {
        return -1.0;
    };
    corners
        .iter()
        .filter(|v| v.normal != Vector3::zeros())
        .map(|v| normal.dot(&v.normal))
        .fold(1.0, f64::min)
}

impl Mesh {
    /// Unused vertices are dead from the start. Kinds, normals and sizes are the caller's to set.
    /// Edges between triangles of different labels are lines.
    pub(super) fn new(mesh: &TriMesh, labels: Vec<u32>) -> Result<Self, MeshError> {
        let edges = Halfedges::of(mesh)?;
        let vertices = mesh
            .positions()
            .iter()
            .map(|&position| Vertex {
                position,
                normal: Vector3::zeros(),
                size: 0.0,
                wanted: 0.0,
                active: true,
                kind: Kind::Smooth,
            })
            .collect();
        let twin = edges.twins().to_vec();
        let marks = (0u32..)
            .zip(&twin)
            .map(|(h, &t)| {
                if t == NONE || labels[(h / 3) as usize] != labels[(t / 3) as usize] {
                    Mark::Line
                } else {
                    Mark::Free
                }
            })
            .collect();
        let out = (0..mesh.positions().len() as u32)
            .map(|v| edges.out(crate::VertexId(v)).map_or(NONE, |h| h.0))
            .collect();
        Ok(Self {
            vertices,
            triangles: mesh.triangles().to_vec(),
            labels,
            twin,
            marks,
            out,
        })
    }

    /// The living vertices and triangles, in order.
    pub(super) fn surface(&self) -> TriMesh {
        let mut number = vec![NONE; self.vertices.len()];
        let mut positions = Vec::new();
        for (v, vertex) in self.vertices.iter().enumerate() {
            if self.out[v] != NONE {
                number[v] = positions.len() as u32;
                positions.push(vertex.position);
            }
        }
        let triangles = self
            .triangles
            .iter()
            .filter(|t| t[0] != NONE)
            .map(|t| t.map(|v| number[v as usize]))
            .collect();
        TriMesh::new(positions, triangles).expect("living triangles have living vertices")
    }
    /// The labels of the living triangles, in order.
    pub(super) fn living_labels(&self) -> Vec<u32> {
        let alive = self.triangles.iter().zip(&self.labels);
        alive
            .filter(|(t, _)| t[0] != NONE)
            .map(|(_, &label)| label)
            .collect()
    }

    pub(super) fn from(&self, h: u32) -> u32 {
        self.triangles[(h / 3) as usize][(h % 3) as usize]
    }
    pub(super) fn to(&self, h: u32) -> u32 {
        self.from(next(h))
    }
    /// The corner opposite to the half-edge.
    pub(super) fn opposite(&self, h: u32) -> u32 {
        self.from(previous(h))
    }
    pub(super) fn twin(&self, h: u32) -> Option<u32> {
        (self.twin[h as usize] != NONE).then(|| self.twin[h as usize])
    }
    /// Is the edge kept: a boundary, a line or a crease?
    pub(super) fn is_feature(&self, h: u32) -> bool {
        self.marks[h as usize] != Mark::Free
    }
    pub(super) fn mark(&self, h: u32) -> Mark {
        self.marks[h as usize]
    }
    /// Marks an edge between two triangles; the boundary stays what it is.
    pub(super) fn mark_crease(&mut self, h: u32) {
        if let Some(g) = self.twin(h) {
            self.marks[h as usize] = Mark::Crease;
            self.marks[g as usize] = Mark::Crease;
        }
    }
    /// Takes the crease of an edge away.
    pub(super) fn unmark_crease(&mut self, h: u32) {
        if let Some(g) = self.twin(h) {
            let differ = self.labels[(h / 3) as usize] != self.labels[(g / 3) as usize];
            let mark = if differ { Mark::Line } else { Mark::Free };
            self.marks[h as usize] = mark;
            self.marks[g as usize] = mark;
        }
    }
    pub(super) fn position(&self, v: u32) -> Point3 {
        self.vertices[v as usize].position
    }
    /// Dead since a contraction, or unused from the start.
    pub(super) fn is_alive(&self, v: u32) -> bool {
        self.out[v as usize] != NONE
    }
    /// Did the wanted length change at an end of the edge?
    pub(super) fn is_active(&self, h: u32) -> bool {
        [self.from(h), self.to(h)]
            .iter()
            .any(|&v| self.vertices[v as usize].active)
    }
    pub(super) fn on_boundary(&self, v: u32) -> bool {
        let h = self.out[v as usize];
        h != NONE && self.twin[h as usize] == NONE
    }
    pub(super) fn length(&self, h: u32) -> f64 {
        (self.position(self.to(h)) - self.position(self.from(h))).norm()
    }
    /// Length in units of the wanted one: that of the end which wants it shorter.
    pub(super) fn relative_length(&self, h: u32) -> f64 {
        let size = |v: u32| self.vertices[v as usize].size;
        self.length(h) / size(self.from(h)).min(size(self.to(h)))
    }

    /// One half-edge per living edge, in order.
    pub(super) fn edges(&self) -> impl Iterator<Item = u32> + '_ {
        (0..3 * self.triangles.len() as u32).filter(|&h| self.is_first(h))
    }
    /// Is `h` alive, and the half-edge that stands for its edge?
    pub(super) fn is_first(&self, h: u32) -> bool {
        self.from(h) != NONE && self.twin(h).is_none_or(|g| h < g)
    }

    /// The half-edges that leave `v`, counter-clockwise, one per triangle.
    pub(super) fn fan(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        let first = (self.out[v as usize] != NONE).then(|| self.out[v as usize]);
        std::iter::successors(first, move |&h| {
            let turned = self.twin(previous(h))?;
            (Some(turned) != first).then_some(turned)
        })
    }
    /// The neighbours of `v`, counter-clockwise.
    pub(super) fn ring(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        let last = self.beyond_the_fan(v);
        self.fan(v).map(|h| self.to(h)).chain(last)
    }
    /// The neighbours along features and boundaries.
    pub(super) fn curve_ring(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        let last = self.beyond_the_fan(v);
        self.fan(v)
            .filter(|&h| self.is_feature(h))
            .map(|h| self.to(h))
            .chain(last)
    }
    /// The neighbour of a boundary vertex to which no half-edge leaves. See [`Halfedges::around`].
    fn beyond_the_fan(&self, v: u32) -> Option<u32> {
        self.on_boundary(v).then(|| {
            let last = self
                .fan(v)
                .last()
                .expect("a boundary vertex has a triangle");
            self.opposite(last)
        })
    }

    /// Makes two half-edges twins; `NONE` for a side that is not there.
    fn link(&mut self, h: u32, g: u32) {
        if h != NONE {
            self.twin[h as usize] = g;
        }
        if g != NONE {
            self.twin[g as usize] = h;
        }
    }
    /// Gives half-edge `to` the other side and the mark that `from` had.
    fn inherit(&mut self, to: u32, (twin, mark): (u32, Mark)) {
        self.link(to, twin);
        self.marks[to as usize] = mark;
    }
    /// What is beyond a half-edge, and its mark: to be handed to the half-edge that takes its place.
    fn side(&self, h: u32) -> (u32, Mark) {
        (self.twin[h as usize], self.marks[h as usize])
    }
    /// Lets `out` of `v` be the first of its fan, given any half-edge that leaves it. Turns clockwise to the boundary,
    /// or once around.
    fn set_out(&mut self, v: u32, h: u32) {
        let mut first = h;
        while let Some(g) = self.twin(first) {
            first = next(g);
            if first == h {
                break;
            }
        }
        self.out[v as usize] = first;
    }
    fn push_triangle(&mut self, corners: [u32; 3], label: u32) -> u32 {
        let t = self.triangles.len() as u32;
        self.triangles.push(corners);
        self.labels.push(label);
        self.twin.extend([NONE; 3]);
        self.marks.extend([Mark::Free; 3]);
        3 * t
    }

    /// Would the edge have the same two vertices as another after a flip?
    pub(super) fn may_flip(&self, h: u32) -> bool {
        let Some(g) = self.twin(h) else { return false };
        let (c, d) = (self.opposite(h), self.opposite(g));
        !self.is_feature(h) && c != d && !self.ring(c).any(|v| v == d)
    }

    /// Turns the edge between two triangles into the other diagonal of their quad. Asks [`Self::may_flip`] of the
    /// caller. Both triangles keep their numbers, and the flipped edge its two half-edges.
    pub(super) fn flip(&mut self, h: u32) {
        let g = self.twin[h as usize];
        let (a, b, c, d) = (
            self.from(h),
            self.from(g),
            self.opposite(h),
            self.opposite(g),
        );
        let (n, p, gn, gp) = (next(h), previous(h), next(g), previous(g));
        let (bc, ca, ad, db) = (self.side(n), self.side(p), self.side(gn), self.side(gp));
        let corner = |mesh: &mut Self, h: u32, v: u32| {
            mesh.triangles[(h / 3) as usize][(h % 3) as usize] = v;
        };
        for (slot, v) in [(h, d), (n, c), (p, a), (g, c), (gn, d), (gp, b)] {
            corner(self, slot, v);
        }
        self.inherit(n, ca);
        self.inherit(p, ad);
        self.inherit(gn, db);
        self.inherit(gp, bc);
        for (v, h) in [(a, p), (b, gp), (c, n), (d, gn)] {
            self.set_out(v, h);
        }
    }

    /// Puts a vertex into the edge; both its halves stay features if it was one. Always possible. The half-edge given
    /// keeps the half at its start. Returns the new vertex.
    pub(super) fn split(&mut self, h: u32, vertex: Vertex) -> u32 {
        let m = self.vertices.len() as u32;
        self.vertices.push(vertex);
        self.out.push(NONE);
        let (g, mark) = self.side(h);
        let (b, a) = (self.to(h), self.from(h));
        let new = self.cut(h, m, mark);
        if g != NONE {
            let other = self.cut(g, m, mark);
            self.link(h, other);
            self.link(new, g);
            self.set_out(a, other + 1);
        }
        self.set_out(b, new + 1);
        self.set_out(m, new);
        m
    }

    /// Cuts the triangle of a half-edge from `m` on it to the corner opposite. The half-edge keeps its first half; the
    /// other one, with the mark, is the first of the new triangle, which is returned.
    fn cut(&mut self, h: u32, m: u32, mark: Mark) -> u32 {
        let (b, c) = (self.to(h), self.opposite(h));
        let n = next(h);
        let bc = self.side(n);
        let new = self.push_triangle([m, b, c], self.labels[(h / 3) as usize]);
        self.triangles[(h / 3) as usize][(n % 3) as usize] = m;
        self.inherit(new + 1, bc);
        self.inherit(n, (new + 2, Mark::Free));
        self.marks[new as usize] = mark;
        new
    }

    /// The link condition: contracting the edge keeps the surface a manifold of the same topology
    /// (Dey, Edelsbrunner, Guha and Nekhayev, 1999).
    pub(super) fn may_contract(&self, h: u32) -> bool {
        let (a, b) = (self.from(h), self.to(h));
        let twin = self.twin(h);
        // Two boundaries would meet in a point.
        if twin.is_some() && self.on_boundary(a) && self.on_boundary(b) {
            return false;
        }
        let wings = 1 + usize::from(twin.is_some());
        let common = self
            .ring(a)
            .filter(|&v| self.ring(b).any(|w| w == v))
            .count();
        if common != wings {
            return false;
        }
        // A loop of three kept edges would become one edge.
        let flattens = |h: u32| self.is_feature(next(h)) && self.is_feature(previous(h));
        if flattens(h) || twin.is_some_and(flattens) {
            return false;
        }
        // The wings must keep a fan: three edges inside, two on a boundary.
        let keeps = |v: u32| {
            let edges = self.ring(v).count();
            edges > if self.on_boundary(v) { 2 } else { 3 }
        };
        keeps(self.opposite(h)) && twin.is_none_or(|g| keeps(self.opposite(g)))
    }

    /// Merges the start of the edge into its end, which becomes `vertex`. Asks [`Self::may_contract`]
    /// of the caller.
    pub(super) fn contract(&mut self, h: u32, vertex: Vertex) {
        let (a, b) = (self.from(h), self.to(h));
        let fan: Vec<u32> = self.fan(a).collect();
        let wings: Vec<u32> = std::iter::once(h).chain(self.twin(h)).collect();
        for &out in &fan {
            self.triangles[(out / 3) as usize][(out % 3) as usize] = b;
        }
        let mut leaving = Vec::with_capacity(3);
        for &wing in &wings {
            let (n, p) = (next(wing), previous(wing));
            let c = self.from(p);
            let ((tn, kept_n), (tp, kept_p)) = (self.side(n), self.side(p));
            self.link(tn, tp);
            for t in [tn, tp] {
                if t != NONE {
                    self.marks[t as usize] = kept_n.max(kept_p);
                }
            }
            // Of the two edges at `c`, now one, some half leaves `c` and another `b`.
            for t in [tn, tp] {
                if t != NONE {
                    let (start, along) = (self.from(t), next(t));
                    leaving.push(if start == c { (c, t) } else { (c, along) });
                    leaving.push(if start == c { (b, along) } else { (b, t) });
                }
            }
            self.triangles[(wing / 3) as usize] = [NONE; 3];
        }
        self.out[a as usize] = NONE;
        for (v, h) in leaving {
            self.set_out(v, h);
        }
        self.vertices[b as usize] = vertex;
    }

    /// Panics unless twins, fans and kinds fit together; for tests.
    #[cfg(feature = "testing")]
    pub(super) fn validate(&self) {
        for h in 0..3 * self.triangles.len() as u32 {
            if self.from(h) == NONE {
                continue;
            }
            if let Some(g) = self.twin(h) {
                assert_eq!(self.twin(g), Some(h));
                assert_eq!((self.from(h), self.to(h)), (self.to(g), self.from(g)));
                assert_eq!(self.mark(h), self.mark(g));
                if !self.is_feature(h) {
                    assert_eq!(self.labels[(h / 3) as usize], self.labels[(g / 3) as usize]);
                }
            } else {
                assert!(self.is_feature(h));
            }
        }
        let mut degree = vec![0; self.vertices.len()];
        for &v in self.triangles.as_flattened().iter().filter(|&&v| v != NONE) {
            degree[v as usize] += 1;
        }
        for v in 0..self.vertices.len() as u32 {
            assert_eq!(self.fan(v).count(), degree[v as usize], "fan of vertex {v}");
            for h in self.fan(v) {
                assert_eq!(self.from(h), v);
                assert!(self.twin(h).is_some() || h == self.out[v as usize]);
            }
        }
    }
}
