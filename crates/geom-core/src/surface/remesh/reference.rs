//! The surface to follow, its features, and the wanted edge lengths.

use crate::compute::parallel;
use crate::mesh::quality::edge_lengths;
use crate::search::bvh::{Closest, TriangleTree};
use crate::surface::distance::{Graph, shortest_paths};
use crate::{ImplicitField, Point3, TriMesh, Vector3};

use super::mesh::{Kind, Mark, Mesh, Vertex};
use super::refine::{Spots, middles};
use super::{Deviation, Error, Features, Options, Sizing};

/// A kept curve that turns by more than this within a wanted edge has a corner there: cos 45°.
const CORNER: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Least cosine between the normals of the level set and of the input.
const AGREE: f64 = 0.3;
/// Most Newton steps towards the level set.
const NEWTON: usize = 12;
/// A last step of this share of an edge leaves less than can be seen.
pub(super) const EXACT: f64 = 1e-4;
/// Growth per Å of lengths that are shorter than the uniform one asked for.
const GRADATION: f64 = 0.3;
/// As short as such lengths may become, in units of the one asked for.
const SHORTEST: f64 = 1.0 / 16.0;

/// Wanted lengths at the vertices of the input.
enum Sizes {
    Same(f64),
    PerVertex(Vec<f64>),
}

/// Kept curves of the input as segments.
struct Curves {
    /// Segments as triangles without area.
    tree: TriangleTree,
    ends: Vec<[u32; 2]>,
}

/// Where a kept curve runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Course {
    /// Where the surface ends: it stays where the input has it.
    Boundary,
    /// Across a smooth surface, which it follows.
    Within,
    /// Along a crease of the input; there is no normal.
    Crease,
}

impl Course {
    pub(super) fn of_edge(mesh: &Mesh, h: u32) -> Self {
        match (mesh.mark(h), mesh.twin(h)) {
            (Mark::Crease, _) => Self::Crease,
            (_, None) => Self::Boundary,
            _ => Self::Within,
        }
    }

    pub(super) fn of_vertex(mesh: &Mesh, v: u32) -> Self {
        if on_crease(mesh, v) {
            Self::Crease
        } else if mesh.on_boundary(v) {
            Self::Boundary
        } else {
            Self::Within
        }
    }
}

pub(super) struct Reference<'a> {
    input: TriMesh,
    tree: TriangleTree,
    /// Normals per corner, smooth across all edges but creases.
    normals: Vec<[Vector3; 3]>,
    curves: Option<Curves>,
    sizes: Sizes,
    /// Where edges are shorter than asked for.
    pub(super) spots: Spots,
    /// As short as they may become, Å.
    shortest: f64,
    /// How far the result may be from the surface, Å.
    pub(super) allowed: f64,
    field: Option<(&'a dyn ImplicitField, f64)>,
}

