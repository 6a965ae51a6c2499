//! Down the gradient of the corners' distortion: optimization-based smoothing of quads on a surface.
//!
//! The distortion of a corner with the sides P and S and the normal n is `(|P|² + |S|²) / 2 n·(P × S)`: 1 for equal sides at a right
//! angle, and infinite where the corner is flat ([`CornerDistortion`]). Summed over all corners it is a function of the vertices, which
//! move down its gradient within the tangent planes and are put back onto the surface. What sides are equal to is an
//! [`Ideal`], as in the target-matrix paradigm (P. Knupp, Engineering with Computers 28, 2012). The sum may fall while single
//! corners do: vertices whose elements would end worse stay ([`Flow::descend_in_rounds`]), and those of the worst elements are lifted
//! one by one after it ([`Flow::lift_the_worst`], [`Flow::straighten`], [`Flow::lift_many`]), a combination that L. Freitag and C. Ollivier-Gooch
//! recommend (Int. J. Numer. Meth. Eng. 40, 1997). Where the mean itself is wanted, [`Flow::lift_the_mean`] follows.
//!
//! What the elements are is for the caller to say, in [`Elements`]: quads, or those of a mesh with T-junctions. All but the
//! distortions ([`CornerBackend`]) is computed on the CPU, with the same bits for any number of threads.

pub mod backend;
mod rounds;
mod search;
#[cfg(feature = "wgpu")]
mod wgpu;

pub use self::backend::{Corner, CornerBackend, CornerDistortion, CornerObject};
pub use self::search::{Search, Straightening};
#[cfg(feature = "wgpu")]
pub use self::wgpu::distortions;

use std::borrow::Cow;

use self::backend::On;
use super::ground::{Freedom, Ground};
use crate::compute::lists::Lists;
use crate::compute::{BackendError, parallel};
use crate::{Cancelled, Point3, Vector3};

/// No vertex moves farther in a step than this share of what is reasonable.
const LONGEST: f64 = 0.3;

/// Positions, and the surface's normals there.
pub type State = (Vec<Point3>, Vec<Vector3>);

/// Vertices on a surface, or each on one of several that may touch.
pub struct Vertices<'a> {
    /// Where they are.
    pub positions: Vec<Point3>,
    /// The surface's unit normals there.
    pub normals: Vec<Vector3>,
    /// How they may move.
    pub freedom: Vec<Freedom>,
    grounds: &'a [Ground<'a>],
    /// Which of these each vertex is on; none if all are on the first.
    part: Vec<u32>,
}

impl<'a> Vertices<'a> {
    /// Put onto the surface.
    pub fn new(positions: Vec<Point3>, freedom: Vec<Freedom>, ground: &'a Ground<'a>) -> Self {
        let grounds = std::slice::from_ref(ground);
        Self::on_parts(positions, freedom, grounds, Vec::new())
    }

