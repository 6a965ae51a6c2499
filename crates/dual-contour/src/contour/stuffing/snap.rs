//! Vertices snap onto close cuts.
//!
//! A cut very near to the end of its edge would make a tetrahedron that is nearly flat. Labelle and Shewchuk move the vertex
//! onto the cut instead: it then lies on the surface, but for a thousandth of the way to other cuts, and no edge of it is cut any more. With cuts closer than a fixed
//! share of the edge snapped, a finite number of shapes remains, and the angles of all of them are known before anything is
//! meshed. But a vertex that becomes part of the surface may touch another part of it. So it may snap only if the surface
//! around it is then one disk, which its link tells; otherwise it stays and its cuts move away from it, or where they
//! are those of a material's boundary, it steps aside itself.

use super::Counts;
use super::aside::{Aside, ROOM};
use super::near::{NONE, Near, Pair, pair};
use crate::dual::Probe;
use crate::octree::{along, exact};
use geom_core::compute::parallel;
use geom_core::{Point3, Vector3};

/// Most neighbours of a vertex that may snap; no octree has more than 50.
const LINK: usize = 64;

/// How much farther cuts are moved away that were farther before, as a share of what is too close. Else all around a vertex
/// are at one share of their edges, and the surface there has triangles that are exactly in planes with each other.
const APART: f64 = 0.01;

/// How far a vertex that snaps onto a cut goes on towards the middle of the cuts around it, and for the same reason: three such
/// vertices whose edges lie in one plane of the lattice are a triangle in it.
const ASIDE: f64 = 1e-3;

/// What becomes of a vertex with cuts too close to it.
enum Decision {
    /// It takes the place of an edge's cut.
    Snaps(u32),
    /// It stays, or steps aside from the boundary of a material, and what is still too close moves away.
    Stays(Option<Aside>),
}

impl Near {
    /// Snaps vertices onto close cuts, or moves the cuts away, until no cut is too close. Rounds take
    /// vertices that have no undecided neighbour of higher priority; what is decided depends on
    /// neighbours alone, so the result is that of a fixed order.
    pub(super) fn snap(&mut self, probe: &Probe<'_>) -> Counts {
        let priority = self.priorities();
        let mut waiting: Vec<u32> = parallel::flat_map(self.samples.len(), |v| {
            let v = v as u32;
            self.violated(v).next().map(|_| v)
        });
        let mut open = vec![false; self.samples.len()];
        for &v in &waiting {
            open[v as usize] = true;
        }
        let mut counts = Counts::default();
        while !waiting.is_empty() {
            // Of those that wait, no two that are decided now stand in one tetrahedron.
            let comes_first = |v: u32, w: u32| {
                w == v || !open[w as usize] || priority[w as usize] < priority[v as usize]
            };
            let decided: Vec<(u32, Decision)> = parallel::flat_map(waiting.len(), |i| {
                let v = waiting[i];
                let mut tets = self
                    .around
                    .list(v as usize)
                    .iter()
                    .map(|&t| self.tets[t as usize]);
                let first = tets.all(|t| t.iter().all(|&w| comes_first(v, w)));
                first.then(|| match self.safe_target(v) {
                    Some(e) => (v, Decision::Snaps(e)),
                    None => (v, Decision::Stays(self.aside(probe, v))),
                })
            });
            for (v, decision) in decided {
                open[v as usize] = false;
                match decision {
                    Decision::Snaps(e) => {
                        self.snap_to(v, e);
                        counts.snapped += 1;
                    }
                    Decision::Stays(aside) => {
                        if let Some(aside) = aside {
                            self.step_aside(v, aside);
                        }
                        counts.clamped += usize::from(self.push_cuts_away(v));
                    }
                }
            }
            waiting.retain(|&v| open[v as usize]);
        }
        counts
    }

    /// They follow from the place among the values (twice the coordinates are whole numbers), so that what else is
    /// meshed does not matter: first by four colours that no two neighbours among finest cells share (corners and
    /// middles, each like the fields of a chessboard), so that a vertex depends on what is four steps away at most;
    /// between larger cells scattered, which makes few rounds.
    fn priorities(&self) -> Vec<u64> {
        self.samples
            .iter()
            .map(|s| {
                let place =
                    [0, 1, 2].map(|k| (2.0 * s.x[k]) as i64 - 2 * i64::from(self.anchor[k]));
                let key = (place.iter()).fold(0u64, |key, &p| key << 20 | (p as u64 & 0xf_ffff));
                let fields = place.iter().map(|p| p >> 1).sum::<i64>() & 1;
                let colour = (place[0] & 1) << 1 | fields;
                (colour as u64) << 62 | key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 2
            })
            .collect()
    }