impl<'a> Reference<'a> {
    /// The reference of the input, and the kinds, normals and sizes of the working mesh's vertices.
    pub(super) fn new(
        input: TriMesh,
        field: Option<&'a dyn ImplicitField>,
        options: &Options,
        work: &mut Mesh,
    ) -> Result<Self, Error> {
        let sizes = sizes(&input, &options.sizing)?;
        mark_features(work, &input, &options.features, &sizes)?;
        let normals = corner_normals(work, &input);
        let estimate = expected_triangles(&input, &sizes);
        let limit = options.max_triangles;
        // What is not a number is too large to be one.
        if estimate.is_nan() || estimate > limit as f64 {
            let estimate = estimate.max(0.0).min(u64::MAX as f64) as u64;
            return Err(Error::TooMany { estimate, limit });
        }
        let segments: Vec<[u32; 2]> = work
            .edges()
            .filter(|&h| work.is_feature(h))
            .map(|h| [work.from(h), work.to(h)])
            .collect();
        let tree = TriangleTree::new(&input).expect("not empty");
        let curves = (!segments.is_empty()).then(|| Curves::new(&input, segments));
        let field = field.map(|field| (field, options.level));
        let (slope, shortest) = match options.sizing {
            Sizing::Uniform { .. } => (GRADATION, sizes.longest() * SHORTEST),
            Sizing::Curvature {
                min_edge,
                gradation,
                ..
            } => (gradation, min_edge),
        };
        let allowed = options.max_deviation.unwrap_or(match options.sizing {
            Sizing::Uniform { .. } => 0.3 * sizes.longest(),
            Sizing::Curvature { tolerance, .. } => 2.0 * tolerance,
        });
        let reference = Self {
            allowed,
            spots: Spots::new(slope, sizes.longest()),
            shortest,
            input,
            tree,
            normals,
            curves,
            sizes,
            field,
        };
        let kinds = kinds(work, &reference.sizes);
        for v in 0..work.vertices.len() as u32 {
            if !work.is_alive(v) {
                continue;
            }
            let kind = kinds[v as usize];
            let h = work.fan(v).next().expect("alive");
            let normal = if on_crease(work, v) {
                Vector3::zeros()
            } else {
                reference.normals[(h / 3) as usize][(h % 3) as usize]
            };
            let wanted = reference.sizes.at(v);
            let position = work.position(v);
            work.vertices[v as usize] = Vertex {
                position,
                normal,
                size: wanted,
                wanted,
                active: true,
                kind,
            };
        }
        Ok(reference)
    }

    /// The point of the surface near `p`, for a vertex inside of it: of the level set if that is near
    /// and faces the way the input does, else of the input, which may have necks and tunnels that
    /// the level set has not. `reach` says how far it may be; `None` when it is farther.
    pub(super) fn on_surface(&self, p: &Point3, reach: f64) -> Option<Vertex> {
        self.about_on_surface(p, reach, EXACT)
    }

    /// The same, nearly: the point is within about `tolerance²` edges of the level set.
    pub(super) fn about_on_surface(
        &self,
        p: &Point3,
        reach: f64,
        tolerance: f64,
    ) -> Option<Vertex> {
        self.on_level(p, reach, tolerance)
            .or_else(|| self.on_input(p, reach))
    }

    /// Is there a level set?
    pub(super) fn has_level(&self) -> bool {
        self.field.is_some()
    }

    /// Does `vertex` follow the input, as there is no level set or not here?
    pub(super) fn is_off_level(&self, vertex: &Vertex) -> bool {
        self.first_order(&vertex.position)
            .is_none_or(|d| d > 1e-3 * vertex.size)
    }

    pub(super) fn on_level(&self, p: &Point3, reach: f64, tolerance: f64) -> Option<Vertex> {
        let (field, level) = self.field?;
        let (position, normal) = level_point(field, level, p, reach, tolerance)?;
        let foot = self.tree.closest(&position);
        if normal.dot(&self.normal_at(&foot)) < AGREE {
            return None;
        }
        Some(self.vertex(position, normal, self.wanted_at(&foot), Kind::Smooth))
    }

    fn on_input(&self, p: &Point3, reach: f64) -> Option<Vertex> {
        let foot = self.tree.closest_within(p, reach)?;
        let (normal, wanted) = (self.normal_at(&foot), self.wanted_at(&foot));
        Some(self.vertex(foot.point, normal, wanted, Kind::Smooth))
    }

    /// A vertex of the length that is wanted there now, given the one that was asked for.
    pub(super) fn vertex(
        &self,
        position: Point3,
        normal: Vector3,
        wanted: f64,
        kind: Kind,
    ) -> Vertex {
        let (size, active) = self.spots.at(&position, wanted);
        Vertex {
            position,
            normal,
            size,
            wanted,
            active,
            kind,
        }
    }

    fn normal_at(&self, foot: &Closest) -> Vector3 {
        let t = foot.triangle as usize;
        (0..3)
            .map(|k| self.normals[t][k] * foot.barycentric[k])
            .sum::<Vector3>()
            .try_normalize(1e-6)
            .unwrap_or_else(|| self.input.doubled_area_normal(t).normalize())
    }

