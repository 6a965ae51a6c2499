//! The quads of an integer-grid map: integer points, the lines between them, and the faces the lines go round.

use std::collections::HashMap;

use geom_core::search::bvh::Closest;
use geom_core::{Point3, QuadMesh, TriMesh};

use super::trace::{Paper, Walker};
use crate::Error;
use crate::field::frames::{Frames, next};
use crate::map::exact::{axes_in, cross, dot, minus, rotated, sector};
use crate::map::{GridMap, Laid, MapReport, Net};

const NONE: u32 = u32::MAX;

/// A point of a triangle mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SurfacePoint {
    /// The triangle.
    pub triangle: u32,
    /// Barycentric coordinates in it.
    pub barycentric: [f64; 3],
}

impl SurfacePoint {
    /// The nearest one of another.
    pub(super) fn of(closest: &Closest) -> Self {
        Self {
            triangle: closest.triangle,
            barycentric: closest.barycentric,
        }
    }

    /// Where it is, Å.
    pub fn position(&self, mesh: &TriMesh) -> Point3 {
        let corners = mesh.corners(self.triangle as usize);
        let sum = (0..3)
            .map(|k| corners[k].coords * self.barycentric[k])
            .fold(geom_core::Vector3::zeros(), |a, b| a + b);
        Point3::from(sum)
    }
}

/// Quads and where their vertices lie on the surface, exactly.
#[derive(Clone, Debug, PartialEq)]
pub struct Extracted {
    /// The quads.
    pub mesh: QuadMesh,
    /// A point of the surface per vertex.
    pub sources: Vec<SurfacePoint>,
}

/// The quad mesh of an integer-grid map (Ebke et al., *QEx: robust quad mesh extraction*, 2013, without their repairs: the map is
/// exact): every orbit of lines must be a quad. Vertices lie on the triangles of
/// `mesh`; [`Extracted::sources`] says where, so that values at its corners can be carried over.
///
/// # Errors
/// [`Error::Torn`] where lines do not close to quads, which a map of [`parameterize`](crate::map::parameterize) does not do;
/// that of the mesh where a handle is so narrow that a quad would meet itself: take a smaller spacing there.
pub fn extract(mesh: &TriMesh, frames: &Frames, map: &GridMap) -> Result<Extracted, Error> {
    let (sources, quads) = cells(&Net::of(frames), map, 0)?;
    let positions = sources.iter().map(|p| p.position(mesh)).collect();
    Ok(Extracted {
        mesh: QuadMesh::new(positions, quads)?,
        sources,
    })
}

/// Where vertices lie in the triangles of a map, and the quads that join them.
type Cells = (Vec<SurfacePoint>, Vec<[u32; 4]>);

/// The vertices and quads of a map. Around a handle or neck that is one or two quads wide they are no mesh: a side may
/// return to its vertex, and two have the same ends.
/// With 2^finer lines to each of the map's.
fn cells(net: &Net, map: &GridMap, finer: u8) -> Result<Cells, Error> {
    let finer = u32::from(finer);
    let paper = Paper { net, map, finer };
    let sites = Sites::of(&paper);
    let ports = Ports::of(&paper, &sites);
    let partner = ports.connected(&paper, &sites)?;
    let quads = ports.orbits(&partner)?;
    Ok((sites.points, quads))
}

/// The quads of what came of a field, with the lines between, and where their vertices lie.
pub(super) type Lines = (Vec<SurfacePoint>, Vec<[u32; 4]>, MapReport);

/// The quads of a map and of `2^nested − 1` lines between each two of it.
pub(super) fn lines(laid: &Laid, frames: &Frames, nested: u8) -> Result<Lines, Error> {
    match laid {
        Laid::Whole(map) => {
            let (sources, quads) = cells(&Net::of(frames), map, nested)?;
            Ok((sources, quads, map.report))
        }
        Laid::Decimated(spread, _) | Laid::Vain(spread) => {
            let (points, quads) = cells(spread.net(), &spread.map, nested)?;
            let placed = |p: &SurfacePoint| {
                let face = p.triangle as usize;
                let (triangle, barycentric) =
                    spread
                        .place(frames, face, p.barycentric)
                        .ok_or(Error::Torn {
                            face,
                            why: "a line of the decimated map does not end",
                        })?;
                Ok(SurfacePoint {
                    triangle: triangle as u32,
                    barycentric,
                })
            };
            let sources = points.iter().map(placed).collect::<Result<_, Error>>()?;
            Ok((sources, quads, spread.map.report))
        }
    }
}

