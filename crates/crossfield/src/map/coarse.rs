//! A map with all regular vertices taken out: triangles between singular vertices and corners, whose sides are integer
//! sums of the integers of the map alone.

use std::collections::BTreeMap;

use super::cut::Cut;
use super::transition::{Form, Seams, turned};
use crate::field::CrossField;
use crate::field::frames::{Frames, next, previous};

const NONE: u32 = u32::MAX;

/// A position in a chart: as it is in the relaxed map, and as sums of integers where it is one.
#[derive(Clone, Debug, Default)]
struct Place {
    at: [f64; 2],
    exact: Option<[Form; 2]>,
}

/// `p ↦ R(−90° turn) p + shift`: from one chart to another.
#[derive(Clone, Debug, Default)]
struct Link {
    turn: u8,
    shift: [f64; 2],
    exact: [Form; 2],
}

/// Triangles that remain of a map (Coudert-Osmont et al., *Quad mesh quantization without a T-mesh*, 2024: the integers of a
/// seamless map are right when they leave the triangles of a decimated map upright). A vertex around which the map is flat is
/// taken out and the polygon around it triangulated anew, in its chart; what is left are cones and corners of the boundary.
pub(super) struct Coarse {
    from: Vec<u32>,
    place: Vec<Place>,
    twin: Vec<u32>,
    link: Vec<Link>,
    alive: Vec<bool>,
    /// A half-edge out of each vertex.
    out: Vec<u32>,
}

impl Coarse {
    /// Of a relaxed map given by its corners; `None` where the map is folded or a regular vertex cannot be taken out.
    pub(super) fn of(
        frames: &Frames,
        field: &CrossField,
        cut: &Cut,
        seams: &Seams,
        corners: &[[[f64; 2]; 3]],
    ) -> Option<Self> {
        if corners
            .iter()
            .any(|uv| signed_area(uv[0], uv[1], uv[2]) <= 0.0)
        {
            return None;
        }
        let mut coarse = Self::fine(frames, cut, seams, corners);
        for h in 0..coarse.from.len() {
            if coarse.out[coarse.from[h] as usize] == NONE || coarse.twin[h] == NONE {
                coarse.out[coarse.from[h] as usize] = h as u32;
            }
        }
        for v in (0..field.index.len()).filter(|&v| field.index[v] != 0) {
            coarse.make_exact(frames, cut, seams, v);
        }
        let mut left: Vec<u32> = (0..field.index.len() as u32)
            .filter(|&v| field.index[v as usize] == 0 && coarse.out[v as usize] != NONE)
            .collect();
        // What cannot be taken out now may be when its neighbours are gone.
        while !left.is_empty() {
            let before = left.len();
            left.retain(|&v| coarse.take_out(v).is_none());
            if left.len() == before {
                return None;
            }
        }
        Some(coarse)
    }

    /// Are all triangles upright with these integers?
    pub(super) fn is_upright(&self, integers: &[f64]) -> bool {
        let value = |form: &Form| -> i64 {
            form.iter()
                .map(|(&k, &c)| c * integers[k as usize].round() as i64)
                .sum()
        };
        (0..self.alive.len()).filter(|&t| self.alive[t]).all(|t| {
            let [a, b, c] = [0, 1, 2].map(|k| {
                let exact = self.place[3 * t + k].exact.as_ref();
                exact.map(|form| [value(&form[0]), value(&form[1])])
            });
            match (a, b, c) {
                (Some(a), Some(b), Some(c)) => {
                    let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
                    i128::from(u[0]) * i128::from(v[1]) > i128::from(u[1]) * i128::from(v[0])
                }
                _ => false,
            }
        })
    }

    /// All triangles of the map.
    fn fine(frames: &Frames, cut: &Cut, seams: &Seams, corners: &[[[f64; 2]; 3]]) -> Self {
        let count = frames.edges().len();
        let link = |h: usize| {
            let Some(t) = frames.twin(h).filter(|_| cut.is_cut[h]) else {
                return Link::default();
            };
            let turn = cut.turn[h];
            let (here, there) = (h, next(t));
            let moved = rotated(corners[here / 3][here % 3], (4 - turn) % 4);
            let at = corners[there / 3][there % 3];
            let own = integers_of(seams, cut.copy[here]);
            let mut exact = integers_of(seams, cut.copy[there]);
            add(&mut exact, &rotated_form(&own, (4 - turn) % 4), -1);
            // What is real in both cancels.
            Link {
                turn,
                shift: [at[0] - moved[0], at[1] - moved[1]],
                exact,
            }
        };
        Self {
            from: (0..count).map(|h| frames.from(h) as u32).collect(),
            place: (0..count)
                .map(|h| Place {
                    at: corners[h / 3][h % 3],
                    exact: None,
                })
                .collect(),
            twin: frames.edges().twins().to_vec(),
            link: (0..count).map(link).collect(),
            alive: vec![true; frames.faces()],
            out: vec![NONE; frames.edges().vertices()],
        }
    }