    /// The length asked for near `p`, Å.
    pub(super) fn wanted_near(&self, p: &Point3) -> f64 {
        match &self.sizes {
            Sizes::Same(size) => *size,
            Sizes::PerVertex(_) => self.wanted_at(&self.tree.closest(p)),
        }
    }

    fn wanted_at(&self, foot: &Closest) -> f64 {
        match &self.sizes {
            Sizes::Same(size) => *size,
            Sizes::PerVertex(sizes) => {
                let corners = self.input.triangles()[foot.triangle as usize];
                (0..3)
                    .map(|k| sizes[corners[k] as usize] * foot.barycentric[k])
                    .sum()
            }
        }
    }

    /// The point near `p` of the kept curves that run as `course` says.
    pub(super) fn on_curve(&self, p: &Point3, reach: f64, course: Course) -> Option<Vertex> {
        let curves = self.curves.as_ref()?;
        let foot = curves.tree.closest_within(p, reach)?;
        let [a, b] = curves.ends[foot.triangle as usize];
        let along = 1.0 - foot.barycentric[0];
        let wanted = self.sizes.at(a) * (1.0 - along) + self.sizes.at(b) * along;
        let on_input = || (foot.point, self.normal_at(&self.tree.closest(&foot.point)));
        let (position, normal) = match (course, self.field) {
            (Course::Crease, _) => (foot.point, Vector3::zeros()),
            (Course::Within, Some(_)) => match self.on_level(&foot.point, reach, EXACT) {
                Some(there) => (there.position, there.normal),
                None => on_input(),
            },
            (Course::Within | Course::Boundary, _) => on_input(),
        };
        Some(self.vertex(position, normal, wanted, Kind::Curve))
    }

    /// From `p` to the level set, to first order, if there is one.
    fn first_order(&self, p: &Point3) -> Option<f64> {
        let (field, level) = self.field?;
        let (value, gradient) = field.value_gradient(p);
        Some((value - level).abs() / gradient.norm().max(f64::MIN_POSITIVE))
    }

    /// From `p` to the surface: to the level set if that is nearer than `reach`, else to the nearer of
    /// it and the input.
    pub(super) fn distance(&self, p: &Point3, reach: f64) -> f64 {
        let to_input = || self.tree.closest(p).distance;
        match self.first_order(p) {
            None => to_input(),
            // To first order is near enough where the surface is near.
            Some(d) if d <= 0.2 * reach => d,
            Some(_) => {
                let (field, level) = self.field.expect("it has a first-order distance");
                let there = level_point(field, level, p, reach, EXACT);
                there
                    .map_or(f64::INFINITY, |(q, _)| (q - p).norm())
                    .min(to_input())
            }
        }
    }

    /// As short as edges may become near `p`, Å. Of a mesh without a level set nothing is known that is
    /// finer than its triangles.
    pub(super) fn shortest_near(&self, p: &Point3) -> f64 {
        if self.field.is_some() {
            return self.shortest;
        }
        let foot = self.tree.closest(p);
        let mut edges = edge_lengths(self.input.corners(foot.triangle as usize));
        edges.sort_by(f64::total_cmp);
        self.shortest.max(0.5 * edges[1])
    }

    /// Samples of the input: its vertices, the middles of its edges and triangles.
    pub(super) fn points(&self) -> Vec<Point3> {
        let mut used = vec![false; self.input.positions().len()];
        for &v in self.input.triangles().as_flattened() {
            used[v as usize] = true;
        }
        let vertices = self.input.positions().iter().zip(used);
        let mut points: Vec<Point3> = vertices.filter(|v| v.1).map(|v| *v.0).collect();
        points.extend(middles(&self.input));
        points
    }

    /// How many vertices of `mesh` does the level set not reach?
    pub(super) fn off_level(&self, mesh: &TriMesh) -> usize {
        let p = mesh.positions();
        let off = |p: &Point3| {
            self.first_order(p)
                .is_some_and(|d| d > 0.01 * self.wanted_near(p))
        };
        parallel::fold_chunks(p.len(), |range| p[range].iter().filter(|p| off(p)).count())
            .into_iter()
            .sum()
    }

