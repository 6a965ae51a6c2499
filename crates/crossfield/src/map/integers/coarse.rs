//! A map with all regular vertices taken out: triangles between singular vertices and corners, whose sides are integer
//! sums of the integers of the map alone.
//!
//! Whether integers are any good cannot be seen from them: two singular vertices that end on one point, or that change sides,
//! may be joined by a long chain of transitions. In the decimated map it can: each of its few triangles has three corners with
//! integer coordinates in one chart, and is upright or not. If all are, an upright map of all triangles exists, because the
//! decimated triangles are a map themselves. So these are the conditions under which integers are sought.

use geom_core::compute::parallel;

use super::plane::{
    FLAT, Link, Place, add, cross, ears, inverse, minus, opening, rotated, rotated_sums,
    signed_area,
};
use crate::field::CrossField;
use crate::field::frames::{Frames, next, previous};
use crate::map::cut::Cut;
use crate::map::transition::{Seams, Sum};

/// No half-edge: beyond a boundary, or out of a vertex that is gone.
pub(super) const NONE: u32 = u32::MAX;
/// Most half-edges around a vertex.
const MOST_AROUND: usize = 256;
/// Vertices of no more go first: what is left of a plane then has few around each, too.
const FEW_AROUND: usize = 8;
/// Most flips for one vertex.
const MOST_FLIPS: usize = 1000;

/// Triangles that remain of a map (Coudert-Osmont et al., *Quad mesh quantization without a T-mesh*, 2024: the integers of a
/// seamless map are right when they leave the triangles of a decimated map upright). A vertex around which the map is flat is
/// taken out and the polygon around it triangulated anew, in its chart; what is left are cones and corners of the boundary.
pub(super) struct Coarse {
    /// Per half-edge, the vertex it starts from. Half-edges `3 t + k` keep their places: a flip writes two triangles
    /// over two others, and taking out a vertex leaves some not alive.
    pub(super) from: Vec<u32>,
    /// Per half-edge, where its start lies in the chart of its triangle.
    pub(super) place: Vec<Place>,
    /// Per half-edge, the other one of its edge, or [`NONE`]. Decimated triangles may be glued to themselves.
    pub(super) twin: Vec<u32>,
    /// Per half-edge, what leads from the chart of its triangle to that of its twin's; inverse to that of the twin.
    pub(super) link: Vec<Link>,
    /// Per triangle, whether it is one still.
    pub(super) alive: Vec<bool>,
    /// A half-edge out of each vertex.
    /// On a boundary the one along it; [`NONE`] for those taken out.
    pub(super) out: Vec<u32>,
    /// The angle of each half-edge around its vertex, from the first of the whole map.
    /// Radians. Flips do not change it, as the plane around is the same: where a new edge leaves is measured from the
    /// edge before it.
    pub(super) angle: Vec<f64>,
}