/// The vertices of a map's quads where these are no mesh, ascending, and how many quads lie around the surface there: one or
/// two.
pub(super) fn tangled(quads: &[[u32; 4]]) -> Vec<(u32, u8)> {
    let mut tangled = Vec::new();
    let mut sides = Vec::with_capacity(4 * quads.len());
    for quad in quads {
        let mut corners = *quad;
        corners.sort_unstable();
        if corners.windows(2).any(|w| w[0] == w[1]) {
            tangled.extend(corners.map(|v| (v, 1)));
        }
        sides.extend((0..4).map(|k| (quad[k], quad[(k + 1) % 4])));
    }
    sides.sort_unstable();
    for pair in sides.windows(2).filter(|w| w[0] == w[1]) {
        tangled.extend([(pair[0].0, 2), (pair[0].1, 2)]);
    }
    tangled.sort_unstable();
    tangled.dedup_by_key(|t| t.0);
    tangled
}

/// What a vertex of the quad mesh lies on.
#[derive(Clone, Copy, Debug)]
pub(super) enum Place {
    Vertex(usize),
    /// Inside of an edge, by its lower half-edge, at a point of that half-edge's chart.
    Edge(usize, [i64; 2]),
    Face(usize, [i64; 2]),
}

/// All integer points of the map.
pub(super) struct Sites {
    pub(super) places: Vec<Place>,
    points: Vec<SurfacePoint>,
    /// Per vertex of the net its site, or [`NONE`].
    of_vertex: Vec<u32>,
    /// By the lower half-edge of the edge and the point in its chart.
    on_edge: HashMap<(usize, [i64; 2]), u32>,
    in_face: HashMap<(usize, [i64; 2]), u32>,
}

impl Sites {
    /// Three passes, over vertices, edges and triangles, so that each integer point of the surface is found once,
    /// wherever it lies. The time is that of the triangles and of the integer points in the boxes around them.
    pub(super) fn of(paper: &Paper<'_>) -> Self {
        let mut sites = Self {
            places: Vec::new(),
            points: Vec::new(),
            of_vertex: vec![NONE; paper.net.vertices()],
            on_edge: HashMap::new(),
            in_face: HashMap::new(),
        };
        let unit = paper.unit();
        for v in 0..sites.of_vertex.len() {
            let Some(h) = paper.net.around(v).next() else {
                continue;
            };
            let at = paper.map.corners[h / 3][h % 3];
            if at.iter().all(|x| x % unit == 0) {
                sites.of_vertex[v] = sites.push(Place::Vertex(v), h / 3, |k| f64::from(k == h % 3));
            }
        }
        for h in 0..3 * paper.net.faces() {
            if paper.net.twin(h).is_none_or(|t| h < t) {
                sites.add_edge_points(paper, h);
            }
        }
        for face in 0..paper.net.faces() {
            sites.add_face_points(paper, face);
        }
        sites
    }

    /// Adds a site, with its barycentric coordinates in a triangle, and answers its number.
    fn push(&mut self, place: Place, face: usize, weight: impl Fn(usize) -> f64) -> u32 {
        self.places.push(place);
        self.points.push(SurfacePoint {
            triangle: face as u32,
            barycentric: [0, 1, 2].map(weight),
        });
        (self.places.len() - 1) as u32
    }

    /// Integer points strictly inside of an edge.
    /// Walks along the longer of its two coordinates; the other one has to divide exactly.
    fn add_edge_points(&mut self, paper: &Paper<'_>, h: usize) {
        let uv = &paper.map.corners[h / 3];
        let (a, b) = (uv[h % 3], uv[next(h) % 3]);
        let d = minus(b, a);
        let axis = usize::from(d[1].abs() > d[0].abs());
        let (unit, other) = (paper.unit(), 1 - axis);
        let (low, high) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
        let first = low.div_euclid(unit) + 1;
        for n in first..=(high - 1).div_euclid(unit) {
            let along = i128::from(n * unit - a[axis]);
            let product = along * i128::from(d[other]);
            let length = i128::from(d[axis]);
            if product % length != 0 {
                continue;
            }
            let across = a[other] + (product / length) as i64;
            if across % unit != 0 {
                continue;
            }
            let mut point = [0; 2];
            point[axis] = n * unit;
            point[other] = across;
            let part = along as f64 / length as f64;
            let weight = |k| match k {
                k if k == h % 3 => 1.0 - part,
                k if k == next(h) % 3 => part,
                _ => 0.0,
            };
            let site = self.push(Place::Edge(h, point), h / 3, weight);
            self.on_edge.insert((h, point), site);
        }
    }