    /// Put each onto its own of some surfaces: where these touch, the nearest point may be that of another. `part` has the
    /// number of each vertex's, or is empty if that is 0 for all.
    pub fn on_parts(
        positions: Vec<Point3>,
        freedom: Vec<Freedom>,
        grounds: &'a [Ground<'a>],
        part: Vec<u32>,
    ) -> Self {
        let mut vertices = Self {
            positions,
            normals: Vec::new(),
            freedom,
            grounds,
            part,
        };
        vertices.settle();
        vertices
    }

    /// The surface that a vertex is on.
    pub fn ground(&self, vertex: usize) -> &'a Ground<'a> {
        let part = self.part.get(vertex).copied().unwrap_or(0);
        &self.grounds[part as usize]
    }

    /// Puts all back onto the surface.
    pub fn settle(&mut self) {
        let pulled = parallel::map(self.positions.len(), |v| self.pulled(v));
        (self.positions, self.normals) = pulled.into_iter().unzip();
    }

    /// Puts some back onto the surface; all others stay as they are.
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn settle_some(&mut self, vertices: &[u32]) {
        let pulled = parallel::map_each(vertices, |&v| self.pulled(v as usize));
        self.put_some(vertices, pulled.into_iter().unzip());
    }

    /// One more, put onto the surface of this number (0 where there is one for all); its own number.
    ///
    /// # Panics
    /// If there is no such surface.
    pub fn add(&mut self, position: Point3, freedom: Freedom, part: u32) -> u32 {
        let number = self.positions.len();
        let (position, normal) = self.grounds[part as usize].pulled(&position, freedom);
        self.positions.push(position);
        self.normals.push(normal);
        self.freedom.push(freedom);
        if part > 0 || !self.part.is_empty() {
            self.part.resize(number, 0);
            self.part.push(part);
        }
        number as u32
    }

    /// The place of one on its surface, and the normal there.
    fn pulled(&self, v: usize) -> (Point3, Vector3) {
        self.ground(v).pulled(&self.positions[v], self.freedom[v])
    }

    /// Places on the surface, and its normals there, after steps along some displacements from places that were on it. What does
    /// not move stays as it was.
    fn stepped_from(&self, start: &State, descent: &[Vector3], length: f64) -> State {
        let mut there = start.clone();
        let (positions, normals) = (&mut there.0, &mut there.1);
        parallel::for_each_pair(positions, normals, |v, position, normal| {
            let p = *position + descent[v] * length;
            if p != *position {
                (*position, *normal) = self.ground(v).pulled_from(position, &p, self.freedom[v]);
            }
        });
        there
    }

    /// To come back to.
    pub fn state(&self) -> State {
        (self.positions.clone(), self.normals.clone())
    }

    /// Comes back to it.
    pub fn put(&mut self, state: State) {
        (self.positions, self.normals) = state;
    }

    /// Some of them, in this order.
    fn some(&self, vertices: &[u32]) -> Self {
        let all = || vertices.iter().map(|&v| v as usize);
        Self {
            positions: all().map(|v| self.positions[v]).collect(),
            normals: all().map(|v| self.normals[v]).collect(),
            freedom: all().map(|v| self.freedom[v]).collect(),
            grounds: self.grounds,
            part: all().filter_map(|v| self.part.get(v).copied()).collect(),
        }
    }

    /// A state of some of them.
    fn put_some(&mut self, vertices: &[u32], (positions, normals): State) {
        for (&v, place) in vertices.iter().zip(positions.into_iter().zip(normals)) {
            (self.positions[v as usize], self.normals[v as usize]) = place;
        }
    }
}

/// Where vertices are; one of them may try another place, which the others do not see.
#[derive(Clone, Copy)]
pub struct Places<'v> {
    vertices: &'v Vertices<'v>,
    tried: Option<(usize, (Point3, Vector3))>,
}

impl<'v> Places<'v> {
    /// All as they are.
    pub fn of(vertices: &'v Vertices<'v>) -> Self {
        Self {
            vertices,
            tried: None,
        }
    }

    /// One of them elsewhere, with the surface's unit normal there.
    #[must_use]
    pub fn but(self, vertex: usize, place: (Point3, Vector3)) -> Self {
        Self {
            tried: Some((vertex, place)),
            ..self
        }
    }

    fn of_tried(&self, vertex: u32) -> Option<(Point3, Vector3)> {
        let tried = self.tried.filter(|(v, _)| *v == vertex as usize);
        tried.map(|(_, place)| place)
    }

    /// Of one vertex.
    pub fn position(&self, vertex: u32) -> Point3 {
        (self.of_tried(vertex)).map_or(self.vertices.positions[vertex as usize], |at| at.0)
    }

    /// The surface's unit normal there.
    pub fn normal(&self, vertex: u32) -> Vector3 {
        (self.of_tried(vertex)).map_or(self.vertices.normals[vertex as usize], |at| at.1)
    }

    /// The surface that a vertex is on.
    pub fn ground(&self, vertex: u32) -> &'v Ground<'v> {
        self.vertices.ground(vertex as usize)
    }
}

/// What two edges that meet in a corner shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ideal {
    /// At right angles, and as long as this, or both the same multiple of it.
    Sides([f64; 2]),
    /// The edges of a triangle: the inverse of the matrix whose columns they are, row after row.
    Inverse([[f64; 2]; 2]),
}

impl Ideal {
    /// What must be unit vectors at right angles: the edges times the inverse of the ideal ones.
    pub fn sides(&self, edges: [Vector3; 2]) -> [Vector3; 2] {
        let [a, b] = edges;
        match self {
            Self::Sides([p, s]) => [a / *p, b / *s],
            Self::Inverse(m) => [0, 1].map(|k| a * m[0][k] + b * m[1][k]),
        }
    }

