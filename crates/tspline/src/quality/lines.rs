//! Lines that vertices keep to.

use geom_core::compute::parallel;
use geom_core::mesh::Halfedges;
use geom_core::surface::ground::{Freedom, on_segments};
use geom_core::{Point3, TriMesh, VertexId};

use crate::Error;
use crate::mesh::TMesh;

/// Lines that turn by more than this in a vertex have a corner there: cos 40°.
const STRAIGHT: f64 = 0.766;

/// Vertices within this share of the surface's size lie on a sharp edge.
const NEAR: f64 = 1e-7;

/// The lines of a surface that vertices keep to.
pub(crate) struct Lines {
    /// Sharp edges, then boundary.
    pub(crate) all: Vec<[Point3; 2]>,
    sharp: usize,
    /// How far from a sharp edge a point may be that lies on it, Å.
    near: f64,
}

impl Lines {
    /// Sharp edges are those whose triangles' normals differ by more than `crease` degrees.
    ///
    /// Without both, no half-edges are made, so that a surface that is no manifold is refused only where lines are
    /// asked for.
    pub(crate) fn of(
        surface: &TriMesh,
        crease: Option<f64>,
        with_boundary: bool,
    ) -> Result<Self, Error> {
        let mut all = Vec::new();
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
                all.extend(edges.edges().filter(is_sharp).map(ends));
                sharp = all.len();
            }
            all.extend(edges.iter().filter(|&h| edges.twin(h).is_none()).map(ends));
        }
        let near = NEAR * surface.bounds().diagonal();
        Ok(Self { all, sharp, near })
    }

    /// Does the point lie on a sharp edge?
    fn has(&self, p: &Point3) -> bool {
        self.sharp > 0 && (on_segments(&self.all[..self.sharp], p) - p).norm() <= self.near
    }
}

/// How the vertices of the fine mesh may move: along lines that go straight through them, not at all where lines end, turn or
/// meet.
///
/// An edge of the fine mesh is part of a sharp line if its ends and its middle lie on one: two ends alone may lie on
/// two lines.
pub(crate) fn freedoms(mesh: &TMesh, kept: &Lines) -> Vec<Freedom> {
    let edges = mesh.fine_edges();
    let fine = mesh.fine().positions();
    let sharp: Vec<bool> = parallel::map_each(fine, |p| kept.has(p));
    // The lines at each vertex: where they lead.
    let mut lines = vec![Vec::new(); fine.len()];
    for h in edges.edges() {
        let [a, b] = [edges.from(h), edges.to(h)].map(|v| v.0 as usize);
        let middle = geom_core::nalgebra::center(&fine[a], &fine[b]);
        let along = sharp[a] && sharp[b] && kept.has(&middle);
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
            [a, b] if !kept.all.is_empty() && -direction(a).dot(&direction(b)) > STRAIGHT => {
                Freedom::Line
            }
            _ => Freedom::Fixed,
        }
    };
    lines.iter().enumerate().map(of).collect()
}
