//! Rational T-splines: a function at every vertex of the T-mesh by its local knots, divided by the sum of all
//! (Sederberg, Zheng, Bakenov and Nasri 2003; the thesis's surface).
//!
//! Elements at an extraordinary vertex, around which all are of one size, are patches like those of the hierarchical
//! basis. Everywhere else a function is seen by the elements that its support reaches without crossing an edge that ends
//! at an extraordinary vertex, so that it comes to each of them in one way only.

use geom_core::compute::parallel;
use geom_core::{HalfedgeId, Point3, VertexId};
use rayon::prelude::*;

use super::extraction::{Extraction, Patch, Rows};
use super::hierarchical::{block_of, corner_points};
use super::knots::{Knots, ahead, bezier_coefficients};
use super::stars::{Ghosts, Mask};
use super::suitable::closed;
use crate::{Error, TMesh, VertexKind};

/// The extraction of T-spline functions, to be divided by their sum unless that is one.
///
/// The origins of its functions are all of level 0, by the fine vertices they belong to.
///
/// # Errors
/// [`Error::Open`] for a boundary, beyond which knots would have to be made up; [`Error::Ring`] if an extraordinary
/// vertex has too few elements of one size around it.
pub(super) fn extraction(mesh: &TMesh, divided: bool) -> Result<Extraction, Error> {
    closed(mesh)?;
    let charts = Charts::new(mesh);
    let reached: Vec<Vec<Reached>> =
        parallel::map(mesh.positions().len(), |v| charts.reached(v as u32));
    let mut of_element: Vec<Vec<Reached>> = vec![Vec::new(); mesh.elements().len()];
    for one in reached.into_iter().flatten() {
        of_element[one.element as usize].push(one);
    }
    let ghosts = Ghosts::new(mesh);
    let made: Vec<Vec<(Patch, Rows)>> = of_element
        .into_par_iter()
        .enumerate()
        .with_min_len(64)
        .map(|(e, functions)| match charts.is_irregular(e) {
            true => irregular(mesh, &ghosts, e).map(|one| vec![one]),
            false => Ok(regular(mesh, e, &functions)),
        })
        .collect::<Result<_, Error>>()?;
    let (patches, rows) = made.into_iter().flatten().unzip();
    let controls: Vec<Point3> =
        parallel::map(mesh.positions().len(), |v| charts.abscissa(v as u32));
    let origins = (0..controls.len()).map(|v| (0, mesh.fine_of_vertex(v)));
    let origins = origins.collect();
    Ok(Extraction::new(patches, rows, (controls, origins), divided))
}

/// A function on an element: its knots along both directions of the element.
#[derive(Clone)]
struct Reached {
    /// The element of the T-mesh.
    element: u32,
    /// The vertex whose function it is.
    function: u32,
    /// Counted from the first corner of the element, in sides of fine quads: whole numbers, so that two elements agree
    /// about where a piece ends.
    knots: [Knots; 2],
}

/// An element at an extraordinary vertex.
/// Its functions are those of the conforming mesh of its level, so that all vertices of its star must be vertices of
/// the T-mesh: which the rings around extraordinary vertices see to.
fn irregular(mesh: &TMesh, ghosts: &Ghosts<'_>, e: usize) -> Result<(Patch, Rows), Error> {
    let element = &mesh.elements()[e];
    let sides = block_of(mesh, e).sides;
    let mut points: [Mask; 16] = Default::default();
    let mut places = Vec::new();
    for (k, corner) in element.corners.iter().enumerate() {
        let vertex = mesh.fine_of_vertex(*corner as usize);
        let star = ghosts.star(element.level, vertex, &mut places)?;
        let own = star.sectors.iter().position(|s| s.from == Some(sides[k]));
        let own = own.expect("an element is a block around its corners");
        corner_points(&star, own, k, &mut points);
    }
    let mut rows = Rows::default();
    for (b, point) in points.iter().enumerate() {
        for &(vertex, x) in point {
            let level = element.level;
            let function = mesh.vertex_of_fine(vertex);
            rows.add(function.ok_or(Error::Ring { vertex, level })?, b, x);
        }
    }
    let patch = Patch {
        element: e as u32,
        from: [0, 0],
        to: [element.size, element.size],
    };
    Ok((patch, rows.sorted()))
}

