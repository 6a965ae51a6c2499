//! A frame per triangle, and the angles between the frames of neighbours.

use std::f64::consts::FRAC_PI_2;

use geom_core::id::Id;
use geom_core::mesh::Halfedges;
use geom_core::surface::curvature;
use geom_core::surface::laplace::{self, EdgeWeights};
use geom_core::{HalfedgeId, TriMesh, Vector3, VertexId};

use crate::Error;

/// A quarter turn.
pub(crate) const QUARTER: f64 = FRAC_PI_2;

/// The frame of each triangle is its first side, made a unit vector, and the vector a quarter turn to
/// the left of it, seen from outside. The **transport** κ of a half-edge turns angles in the frame of its
/// triangle into angles in that of its twin's: the two triangles laid flat (Crane, Desbrun and Schröder,
/// *Trivial connections on discrete surfaces*, 2010).
#[derive(Clone, Debug)]
pub struct Frames {
    edges: Halfedges<3>,
    axes: Vec<[Vector3; 2]>,
    side_angle: Vec<f64>,
    transport: Vec<f64>,
    weight: Vec<f64>,
    defect: Vec<f64>,
    areas: Vec<f64>,
}

impl Frames {
    /// The frames of an oriented manifold, perhaps with boundary, without flat triangles.
    ///
    /// # Errors
    /// [`Error::Mesh`] if three triangles meet at an edge or two of them disagree about its sense; [`Error::Operator`]
    /// for a triangle without area, which has no frame.
    pub fn of(mesh: &TriMesh, weights: EdgeWeights) -> Result<Self, Error> {
        let edges = Halfedges::of(mesh)?;
        let connection = laplace::connection(mesh, 4, weights)?;
        let axes = axes(mesh);
        let side_angle = side_angles(mesh, &axes);
        let (mut transport, mut weight) = (vec![0.0; edges.len()], vec![0.0; edges.len()]);
        // The core lists the transports by the lower half-edge of each interior edge.
        let interior = edges.edges().filter(|&h| edges.twin(h).is_some());
        for (h, t) in interior.zip(&connection.transports) {
            let twin = edges.twin(h).expect("interior");
            transport[h.index()] = t.angle;
            transport[twin.index()] = -t.angle;
            weight[h.index()] = t.weight;
            weight[twin.index()] = t.weight;
        }
        Ok(Self {
            edges,
            axes,
            side_angle,
            transport,
            weight,
            defect: curvature::angle_defects(mesh),
            areas: connection.areas,
        })
    }

    /// Which vertices are at most so many edges away from one of these.
    pub(crate) fn within(&self, vertices: &[usize], rings: usize) -> Vec<bool> {
        let mut near = vec![false; self.edges.vertices()];
        vertices.iter().for_each(|&v| near[v] = true);
        for _ in 0..rings {
            let before = near.clone();
            for [a, b] in self.sides().filter(|&[a, b]| before[a] || before[b]) {
                (near[a], near[b]) = (true, true);
            }
        }
        near
    }

    /// The ends of every half-edge.
    pub(crate) fn sides(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        (0..self.edges.len()).map(|h| [self.from(h), self.to(h)])
    }

