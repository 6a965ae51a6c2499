//! How good a quad mesh is.

use geom_core::compute::parallel;
use geom_core::mesh::Halfedges;
pub use geom_core::mesh::quality::{JacobianSummary, scaled_jacobian};
use geom_core::search::bvh::TriangleTree;
use geom_core::surface::ground::{Freedom, Ground};
use geom_core::{Point3, QuadMesh, TriMesh, Vector3, VertexId};

use super::extract::SurfacePoint;
use crate::Error;

/// Vertices by the number of quads around them.
///
/// The irregular ones inside satisfy Euler's equation: `Σ (4 − n) = 4 χ` over the vertices of a closed mesh, so that a sphere has
/// eight vertices of three quads at least, and on a torus those of three and of five balance.
///
/// ```
/// use crossfield::{geom_core::mesh::shapes, quads::quality::Valences};
/// let sphere = Valences::of(&shapes::quad_sphere(1.0, 4))?;
/// assert_eq!((sphere.interior[3], sphere.irregular()), (8, 8));
/// assert_eq!(Valences::of(&shapes::quad_torus(3.0, 1.0, 12, 6))?.irregular(), 0);
/// # Ok::<(), crossfield::Error>(())
/// ```
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
    ///
    /// Vertices of no quad are in entry 0, and are not irregular.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the quads are no oriented manifold.
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

/// The mean sides of a quad: of the first and third together, and of the others.
pub(super) fn mean_sides([a, b, c, d]: &[Point3; 4]) -> [Vector3; 2] {
    [((b - a) + (c - d)) / 2.0, ((d - a) + (c - b)) / 2.0]
}

/// How much longer than wide a quad is, at least 1; infinite for one without a width.
///
/// ```
/// use crossfield::geom_core::{Point3, Vector3};
/// use crossfield::quads::quality::{aspect_ratio, ratio_along};
/// let quad = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
/// assert!((aspect_ratio(&quad) - 3.0).abs() < 1e-12);
/// // Long along x is short along y.
/// assert!((ratio_along(&quad, &Vector3::y()).expect("a length") - 1.0 / 3.0).abs() < 1e-12);
/// ```
pub fn aspect_ratio(corners: &[Point3; 4]) -> f64 {
    let [first, second] = mean_sides(corners).map(|s| s.norm());
    first.max(second) / first.min(second)
}

/// The length of a quad along a direction over that across; `None` without a direction or length.
pub fn ratio_along(corners: &[Point3; 4], direction: &Vector3) -> Option<f64> {
    let sides = mean_sides(corners);
    let [first, second] = sides.map(|s| s.norm());
    let [along_first, along_second] = [0, 1].map(|k| sides[k].normalize().dot(direction).abs());
    let ratio = if along_first >= along_second {
        first / second
    } else {
        second / first
    };
    let fine = ratio.is_finite() && along_first.max(along_second) > 0.0;
    fine.then_some(ratio)
}

/// How much longer than wide the quads of a mesh are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct AspectSummary {
    /// Half of them at most.
    pub median: f64,
    /// All but one in twenty at most.
    pub percentile_95: f64,
    /// The longest.
    pub max: f64,
}

impl AspectSummary {
    /// Of these [`aspect_ratio`]s.
    pub fn of(mut ratios: Vec<f64>) -> Self {
        if ratios.is_empty() {
            return Self::default();
        }
        ratios.sort_by(f64::total_cmp);
        let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share) as usize];
        Self {
            median: at(0.5),
            percentile_95: at(0.95),
            max: at(1.0),
        }
    }
}

/// The largest distance between a quad mesh, its quads halved, and a surface, measured from the corners, midpoints and
/// centres of the triangles of either, Å: from the quads to the surface, and back.
///
/// Maxima over these samples, which may miss what lies between them.
///
/// # Errors
/// [`Error::Tree`] if one of the two has no triangle.
pub fn distances(quads: &QuadMesh, surface: &TriMesh) -> Result<[f64; 2], Error> {
    let halves = quads.clone().into_triangles();
    let one = |from: &TriMesh, to: &TriMesh| -> Result<f64, Error> {
        let tree = TriangleTree::new(to)?;
        // Vertices of no triangle are not on the surface.
        let mut is_corner = vec![false; from.positions().len()];
        let all = from.triangles().as_flattened();
        all.iter().for_each(|&v| is_corner[v as usize] = true);
        let corners = from.positions().iter().zip(is_corner);
        let mut samples: Vec<Point3> = corners.filter_map(|(p, is)| is.then_some(*p)).collect();
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

/// The scaled Jacobian of each quad, signed by the normals over it of the connected surface that it is on: those at its corners, and
/// those in between where they do not agree. (The nearest triangle alone does not tell the sign: where the surface is coarser than the quads
/// it may look elsewhere.)
///
/// # Errors
/// [`Error::Tree`] for a surface without triangles.
///
/// ```
/// use crossfield::{geom_core::mesh::shapes, quads::quality::scaled_jacobians};
/// let (quads, ball) = (shapes::quad_sphere(1.0, 8), shapes::icosphere(1.0, 3));
/// let jacobians = scaled_jacobians(&quads, &ball)?;
/// assert!(jacobians.iter().all(|&j| j > 0.8));
/// # Ok::<(), crossfield::Error>(())
/// ```
pub fn scaled_jacobians(mesh: &QuadMesh, surface: &TriMesh) -> Result<Vec<f64>, Error> {
    let ground = Ground::new(surface, Vec::new())?;
    let positions = mesh.positions();
    let normals = parallel::map_each(positions, |p| ground.pulled(p, Freedom::Surface).1);
    Ok(parallel::map_each(mesh.quads(), |quad| {
        let corners = quad.map(|v| positions[v as usize]);
        let normals = quad.map(|v| normals[v as usize]);
        scaled_jacobian(&corners, &ground.normal_over(&corners, &normals))
    }))
}

/// Where vertices lie on the surface.
pub(super) fn sources(mesh: &QuadMesh, tree: &TriangleTree) -> Result<Vec<SurfacePoint>, Error> {
    let closest = tree.closest_to_all(mesh.positions())?;
    Ok(closest.iter().map(SurfacePoint::of).collect())
}