/// Any other element, cut along the knots of its functions.
///
/// Between knots each function is one polynomial in s times one in t, whose Bézier coefficients are products. A
/// T-junction two elements away may cut an element: that is what is called its extension. Functions that do not reach a
/// piece are not among its rows.
fn regular(mesh: &TMesh, e: usize, functions: &[Reached]) -> Vec<(Patch, Rows)> {
    let size = i64::from(mesh.elements()[e].size);
    let cuts = [0, 1].map(|axis| {
        let knots = functions.iter().flat_map(|f| f.knots[axis]);
        let mut cuts: Vec<i64> = knots.filter(|k| (1..size).contains(k)).collect();
        cuts.extend([0, size]);
        cuts.sort_unstable();
        cuts.dedup();
        cuts
    });
    let mut out = Vec::new();
    for y in cuts[1].windows(2) {
        for x in cuts[0].windows(2) {
            let (x, y) = ([x[0], x[1]], [y[0], y[1]]);
            let mut rows = Rows::default();
            for f in functions {
                let (a, b) = (
                    bezier_coefficients(&f.knots[0], x),
                    bezier_coefficients(&f.knots[1], y),
                );
                if a.iter().any(|&a| a != 0.0) && b.iter().any(|&b| b != 0.0) {
                    let row = rows.row(f.function);
                    for (k, out) in row.iter_mut().enumerate() {
                        *out += a[k % 4] * b[k / 4];
                    }
                }
            }
            let patch = Patch {
                element: e as u32,
                from: [x[0] as u32, y[0] as u32],
                to: [x[1] as u32, y[1] as u32],
            };
            out.push((patch, rows.sorted()));
        }
    }
    out
}

/// Where an element lies in the chart of a function: turned by quarters, then moved.
#[derive(Clone, Copy, PartialEq)]
struct Place {
    element: u32,
    /// Quarters counter-clockwise.
    turn: usize,
    /// Where the first corner of the element comes to lie.
    moved: [i64; 2],
}

/// A vector turned by quarters, counter-clockwise.
fn turned([x, y]: [i64; 2], quarters: usize) -> [i64; 2] {
    match quarters % 4 {
        0 => [x, y],
        1 => [-y, x],
        2 => [-x, -y],
        _ => [y, -x],
    }
}

/// Where fine quads lie in their elements, and how elements meet.
struct Charts<'a> {
    mesh: &'a TMesh,
    /// Per fine quad its place in its element, and which of its half-edges runs along side 0.
    place: Vec<([i64; 2], u32)>,
    /// Per element the half-edges with which the edges of the T-mesh along its sides begin, if they may be crossed.
    gates: Vec<Vec<HalfedgeId>>,
}

impl<'a> Charts<'a> {
    fn new(mesh: &'a TMesh) -> Self {
        let mut charts = Self {
            mesh,
            place: vec![([0; 2], 0); mesh.fine().quads().len()],
            gates: Vec::with_capacity(mesh.elements().len()),
        };
        for (e, element) in mesh.elements().iter().enumerate() {
            charts.lay(block_of(mesh, e).sides[0], element.size);
            let gates = (0..4).flat_map(|side| charts.gates_of(e, side));
            let gates = gates.collect();
            charts.gates.push(gates);
        }
        charts
    }

    /// Numbers the fine quads of an element, row after row from its first corner.
    fn lay(&mut self, start: HalfedgeId, size: u32) {
        let edges = self.mesh.fine_edges();
        let mut row = Some(start);
        for j in 0..i64::from(size) {
            let mut at = row;
            for i in 0..i64::from(size) {
                let Some(h) = at else { return };
                self.place[edges.face(h).0 as usize] = ([i, j], h.0 % 4);
                at = edges.twin(edges.next(h)).map(|t| edges.next(t));
            }
            row = row.and_then(|h| edges.twin(edges.next(edges.next(h))));
        }
    }