    /// The connectivity.
    pub fn edges(&self) -> &Halfedges<3> {
        &self.edges
    }
    /// Number of triangles.
    pub fn faces(&self) -> usize {
        self.axes.len()
    }
    /// The axes of a triangle's frame: unit vectors in its plane.
    pub fn axes(&self, face: usize) -> [Vector3; 2] {
        self.axes[face]
    }
    /// The angle of a half-edge in the frame of its triangle.
    /// Half-edge `3 f + k` leads from corner k of triangle f to the next one. The angle lies within ±π, and that of
    /// side 0 is 0.
    pub fn side_angle(&self, halfedge: usize) -> f64 {
        self.side_angle[halfedge]
    }
    /// κ: a direction of angle t in the frame of the half-edge's triangle has the angle t + κ in that of
    /// its twin's. 0 on a boundary.
    pub fn transport(&self, halfedge: usize) -> f64 {
        self.transport[halfedge]
    }
    /// The weight of the edge in the energy; 0 on a boundary.
    pub fn weight(&self, halfedge: usize) -> f64 {
        self.weight[halfedge]
    }
    /// Gaussian curvature gathered at a vertex, radians.
    pub fn defect(&self, vertex: usize) -> f64 {
        self.defect[vertex]
    }
    /// The areas of the triangles, Å².
    pub fn areas(&self) -> &[f64] {
        &self.areas
    }
    /// The direction of an angle in a triangle's frame.
    pub fn direction(&self, face: usize, angle: f64) -> Vector3 {
        let [first, second] = self.axes[face];
        first * angle.cos() + second * angle.sin()
    }
    /// The angle of a direction, projected to the triangle's plane.
    /// Within ±π; a direction along the normal has none, and 0 stands for it.
    pub fn angle(&self, face: usize, direction: &Vector3) -> f64 {
        let [first, second] = self.axes[face];
        second.dot(direction).atan2(first.dot(direction))
    }
    /// The twin of a half-edge by number.
    pub(crate) fn twin(&self, halfedge: usize) -> Option<usize> {
        let twin = self.edges.twins()[halfedge];
        (twin != u32::MAX).then_some(twin as usize)
    }
    /// The vertex a half-edge starts from.
    pub(crate) fn from(&self, halfedge: usize) -> usize {
        self.edges.from(HalfedgeId(halfedge as u32)).index()
    }
    /// The vertex a half-edge leads to.
    pub(crate) fn to(&self, halfedge: usize) -> usize {
        self.from(next(halfedge))
    }
    /// Is a vertex on the boundary?
    pub(crate) fn on_boundary(&self, vertex: usize) -> bool {
        self.edges.on_boundary(VertexId(vertex as u32))
    }
    /// The half-edges out of a vertex, counter-clockwise.
    pub(crate) fn around(&self, vertex: usize) -> impl Iterator<Item = usize> + '_ {
        self.edges
            .around(VertexId(vertex as u32))
            .map(|h| h.index())
    }
    /// Interior edges by their lower half-edge, with the twin.
    pub(crate) fn interior(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.edges.len()).filter_map(|h| self.twin(h).filter(|&t| t > h).map(|t| (h, t)))
    }
}

/// The half-edge after this one in its triangle.
pub(crate) fn next(halfedge: usize) -> usize {
    if halfedge % 3 == 2 {
        halfedge - 2
    } else {
        halfedge + 1
    }
}

/// The half-edge before this one in its triangle.
pub(crate) fn previous(halfedge: usize) -> usize {
    if halfedge.is_multiple_of(3) {
        halfedge + 2
    } else {
        halfedge - 1
    }
}

/// The rest of an angle after the nearest multiple of a quarter turn, within ±π/4.
pub(crate) fn modulo_quarter(angle: f64) -> f64 {
    angle - (angle / QUARTER).round() * QUARTER
}

fn axes(mesh: &TriMesh) -> Vec<[Vector3; 2]> {
    (0..mesh.triangles().len())
        .map(|t| {
            let [a, b, _] = mesh.corners(t);
            let first = (b - a).normalize();
            let normal = mesh.doubled_area_normal(t).normalize();
            [first, normal.cross(&first)]
        })
        .collect()
}

fn side_angles(mesh: &TriMesh, axes: &[[Vector3; 2]]) -> Vec<f64> {
    axes.iter()
        .enumerate()
        .flat_map(|(t, [first, second])| {
            let p = mesh.corners(t);
            [0, 1, 2].map(|k| {
                let side = p[(k + 1) % 3] - p[k];
                second.dot(&side).atan2(first.dot(&side))
            })
        })
        .collect()
}