    /// Derivatives by the edges, of those by the sides, times a factor.
    pub fn by_edges(&self, [p, s]: [Vector3; 2], factor: f64) -> [Vector3; 2] {
        match self {
            Self::Sides([first, second]) => [p * factor / *first, s * factor / *second],
            Self::Inverse(m) => [0, 1].map(|k| (p * m[k][0] + s * m[k][1]) * factor),
        }
    }
}

/// A corner whose distortion counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wedge {
    /// The corner, and where the edges from it lead, the second to the left of the first.
    pub nodes: [u32; 3],
    /// What these edges shall be.
    pub ideal: Ideal,
}

impl Wedge {
    /// The corner of a quad, with the ideal lengths of the sides that leave it.
    pub fn of_quad(quad: &[u32; 4], corner: usize, lengths: [f64; 2]) -> Self {
        Self {
            nodes: [0, 1, 3].map(|k| quad[(corner + k) % 4]),
            ideal: Ideal::Sides(lengths),
        }
    }
}

/// The elements of a mesh, whose vertices move.
///
/// An element is one quad or several; their corners are *nodes*: the vertices, and what follows from where these are.
pub trait Elements: Sync {
    /// What stops a flow.
    type Error: From<BackendError> + From<Cancelled>;
    /// Vertices of an element.
    type Rim: IntoIterator<Item = u32>;

    /// How many.
    fn count(&self) -> usize;
    /// The vertices of one, each once: those that its merit depends on.
    fn rim(&self, element: usize) -> Self::Rim;
    /// The elements around a vertex.
    fn around(&self, vertex: usize) -> &[u32];
    /// The corners whose distortion is lowered.
    fn wedges(&self) -> &[Wedge];
    /// Makes the ideal of each wedge what it is at these places.
    fn renew(&mut self, positions: &[Point3]);
    /// Some of them on their own, renewed at these places of their vertices; those are numbered as they are in `vertices`, which
    /// ascends. What has other elements around it does not move.
    fn part(&self, elements: &[usize], vertices: &[u32], positions: &[Point3]) -> Self;
    /// The unit normal along which each wedge is seen: of its quad by [`facing`], as the scaled Jacobian sees it, unless there are
    /// reasons. At a thin rim or in a narrow tunnel the surface's normal at the vertex may be that of another side, along which the
    /// best corner looks inverted, and all others would be spoiled for its sake.
    fn seen(&self, vertices: &Vertices<'_>) -> Vec<Vector3>;
    /// What a search raises, as [`upright_jacobian`](crate::mesh::quality::upright_jacobian).
    fn merit(&self, element: usize, places: &Places<'_>) -> f64;
    /// What the merit is at most, from the positions alone: many a place is refused by it, without a question to the surface.
    fn merit_at_most(&self, _element: usize, _places: &Places<'_>) -> f64 {
        f64::INFINITY
    }
    /// The square of a reasonable step of a vertex: the area of the quads around it.
    fn scale(&self, vertex: usize) -> f64;
    /// How long a step in a search is for a vertex.
    fn reach(&self, vertex: usize) -> f64 {
        self.scale(vertex).sqrt()
    }
    /// Where the nodes are.
    fn nodes<'p>(&self, positions: &'p [Point3]) -> Cow<'p, [Point3]> {
        Cow::Borrowed(positions)
    }
    /// What derivatives by the nodes are by the vertices.
    fn to_vertices(&self, gradient: Vec<Vector3>) -> Vec<Vector3> {
        gradient
    }
    /// ε of [`CornerDistortion::of`] where the smallest area is this, and whether the flow may end with it.
    fn epsilon(&self, smallest: f64) -> (f64, bool) {
        barrier(smallest)
    }
}

/// What an element is worth, its scaled Jacobian perhaps; the places of its own vertices decide it.
pub type Measure<E> = fn(&E, usize, &Places<'_>) -> f64;

/// How far a flow goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descent {
    /// What falls is the sum of this power of the distortions: the higher, the more the worst count.
    pub power: i32,
    /// Steps at most.
    pub steps: usize,
    /// The first of them, as a share of the reasonable one.
    pub first: f64,
    /// It stands still when the sum falls by less, relatively.
    pub tolerance: f64,
    /// Renews what is ideal at each step.
    pub renew: bool,
}