    /// The edge whose cut is closest to `v`, relative to what is too close, and may take it.
    fn safe_target(&self, v: u32) -> Option<u32> {
        self.violated(v)
            .filter(|&(e, _)| {
                let fits = || !self.is_by_moved(v) || self.keeps_volumes(v, &self.place_at(e, v));
                self.is_safe(v, self.other(e, v)) && fits()
            })
            .min_by(|x, y| x.1.total_cmp(&y.1))
            .map(|(e, _)| e)
    }

    /// Moves a vertex to the cut of an edge. All edges from it to other labels lose their cuts by that:
    /// [`Near::violated`] no longer counts them.
    fn snap_to(&mut self, v: u32, edge: u32) {
        let w = self.other(edge, v);
        self.samples[v as usize].x = self.place_at(edge, v);
        self.zero[v as usize] = Some(pair(self.label(v), self.label(w)));
    }

    /// The place that a vertex takes at the cut of an edge. In the plane of the box, and on the boundary of a material, which
    /// may be plane, the cut itself.
    fn place_at(&self, edge: u32, v: u32) -> Point3 {
        let cut = self.cut_point(edge, v);
        if self.planes[v as usize] != 0 || self.is_of_materials(edge) {
            return cut;
        }
        // One of them is the edge itself.
        let edges = self.edges_at.list(v as usize).iter();
        let cuts = edges.filter(|&&e| self.zero[self.other(e, v) as usize].is_none());
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for &e in cuts {
            sum += self.cut_point(e, v) - cut;
            count += 1.0;
        }
        cut + (sum * (ASIDE / count)).map(exact)
    }

    /// The cut of an edge, as seen from its end `v`.
    fn cut_point(&self, edge: u32, v: u32) -> Point3 {
        let [from, to] = [v, self.other(edge, v)].map(|v| self.samples[v as usize].x);
        along(from, to, self.from(edge, v))
    }

    /// Moves the cuts that are too close to `v` to where they may stay. Returns whether there were any.
    /// Those of materials stay where `v` has stepped aside far enough.
    fn push_cuts_away(&mut self, v: u32) -> bool {
        let stays = |e: u32, ratio: f64| ratio >= ROOM && self.is_of_materials(e);
        let close = self.violated(v).filter(|&(e, ratio)| !stays(e, ratio));
        let close: Vec<(u32, f64)> = close.collect();
        for &(e, ratio) in &close {
            let share = self.limit(e) * (1.0 + APART * ratio);
            self.cuts[e as usize] = self.turned(e, v, share);
        }
        !close.is_empty()
    }

    /// May `v` become a point of the interface towards `w`? The interface around it is then a disk: seen from
    /// `v`, the rest of its neighbours falls into one connected part on either side.
    fn is_safe(&self, v: u32, w: u32) -> bool {
        // On the box only along it.
        let planes = self.planes[v as usize];
        if planes & !self.planes[w as usize] != 0 {
            return false;
        }
        let Some(link) = Link::new(self, v, pair(self.label(v), self.label(w))) else {
            return false;
        };
        // The link's vertices of each sign are connected; so are, on the box, those of its rim.
        let rim = |a: u8, b: u8| {
            let [a, b] = [a, b].map(|c| self.planes[link.vertices[c as usize] as usize]);
            planes & a & b != 0
        };
        (planes == 0 || link.each_sign_connected(rim))
            && link.each_sign_connected(|_, _| true)
            && link.has_one_arc_per_sign()
    }
}

/// The link of a vertex: the triangles opposite it in the tetrahedra around, each of their corners on one side of
/// an interface or on it.
struct Link {
    vertices: [u32; LINK],
    /// −1 and 1 on the two sides, 0 on the interface.
    sign: [i8; LINK],
    len: usize,
    triangles: [[u8; 3]; 2 * LINK],
    triangle_len: usize,
}

impl Link {
    /// `None` if `v` must stay: another label or interface is near, a tetrahedron would lie on the interface as a
    /// whole, or there are too many neighbours.
    fn new(near: &Near, v: u32, parted: Pair) -> Option<Self> {
        let mut out = Self {
            vertices: [NONE; LINK],
            sign: [0; LINK],
            len: 0,
            triangles: [[0; 3]; 2 * LINK],
            triangle_len: 0,
        };
        for &t in near.around.list(v as usize) {
            if out.triangle_len == out.triangles.len() {
                return None;
            }
            let mut triangle = [0; 3];
            let others = near.tets[t as usize].into_iter().filter(|&u| u != v);
            for (corner, u) in triangle.iter_mut().zip(others) {
                *corner = out.number(near, u, parted)?;
            }
            if triangle.iter().all(|&c| out.sign[c as usize] == 0) {
                return None;
            }
            out.triangles[out.triangle_len] = triangle;
            out.triangle_len += 1;
        }
        Some(out)
    }