    /// Of the vertices and of the edges' middles and centroids of `mesh`.
    pub(super) fn deviations(&self, mesh: &TriMesh) -> (Deviation, Deviation) {
        let reach = self.allowed.min(self.sizes.longest());
        let of = |n: usize, point: &(dyn Fn(usize) -> Point3 + Sync)| {
            let parts = parallel::fold_chunks(n, |range| {
                range.fold((0.0, 0.0f64), |(sum, max), i| {
                    let d = self.distance(&point(i), reach);
                    (sum + d, max.max(d))
                })
            });
            let (sum, max) = parts
                .iter()
                .fold((0.0, 0.0f64), |(sum, max), p| (sum + p.0, max.max(p.1)));
            Deviation {
                mean: sum / n as f64,
                max,
            }
        };
        let vertices = of(mesh.positions().len(), &|v| mesh.positions()[v]);
        let middles = middles(mesh);
        (vertices, of(middles.len(), &|i| middles[i]))
    }
}

impl Sizes {
    fn at(&self, v: u32) -> f64 {
        match self {
            Self::Same(size) => *size,
            Self::PerVertex(sizes) => sizes[v as usize],
        }
    }

    fn longest(&self) -> f64 {
        match self {
            Self::Same(size) => *size,
            Self::PerVertex(sizes) => sizes
                .iter()
                .copied()
                .filter(|s| s.is_finite())
                .fold(0.0, f64::max),
        }
    }
}

impl Curves {
    fn new(input: &TriMesh, ends: Vec<[u32; 2]>) -> Self {
        let positions = ends
            .iter()
            .flat_map(|&[a, b]| [a, b, b].map(|v| input.positions()[v as usize]))
            .collect();
        let triangles = (0..ends.len() as u32)
            .map(|s| [3 * s, 3 * s + 1, 3 * s + 2])
            .collect();
        let segments = TriMesh::new(positions, triangles).expect("from a mesh");
        Self {
            tree: TriangleTree::new(&segments).expect("not empty"),
            ends,
        }
    }
}

/// Newton's way from `p` to the level, with a search along it; `None` when it leads farther than
/// `reach` or nowhere.
fn level_point(
    field: &dyn ImplicitField,
    level: f64,
    p: &Point3,
    reach: f64,
    tolerance: f64,
) -> Option<(Point3, Vector3)> {
    let mut x = *p;
    let (mut value, mut gradient) = field.value_gradient(&x);
    for _ in 0..NEWTON {
        let slope = gradient.norm_squared();
        if !(slope > 0.0 && slope.is_finite()) {
            return None;
        }
        let step = gradient * ((level - value) / slope);
        // What a last step leaves is its square.
        if step.norm() <= tolerance * reach {
            return Some((x + step, -gradient / slope.sqrt()));
        }
        let mut t = (0.5 * reach / step.norm()).min(1.0);
        loop {
            let y = x + step * t;
            let (v, g) = field.value_gradient(&y);
            if (v - level).abs() < (value - level).abs() {
                (x, value, gradient) = (y, v, g);
                break;
            }
            t *= 0.5;
            if t < 1e-3 {
                return None;
            }
        }
        if (x - p).norm() > reach {
            return None;
        }
    }
    // A kinked field is followed slowly; what is left must be small all the same.
    let slope = gradient.norm();
    (slope > 0.0 && (value - level).abs() <= 1e-4 * reach * slope).then(|| (x, -gradient / slope))
}

