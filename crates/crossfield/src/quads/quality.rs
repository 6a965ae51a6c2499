//! How good a quad mesh is.

use geom_core::mesh::Halfedges;
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, QuadMesh, TriMesh, Vector3, VertexId};

use crate::Error;

/// The smallest signed sine between two sides that meet in a corner of a quad (the scaled Jacobian): 1 for a
/// rectangle, negative where a corner is turned inside out. Corners are seen along the quad's vector area, whose sign
/// is that of the surface's normal.
pub fn scaled_jacobian(corners: &[Point3; 4], surface_normal: &Vector3) -> f64 {
    let area = (corners[2] - corners[0]).cross(&(corners[3] - corners[1]));
    let Some(normal) = area.try_normalize(0.0) else {
        return -1.0;
    };
    let worst = (0..4)
        .map(|k| {
            let (next, previous) = (
                corners[(k + 1) % 4] - corners[k],
                corners[(k + 3) % 4] - corners[k],
            );
            let lengths = next.norm() * previous.norm();
            if lengths > 0.0 {
                next.cross(&previous).dot(&normal) / lengths
            } else {
                -1.0
            }
        })
        .fold(f64::INFINITY, f64::min);
    if normal.dot(surface_normal) < 0.0 {
        -worst.abs()
    } else {
        worst
    }
}

/// Scaled Jacobians of all quads of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct JacobianSummary {
    /// The smallest.
    pub min: f64,
    /// One in a hundred is smaller.
    pub percentile_1: f64,
    /// One in twenty is smaller.
    pub percentile_5: f64,
    /// The mean.
    pub mean: f64,
    /// Quads below 0.3.
    pub below_0_3: usize,
}

impl JacobianSummary {
    /// Of these values.
    pub fn of(values: &[f64]) -> Self {
        if values.is_empty() {
            return Self::default();
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
        Self {
            min: sorted[0],
            percentile_1: at(0.01),
            percentile_5: at(0.05),
            mean: values.iter().sum::<f64>() / values.len() as f64,
            below_0_3: values.iter().filter(|&&j| j < 0.3).count(),
        }
    }
}

/// Vertices by the number of quads around them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Valences {
    /// Inside: entry n counts the vertices of n quads.
    pub interior: Vec<usize>,
    /// On the boundary.
    pub boundary: Vec<usize>,
}

impl Valences {
    /// Of a manifold quad mesh.
    pub fn of(mesh: &QuadMesh) -> Result<Self, Error> {
        let edges = Halfedges::of_quads(mesh)?;
        let mut valences = Self::default();
        for v in (0..edges.vertices() as u32).map(VertexId) {
            let count = edges.around(v).count();
            let list = if edges.on_boundary(v) {
                &mut valences.boundary
            } else {
                &mut valences.interior
            };
            if list.len() <= count {
                list.resize(count + 1, 0);
            }
            list[count] += 1;
        }
        Ok(valences)
    }

    /// Vertices inside with other than four quads.
    pub fn irregular(&self) -> usize {
        let all: usize = self.interior.iter().sum();
        all - self.interior.get(4).copied().unwrap_or(0)
            - self.interior.first().copied().unwrap_or(0)
    }
}

/// The largest distance between a quad mesh, its quads halved, and a surface, measured from vertices, midpoints and
/// centres of either, Å: from the quads to the surface, and back.
pub fn distances(quads: &QuadMesh, surface: &TriMesh) -> Result<[f64; 2], Error> {
    let halves = quads.clone().into_triangles();
    let one = |from: &TriMesh, to: &TriMesh| -> Result<f64, Error> {
        let tree = TriangleTree::new(to)?;
        let mut samples = from.positions().to_vec();
        for t in 0..from.triangles().len() {
            let [a, b, c] = from.corners(t).map(|p| p.coords);
            samples.push(Point3::from((a + b + c) / 3.0));
            samples.extend([a + b, b + c, c + a].map(|s| Point3::from(s / 2.0)));
        }
        let closest = tree.closest_to_all(&samples)?;
        Ok(closest.iter().map(|c| c.distance).fold(0.0, f64::max))
    };
    Ok([one(&halves, surface)?, one(surface, &halves)?])
}