impl Coarse {
    /// Of a relaxed map given by its corners; `None` where the map is folded or a regular vertex cannot be taken out.
    ///
    /// `corners` are in units of lines, and need not be integers anywhere. First go vertices of few edges, each with as
    /// many flips as it needs, then those of twice as many, and so on, so that the work stays near proportional to the
    /// triangles; what resists is hidden in a Delaunay triangulation. What is left are the singular vertices and the
    /// corners of the boundary, in a Delaunay triangulation: two triangles for each of them, about.
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
        let stays = |v: usize| field.index[v] != 0 || seams.pinned.contains(&v);
        for v in (0..field.index.len()).filter(|&v| stays(v)) {
            coarse.make_exact(frames, cut, seams, v);
        }
        let mut left: Vec<u32> = (0..field.index.len() as u32)
            .filter(|&v| !stays(v as usize) && coarse.out[v as usize] != NONE)
            .collect();
        // What cannot be taken out now may be when its neighbours are gone.
        let mut most = FEW_AROUND;
        while !left.is_empty() {
            let before = left.len();
            left.retain(|&v| coarse.has_more_than(v, most) || !coarse.is_taken_out(v));
            if left.len() < before {
                continue;
            }
            most *= 2;
            if most > MOST_AROUND {
                coarse.make_delaunay();
                left.retain(|&v| !coarse.is_hidden(v));
                if left.len() == before {
                    return None;
                }
            }
        }
        coarse.make_delaunay();
        coarse.write_out(seams);
        Some(coarse)
    }

    /// Exact parts are sums of integers alone from now on. Before, they are over sums as well: those of many terms would be
    /// added up again and again.
    fn write_out(&mut self, seams: &Seams) {
        let alive: Vec<usize> = (0..self.from.len()).filter(|h| self.alive[h / 3]).collect();
        let all = |sums: &[Sum; 2]| [0, 1].map(|c| seams.written_out(&sums[c]));
        let written = parallel::map_each(&alive, |&h| {
            (
                self.place[h].exact.as_ref().map(all),
                all(&self.link[h].exact),
            )
        });
        for (h, (place, link)) in alive.into_iter().zip(written) {
            (self.place[h].exact, self.link[h].exact) = (place, link);
        }
    }

    /// Flips edges until the sum of the angles opposite each is at most a half turn (Delaunay): no triangle is flatter than
    /// it must be, and has to stay upright less strictly.
    ///
    /// In exact arithmetic flips end by themselves; forty per half-edge bound them all the same, since rounding could let
    /// them go round in circles.
    fn make_delaunay(&mut self) {
        let mut open: Vec<usize> = (0..self.from.len()).filter(|h| self.alive[h / 3]).collect();
        let mut left = 40 * open.len();
        while let Some(h) = open.pop() {
            if left == 0 {
                return;
            }
            if self.is_too_long(h) {
                left -= 1;
                let t = self.twin[h] as usize;
                self.flip(h);
                open.extend([h / 3, t / 3].iter().flat_map(|f| 3 * f..3 * f + 3));
            }
        }
    }

    /// Takes a flat vertex out of a Delaunay triangulation whatever its edges, loops above all: its weight falls, and each edge
    /// that is regular no more is flipped, until the vertex is inside of a triangle (Edelsbrunner and Shah, *Incremental topological
    /// flipping works for regular triangulations*, 1996).
    fn is_hidden(&mut self, v: u32) -> bool {
        for _ in 0..MOST_FLIPS {
            if self.take_out(v).is_some() {
                return true;
            }
            let mut first: Option<(f64, usize)> = None;
            for h in self.edges_at(v) {
                if let Some(height) = self.regular_up_to(h, v)
                    && first.is_none_or(|f| height < f.0)
                {
                    first = Some((height, h));
                }
            }
            match first {
                Some((_, h)) => self.flip(h),
                None => return false,
            }
        }
        false
    }

    fn has_more_than(&self, v: u32, most: usize) -> bool {
        most < MOST_AROUND && self.edges_at(v).len() > most
    }

    /// The half-edges out of a vertex.
    /// Counter-clockwise; an edge from the vertex to itself is there twice. On a boundary from the half-edge along it
    /// on.
    fn edges_at(&self, v: u32) -> Vec<usize> {
        let first = self.out[v as usize] as usize;
        let mut out = vec![first];
        loop {
            let over = previous(out[out.len() - 1]);
            match self.twin[over] {
                NONE => return out,
                h if h as usize == first || out.len() > self.from.len() => return out,
                h => out.push(h as usize),
            }
        }
    }

    /// How far a vertex may be lifted before an edge is not regular any more; `None` if it always is, or cannot be flipped.
    ///
    /// With weights as heights over the plane, an edge is regular if its two triangles, lifted to the paraboloid plus
    /// these heights, are convex from below: the sign of a determinant, linear in the height of v. Where it becomes 0
    /// the edge has to be flipped; the edge with the least such height is the next.
    fn regular_up_to(&self, h: usize, v: u32) -> Option<f64> {
        let ring = self.diamond(h)?;
        let t = self.twin[h] as usize;
        let ends = [self.from[h], self.from[next(h)], self.from[previous(h)]];
        let lifted = |vertex: u32| f64::from(u8::from(vertex == v));
        let [a, d, b, c] = ring.map(|p| p.at);
        let origin = lifted(self.from[previous(t)]);
        let rows = [a, b, c].map(|p| minus(p, d));
        let cofactor = |k: usize| cross(rows[(k + 1) % 3], rows[(k + 2) % 3]);
        let (mut now, mut by) = (0.0, 0.0);
        for k in 0..3 {
            let [x, y] = rows[k];
            now += (x * x + y * y) * cofactor(k);
            by += (lifted(ends[k]) - origin) * cofactor(k);
        }
        let scale = rows.iter().map(|[x, y]| x * x + y * y).sum::<f64>();
        let convex = signed_area(a, d, c) > FLAT * scale && signed_area(d, b, c) > FLAT * scale;
        (convex && by > FLAT * scale).then(|| -now / by)
    }

    /// The sum of the cotangents of the two opposite angles is below 0, that is, their sum is above a half turn.
    fn is_too_long(&self, h: usize) -> bool {
        let Some(ring) = self.diamond(h) else {
            return false;
        };
        let [a, d, b, c] = ring.map(|p| p.at);
        let cotangent = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
            let (u, v) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
            (u[0] * v[0] + u[1] * v[1]) / cross(u, v)
        };
        // Not Delaunay, hence convex.
        cotangent(c, a, b) + cotangent(d, b, a) < -1e-6
    }

    /// All triangles of the map.
    ///
    /// Over edges that are not cut the link is the identity. Over cut ones its shift is the difference of the two
    /// copies of a vertex; the real parts of both are the same vertex's, and cancel.
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
            add(&mut exact, &rotated_sums(&own, (4 - turn) % 4), -1);
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
            angle: signposts(frames, corners),
        }
    }

    /// The coordinates of a singular vertex or corner are integers of the map.
    /// Where one of them is real all the same, the place stays inexact, and there is no decimated map.
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
    /// The star is laid out in one chart, cut into ears, and its triangles replaced; two of them go, or one at a
    /// boundary.
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

    /// Replaces the two triangles of an edge by the other two of their four corners, which must be convex; nothing
    /// happens on a boundary or where a triangle is glued to itself.
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
            base: outer.map(|o| self.angle[o]).to_vec(),
        };
        self.fill(&polygon, &ring, &[[0, 1, 3], [1, 2, 3]]);
    }

    /// The half-edges out of a vertex, counter-clockwise, each with what leads from its chart to the first.
    ///
    /// `None` for a vertex that is joined to itself by an edge, that has too many edges, or around which the map turns.
    fn star(&self, v: u32) -> Option<Star> {
        let first = self.out[v as usize] as usize;
        let mut star = Star {
            out: Vec::with_capacity(FEW_AROUND),
            home: Vec::with_capacity(FEW_AROUND),
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
    /// `None` if it has fewer than three corners.
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
    ///
    /// On a boundary the last side is that which closes the polygon past the vertex: it has no triangle outside, nor
    /// had one.
    fn around(&self, star: &Star) -> Polygon {
        let mut polygon = Polygon {
            outer: star.out.iter().map(|&h| Some(next(h))).collect(),
            home: star.home.clone(),
            vertices: star.out.iter().map(|&h| self.from[next(h)]).collect(),
            slots: star.out.iter().map(|h| h / 3).collect(),
            base: star.out.iter().map(|&h| self.angle[next(h)]).collect(),
        };
        if !star.closed {
            let last = star.out[star.out.len() - 1];
            // Straight on through the vertex that goes.
            polygon.base.push(self.angle[previous(last)]);
            polygon.outer.push(None);
            polygon.home.push(Link::default());
            polygon.vertices.push(self.from[previous(last)]);
        }
        polygon
    }

    /// Puts the triangles of a polygon in place of those that filled it.
    ///
    /// `ears` are triples of corners of the `ring`, at most as many as there are `slots`; slots left over are alive no
    /// more. Sides of the polygon keep their neighbours, with links from the polygon's chart; two sides that were glued
    /// to each other are so again.
    fn fill(&mut self, polygon: &Polygon, ring: &[Place], ears: &[[usize; 3]]) {
        let Polygon {
            outer,
            home,
            vertices,
            slots,
            base,
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
        let mut side: Vec<([usize; 2], usize)> = Vec::with_capacity(3 * ears.len());
        for (ear, &slot) in ears.iter().zip(slots) {
            self.alive[slot] = true;
            for k in 0..3 {
                let h = 3 * slot + k;
                self.from[h] = vertices[ear[k]];
                self.place[h] = ring[ear[k]].clone();
                self.twin[h] = NONE;
                self.link[h] = Link::default();
                let (a, b) = (ear[k], ear[(k + 1) % 3]);
                self.angle[h] = base[a]
                    + if b == (a + 1) % count {
                        0.0
                    } else {
                        let toward = |i: usize| minus(ring[i].at, ring[a].at);
                        opening(toward((a + 1) % count), toward(b))
                    };
                side.push(([a, b], h));
            }
        }
        side.sort_unstable();
        let from_to = |a, b| {
            let at = side.binary_search_by_key(&[a, b], |s| s.0);
            at.ok().map(|at| side[at].1)
        };
        for &([a, b], h) in &side {
            if let Some(other) = from_to(b, a) {
                self.twin[h] = other as u32;
            }
        }
        let on_rim = |k: usize| from_to(k, (k + 1) % count).expect("ears fill the polygon");
        let place_of = |o: usize| outer.iter().position(|&p| p == Some(o));
        for k in 0..count {
            let h = on_rim(k);
            let (twin, link) = &old[k];
            if *twin == NONE {
                continue;
            }
            let from_here = inverse(&home[k]).then(link);
            match place_of(*twin as usize) {
                // Glued to another side of the same polygon.
                Some(j) => {
                    self.twin[h] = on_rim(j) as u32;
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
        for &(_, h) in &side {
            self.out[self.from[h] as usize] = h as u32;
        }
        // On a boundary the fan begins at it.
        for &(_, h) in side.iter().filter(|s| self.twin[s.1] == NONE) {
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
    /// Counter-clockwise.
    out: Vec<usize>,
    /// What leads from the chart of each to that of the first.
    home: Vec<Link>,
    /// Whether it is not cut short by a boundary.
    closed: bool,
}

/// Triangles about to be replaced by others.
struct Polygon {
    /// Per side the half-edge of the triangle inside, counter-clockwise; none along a boundary.
    outer: Vec<Option<usize>>,
    /// What leads from the chart of each to that of the polygon.
    home: Vec<Link>,
    /// The corners, each the first of its side.
    vertices: Vec<u32>,
    /// The triangles.
    slots: Vec<usize>,
    /// The angle of each side around its first vertex.
    base: Vec<f64>,
}

/// The integer terms of a copy's coordinates, by integer or sum of such.
fn integers_of(seams: &Seams, copy: u32) -> [Sum; 2] {
    [0, 1].map(|c| seams.integers_of(copy, c))
}

/// The angle of each half-edge around its vertex, from the first one of the fan.
fn signposts(frames: &Frames, corners: &[[[f64; 2]; 3]]) -> Vec<f64> {
    let mut angle = vec![0.0; frames.edges().len()];
    for v in 0..frames.edges().vertices() {
        let mut sum = 0.0;
        for h in frames.around(v) {
            angle[h] = sum;
            let uv = &corners[h / 3];
            let toward = |k: usize| minus(uv[k % 3], uv[h % 3]);
            sum += opening(toward(next(h)), toward(previous(h)));
        }
    }
    angle
}
