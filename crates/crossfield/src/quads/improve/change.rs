//! Other quads in place of some: local operations on the connectivity.
//!
//! An edge turns within the two quads that it divides; a quad closes along a diagonal, whose ends become one vertex, or opens
//! between two sides of a vertex, which become two; the sides of a vertex turn on to the far corners of its quads (Daniels,
//! Silva, Shepherd and Cohen, *Quadrilateral mesh simplification*, 2008; Tarini et al., *Practical quad mesh simplification*,
//! 2010). All of them keep the rim of what they change, so the topology of the surface, and none takes away a side along a
//! line that is kept.

use std::collections::BTreeMap;

use geom_core::{Point3, Vector3};

/// Fewest and most quads around a vertex inside.
const VALENCES: [usize; 2] = [3, 6];

/// Some quads of a mesh, with vertices of their own numbers.
#[derive(Clone)]
pub(super) struct Patch {
    pub(super) quads: Vec<[u32; 4]>,
    pub(super) positions: Vec<Point3>,
    /// Do all quads around the vertex belong to the patch?
    pub(super) inner: Vec<bool>,
    /// Is the vertex on no line or boundary?
    pub(super) free: Vec<bool>,
    /// Quads around the vertex that are not of the patch.
    pub(super) outside: Vec<usize>,
}

/// The sides of a vertex that is inside, counter-clockwise, and the far corner of the quad between each and the next.
struct Star {
    sides: Vec<u32>,
    corners: Vec<u32>,
    quads: Vec<usize>,
}

impl Patch {
    /// The quad to the left of each directed side.
    fn sides(&self) -> BTreeMap<(u32, u32), usize> {
        let of = |(q, quad): (usize, &[u32; 4])| {
            let quad = *quad;
            (0..4).map(move |k| ((quad[k], quad[(k + 1) % 4]), q))
        };
        self.quads.iter().enumerate().flat_map(of).collect()
    }

    /// A quad, beginning at one of its corners.
    fn from(&self, q: usize, v: u32) -> [u32; 4] {
        let mut quad = self.quads[q];
        let k = quad.iter().position(|&c| c == v).unwrap_or(0);
        quad.rotate_left(k);
        quad
    }

    fn star(&self, sides: &BTreeMap<(u32, u32), usize>, v: u32) -> Option<Star> {
        if !self.inner[v as usize] || !self.free[v as usize] {
            return None;
        }
        let first = self.quads.iter().position(|q| q.contains(&v))?;
        let mut star = Star {
            sides: Vec::new(),
            corners: Vec::new(),
            quads: Vec::new(),
        };
        let mut q = first;
        loop {
            let [_, side, corner, last] = self.from(q, v);
            star.sides.push(side);
            star.corners.push(corner);
            star.quads.push(q);
            q = *sides.get(&(v, last))?;
            if q == first {
                return Some(star);
            }
            if star.quads.len() > self.quads.len() {
                return None;
            }
        }
    }

    /// How many quads are around each vertex.
    fn valences(&self) -> Vec<usize> {
        let mut count = self.outside.clone();
        for &v in self.quads.as_flattened() {
            count[v as usize] += 1;
        }
        count
    }

    /// How far the vertices inside are from four quads.
    pub(super) fn irregularity(&self) -> usize {
        let all = self.valences().into_iter().zip(&self.free);
        let inside = all.filter(|(n, free)| **free && *n > 0);
        inside.map(|(n, _)| n.abs_diff(4).pow(2)).sum()
    }

    /// Patches that one operation on a quad, or on one that touches it, makes of this one.
    pub(super) fn changes(&self, quad: usize) -> Vec<Patch> {
        let sides = self.sides();
        let corners = self.quads[quad];
        let touches = |q: &usize| self.quads[*q].iter().any(|v| corners.contains(v));
        let near: Vec<usize> = (0..self.quads.len()).filter(touches).collect();
        let mut made = Vec::new();
        for (&(a, b), &q) in sides.iter().filter(|s| s.0.0 < s.0.1) {
            let Some(&other) = sides.get(&(b, a)) else {
                continue;
            };
            let kept = !self.free[a as usize] && !self.free[b as usize];
            if !kept && (corners.contains(&a) || corners.contains(&b)) {
                made.extend(self.turned([a, b], [q, other]));
            }
        }
        for &q in &near {
            made.extend([0, 1].into_iter().filter_map(|k| self.closed(q, k)));
        }
        for v in corners {
            let Some(star) = self.star(&sides, v) else {
                continue;
            };
            if star.quads.len() == 2 {
                made.push(self.without(&star));
            } else {
                made.push(self.twisted(v, &star));
                made.extend(self.opened(v, &star));
            }
        }
        made.retain(|p| p.is_sound(self));
        made
    }

