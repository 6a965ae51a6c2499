//! Vertices snap onto close cuts.

use rayon::prelude::*;

use super::near::{NONE, Near, pair};

/// Share of an edge within which a cut is too close: between points of one kind, and between a corner
/// and a cell (Labelle & Shewchuk, uniform and one-sided).
const LONG: f64 = 0.249_99;
const SHORT: f64 = 0.411_89;
/// Most neighbours of a vertex that may snap; no octree has more than 50.
const LINK: usize = 64;

/// What the mesher did.
#[derive(Default)]
pub(super) struct Counts {
    /// Vertices snapped onto the interface.
    pub(super) snapped: usize,
    /// Vertices kept, because snapping would have pinched the interface; their cuts moved away.
    pub(super) refused: usize,
}

impl Near {
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
    pub(super) fn snap(&mut self) -> Counts {
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
}