fn mark_features(
    work: &mut Mesh,
    input: &TriMesh,
    features: &Features,
    sizes: &Sizes,
) -> Result<(), Error> {
    match features {
        Features::None => {}
        Features::Angle(degrees) => {
            let least = degrees.to_radians().cos();
            let normal = |h: u32| input.doubled_area_normal((h / 3) as usize).normalize();
            let sharp: Vec<u32> = work
                .edges()
                .filter(|&h| {
                    work.twin(h)
                        .is_some_and(|g| normal(h).dot(&normal(g)) < least)
                })
                .collect();
            for h in sharp {
                work.mark_crease(h);
            }
            for v in 0..work.vertices.len() as u32 {
                drop_spur(work, v, sizes.at(v));
            }
        }
        Features::Edges(edges) => {
            for (feature, &[from, to]) in edges.iter().enumerate() {
                let missing = Error::NoSuchEdge { feature, from, to };
                if from as usize >= work.vertices.len() || to as usize >= work.vertices.len() {
                    return Err(missing);
                }
                let leaving = work.fan(from).find(|&h| work.to(h) == to);
                let h = leaving.or_else(|| work.fan(to).find(|&h| work.to(h) == from));
                work.mark_crease(h.ok_or(missing)?);
            }
        }
    }
    Ok(())
}

fn on_crease(work: &Mesh, v: u32) -> bool {
    work.fan(v).any(|h| work.mark(h) == Mark::Crease)
}

/// Takes away a crease that begins at `v` and ends, or meets others, before a wanted edge is over: it
/// is noise.
fn drop_spur(work: &mut Mesh, v: u32, length: f64) {
    let creases = |work: &Mesh, v: u32| -> Vec<u32> {
        work.fan(v)
            .filter(|&h| work.mark(h) == Mark::Crease)
            .collect()
    };
    if work.on_boundary(v) {
        return;
    }
    let [mut h] = creases(work, v)[..] else {
        return;
    };
    let (mut chain, mut way) = (vec![h], work.length(h));
    while way < length {
        let w = work.to(h);
        let onward: Vec<u32> = creases(work, w)
            .into_iter()
            .filter(|&g| Some(g) != work.twin(h))
            .collect();
        let [next] = onward[..] else { break };
        if work.on_boundary(w) {
            break;
        }
        h = next;
        chain.push(h);
        way += work.length(h);
    }
    if way < length {
        for h in chain {
            work.unmark_crease(h);
        }
    }
}

/// What holds each vertex.
fn kinds(work: &Mesh, sizes: &Sizes) -> Vec<Kind> {
    let vertices = 0..work.vertices.len() as u32;
    let neighbours: Vec<Option<[u32; 2]>> = vertices
        .clone()
        .map(|v| {
            let ends: Vec<u32> = work.curve_ring(v).collect();
            <[u32; 2]>::try_from(ends).ok()
        })
        .collect();
    // The cosine by which a curve turns at a vertex, seen from a wanted edge away on both sides, and
    // the vertices within half of that.
    let turn = |v: u32| -> Option<(f64, Vec<u32>)> {
        let ends = neighbours[v as usize]?;
        let (p, length) = (work.position(v), sizes.at(v));
        let mut passed = Vec::new();
        let [u, w] = ends.map(|first| {
            let (mut before, mut here, mut way) = (v, first, 0.0);
            loop {
                let (a, b) = (work.position(before), work.position(here));
                let step = (b - a).norm();
                if way + step >= length {
                    return a + (b - a) * ((length - way) / step) - p;
                }
                way += step;
                if way <= 0.5 * length {
                    passed.push(here);
                }
                match neighbours[here as usize] {
                    Some([x, y]) if here != v => {
                        (before, here) = (here, if x == before { y } else { x });
                    }
                    _ => return b - p,
                }
            }
        });
        let cosine = -u.dot(&w) / (u.norm() * w.norm()).max(f64::MIN_POSITIVE);
        Some((cosine, passed))
    };
    // Where labels meet, the line follows the input's edges in zigzag: no corners.
    let turns: Vec<Option<(f64, Vec<u32>)>> = vertices
        .clone()
        .map(|v| match neighbours[v as usize] {
            Some(_) if Course::of_vertex(work, v) != Course::Within => turn(v),
            _ => None,
        })
        .collect();
    vertices
        .map(|v| {
            if neighbours[v as usize].is_none() {
                let inside = work.curve_ring(v).next().is_none();
                return if inside { Kind::Smooth } else { Kind::Corner };
            }
            let Some((cosine, passed)) = &turns[v as usize] else {
                return Kind::Curve;
            };
            // Of a bend that several vertices see, the sharpest is the corner.
            let sharpest = passed.iter().all(|&w| match &turns[w as usize] {
                Some((other, _)) => (*cosine, v) < (*other, w),
                None => true,
            });
            if *cosine < CORNER && sharpest {
                Kind::Corner
            } else {
                Kind::Curve
            }
        })
        .collect()
}

