//! The surface to follow, its features, and the wanted edge lengths.

use geom_core::bvh::{Closest, TriangleTree};
use geom_core::distance::{Graph, shortest_paths};
use geom_core::{ImplicitField, Point3, TriMesh, Vector3, parallel};

use super::mesh::{Kind, Mark, Mesh, Vertex};
use super::{Deviation, Error, Features, Options, Sizing};

/// A kept curve that turns by more than this has a corner there: cos 45°.
const CORNER: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Least cosine between the normals of the level set and of the input.
const AGREE: f64 = 0.3;
/// Most Newton steps towards the level set.
const NEWTON: usize = 12;

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
        mark_features(work, &input, &options.features)?;
        let normals = corner_normals(work, &input);
        let sizes = sizes(&input, &options.sizing);
        let estimate = expected_triangles(&input, &sizes);
        if estimate > options.max_triangles as f64 {
            let limit = options.max_triangles;
            return Err(Error::TooMany {
                estimate: estimate as u64,
                limit,
            });
        }
        let segments: Vec<[u32; 2]> = work
            .edges()
            .filter(|&h| work.is_feature(h))
            .map(|h| [work.from(h), work.to(h)])
            .collect();
        let tree = TriangleTree::new(&input).expect("not empty");
        let curves = (!segments.is_empty()).then(|| Curves::new(&input, segments));
        let field = field.map(|field| (field, options.level));
        let reference = Self {
            input,
            tree,
            normals,
            curves,
            sizes,
            field,
        };
        for v in 0..work.vertices.len() as u32 {
            if !work.is_alive(v) {
                continue;
            }
            let kind = kind(work, v);
            let h = work.fan(v).next().expect("alive");
            let normal = if on_crease(work, v) {
                Vector3::zeros()
            } else {
                reference.normals[(h / 3) as usize][(h % 3) as usize]
            };
            let size = match &reference.sizes {
                Sizes::Same(size) => *size,
                Sizes::PerVertex(sizes) => sizes[v as usize],
            };
            let position = work.position(v);
            work.vertices[v as usize] = Vertex {
                position,
                normal,
                size,
                kind,
            };
        }
        Ok(reference)
    }

    /// The point of the surface near `p`, for a vertex inside of it: of the level set if that is near
    /// and faces the way the input does, else of the input, which may have necks and tunnels that
    /// the level set has not. `reach` says how far it may be; `None` when it is farther.
    pub(super) fn on_surface(&self, p: &Point3, reach: f64) -> Option<Vertex> {
        self.on_level(p, reach).or_else(|| self.on_input(p, reach))
    }

    /// The same, but on the level set only if there is one and `near` lies on it: a small step must
    /// not lead away from it.
    pub(super) fn beside(&self, near: &Vertex, p: &Point3, reach: f64) -> Option<Vertex> {
        match self.field {
            Some(_) if self.distance(&near.position) <= 1e-3 * near.size => self.on_level(p, reach),
            Some(_) => self.on_surface(p, reach),
            None => self.on_input(p, reach),
        }
    }

    fn on_level(&self, p: &Point3, reach: f64) -> Option<Vertex> {
        let (field, level) = self.field?;
        let (position, normal) = level_point(field, level, p, reach)?;
        let foot = self.tree.closest(&position);
        if normal.dot(&self.normal_at(&foot)) < AGREE {
            return None;
        }
        Some(Vertex {
            position,
            normal,
            size: self.size_at(&foot),
            kind: Kind::Smooth,
        })
    }

    fn on_input(&self, p: &Point3, reach: f64) -> Option<Vertex> {
        let foot = self.tree.closest_within(p, reach)?;
        Some(Vertex {
            position: foot.point,
            normal: self.normal_at(&foot),
            size: self.size_at(&foot),
            kind: Kind::Smooth,
        })
    }

    fn normal_at(&self, foot: &Closest) -> Vector3 {
        let t = foot.triangle as usize;
        (0..3)
            .map(|k| self.normals[t][k] * foot.barycentric[k])
            .sum::<Vector3>()
            .try_normalize(1e-6)
            .unwrap_or_else(|| self.input.doubled_area_normal(t).normalize())
    }

    fn size_at(&self, foot: &Closest) -> f64 {
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
        let size = match &self.sizes {
            Sizes::Same(size) => *size,
            Sizes::PerVertex(sizes) => {
                sizes[a as usize] * (1.0 - along) + sizes[b as usize] * along
            }
        };
        let on_input = || (foot.point, self.normal_at(&self.tree.closest(&foot.point)));
        let (position, normal) = match (course, self.field) {
            (Course::Crease, _) => (foot.point, Vector3::zeros()),
            (Course::Within, Some(_)) => match self.on_level(&foot.point, reach) {
                Some(there) => (there.position, there.normal),
                None => on_input(),
            },
            (Course::Within | Course::Boundary, _) => on_input(),
        };
        Some(Vertex {
            position,
            normal,
            size,
            kind: Kind::Curve,
        })
    }

    fn distance(&self, p: &Point3) -> f64 {
        match self.field {
            Some((field, level)) => {
                let (value, gradient) = field.value_gradient(p);
                (value - level).abs() / gradient.norm().max(f64::MIN_POSITIVE)
            }
            None => self.tree.closest(p).distance,
        }
    }

    /// How many vertices of `mesh` does the level set not reach?
    pub(super) fn off_level(&self, mesh: &TriMesh) -> usize {
        if self.field.is_none() {
            return 0;
        }
        let p = mesh.positions();
        let off = |p: &Point3| {
            let size = match &self.sizes {
                Sizes::Same(size) => *size,
                Sizes::PerVertex(_) => self.size_at(&self.tree.closest(p)),
            };
            self.distance(p) > 0.01 * size
        };
        parallel::fold_chunks(p.len(), |range| p[range].iter().filter(|p| off(p)).count())
            .into_iter()
            .sum()
    }

    /// Of the vertices and of the centroids of `mesh`.
    pub(super) fn deviations(&self, mesh: &TriMesh) -> (Deviation, Deviation) {
        let of = |n: usize, point: &(dyn Fn(usize) -> Point3 + Sync)| {
            let parts = parallel::fold_chunks(n, |range| {
                range.fold((0.0, 0.0f64), |(sum, max), i| {
                    let d = self.distance(&point(i));
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
        let centroids = of(mesh.triangles().len(), &|t| {
            let [a, b, c] = mesh.corners(t);
            Point3::from((a.coords + b.coords + c.coords) / 3.0)
        });
        (vertices, centroids)
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
) -> Option<(Point3, Vector3)> {
    let mut x = *p;
    let (mut value, mut gradient) = field.value_gradient(&x);
    for _ in 0..NEWTON {
        let slope = gradient.norm_squared();
        if !(slope > 0.0 && slope.is_finite()) {
            return None;
        }
        let step = gradient * ((level - value) / slope);
        // Small against any edge: more would not be seen.
        if step.norm() <= 1e-7 * reach {
            return Some((x, -gradient / slope.sqrt()));
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

fn mark_features(work: &mut Mesh, input: &TriMesh, features: &Features) -> Result<(), Error> {
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

fn kind(work: &Mesh, v: u32) -> Kind {
    let ends: Vec<u32> = work.curve_ring(v).collect();
    match ends[..] {
        [] => Kind::Smooth,
        [a, b] => {
            let p = work.position(v);
            let [u, w] = [p - work.position(a), work.position(b) - p].map(|d| d.normalize());
            // Where labels meet, the line follows the input's edges in zigzag: no corners.
            if u.dot(&w) < CORNER && Course::of_vertex(work, v) != Course::Within {
                Kind::Corner
            } else {
                Kind::Curve
            }
        }
        _ => Kind::Corner,
    }
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

fn sizes(input: &TriMesh, sizing: &Sizing) -> Sizes {
    match *sizing {
        Sizing::Uniform {
            edge_length: Some(length),
        } => Sizes::Same(length),
        Sizing::Uniform { edge_length: None } => {
            let n = input.triangles().len();
            let sum = parallel::sum(n, |t| super::edge_lengths(input.corners(t)).iter().sum());
            Sizes::Same(sum / (3 * n) as f64)
        }
        Sizing::Curvature {
            tolerance,
            min_edge,
            max_edge,
            gradation,
        } => {
            let curvature = geom_core::curvature::principal(input, 2);
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
            let paths = shortest_paths(&Graph::of_edges(input), &sources, f64::INFINITY)
                .expect("every vertex is a node, every length positive");
            Sizes::PerVertex(paths.distance.iter().map(|d| d * gradation).collect())
        }
    }
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
