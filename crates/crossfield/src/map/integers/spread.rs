//! What is left of a decimated map, and its integers, laid on the surface by straight lines of the relaxed map.
//!
//! The integers say where the corners of the decimated triangles are on the grid. Where each point of such a triangle
//! is on the surface, they do not say; but every decimated triangle is a straight one in the plane of the relaxed map,
//! which is flat but for the singular vertices. So a point of it is found from its barycentric coordinates there: a
//! direction and a length from one corner, and a straight walk over the triangles of the surface, turned at each seam.
//! Such walks are intrinsic, like those of Sharp, Soliman and Crane (*Navigating intrinsic triangulations*, 2019),
//! whose angles around vertices (signposts) say how a walk begins.

use std::mem::take;
use std::sync::Arc;

use super::coarse::{Coarse, NONE};
use super::plane::{Link, Place, add, added, cross, inverse, minus, opening, rotated};
use super::upright::{AtLeast, Upright};
use crate::field::CrossField;
use crate::field::frames::{Frames, next, previous};
use crate::map::cut::Cut;
use crate::map::exact::{GridMap, MapReport};
use crate::map::net::Net;
use crate::map::transition::{Seams, Sum};

type Point = [f64; 2];

/// A line that meets a side at a larger angle than this, radians, does not run along it.
const ASIDE: f64 = 1e-6;

/// A decimated map without integers: what all choices of these share.
pub(in crate::map) struct Decimated {
    /// How its triangles are glued to each other; vertices have the numbers of the surface.
    net: Net,
    /// The corners as they are in the relaxed map.
    at: Vec<[Point; 3]>,
    /// The angle of each half-edge around its vertex.
    /// Radians in the relaxed map, from the first half-edge that the surface has there.
    angle: Vec<f64>,
    /// Per half-edge, what leads to the chart of its twin, as sums of the integers.
    link: Vec<Link>,
    /// Per corner, where it lies.
    exact: Vec<[Sum; 2]>,
    /// The relaxed map.
    /// Of the triangles of the surface.
    relaxed: Vec<[Point; 3]>,
    /// Its quarter turns, per half-edge of the surface.
    turn: Vec<u8>,
}

/// A decimated map with integers at its corners. Between them it is the relaxed map, stretched: each of its triangles is one
/// of that map's plane, and a point of it is found by a straight walk from a corner. It is upright wherever the integers leave
/// its few triangles so, whatever the triangles of the surface.
pub(crate) struct Spread {
    /// Shared by all that are tried.
    decimated: Arc<Decimated>,
    /// The integers at the corners of its triangles, in fixed point.
    pub(crate) map: GridMap,
    /// The integers.
    z: Vec<f64>,
}

impl Decimated {
    /// Of a relaxed map given by its corners; `None` where the map is folded, a regular vertex cannot be taken out, or a corner is
    /// no sum of integers.
    ///
    /// Triangles that are gone are left out, with all that was known of them, and the others numbered anew.
    pub(in crate::map) fn of(
        frames: &Frames,
        field: &CrossField,
        cut: &Cut,
        seams: &Seams,
        relaxed: Vec<[Point; 3]>,
    ) -> Option<Self> {
        let mut coarse = Coarse::of(frames, field, cut, seams, &relaxed)?;
        let alive: Vec<usize> = (0..coarse.alive.len())
            .filter(|&t| coarse.alive[t])
            .collect();
        let mut number = vec![NONE; coarse.alive.len()];
        for (k, &t) in (0u32..).zip(&alive) {
            number[t] = k;
        }
        let moved = |h: u32| match h {
            NONE => NONE,
            h => 3 * number[h as usize / 3] + h % 3,
        };
        let sides = || alive.iter().flat_map(|&t| 3 * t..3 * t + 3);
        let places: Vec<Place> = sides().map(|h| take(&mut coarse.place[h])).collect();
        Some(Self {
            net: Net::new(
                sides().map(|h| coarse.from[h]).collect(),
                sides().map(|h| moved(coarse.twin[h])).collect(),
                coarse.out.iter().map(|&h| moved(h)).collect(),
            ),
            at: places
                .as_chunks::<3>()
                .0
                .iter()
                .map(|corners| corners.each_ref().map(|place| place.at))
                .collect(),
            angle: sides().map(|h| coarse.angle[h]).collect(),
            link: sides().map(|h| take(&mut coarse.link[h])).collect(),
            exact: places
                .into_iter()
                .map(|place| place.exact)
                .collect::<Option<_>>()?,
            relaxed,
            turn: cut.turn.clone(),
        })
    }

    /// How many triangles are left.
    #[cfg(feature = "testing")]
    pub(in crate::map) fn triangles(&self) -> usize {
        self.at.len()
    }

    /// What the integers must be for every triangle to be upright.
    pub(in crate::map) fn upright(&self) -> Upright {
        let sides = self.exact.as_chunks::<3>().0.iter().map(|[a, b, c]| {
            [b, c].map(|to| {
                let mut side = to.clone();
                add(&mut side, a, -1);
                side
            })
        });
        let relaxed = self.at.iter().map(|&[a, b, c]| [minus(b, a), minus(c, a)]);
        let relaxed: Vec<_> = relaxed.collect();
        Upright::new(&sides.collect::<Vec<_>>(), &relaxed)
    }