    /// Is a corner extraordinary?
    fn is_irregular(&self, element: usize) -> bool {
        let corners = self.mesh.elements()[element].corners;
        corners.iter().any(|&v| self.is_extraordinary(v))
    }

    fn is_extraordinary(&self, vertex: u32) -> bool {
        matches!(
            self.mesh.kind(vertex as usize),
            VertexKind::Extraordinary(_)
        )
    }

    /// The edges along a side, in order, without those that end at an extraordinary vertex.
    fn gates_of(&self, e: usize, side: usize) -> Vec<HalfedgeId> {
        let (mesh, edges) = (self.mesh, self.mesh.fine_edges());
        let mut h = Some(block_of(mesh, e).sides[side]);
        let mut starts = Vec::new();
        for _ in 0..mesh.elements()[e].size {
            let Some(at) = h else { break };
            if mesh.vertex_of_fine(edges.from(at).0).is_some() {
                starts.push(at);
            }
            h = edges.twin(edges.next(at)).map(|t| edges.next(t));
        }
        let vertices = mesh.side(e, side);
        let open = |pair: &[u32]| pair.iter().all(|&v| !self.is_extraordinary(v));
        let both = starts.into_iter().zip(vertices.windows(2));
        both.filter(|(_, pair)| open(pair)).map(|b| b.0).collect()
    }

    /// A half-edge in its element: where it starts, and its direction in quarters.
    /// Answers the element, the start in its own coordinates and the direction in quarters from side 0 on.
    fn local(&self, h: HalfedgeId) -> (u32, [i64; 2], usize) {
        let quad = self.mesh.fine_edges().face(h).0 as usize;
        let ([i, j], bottom) = self.place[quad];
        let direction = (h.0 % 4 + 4 - bottom) as usize % 4;
        let [di, dj] = [[0, 0], [1, 0], [1, 1], [0, 1]][direction];
        (self.mesh.element_of(quad), [i + di, j + dj], direction)
    }

    /// The place of the element of a half-edge that starts at a point of the chart and runs in a direction.
    fn placed(&self, h: HalfedgeId, at: [i64; 2], direction: usize) -> Place {
        let (element, start, own) = self.local(h);
        let turn = (direction + 4 - own) % 4;
        let [x, y] = turned(start, turn);
        Place {
            element,
            turn,
            moved: [at[0] - x, at[1] - y],
        }
    }

    /// The elements on which the function of a vertex is not zero, those at extraordinary vertices left out.
    ///
    /// Knots come from four rays; at an extraordinary vertex there are as many sectors as elements, and each sees a
    /// quarter of the uniform function of the elements' size, which is what the patches around it are made of.
    fn reached(&self, vertex: u32) -> Vec<Reached> {
        let (mesh, edges) = (self.mesh, self.mesh.fine_edges());
        let fine = VertexId(mesh.fine_of_vertex(vertex as usize));
        let around: Vec<HalfedgeId> = edges.around(fine).collect();
        let mut out = Vec::new();
        if self.is_extraordinary(vertex) {
            // Sector by sector: each sees the quarter of a uniform function.
            for &h in &around {
                let [a, _] = ahead(mesh, h);
                let knots = [-2 * a, -a, 0, a, 2 * a];
                self.flood(vertex, &[(h, 0)], [knots, knots], [0, 2 * a], &mut out);
            }
            return out;
        }
        let rays = [0, 1, 2, 3].map(|k| ahead(mesh, around[k]));
        let knots = |to: [i64; 2], back: [i64; 2]| [-back[1], -back[0], 0, to[0], to[1]];
        let knots = [knots(rays[0], rays[2]), knots(rays[1], rays[3])];
        let starts: Vec<(HalfedgeId, usize)> = around.into_iter().zip(0..).collect();
        let all = [i64::MIN, i64::MAX];
        self.flood(vertex, &starts, knots, all, &mut out);
        out
    }

