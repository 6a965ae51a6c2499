//! A map with all regular vertices taken out: triangles between singular vertices and corners, whose sides are integer
//! sums of the integers of the map alone.

use std::collections::BTreeMap;

use super::upright::Upright;
use crate::field::CrossField;
use crate::field::frames::{Frames, next, previous};
use crate::map::cut::Cut;
use crate::map::transition::{self, Form, Seams, turned};

const NONE: u32 = u32::MAX;
/// Most half-edges around a vertex.
const MOST_AROUND: usize = 256;
/// Triangles with an area below this over their sides squared are flat.
const FLAT: f64 = 1e-9;

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
pub(in crate::map) struct Coarse {
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
    pub(in crate::map) fn of(
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
            left.retain(|&v| !coarse.is_taken_out(v));
            if left.len() == before {
                return None;
            }
        }
        coarse.make_delaunay();
        Some(coarse)
    }

    /// What the integers must be for every triangle to be upright; `None` if a corner is no sum of integers.
    pub(in crate::map) fn upright(&self) -> Option<Upright> {
        let sides = (0..self.alive.len()).filter(|&t| self.alive[t]).map(|t| {
            let [a, b, c] = [0, 1, 2].map(|k| self.place[3 * t + k].exact.as_ref());
            let from_a = |to: &[Form; 2]| {
                let mut side = to.clone();
                add(&mut side, a?, -1);
                Some(side)
            };
            Some([from_a(b?)?, from_a(c?)?])
        });
        Some(Upright::new(&sides.collect::<Option<Vec<_>>>()?))
    }

    /// Flips edges until the sum of the angles opposite each is at most a half turn (Delaunay): no triangle is flatter than
    /// it must be, and has to stay upright less strictly.
    fn make_delaunay(&mut self) {
        let most = 20 * self.alive.iter().filter(|&&a| a).count();
        for _ in 0..most {
            let is_next = |&h: &usize| self.alive[h / 3] && self.is_too_long(h);
            let Some(h) = (0..self.from.len()).find(is_next) else {
                return;
            };
            self.flip(h);
        }
    }

    fn is_too_long(&self, h: usize) -> bool {
        let Some(ring) = self.diamond(h) else {
            return false;
        };
        let [a, d, b, c] = ring.map(|p| p.at);
        let cotangent = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
            let (u, v) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
            (u[0] * v[0] + u[1] * v[1]) / (u[0] * v[1] - u[1] * v[0])
        };
        // Not Delaunay, hence convex.
        cotangent(c, a, b) + cotangent(d, b, a) < -1e-6
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

    /// Takes a flat vertex out, after as many flips of its edges as that needs.
    fn is_taken_out(&mut self, v: u32) -> bool {
        loop {
            if self.take_out(v).is_some() {
                return true;
            }
            if self.loosen(v).is_none() {
                return false;
            }
        }
    }

    /// Takes a flat vertex out; `None` if its star is no simple polygon.
    fn take_out(&mut self, v: u32) -> Option<()> {
        let star = self.star(v)?;
        let ring = self.ring(&star)?;
        let ears = ears(&ring.iter().map(|p| p.at).collect::<Vec<_>>())?;
        let polygon = self.around(&star);
        self.out[v as usize] = NONE;
        self.fill(&polygon, &ring, &ears);
        Some(())
    }

    /// Flips the edge that frees a vertex of most of its edges, loops above all; `None` if none does. A flat vertex loses all
    /// but three that way (Sharp, Soliman and Crane, *Navigating intrinsic triangulations*, 2019).
    fn loosen(&mut self, v: u32) -> Option<()> {
        let mut best: Option<(usize, usize)> = None;
        let first = self.out[v as usize] as usize;
        let mut h = first;
        for _ in 0..MOST_AROUND {
            if let Some(freed) = self.freed(h, v)
                && best.is_none_or(|b| freed > b.0)
            {
                best = Some((freed, h));
            }
            let over = previous(h);
            if self.twin[over] == NONE || self.twin[over] as usize == first {
                break;
            }
            h = self.twin[over] as usize;
        }
        self.flip(best?.1);
        Some(())
    }

    /// How many ends of edges fewer a vertex has when an edge is flipped; `None` if not fewer, or the edge cannot be
    /// flipped.
    fn freed(&self, h: usize, v: u32) -> Option<usize> {
        let ring = self.diamond(h)?;
        let t = self.twin[h] as usize;
        let ends = |edges: [usize; 2]| edges.iter().filter(|&&e| self.from[e] == v).count();
        let (now, then) = (ends([h, t]), ends([previous(h), previous(t)]));
        let [a, d, b, c] = ring.map(|p| p.at);
        let scale = [a, d, b, c]
            .windows(2)
            .map(|w| (w[0][0] - w[1][0]).powi(2) + (w[0][1] - w[1][1]).powi(2))
            .sum::<f64>();
        let convex = signed_area(a, d, c) > FLAT * scale && signed_area(d, b, c) > FLAT * scale;
        (convex && then < now).then(|| now - then)
    }

    /// The corners of both triangles at an edge in the chart of the half-edge's: from its start counter-clockwise.
    fn diamond(&self, h: usize) -> Option<[Place; 4]> {
        if self.twin[h] == NONE || self.twin[h] as usize / 3 == h / 3 {
            return None;
        }
        let beyond = inverse(&self.link[h]).apply(&self.place[previous(self.twin[h] as usize)]);
        let own = |h: usize| self.place[h].clone();
        Some([own(h), beyond, own(next(h)), own(previous(h))])
    }

    fn flip(&mut self, h: usize) {
        let Some(ring) = self.diamond(h) else {
            return;
        };
        let t = self.twin[h] as usize;
        let back = inverse(&self.link[h]);
        let outer = [next(t), previous(t), next(h), previous(h)];
        let polygon = Polygon {
            vertices: outer.iter().map(|&o| self.from[o]).collect(),
            outer: outer.map(Some).to_vec(),
            home: vec![back.clone(), back, Link::default(), Link::default()],
            slots: vec![h / 3, t / 3],
        };
        self.fill(&polygon, &ring, &[[0, 1, 3], [1, 2, 3]]);
    }

    /// The half-edges out of a vertex, counter-clockwise, each with what leads from its chart to the first.
    fn star(&self, v: u32) -> Option<Star> {
        let first = self.out[v as usize] as usize;
        let mut star = Star {
            out: Vec::new(),
            home: Vec::new(),
            closed: true,
        };
        let (mut h, mut home) = (first, Link::default());
        loop {
            if star.out.len() > MOST_AROUND
                || self.from[next(h)] == v
                || self.from[previous(h)] == v
            {
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

    /// The polygon that a star fills.
    fn around(&self, star: &Star) -> Polygon {
        let mut polygon = Polygon {
            outer: star.out.iter().map(|&h| Some(next(h))).collect(),
            home: star.home.clone(),
            vertices: star.out.iter().map(|&h| self.from[next(h)]).collect(),
            slots: star.out.iter().map(|h| h / 3).collect(),
        };
        if !star.closed {
            let last = star.out[star.out.len() - 1];
            polygon.outer.push(None);
            polygon.home.push(Link::default());
            polygon.vertices.push(self.from[previous(last)]);
        }
        polygon
    }

    /// Puts the triangles of a polygon in place of those that filled it.
    fn fill(&mut self, polygon: &Polygon, ring: &[Place], ears: &[[usize; 3]]) {
        let Polygon {
            outer,
            home,
            vertices,
            slots,
        } = polygon;
        let count = ring.len();
        let old: Vec<(u32, Link)> = outer
            .iter()
            .map(|o| match o {
                Some(o) => (self.twin[*o], self.link[*o].clone()),
                None => (NONE, Link::default()),
            })
            .collect();
        for &slot in slots {
            self.alive[slot] = false;
        }
        let mut side: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for (ear, &slot) in ears.iter().zip(slots) {
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
            let from_here = inverse(&home[k]).then(link);
            match place_of(*twin as usize) {
                // Glued to another side of the same polygon.
                Some(j) => {
                    self.twin[h] = side[&(j, (j + 1) % count)] as u32;
                    self.link[h] = from_here.then(&home[j]);
                }
                None => {
                    self.twin[h] = *twin;
                    self.twin[*twin as usize] = h as u32;
                    self.link[*twin as usize] = inverse(&from_here);
                    self.link[h] = from_here;
                }
            }
        }
        for &h in side.values() {
            self.out[self.from[h] as usize] = h as u32;
        }
        // On a boundary the fan begins at it.
        for &h in side.values().filter(|&&h| self.twin[h] == NONE) {
            self.out[self.from[h] as usize] = h as u32;
        }
        self.restore_rims(vertices);
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

/// Triangles about to be replaced by others.
struct Polygon {
    /// Per side the half-edge of the triangle inside, counter-clockwise; none along a boundary.
    outer: Vec<Option<usize>>,
    /// What leads from the chart of each to that of the polygon.
    home: Vec<Link>,
    vertices: Vec<u32>,
    /// The triangles.
    slots: Vec<usize>,
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
        transition::add(form, other, factor);
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
            (empty && area > FLAT * size).then_some(area / size)
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