    /// That the sides out of some vertices stay within a quarter turn of where they point in the relaxed map: then upright
    /// triangles turn as far around each as they do there.
    pub(crate) fn unturned(&self, vertices: &[usize]) -> Vec<AtLeast> {
        /// Directions are rounded to so many units.
        const FINE: f64 = 4.0;
        let Self { net, at, exact, .. } = self;
        let halfedges = vertices.iter().flat_map(|&v| net.around(v));
        let of = |h: usize| {
            let [x, y] = minus(at[h / 3][next(h) % 3], at[h / 3][h % 3]);
            let [x, y] = [x, y].map(|c| (FINE * c / x.hypot(y)).round() as i64);
            let mut side = exact[next(h)].clone();
            add(&mut side, &exact[h], -1);
            let sum = combined(&side, [x, y]);
            AtLeast { sum, bound: 1 }
        };
        halfedges.map(of).collect()
    }

    /// With these integers. Whether they leave its triangles upright is not checked here.
    pub(in crate::map) fn spread(
        self: &Arc<Self>,
        z: &[f64],
        bits: u32,
        report: MapReport,
    ) -> Spread {
        let value = |exact: &[Sum; 2]| {
            [0, 1].map(|c| {
                let terms = exact[c].iter();
                let sum = terms.map(|&(k, p)| p * z[k as usize].round() as i64);
                sum.sum::<i64>() << bits
            })
        };
        let corners = self.exact.as_chunks::<3>().0;
        Spread {
            map: GridMap {
                corners: corners
                    .iter()
                    .map(|all| all.each_ref().map(value))
                    .collect(),
                turn: self.link.iter().map(|link| link.turn).collect(),
                bits,
                report,
            },
            z: z.to_vec(),
            decimated: self.clone(),
        }
    }
}

impl Spread {
    /// How its triangles are glued to each other.
    pub(crate) fn net(&self) -> &Net {
        &self.decimated.net
    }

    /// That a closed path be at least so many lines long, the more of both coordinates together than now.
    ///
    /// It crosses these half-edges, from a point and back to it: a corner, if it starts at a singular vertex. `None`
    /// where its length is no sum of the integers, because the map turns along it, or is 0.
    pub(crate) fn longer(
        &self,
        crossed: &[usize],
        corner: Option<usize>,
        least: i64,
    ) -> Option<AtLeast> {
        let Decimated { link, exact, .. } = &*self.decimated;
        let around = crossed
            .iter()
            .fold(Link::default(), |all, &h| all.then(&link[h]));
        let back = inverse(&around);
        let length = match corner {
            Some(h) => {
                let at = Place {
                    exact: Some(exact[h].clone()),
                    ..Place::default()
                };
                let mut end = back.apply(&at).exact?;
                add(&mut end, &exact[h], -1);
                end
            }
            None if back.turn == 0 => back.exact,
            None => return None,
        };
        let value = |sum: &Sum| -> i64 {
            let terms = sum.iter();
            terms
                .map(|&(k, c)| c * self.z[k as usize].round() as i64)
                .sum()
        };
        let signs = [0, 1].map(|c| value(&length[c]).signum());
        let sum = combined(&length, signs);
        (value(&sum) > 0).then_some(AtLeast { sum, bound: least })
    }

    /// Where a point of one of its triangles lies on the surface: triangle and barycentric coordinates. `None` if the walk
    /// does not end.
    ///
    /// `weights` are barycentric coordinates in triangle `face` of the decimated map. The walk starts from the corner
    /// with the largest of them, the nearest one in that sense. It may fail to end for rounding, or meet a boundary.
    pub(crate) fn place(
        &self,
        frames: &Frames,
        face: usize,
        weights: [f64; 3],
    ) -> Option<(usize, [f64; 3])> {
        let Decimated { net, at, angle, .. } = &*self.decimated;
        let at = &at[face];
        let k = (0..3).fold(
            0,
            |best, k| if weights[k] > weights[best] { k } else { best },
        );
        let h = 3 * face + k;
        let to: Point =
            [0, 1].map(|c| (0..3).map(|j| weights[j] * at[j][c]).sum::<f64>() - at[k][c]);
        let side = minus(at[(k + 1) % 3], at[k]);
        let turn = opening(side, to);
        // Along the side it may be a full turn for rounding.
        let turn = if turn > std::f64::consts::PI {
            0.0
        } else {
            turn
        };
        let length = to[0].hypot(to[1]);
        self.decimated
            .walk(frames, net.from(h), angle[h] + turn, length)
    }
}