/// Which wedges each node is in, and as which of their nodes.
type AtNodes = Lists<(u32, u32)>;

/// Elements on their way.
pub struct Flow<'a, E> {
    /// The elements.
    pub elements: E,
    /// Their vertices.
    pub vertices: Vertices<'a>,
    /// Where distortions are computed, and who watches.
    pub run: On<'a>,
    seen: Vec<Vector3>,
    corners: Vec<Corner>,
    out: Vec<CornerDistortion>,
}

impl<'a, E: Elements> Flow<'a, E> {
    /// Nothing has moved yet.
    pub fn new(elements: E, vertices: Vertices<'a>, run: On<'a>) -> Self {
        Self {
            elements,
            vertices,
            run,
            seen: Vec::new(),
            corners: Vec::new(),
            out: Vec::new(),
        }
    }

    /// Steps down the sum of a power of all corners' distortions, back onto the surface after each; how many there were. `stepped`
    /// is called after each, and says whether to go on.
    ///
    /// # Errors
    /// Of the backend, and if the watcher asks to stop.
    pub fn descend(
        &mut self,
        how: &Descent,
        mut stepped: impl FnMut(&Self) -> bool,
    ) -> Result<usize, E::Error> {
        let mut length = how.first;
        let at_nodes = self.wedges_at_nodes();
        for step in 0..how.steps {
            (self.run).progress("better corners", step as u64, how.steps as u64)?;
            if how.renew {
                self.elements.renew(&self.vertices.positions);
            }
            let (epsilon, last) = self.measure()?;
            let before = self.energy(how.power);
            let lower = self.step(how.power, &at_nodes, (before, epsilon), &mut length)?;
            let Some(after) = lower else {
                return Ok(step);
            };
            let goes_on = stepped(self);
            if !goes_on || last && before - after < how.tolerance * before {
                return Ok(step + 1);
            }
        }
        Ok(how.steps)
    }

    /// The mean distortion of a corner.
    ///
    /// # Errors
    /// Of the backend.
    pub fn mean_distortion(&mut self) -> Result<f64, E::Error> {
        Ok(self.sum(1)? / self.out.len() as f64)
    }

    /// What falls, as it is seen now.
    fn sum(&mut self, power: i32) -> Result<f64, E::Error> {
        self.measure()?;
        Ok(self.energy(power))
    }

    /// The distortions as they are seen from now on; [`Elements::epsilon`].
    fn measure(&mut self) -> Result<(f64, bool), E::Error> {
        self.seen = self.elements.seen(&self.vertices);
        self.distortions(0.0)?;
        let (epsilon, last) = self.elements.epsilon(self.smallest_area());
        if epsilon > 0.0 {
            self.distortions(epsilon)?;
        }
        Ok((epsilon, last))
    }

    fn distortions(&mut self, epsilon: f64) -> Result<(), E::Error> {
        let nodes = self.elements.nodes(&self.vertices.positions);
        let wedges = self.elements.wedges();
        let seen = &self.seen;
        self.corners.resize(wedges.len(), Corner::default());
        parallel::for_each(&mut self.corners, |w, corner| {
            let [o, a, b] = wedges[w].nodes.map(|n| nodes[n as usize]);
            corner.sides = wedges[w].ideal.sides([a - o, b - o]);
            corner.normal = seen[w];
        });
        let backend = self.run.backend;
        backend.corner_distortion(&self.corners, epsilon, &mut self.out)?;
        let (found, of) = (self.out.len(), wedges.len());
        Ok(BackendError::unless(found == of, &backend.name(), || {
            format!("{found} distortions for {of} corners")
        })?)
    }

    fn energy(&self, power: i32) -> f64 {
        self.out.iter().map(|c| c.energy.powi(power)).sum()
    }

    fn smallest_area(&self) -> f64 {
        least(self.out.iter().map(|c| c.area))
    }