    /// Integer points strictly inside of a triangle.
    fn add_face_points(&mut self, paper: &Paper<'_>, face: usize) {
        let uv = paper.map.corners[face];
        let unit = paper.unit();
        let range = |c: usize| {
            let values = uv.map(|p| p[c]);
            let low = values.iter().min().expect("three corners");
            let high = values.iter().max().expect("three corners");
            low.div_euclid(unit) + 1..=(high - 1).div_euclid(unit)
        };
        for i in range(0) {
            for j in range(1) {
                let point = [i * unit, j * unit];
                let areas = [0, 1, 2].map(|k| {
                    let (a, b) = (uv[(k + 1) % 3], uv[(k + 2) % 3]);
                    cross(minus(b, a), minus(point, a))
                });
                if areas.iter().all(|&a| a > 0) {
                    let total: i128 = areas.iter().sum();
                    let site = self.push(Place::Face(face, point), face, |k| {
                        areas[k] as f64 / total as f64
                    });
                    self.in_face.insert((face, point), site);
                }
            }
        }
    }

    /// The site at an integer point of a closed triangle.
    fn at(&self, paper: &Paper<'_>, face: usize, point: [i64; 2]) -> Option<u32> {
        let uv = &paper.map.corners[face];
        if let Some(k) = (0..3).find(|&k| uv[k] == point) {
            let site = self.of_vertex[paper.net.from(3 * face + k)];
            return (site != NONE).then_some(site);
        }
        for h in 3 * face..3 * face + 3 {
            let (a, b) = (uv[h % 3], uv[next(h) % 3]);
            if cross(minus(b, a), minus(point, a)) == 0 {
                let key = match paper.net.twin(h) {
                    Some(t) if t < h => (t, paper.across(h, t, point)),
                    _ => (h, point),
                };
                return self.on_edge.get(&key).copied();
            }
        }
        self.in_face.get(&(face, point)).copied()
    }
}

/// A direction in which a line leaves an integer point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Port {
    pub(super) site: u32,
    pub(super) face: usize,
    /// Quarter turns from +u, in the chart of the triangle.
    pub(super) heading: u8,
    /// The site in the chart of the triangle.
    pub(super) at: [i64; 2],
}

impl Port {
    /// At the start of its line.
    pub(super) fn walker(&self, unit: i64) -> Walker {
        let d = rotated([unit, 0], self.heading);
        Walker {
            face: self.face,
            at: self.at,
            target: [self.at[0] + d[0], self.at[1] + d[1]],
            heading: self.heading,
        }
    }
}

/// The ports of all sites, counter-clockwise around each.
pub(super) struct Ports {
    /// Where the ports of each site begin.
    starts: Vec<usize>,
    /// Counter-clockwise around each site, so that the number before is the next one clockwise.
    pub(super) all: Vec<Port>,
    /// Is the site on the rim, so that its first port has none before it?
    on_rim: Vec<bool>,
}

impl Ports {
    pub(super) fn of(paper: &Paper<'_>, sites: &Sites) -> Self {
        let mut ports = Self {
            starts: vec![0],
            all: Vec::new(),
            on_rim: Vec::new(),
        };
        for (site, place) in sites.places.iter().enumerate() {
            let on_rim = ports.add(paper, site as u32, place);
            ports.on_rim.push(on_rim);
            ports.starts.push(ports.all.len());
        }
        ports
    }

    /// Adds the ports of a site; true if it is on the rim.
    fn add(&mut self, paper: &Paper<'_>, site: u32, place: &Place) -> bool {
        match *place {
            Place::Face(face, at) => {
                self.all.extend((0..4).map(|heading| Port {
                    site,
                    face,
                    heading,
                    at,
                }));
                false
            }
            Place::Edge(h, at) => {
                let twin = paper.net.twin(h);
                self.add_half_turn(paper, site, h, at, twin.is_none());
                if let Some(twin) = twin {
                    self.add_half_turn(paper, site, twin, paper.across(h, twin, at), false);
                }
                twin.is_none()
            }
            Place::Vertex(v) => {
                let fan: Vec<usize> = paper.net.around(v).collect();
                let on_rim = paper.net.on_boundary(v);
                for (i, &h) in fan.iter().enumerate() {
                    let [a, b] = sector(paper.map, h);
                    let at = paper.map.corners[h / 3][h % 3];
                    let headings = axes_in(a, b, on_rim && i + 1 == fan.len());
                    self.all.extend(headings.map(|heading| Port {
                        site,
                        face: h / 3,
                        heading,
                        at,
                    }));
                }
                on_rim
            }
        }
    }

