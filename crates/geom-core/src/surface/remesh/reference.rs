//! The surface to follow, its features, and the wanted edge lengths.
//!
//! Everything else in this folder asks here where a vertex may be, which way the surface faces there, and how long
//! edges shall be. Nothing of it changes but the spots, so that all threads may ask at once.

use crate::compute::parallel;
use crate::field::{End, Guard, Tangent, project};
use crate::mesh::quality::edge_lengths;
use crate::nalgebra::center;
use crate::search::bvh::{Closest, TriangleTree};
use crate::search::crossing::crossing_pairs;
use crate::{ImplicitField, Point3, TriMesh, Vector3};

use super::kept::{Course, corner_normals, kinds, mark_features, on_crease};
use super::mesh::{Kind, Mesh, Vertex};
use super::options::{Error, Options, Sizing};
use super::report::Deviation;
use super::sizes::{Sizes, Spots, expected_triangles, sizes};

/// Least cosine between the normals of the level set and of the input.
const AGREE: f64 = 0.3;
/// A last step of this share of an edge leaves less than can be seen.
pub(super) const EXACT: f64 = 1e-4;
/// Growth per Å of lengths that are shorter than the uniform one asked for.
const GRADATION: f64 = 0.3;
/// As short as such lengths may become, in units of the one asked for.
const SHORTEST: f64 = 1.0 / 16.0;

/// Kept curves of the input as segments.
struct Curves {
    /// Segments as triangles without area.
    tree: TriangleTree,
    ends: Vec<[u32; 2]>,
}

/// The surface that is followed: the input, and the level set where there is one. Where both disagree, because the
/// level set is farther than an edge or faces another way, the input decides: the topology is its.
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
        // Wanted lengths first: corners of features and noise are judged in their units.
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
        // What is kept is looked up as segments.
        let segments: Vec<[u32; 2]> = work
            .edges()
            .filter(|&h| work.is_feature(h))
            .map(|h| [work.from(h), work.to(h)])
            .collect();
        let tree = TriangleTree::new(&input).expect("not empty");
        let curves = (!segments.is_empty()).then(|| Curves::new(&input, segments));
        let field = field.map(|field| (field, options.level));
        // Where goals are missed, lengths may shrink so far and must grow so slowly.
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
        // What the working mesh's vertices know of all this.
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

    /// Do triangles of the input cross each other?
    pub(super) fn crosses_itself(&self) -> bool {
        !crossing_pairs(&self.input).is_empty()
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

    /// The point of the level set that the way along the gradient leads to, if it is no farther than `reach` and faces
    /// as the input does there.
    pub(super) fn on_level(&self, p: &Point3, reach: f64, tolerance: f64) -> Option<Vertex> {
        let (field, level) = self.field?;
        let (position, normal) = level_point(field, level, p, reach, tolerance)?;
        let foot = self.tree.closest(&position);
        if normal.dot(&self.normal_at(&foot)) < AGREE {
            return None;
        }
        Some(self.vertex(position, normal, self.wanted_at(&foot), Kind::Smooth))
    }

    /// The nearest point of the input, exactly, with the blended normal of its corners.
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

    /// Blended from the corners, which do not blend across creases; the triangle's own where they cancel.
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

    /// The length asked for at a point of the input, linear on its triangles.
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

    /// Samples of the input: its vertices, the middles of its edges and triangles. They stand for the input when the
    /// distance from it to the result is measured.
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

impl Curves {
    /// Each segment as a triangle with its second corner twice, at three places of their own.
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
    let guard = Guard {
        near: tolerance * reach,
        ..Guard::within(reach)
    };
    let look = |x| Some(Tangent::new(field, level, x));
    let found = project(Tangent::new(field, level, *p), &guard, look);
    let normal = -found.best.normal();
    match found.end {
        // What a last step leaves is its square.
        End::Near => Some((found.best.foot(), normal)),
        // A kinked field is followed slowly; what is left must be small all the same.
        End::Tired => {
            let close = found.best.distance().abs() <= 1e-4 * reach;
            close.then_some((found.best.at, normal))
        }
        End::Lost | End::Away => None,
    }
}

pub(super) fn centroid([a, b, c]: [Point3; 3]) -> Point3 {
    Point3::from((a.coords + b.coords + c.coords) / 3.0)
}

/// The middles of the edges and the centroids of the triangles.
fn middles(mesh: &TriMesh) -> Vec<Point3> {
    let mut points = Vec::with_capacity(5 * mesh.triangles().len() / 2);
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let p = mesh.corners(t);
        for k in 0..3 {
            // Of an edge between two triangles, once.
            if corners[k] < corners[(k + 1) % 3] {
                points.push(center(&p[k], &p[(k + 1) % 3]));
            }
        }
        points.push(centroid(p));
    }
    points
}