/// Per corner the mean normal of the triangles around the vertex up to the next creases, weighted
/// by their angles.
fn corner_normals(work: &Mesh, input: &TriMesh) -> Vec<[Vector3; 3]> {
    let weighted = |h: u32| {
        let (t, k) = ((h / 3) as usize, (h % 3) as usize);
        let p = input.corners(t);
        let (u, w) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
        input.doubled_area_normal(t).normalize() * u.angle(&w)
    };
    let mut normals = vec![[Vector3::zeros(); 3]; input.triangles().len()];
    for v in 0..work.vertices.len() as u32 {
        let mut fan: Vec<u32> = work.fan(v).collect();
        // Lets the fan start at a crease or boundary, so that sectors do not wrap around.
        let ends = |h: u32| work.mark(h) == Mark::Crease || work.twin(h).is_none();
        let start = fan.iter().position(|&h| ends(h)).unwrap_or(0);
        fan.rotate_left(start);
        let mut first = 0;
        while first < fan.len() {
            let end = (first + 1..fan.len())
                .find(|&i| ends(fan[i]))
                .unwrap_or(fan.len());
            let sum: Vector3 = fan[first..end].iter().map(|&h| weighted(h)).sum();
            for &h in &fan[first..end] {
                let own = input.doubled_area_normal((h / 3) as usize).normalize();
                normals[(h / 3) as usize][(h % 3) as usize] =
                    sum.try_normalize(1e-9).unwrap_or(own);
            }
            first = end;
        }
    }
    normals
}

fn sizes(input: &TriMesh, sizing: &Sizing) -> Result<Sizes, Error> {
    Ok(match *sizing {
        Sizing::Uniform {
            edge_length: Some(length),
        } => Sizes::Same(length),
        Sizing::Uniform { edge_length: None } => {
            let n = input.triangles().len();
            let sum = parallel::sum(n, |t| edge_lengths(input.corners(t)).iter().sum());
            Sizes::Same(sum / (3 * n) as f64)
        }
        Sizing::Curvature {
            tolerance,
            min_edge,
            max_edge,
            gradation,
        } => {
            let curvature = crate::surface::curvature::principal(input, 2);
            let wanted = curvature.iter().map(|c| {
                let largest = c.max.abs().max(c.min.abs());
                // For κ → 0 the root grows without bound, and for κ ε > 2 there is none.
                let squared = 6.0 * tolerance / largest - 3.0 * tolerance * tolerance;
                squared.max(0.0).sqrt().clamp(min_edge, max_edge)
            });
            // The largest lengths that grow no faster along edges than allowed.
            let sources: Vec<(u32, f64)> = (0..)
                .zip(wanted)
                .map(|(v, length)| (v, length / gradation))
                .collect();
            let paths = shortest_paths(&Graph::of_edges(input)?, &sources, f64::INFINITY)?;
            Sizes::PerVertex(paths.distance.iter().map(|d| d * gradation).collect())
        }
    })
}

/// Equilateral triangles of the wanted edge lengths on the area of the input.
fn expected_triangles(input: &TriMesh, sizes: &Sizes) -> f64 {
    parallel::sum(input.triangles().len(), |t| {
        let length = match sizes {
            Sizes::Same(length) => *length,
            Sizes::PerVertex(sizes) => {
                input.triangles()[t]
                    .iter()
                    .map(|&v| sizes[v as usize])
                    .sum::<f64>()
                    / 3.0
            }
        };
        let area = 0.5 * input.doubled_area_normal(t).norm();
        area / (3f64.sqrt() / 4.0 * length * length)
    })
}