    /// From along a half-edge to against it, half-open or closed.
    fn add_half_turn(
        &mut self,
        paper: &Paper<'_>,
        site: u32,
        h: usize,
        at: [i64; 2],
        closed: bool,
    ) {
        let uv = &paper.map.corners[h / 3];
        let along = minus(uv[next(h) % 3], uv[h % 3]);
        let first = (0..4u8)
            .find(|&q| {
                let (d, before) = (rotated([1, 0], q), rotated([1, 0], (q + 3) % 4));
                cross(before, along) > 0 && cross(along, d) >= 0
            })
            .unwrap_or(0);
        for q in [first, (first + 1) % 4, (first + 2) % 4] {
            let d = rotated([1, 0], q);
            let side = cross(along, d);
            let ahead = dot(along, d) > 0;
            if side > 0 || (side == 0 && (ahead || closed)) {
                self.all.push(Port {
                    site,
                    face: h / 3,
                    heading: q,
                    at,
                });
            }
        }
    }

    /// The port of a site through which a line comes back that has ended there.
    ///
    /// A line along a side of triangles ends in either of the two: the port is looked for in both.
    fn find(&self, paper: &Paper<'_>, site: u32, end: &Walker) -> Option<usize> {
        let range = self.starts[site as usize]..self.starts[site as usize + 1];
        // A triangle glued to itself may have a site more than once.
        let named = |face: usize, heading: u8, at: [i64; 2]| {
            range.clone().find(|&p| {
                let port = &self.all[p];
                port.face == face && port.heading == heading && port.at == at
            })
        };
        let (face, at) = (end.face, end.target);
        let heading = (end.heading + 2) % 4;
        // A port along a side belongs to the triangle on one side of it only.
        named(face, heading, at).or_else(|| {
            (3 * face..3 * face + 3).find_map(|h| {
                let twin = paper.net.twin(h)?;
                let uv = &paper.map.corners[face];
                let along = minus(uv[next(h) % 3], uv[h % 3]);
                let lies = cross(along, minus(at, uv[h % 3])) == 0
                    && cross(along, rotated([1, 0], heading)) == 0;
                let there = || {
                    let (heading, at) =
                        (paper.heading_across(h, heading), paper.across(h, twin, at));
                    named(twin / 3, heading, at)
                };
                lies.then(there).flatten()
            })
        })
    }

    /// For each port the one at the other end of its line.
    ///
    /// Lines are one unit long. Each is walked from one end only; that its other end leads back is checked by the port
    /// found there.
    pub(super) fn connected(&self, paper: &Paper<'_>, sites: &Sites) -> Result<Vec<u32>, Error> {
        let unit = paper.unit();
        let mut partner = vec![NONE; self.all.len()];
        for (number, port) in self.all.iter().enumerate() {
            if partner[number] != NONE {
                continue;
            }
            let walker = port.walker(unit);
            let torn = |why| Error::Torn {
                face: port.face,
                why,
            };
            let end = paper
                .follow(walker)?
                .ok_or_else(|| torn("it leaves the surface"))?;
            let site = sites
                .at(paper, end.face, end.target)
                .ok_or_else(|| torn("no integer point lies at its end"))?;
            let other = self
                .find(paper, site, &end)
                .ok_or_else(|| torn("no line comes back"))?;
            if partner[other] != NONE || other == number {
                return Err(torn("two lines end in one"));
            }
            partner[number] = other as u32;
            partner[other] = number as u32;
        }
        Ok(partner)
    }

    /// The faces that lie to the left of the lines.
    ///
    /// From a port along its line, then the line that is next clockwise from where it came, which is a turn to the
    /// left, and so on: four steps lead round a quad. At a rim the way round breaks off, and what was met lies outside.
    fn orbits(&self, partner: &[u32]) -> Result<Vec<[u32; 4]>, Error> {
        let mut seen = vec![false; self.all.len()];
        let mut quads = Vec::new();
        for start in 0..self.all.len() {
            if seen[start] {
                continue;
            }
            let mut corners = Vec::new();
            let (mut port, mut outside) = (start, false);
            loop {
                seen[port] = true;
                corners.push(self.all[port].site);
                match self.before(partner[port] as usize) {
                    Some(on) => port = on,
                    None => {
                        outside = true;
                        break;
                    }
                }
                if port == start || seen[port] {
                    break;
                }
            }
            if outside {
                continue;
            }
            let closed = port == start;
            match <[u32; 4]>::try_from(corners) {
                Ok(quad) if closed => quads.push(quad),
                // The outer side of a rim, entered in its middle.
                _ if !closed => {}
                _ => {
                    let why = "its face is no quad";
                    return Err(Error::Torn {
                        face: self.all[start].face,
                        why,
                    });
                }
            }
        }
        Ok(quads)
    }

    /// The port before this one, counter-clockwise around its site; none before the first on a rim.
    fn before(&self, port: usize) -> Option<usize> {
        let site = self.all[port].site as usize;
        let (first, end) = (self.starts[site], self.starts[site + 1]);
        match (port == first, self.on_rim[site]) {
            (true, true) => None,
            (true, false) => Some(end - 1),
            (false, _) => Some(port - 1),
        }
    }
}