    /// No quad or side twice, no quad that meets itself, no vertex of too few or too many quads.
    fn is_sound(&self, before: &Self) -> bool {
        let twice = |quad: &[u32; 4]| (0..4).any(|k| (0..k).any(|l| quad[k] == quad[l]));
        if self.quads.iter().any(twice) || self.sides().len() != 4 * self.quads.len() {
            return false;
        }
        let old = before.valences();
        let fine = |(v, n): (usize, usize)| {
            let was = old.get(v).copied().unwrap_or(4);
            if !self.free[v] {
                return n > 0 || was == 0;
            }
            n == 0 || n == was || (VALENCES[0]..=VALENCES[1].max(was)).contains(&n)
        };
        self.valences().into_iter().enumerate().all(fine)
    }

    fn with(&self, gone: &[usize], new: impl IntoIterator<Item = [u32; 4]>) -> Self {
        let mut made = self.clone();
        let kept = self.quads.iter().enumerate();
        let kept = kept.filter(|(q, _)| !gone.contains(q)).map(|(_, q)| *q);
        made.quads = kept.chain(new).collect();
        made
    }

    /// The edge joins other corners of its two quads.
    fn turned(&self, [a, b]: [u32; 2], [q, other]: [usize; 2]) -> [Self; 2] {
        let [_, _, c, d] = self.from(q, a);
        let [_, _, e, f] = self.from(other, b);
        [
            self.with(&[q, other], [[c, d, a, e], [e, f, b, c]]),
            self.with(&[q, other], [[d, a, e, f], [f, b, c, d]]),
        ]
    }

    /// Two opposite corners of a quad become one vertex.
    fn closed(&self, q: usize, k: usize) -> Option<Self> {
        let [mut kept, mut gone] = [self.quads[q][k], self.quads[q][k + 2]];
        let [on_kept, on_gone] = [kept, gone].map(|v| !self.free[v as usize]);
        let inner = self.inner[kept as usize] && self.inner[gone as usize];
        if !inner || (on_kept && on_gone) {
            return None;
        }
        if on_gone {
            (kept, gone) = (gone, kept);
        }
        let mut made = self.with(&[q], []);
        for v in made.quads.as_flattened_mut() {
            if *v == gone {
                *v = kept;
            }
        }
        if !on_kept && !on_gone {
            let [a, b] = [kept, gone].map(|v| self.positions[v as usize]);
            made.positions[kept as usize] = geom_core::nalgebra::center(&a, &b);
        }
        Some(made)
    }

    /// The sides of a vertex turn on to the next corners.
    fn twisted(&self, v: u32, star: &Star) -> Self {
        let n = star.quads.len();
        let new = (0..n).map(|i| {
            [
                v,
                star.corners[(i + n - 1) % n],
                star.sides[i],
                star.corners[i],
            ]
        });
        self.with(&star.quads, new)
    }

    /// A vertex of two quads goes, and they become one.
    fn without(&self, star: &Star) -> Self {
        let quad = [
            star.sides[0],
            star.corners[0],
            star.sides[1],
            star.corners[1],
        ];
        self.with(&star.quads, [quad])
    }

    /// A new quad between two sides of a vertex, on each side of which at least two of its quads stay.
    fn opened(&self, v: u32, star: &Star) -> Vec<Self> {
        let n = star.quads.len();
        let pairs = (0..n).flat_map(|i| (i + 2..n.min(i + n - 1)).map(move |j| [i, j]));
        let between = |[i, j]: [usize; 2]| {
            let new = self.positions.len() as u32;
            let mut made = self.with(&[], [[v, star.sides[j], new, star.sides[i]]]);
            let there = [&star.quads[j..], &star.quads[..i]].concat();
            for &q in &there {
                for c in made.quads[q].iter_mut().filter(|c| **c == v) {
                    *c = new;
                }
            }
            made.positions[v as usize] = self.middle(&star.quads[i..j]);
            made.positions.push(self.middle(&there));
            made.inner.push(true);
            made.free.push(true);
            made.outside.push(0);
            made
        };
        pairs.map(between).collect()
    }

    /// The mean of the corners of some quads.
    fn middle(&self, quads: &[usize]) -> Point3 {
        let corners = quads.iter().flat_map(|&q| self.quads[q]);
        let sum: Vector3 = corners.map(|v| self.positions[v as usize].coords).sum();
        Point3::from(sum / (4 * quads.len()) as f64)
    }
}