    /// For a descent, during which the wedges stay the same ones; between two of them the elements may be others.
    fn wedges_at_nodes(&self) -> AtNodes {
        let nodes = self.elements.nodes(&self.vertices.positions).len();
        let wedges = || (0..).zip(self.elements.wedges());
        let roles = |(w, wedge): (u32, &Wedge)| [0, 1, 2].map(|k| (wedge.nodes[k], (w, k as u32)));
        Lists::of(nodes, || wedges().flat_map(roles))
    }

    /// Displacements for a step of one: down the gradient within the surface, in units of the elements.
    fn descent(&self, power: i32, at_nodes: &AtNodes) -> Vec<Vector3> {
        let (elements, vertices, out) = (&self.elements, &self.vertices, &self.out);
        let wedges = elements.wedges();
        let mut slopes = vec![[Vector3::zeros(); 2]; wedges.len()];
        parallel::for_each(&mut slopes, |w, slopes| {
            // Of the power, but for a factor.
            let steep = out[w].energy.powi(power - 1);
            *slopes = wedges[w].ideal.by_edges(out[w].gradient, steep);
        });
        let mut gradient = vec![Vector3::zeros(); at_nodes.count()];
        parallel::for_each(&mut gradient, |n, sum| {
            for &(w, role) in at_nodes.list(n) {
                let [first, second] = slopes[w as usize];
                *sum += match role {
                    0 => -(first + second),
                    1 => first,
                    _ => second,
                };
            }
        });
        let mut descent = elements.to_vertices(gradient);
        parallel::for_each(&mut descent, |v, g| {
            let n = vertices.normals[v];
            let scale = elements.scale(v);
            let step = -(*g - n * n.dot(g)) * scale;
            // No vertex jumps over its neighbours.
            let most = LONGEST * scale.sqrt();
            *g = match vertices.freedom[v] {
                Freedom::Fixed => Vector3::zeros(),
                _ if step.norm() > most => step * (most / step.norm()),
                _ => step,
            };
        });
        descent
    }

    /// One step that lowers the energy, and what it is then; `None` where none does.
    fn step(
        &mut self,
        power: i32,
        at_nodes: &AtNodes,
        (before, epsilon): (f64, f64),
        length: &mut f64,
    ) -> Result<Option<f64>, E::Error> {
        let descent = self.descent(power, at_nodes);
        let start = self.vertices.state();
        for _ in 0..12 {
            // Corners are seen as for the gradient: on a surface of large triangles normals change faster than anything else.
            let (positions, normals) = self.vertices.stepped_from(&start, &descent, *length);
            self.vertices.positions = positions;
            self.distortions(epsilon)?;
            let energy = self.energy(power);
            let upright = epsilon > 0.0 || self.smallest_area() > 0.0;
            if energy < before && upright {
                self.vertices.normals = normals;
                *length = (*length * 1.5).min(1.0);
                return Ok(Some(energy));
            }
            *length *= 0.5;
        }
        self.vertices.put(start);
        Ok(None)
    }

    /// What is measured, of each element.
    pub fn values(&self, of: Measure<E>) -> Vec<f64> {
        let places = Places::of(&self.vertices);
        parallel::map(self.elements.count(), |e| of(&self.elements, e, &places))
    }

    /// The mean of that.
    pub fn mean(&self, of: Measure<E>) -> f64 {
        mean(&self.values(of))
    }

    /// The least of that.
    pub fn worst(&self, of: Measure<E>) -> f64 {
        least(self.values(of))
    }
}

/// Unit normal of a quad, that of its area; the surface's where it lies on its back, for it to turn over.
pub fn facing(corners: &[Point3; 4], of_surface: &Vector3) -> Option<Vector3> {
    let own = (corners[2] - corners[0]).cross(&(corners[3] - corners[1]));
    let own = own.try_normalize(0.0).filter(|n| n.dot(of_surface) > 0.0);
    own.or_else(|| of_surface.try_normalize(1e-9))
}

/// [`Elements::epsilon`] that becomes 0, an infinite barrier, once no corner is inverted or nearly so: no flow ends before.
pub fn barrier(smallest: f64) -> (f64, bool) {
    if smallest <= 1e-3 {
        ((0.5 * smallest.abs()).max(1e-2), false)
    } else {
        (0.0, true)
    }
}

/// The least of some values; infinite without any.
pub fn least(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::INFINITY, f64::min)
}

/// Their mean; 0 without any.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