    /// The coordinates of a singular vertex or corner are integers of the map.
    fn make_exact(&mut self, frames: &Frames, cut: &Cut, seams: &Seams, v: usize) {
        for h in frames.around(v) {
            let real = [0, 1]
                .iter()
                .any(|&c| seams.row(cut.copy[h], c).any(|(k, _)| k < seams.reals));
            self.place[h].exact = (!real).then(|| integers_of(seams, cut.copy[h]));
        }
    }

    /// Takes a flat vertex out; `None` if its star is no simple polygon.
    fn take_out(&mut self, v: u32) -> Option<()> {
        let star = self.star(v)?;
        let ring = self.ring(&star)?;
        let ears = ears(&ring.iter().map(|p| p.at).collect::<Vec<_>>())?;
        self.fill(v, &star, &ring, &ears);
        Some(())
    }

    /// The half-edges out of a vertex, counter-clockwise, each with what leads from its chart to the first.
    fn star(&self, v: u32) -> Option<Star> {
        const MOST: usize = 256;
        let first = self.out[v as usize] as usize;
        let mut star = Star {
            out: Vec::new(),
            home: Vec::new(),
            closed: true,
        };
        let (mut h, mut home) = (first, Link::default());
        loop {
            if star.out.len() > MOST || self.from[next(h)] == v || self.from[previous(h)] == v {
                return None;
            }
            star.out.push(h);
            star.home.push(home.clone());
            let over = previous(h);
            if self.twin[over] == NONE {
                star.closed = false;
                break;
            }
            home = inverse(&self.link[over]).then(&home);
            h = self.twin[over] as usize;
            if h == first {
                break;
            }
        }
        // A closed star comes home unturned.
        (!star.closed || home.turn == 0).then_some(star)
    }

    /// The polygon around a star, in the chart of its first triangle.
    fn ring(&self, star: &Star) -> Option<Vec<Place>> {
        let mut ring: Vec<Place> = star
            .out
            .iter()
            .zip(&star.home)
            .map(|(&h, home)| home.apply(&self.place[next(h)]))
            .collect();
        if !star.closed {
            let last = star.out.len() - 1;
            ring.push(star.home[last].apply(&self.place[previous(star.out[last])]));
        }
        (ring.len() >= 3).then_some(ring)
    }

    /// Puts the triangles of a polygon in place of a star.
    fn fill(&mut self, v: u32, star: &Star, ring: &[Place], ears: &[[usize; 3]]) {
        let count = ring.len();
        let vertices: Vec<u32> = (0..count)
            .map(|k| match star.out.get(k) {
                Some(&h) => self.from[next(h)],
                None => self.from[previous(star.out[k - 1])],
            })
            .collect();
        // The sides of the polygon as they were: outer half-edge k runs from point k to the next.
        let outer: Vec<Option<usize>> = (0..count)
            .map(|k| star.out.get(k).map(|&h| next(h)))
            .collect();
        let old: Vec<(u32, Link)> = outer
            .iter()
            .map(|o| match o {
                Some(o) => (self.twin[*o], self.link[*o].clone()),
                None => (NONE, Link::default()),
            })
            .collect();
        let slots: Vec<usize> = star.out.iter().map(|h| h / 3).collect();
        for &slot in &slots {
            self.alive[slot] = false;
        }
        let mut side: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for (ear, &slot) in ears.iter().zip(&slots) {
            self.alive[slot] = true;
            for k in 0..3 {
                let h = 3 * slot + k;
                self.from[h] = vertices[ear[k]];
                self.place[h] = ring[ear[k]].clone();
                self.twin[h] = NONE;
                self.link[h] = Link::default();
                side.insert((ear[k], ear[(k + 1) % 3]), h);
            }
        }
        for (&(a, b), &h) in &side {
            if let Some(&other) = side.get(&(b, a)) {
                self.twin[h] = other as u32;
            }
        }
        let place_of = |o: usize| outer.iter().position(|&p| p == Some(o));
        for k in 0..count {
            let h = side[&(k, (k + 1) % count)];
            let (twin, link) = &old[k];
            if *twin == NONE {
                continue;
            }
            let from_here = inverse(&star.home[k]).then(link);
            match place_of(*twin as usize) {
                // Glued to another side of the same polygon.
                Some(j) => {
                    self.twin[h] = side[&(j, (j + 1) % count)] as u32;
                    self.link[h] = from_here.then(&star.home[j]);
                }
                None => {
                    self.twin[h] = *twin;
                    self.twin[*twin as usize] = h as u32;
                    self.link[*twin as usize] = inverse(&from_here);
                    self.link[h] = from_here;
                }
            }
        }
        self.out[v as usize] = NONE;
        for &h in side.values() {
            self.out[self.from[h] as usize] = h as u32;
        }
        // On a boundary the fan begins at it.
        for &h in side.values().filter(|&&h| self.twin[h] == NONE) {
            self.out[self.from[h] as usize] = h as u32;
        }
        self.restore_rims(&vertices);
    }

