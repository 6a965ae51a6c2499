//! The surface on which vertices stay.

use geom_core::mesh::Halfedges;
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, TriMesh, Vector3, VertexId};
use rayon::prelude::*;

use crate::Error;
use crate::mesh::TMesh;

/// Lines that turn by more than this in a vertex have a corner there: cos 40°.
const STRAIGHT: f64 = 0.766;

/// How a vertex may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Freedom {
    /// On the surface.
    Surface,
    /// Along the boundary or a sharp edge.
    Line,
    /// Not at all: its corners.
    Fixed,
}

/// Vertices within this share of the surface's size lie on a sharp edge.
const NEAR: f64 = 1e-7;

/// A surface, and its boundary and sharp edges if they are needed.
pub(crate) struct Ground<'a> {
    surface: &'a TriMesh,
    tree: TriangleTree,
    normals: Vec<Vector3>,
    /// Sharp edges, then boundary.
    lines: Vec<[Point3; 2]>,
    sharp: usize,
}

impl<'a> Ground<'a> {
    /// Sharp edges are those whose triangles' normals differ by more than `crease` degrees.
    pub(crate) fn new(
        surface: &'a TriMesh,
        crease: Option<f64>,
        with_boundary: bool,
    ) -> Result<Self, Error> {
        let mut lines = Vec::new();
        let mut sharp = 0;
        if with_boundary || crease.is_some() {
            let edges = Halfedges::of(surface)?;
            let at = |v: VertexId| surface.positions()[v.0 as usize];
            let ends = |h| [at(edges.from(h)), at(edges.to(h))];
            if let Some(degrees) = crease {
                let least = degrees.to_radians().cos();
                let normal = |h| surface.doubled_area_normal(edges.face(h).0 as usize);
                let is_sharp = |&h: &_| {
                    edges.twin(h).is_some_and(|t| {
                        let (a, b) = (normal(h), normal(t));
                        a.dot(&b) < least * a.norm() * b.norm()
                    })
                };
                lines.extend(edges.edges().filter(is_sharp).map(ends));
                sharp = lines.len();
            }
            lines.extend(edges.iter().filter(|&h| edges.twin(h).is_none()).map(ends));
        }
        Ok(Self {
            surface,
            tree: TriangleTree::new(surface)?,
            normals: surface.vertex_normals(),
            lines,
            sharp,
        })
    }

    /// The nearest allowed place, and the surface's normal there.
    pub(crate) fn pulled(&self, p: &Point3, freedom: Freedom) -> (Point3, Vector3) {
        let p = match freedom {
            Freedom::Line => on_line(&self.lines, p),
            _ => *p,
        };
        let closest = self.tree.closest(&p);
        let corners = self.surface.triangles()[closest.triangle as usize];
        let normal: Vector3 = (0..3)
            .map(|k| self.normals[corners[k] as usize] * closest.barycentric[k])
            .sum();
        let own = self.surface.doubled_area_normal(closest.triangle as usize);
        let normal = normal
            .try_normalize(1e-12)
            .or_else(|| own.try_normalize(0.0))
            .unwrap_or_else(Vector3::z);
        let at = if freedom == Freedom::Surface {
            closest.point
        } else {
            p
        };
        (at, normal)
    }

    /// Does the point lie on a sharp edge?
    fn is_sharp(&self, p: &Point3) -> bool {
        let near = NEAR * self.tree.bounds().diagonal();
        self.sharp > 0 && (on_line(&self.lines[..self.sharp], p) - p).norm() <= near
    }
}

/// The nearest point of some segments.
fn on_line(lines: &[[Point3; 2]], p: &Point3) -> Point3 {
    let on = |[a, b]: &[Point3; 2]| {
        let d = b - a;
        let part = (p - a).dot(&d) / d.norm_squared();
        // A segment without length is its end.
        let part = if part.is_finite() { part } else { 0.0 };
        a + d * part.clamp(0.0, 1.0)
    };
    let nearer = |a: &Point3, b: &Point3| (a - p).norm_squared().total_cmp(&(b - p).norm_squared());
    lines.iter().map(on).min_by(nearer).unwrap_or(*p)
}

/// How the vertices of the fine mesh may move: along lines that go straight through them, not at all where lines end, turn or
/// meet.
pub(crate) fn freedoms(mesh: &TMesh, ground: &Ground<'_>) -> Vec<Freedom> {
    let edges = mesh.fine_edges();
    let fine = mesh.fine().positions();
    let sharp: Vec<bool> = fine.par_iter().map(|p| ground.is_sharp(p)).collect();
    // The lines at each vertex: where they lead.
    let mut lines = vec![Vec::new(); fine.len()];
    for h in edges.edges() {
        let [a, b] = [edges.from(h), edges.to(h)].map(|v| v.0 as usize);
        let middle = geom_core::nalgebra::center(&fine[a], &fine[b]);
        let along = sharp[a] && sharp[b] && ground.is_sharp(&middle);
        if along || edges.twin(h).is_none() {
            lines[a].push(b);
            lines[b].push(a);
        }
    }
    let of = |(v, lines): (usize, &Vec<usize>)| {
        let direction = |w: usize| (fine[w] - fine[v]).normalize();
        match lines[..] {
            [] => Freedom::Surface,
            // Without a line on the surface there is nothing to slide along.
            [a, b] if !ground.lines.is_empty() && -direction(a).dot(&direction(b)) > STRAIGHT => {
                Freedom::Line
            }
            _ => Freedom::Fixed,
        }
    };
    lines.iter().enumerate().map(of).collect()
}