    /// The number of a neighbour, new or not.
    fn number(&mut self, near: &Near, u: u32, parted: Pair) -> Option<u8> {
        let n = self.len;
        if let Some(at) = self.vertices[..n].iter().position(|&l| l == u) {
            return Some(at as u8);
        }
        if n == LINK {
            return None;
        }
        self.sign[n] = match near.zero[u as usize] {
            Some(p) if p != parted => return None,
            Some(_) => 0,
            None if near.label(u) == parted.0 => -1,
            None if near.label(u) == parted.1 => 1,
            None => return None,
        };
        self.vertices[n] = u;
        self.len += 1;
        Some(n as u8)
    }

    /// One for each tetrahedron around the vertex.
    fn triangles(&self) -> &[[u8; 3]] {
        &self.triangles[..self.triangle_len]
    }

    /// Are there vertices of both signs at the edges that are taken, and are those of each sign connected by
    /// them?
    fn each_sign_connected(&self, takes: impl Fn(u8, u8) -> bool) -> bool {
        let mut group: [u8; LINK] = std::array::from_fn(|i| i as u8);
        let mut used = [false; LINK];
        for t in self.triangles() {
            for (mut a, mut b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                if !takes(a, b) {
                    continue;
                }
                (used[a as usize], used[b as usize]) = (true, true);
                if self.sign[a as usize] == self.sign[b as usize] {
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
            let is_root = |i: &usize| used[*i] && self.sign[*i] == s && group[*i] as usize == *i;
            (0..self.len).filter(is_root).count() == 1
        })
    }

    /// Around the edge to each neighbour on the interface, has each sign at most one arc? Else the interface would
    /// pass that edge twice.
    fn has_one_arc_per_sign(&self) -> bool {
        let on_interface = (0..self.len).filter(|&i| self.sign[i] == 0);
        on_interface
            .flat_map(|i| [(i as u8, 1), (i as u8, -1)])
            .all(|(i, sign)| self.arcs(i, sign) <= 1)
    }

    /// Arcs of a sign around the edge to neighbour `i`: its vertices in the edge's link, less the link's edges
    /// between them. (A full circle counts as none.)
    fn arcs(&self, i: u8, sign: i8) -> i64 {
        let (mut vertices, mut edges) = (0u64, 0);
        for t in self.triangles().iter().filter(|t| t.contains(&i)) {
            let mut both = true;
            for &c in t.iter().filter(|&&c| c != i) {
                if self.sign[c as usize] == sign {
                    vertices |= 1 << c;
                } else {
                    both = false;
                }
            }
            edges += i64::from(both);
        }
        i64::from(vertices.count_ones()) - edges
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;

    /// The link of a vertex like an octahedron: poles 0 and 5, and 1 to 4 around them.
    fn octahedron(signs: [i8; 6]) -> Link {
        let mut out = Link {
            vertices: [NONE; LINK],
            sign: [0; LINK],
            len: 6,
            triangles: [[0; 3]; 2 * LINK],
            triangle_len: 8,
        };
        out.sign[..6].copy_from_slice(&signs);
        for i in 0..4u8 {
            let (a, b) = (1 + i, 1 + (i + 1) % 4);
            out.triangles[2 * usize::from(i)] = [0, a, b];
            out.triangles[2 * usize::from(i) + 1] = [5, b, a];
        }
        out
    }

    /// The neighbour at pole 0 is on the interface. Around the edge to it one sign has two arcs where its vertices
    /// 1 and 3 are parted by another point of the interface and one of the other sign, though they connect by pole 5.
    pub fn an_interface_that_would_pass_an_edge_twice_is_seen() {
        let pinched = octahedron([0, 1, 0, 1, -1, 1]);
        assert!(pinched.each_sign_connected(|_, _| true));
        assert_eq!([pinched.arcs(0, 1), pinched.arcs(0, -1)], [2, 1]);
        assert!(!pinched.has_one_arc_per_sign());
        let flat = octahedron([0, 1, 1, 1, -1, 1]);
        assert!(flat.each_sign_connected(|_, _| true) && flat.has_one_arc_per_sign());
        let saddle = octahedron([0, 1, -1, 1, -1, 1]);
        assert!(!saddle.each_sign_connected(|_, _| true));
    }
}