    /// Boundary vertices of a polygon whose boundary half-edge lies outside of it.
    fn restore_rims(&mut self, vertices: &[u32]) {
        for &v in vertices {
            let first = self.out[v as usize];
            let mut h = first;
            // Clockwise to the boundary, if there is one.
            while self.twin[h as usize] != NONE {
                h = next(self.twin[h as usize] as usize) as u32;
                if h == first {
                    break;
                }
            }
            self.out[v as usize] = h;
        }
    }
}

/// A vertex's half-edges and charts.
struct Star {
    out: Vec<usize>,
    home: Vec<Link>,
    closed: bool,
}

impl Link {
    /// This, then `after`.
    fn then(&self, after: &Link) -> Link {
        let moved = rotated(self.shift, (4 - after.turn) % 4);
        let mut exact = rotated_form(&self.exact, (4 - after.turn) % 4);
        add(&mut exact, &after.exact, 1);
        Link {
            turn: (self.turn + after.turn) % 4,
            shift: [moved[0] + after.shift[0], moved[1] + after.shift[1]],
            exact,
        }
    }

    fn apply(&self, place: &Place) -> Place {
        let moved = rotated(place.at, (4 - self.turn) % 4);
        let exact = place.exact.as_ref().map(|form| {
            let mut form = rotated_form(form, (4 - self.turn) % 4);
            add(&mut form, &self.exact, 1);
            form
        });
        Place {
            at: [moved[0] + self.shift[0], moved[1] + self.shift[1]],
            exact,
        }
    }
}

fn inverse(link: &Link) -> Link {
    let back = rotated(link.shift, link.turn);
    let mut exact = [Form::new(), Form::new()];
    add(&mut exact, &rotated_form(&link.exact, link.turn), -1);
    Link {
        turn: (4 - link.turn) % 4,
        shift: [-back[0], -back[1]],
        exact,
    }
}

/// The integer terms of a copy's coordinates, by integer.
fn integers_of(seams: &Seams, copy: u32) -> [Form; 2] {
    [0, 1].map(|c| {
        let terms = seams.row(copy, c).filter(|&(k, _)| k >= seams.reals);
        terms
            .map(|(k, p)| ((k - seams.reals) as u32, i64::from(p)))
            .collect()
    })
}

/// Turned left by quarters.
fn rotated(p: [f64; 2], quarters: u8) -> [f64; 2] {
    [0, 1].map(|c| {
        let (from, sign) = turned(quarters, c);
        sign as f64 * p[from]
    })
}

fn rotated_form(form: &[Form; 2], quarters: u8) -> [Form; 2] {
    [0, 1].map(|c| {
        let (from, sign) = turned(quarters, c);
        form[from].iter().map(|(&k, &v)| (k, sign * v)).collect()
    })
}

fn add(form: &mut [Form; 2], other: &[Form; 2], factor: i64) {
    for (form, other) in form.iter_mut().zip(other) {
        super::transition::add(form, other, factor);
    }
}

fn signed_area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// A triangulation of a simple polygon by cutting off its best ears; `None` if it has none.
fn ears(polygon: &[[f64; 2]]) -> Option<Vec<[usize; 3]>> {
    let mut left: Vec<usize> = (0..polygon.len()).collect();
    let mut out = Vec::new();
    let squared = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
    while left.len() >= 3 {
        let n = left.len();
        let quality = |k: usize| {
            let corner = [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
            let [a, b, c] = corner.map(|i| polygon[i]);
            let area = signed_area(a, b, c);
            let size = squared(a, b) + squared(b, c) + squared(c, a);
            let holds = |i: usize| {
                let p = polygon[i];
                [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|&(s, t)| signed_area(s, t, p) >= 0.0)
            };
            let empty = left.iter().all(|&i| corner.contains(&i) || !holds(i));
            (empty && area > 1e-9 * size).then_some(area / size)
        };
        let best = (0..n)
            .filter_map(|k| quality(k).map(|q| (q, k)))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
        let k = best.1;
        out.push([left[(k + n - 1) % n], left[k], left[(k + 1) % n]]);
        left.remove(k);
    }
    (out.len() + 2 == polygon.len()).then_some(out)
}