    /// Where the control point of a vertex starts: at the mean of its three middle knots (Greville 1964), so that the parameters
    /// run evenly across a change of level. As far as rays go along the fine mesh; at the vertex itself if it is extraordinary.
    fn abscissa(&self, vertex: u32) -> Point3 {
        let (mesh, edges) = (self.mesh, self.mesh.fine_edges());
        let fine = mesh.fine_of_vertex(vertex as usize);
        let start = mesh.positions()[vertex as usize];
        if self.is_extraordinary(vertex) {
            return start;
        }
        let around: Vec<HalfedgeId> = edges.around(VertexId(fine)).collect();
        let first = [0, 1, 2, 3].map(|k| ahead(mesh, around[k])[0]);
        let mut place = start;
        for axis in 0..2 {
            let thirds = first[axis] - first[axis + 2];
            let ray = around[if thirds > 0 { axis } else { axis + 2 }];
            place += self.along(ray, thirds.unsigned_abs() as f64 / 3.0) - start;
        }
        place
    }

    /// The point so many sides of fine quads along a ray.
    fn along(&self, ray: HalfedgeId, length: f64) -> Point3 {
        let edges = self.mesh.fine_edges();
        let at = |v: VertexId| self.mesh.fine().positions()[v.0 as usize];
        let (mut h, mut left) = (ray, length);
        while left > 1.0 {
            match edges.twin(edges.next(h)) {
                Some(g) => h = edges.next(g),
                None => break,
            }
            left -= 1.0;
        }
        at(edges.from(h)) + (at(edges.to(h)) - at(edges.from(h))) * left.min(1.0)
    }

    /// Goes from element to element within the support, clipped to `window` along both directions.
    ///
    /// An element is placed by the gate through which it is entered. It may be met more than once, at different places,
    /// as around a thin tube: then it has the function twice, and both are added up. Places that were seen are not
    /// entered again.
    fn flood(
        &self,
        function: u32,
        starts: &[(HalfedgeId, usize)],
        knots: [Knots; 2],
        window: [i64; 2],
        out: &mut Vec<Reached>,
    ) {
        let support = knots.map(|k| [k[0].max(window[0]), k[4].min(window[1])]);
        let edges = self.mesh.fine_edges();
        let mut seen: Vec<Place> = Vec::new();
        let mut waiting: Vec<Place> = Vec::new();
        for &(h, direction) in starts {
            waiting.push(self.placed(h, [0, 0], direction));
        }
        while let Some(place) = waiting.pop() {
            let e = place.element as usize;
            let size = i64::from(self.mesh.elements()[e].size);
            let [x, y] = turned([size, size], place.turn);
            let [tx, ty] = place.moved;
            let meets = |axis: usize, a: i64, b: i64| {
                a.max(b) > support[axis][0] && a.min(b) < support[axis][1]
            };
            if seen.contains(&place) || !meets(0, tx, tx + x) || !meets(1, ty, ty + y) {
                continue;
            }
            seen.push(place);
            if !self.is_irregular(e) {
                out.push(Reached {
                    element: place.element,
                    function,
                    knots: seen_from(&knots, &place),
                });
            }
            for &gate in &self.gates[e] {
                let (_, start, direction) = self.local(gate);
                let ahead = turned([1, 0], direction);
                let end = turned([start[0] + ahead[0], start[1] + ahead[1]], place.turn);
                let end = [end[0] + tx, end[1] + ty];
                if let Some(twin) = edges.twin(gate) {
                    waiting.push(self.placed(twin, end, direction + place.turn + 2));
                }
            }
        }
    }
}

/// The knots of a function along the directions of an element.
/// A turn exchanges the directions and reverses knots, so that they ascend again.
fn seen_from([x, y]: &[Knots; 2], place: &Place) -> [Knots; 2] {
    let [tx, ty] = place.moved;
    let along = |k: &Knots, t: i64| k.map(|k| k - t);
    let against = |k: &Knots, t: i64| {
        let mut turned = k.map(|k| t - k);
        turned.reverse();
        turned
    };
    match place.turn {
        0 => [along(x, tx), along(y, ty)],
        1 => [along(y, ty), against(x, tx)],
        2 => [against(x, tx), against(y, ty)],
        _ => [against(y, ty), along(x, tx)],
    }
}