impl Decimated {
    /// So far straight on from a vertex; along a rim from side to side of it.
    ///
    /// At most four steps per triangle of the surface: a straight line of the map meets a triangle more than once only
    /// if it goes around something.
    fn walk(
        &self,
        frames: &Frames,
        vertex: usize,
        angle: f64,
        mut length: f64,
    ) -> Option<(usize, [f64; 3])> {
        let (h, direction) = self.start(frames, vertex, angle)?;
        if length == 0.0 {
            let mut weights = [0.0; 3];
            weights[h % 3] = 1.0;
            return Some((h / 3, weights));
        }
        let mut at = self.relaxed[h / 3][h % 3];
        let (mut direction, mut over) = (direction, next(h));
        for _ in 0..4 * frames.faces() {
            let uv = &self.relaxed[over / 3];
            let (p, q) = (uv[over % 3], uv[next(over) % 3]);
            let side = minus(q, p);
            let (along, across) = (dot(direction, side), cross(direction, side));
            // Along a side, as lines on a rim go, it does not cross it, but goes to its end.
            let is_along = across.abs() <= ASIDE * along.abs();
            let end = if along > 0.0 { q } else { p };
            let far = match is_along {
                true => dot(minus(end, at), direction),
                false => cross(minus(p, at), side) / across,
            };
            if far.is_nan() || length <= far {
                let end = [0, 1].map(|c| at[c] + direction[c] * length);
                return Some((over / 3, weights_of(uv, end)));
            }
            let far = far.max(0.0);
            length -= far;
            let crossing = match is_along {
                true => end,
                false => [0, 1].map(|c| at[c] + direction[c] * far),
            };
            let Some(twin) = frames.twin(over) else {
                // The rim's next side, if the line runs along it; whatever else leaves the surface is lost.
                if !is_along {
                    return None;
                }
                let vertex = frames.from(if along > 0.0 { next(over) } else { over });
                let (h, onwards) = self.along_rim(frames, vertex, along > 0.0)?;
                (at, direction, over) = (self.relaxed[h / 3][h % 3], onwards, next(h));
                continue;
            };
            // Into the chart of the triangle beyond, measured from the end that both charts have of the side.
            let turn = (4 - self.turn[over]) % 4;
            let there = &self.relaxed[twin / 3];
            let offset = rotated(minus(crossing, p), turn);
            let from = there[next(twin) % 3];
            at = [from[0] + offset[0], from[1] + offset[1]];
            direction = rotated(direction, turn);
            let apex = there[previous(twin) % 3];
            over = if cross(direction, minus(apex, at)) > 0.0 {
                next(twin)
            } else {
                previous(twin)
            };
        }
        None
    }

    /// From a vertex of the boundary along it, with the surface on the left or on the right: a half-edge out of the vertex and
    /// the direction in its chart.
    fn along_rim(&self, frames: &Frames, vertex: usize, left: bool) -> Option<(usize, Point)> {
        let mut fan = frames.around(vertex);
        let (h, to) = match left {
            true => fan.next().map(|h| (h, next(h)))?,
            false => fan.last().map(|h| (h, previous(h)))?,
        };
        let uv = &self.relaxed[h / 3];
        let side = minus(uv[to % 3], uv[h % 3]);
        let norm = side[0].hypot(side[1]);
        Some((h, side.map(|x| x / norm)))
    }

    /// The triangle at a vertex into which a direction points, by its half-edge there, and the direction in its chart.
    ///
    /// Angles are taken modulo the total angle around the vertex in the map; on a boundary they are not more than that, but for
    /// rounding.
    fn start(&self, frames: &Frames, vertex: usize, angle: f64) -> Option<(usize, Point)> {
        let toward = |h: usize, to: usize| {
            let uv = &self.relaxed[h / 3];
            minus(uv[to % 3], uv[h % 3])
        };
        let fan: Vec<usize> = frames.around(vertex).collect();
        let openings: Vec<f64> = fan
            .iter()
            .map(|&h| opening(toward(h, next(h)), toward(h, previous(h))))
            .collect();
        let total: f64 = openings.iter().sum();
        let mut rest = match frames.on_boundary(vertex) {
            true => angle.clamp(0.0, total),
            false => angle.rem_euclid(total),
        };
        for (k, &h) in fan.iter().enumerate() {
            if rest <= openings[k] || k + 1 == fan.len() {
                let (sine, cosine) = rest.min(openings[k]).sin_cos();
                let [x, y] = toward(h, next(h));
                let norm = x.hypot(y);
                let turned = [cosine * x - sine * y, sine * x + cosine * y];
                return Some((h, turned.map(|x| x / norm)));
            }
            rest -= openings[k];
        }
        None
    }
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Barycentric coordinates, those below 0 raised to 0, so that a point beside a triangle for rounding is put on its
/// rim.
fn weights_of(uv: &[Point; 3], at: Point) -> [f64; 3] {
    let areas = [0, 1, 2].map(|k| {
        let (a, b) = (uv[(k + 1) % 3], uv[(k + 2) % 3]);
        cross(minus(b, a), minus(at, a)).max(0.0)
    });
    let total: f64 = areas.iter().sum();
    areas.map(|a| a / total)
}

/// Both coordinates together, each so many times.
fn combined([u, v]: &[Sum; 2], [x, y]: [i64; 2]) -> Sum {
    added(&added(&Sum::new(), u, x), v, y)
}
