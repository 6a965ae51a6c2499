//! Curvature of triangle meshes: principal values and directions per vertex by fitted polynomials of third degree
//! (jets: Cazals and Pouget, CAGD 22, 2005), and the angle defect.
//!
//! ```
//! use geom_core::{mesh::shapes, surface::curvature};
//! let curvature = curvature::principal(&shapes::icosphere(2.0, 3), 2);
//! assert!(curvature.iter().all(|c| (c.max - 0.5).abs() < 0.02 && (c.min - 0.5).abs() < 0.02));
//! ```

use nalgebra::{Matrix2, SMatrix, SVector, SymmetricEigen};

use crate::compute::parallel;
use crate::{TriMesh, Vector3};

/// Curvature at a vertex. Positive where the surface is convex: a sphere of radius R with outward
/// normals has 1/R twice.
///
/// [`Principal::residual`] says whether the values can be trusted, [`Principal::confidence`] whether the directions
/// can: a sphere has good values and no directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Principal {
    /// The larger principal curvature, Å⁻¹.
    pub max: f64,
    /// The smaller principal curvature, Å⁻¹.
    pub min: f64,
    /// Unit direction of the larger one. `(max_direction, min_direction, normal)` is right-handed.
    pub max_direction: Vector3,
    /// Unit direction of the smaller one.
    pub min_direction: Vector3,
    /// Unit normal of the fitted surface, on the outer side.
    pub normal: Vector3,
    /// Distance of the neighbours from the fitted surface (rms) over the distance to them: 0 for a
    /// perfect fit.
    pub residual: f64,
    /// Trust in the *directions*, 0…1: `(max − min) / (|max| + |min|)`, which is 0 at an umbilic
    /// point, times `1 − 10 residual` (at least 0). 0 also where nothing could be fitted.
    pub confidence: f64,
}

impl Principal {
    /// Where nothing can be fitted: flat, and without trust.
    const UNKNOWN: Self = Self {
        max: 0.0,
        min: 0.0,
        max_direction: Vector3::new(1.0, 0.0, 0.0),
        min_direction: Vector3::new(0.0, 1.0, 0.0),
        normal: Vector3::new(0.0, 0.0, 1.0),
        residual: 1.0,
        confidence: 0.0,
    };

    /// Mean curvature, Å⁻¹. 1/R on a sphere of radius R.
    pub fn mean(&self) -> f64 {
        f64::midpoint(self.max, self.min)
    }
    /// Gaussian curvature, Å⁻². Negative at saddles. That of the fit, at a point; gathered over an area it is
    /// [`angle_defects`].
    pub fn gaussian(&self) -> f64 {
        self.max * self.min
    }
}

/// Most rings that are looked at around a vertex.
const MAX_RINGS: usize = 8;

/// Principal curvatures at every vertex, from a cubic height function fitted to the vertices of
/// `rings` rings around it (2 for smooth meshes, 3…5 for noisy ones; more rings where they hold too
/// few vertices): second-order convergent on smooth surfaces (Cazals and Pouget, *Estimating
/// differential quantities using polynomial fitting of osculating jets*, 2005). The cubic misses the
/// quartic term of the surface, on a sphere of radius R `d⁴/8R³` at the distance d from the vertex:
/// with the farthest vertex of the fit at the distance r, values there are right within the fraction
/// `r²/2R²`. Near boundaries and on tiny meshes a quadric is fitted, and where not even that can be,
/// confidence is 0.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::curvature;
/// let error = |levels: u32| {
///     let sphere = shapes::icosphere(2.0, levels);
///     let errors = curvature::principal(&sphere, 2)
///         .into_iter()
///         .map(|c| (c.max - 0.5).abs().max((c.min - 0.5).abs()));
///     errors.fold(0.0, f64::max)
/// };
/// // Two rings reach 0.15 R: 0.15²/2 of 0.5. Half the edges, a quarter of the error.
/// assert!(error(4) < 0.0056);
/// assert!(error(5) < error(4) / 3.5);
/// ```
///
/// More rings average noise away and blur what is smaller than they are. `rings` is taken as 1 to 8. All vertices have
/// an entry; unused ones, and those whose normals cancel, have confidence 0. Parallel; the time is that of a 10 × 10
/// factor and of some dozens of neighbours per vertex.
pub fn principal(mesh: &TriMesh, rings: usize) -> Vec<Principal> {
    let adjacency = Adjacency::of(mesh);
    let normals = mesh.vertex_normals();
    parallel::map_init(mesh.positions().len(), Vec::new, |near, v| {
        let normal = normals[v];
        if normal == Vector3::zeros() {
            return Principal::UNKNOWN;
        }
        adjacency.rings(v as u32, rings.clamp(1, MAX_RINGS), CUBIC + CUBIC / 2, near);
        let positions = mesh.positions();
        let around: Vec<Vector3> = near
            .iter()
            .map(|&w: &u32| positions[w as usize] - positions[v])
            .collect();
        fit::<CUBIC>(normal, &around)
            .or_else(|| fit::<QUADRIC>(normal, &around))
            .unwrap_or(Principal {
                normal,
                ..Principal::UNKNOWN
            })
    })
}

/// Coefficients of a quadric and of a cubic in two variables.
const QUADRIC: usize = 6;
const CUBIC: usize = 10;

/// The fit of [`principal`] over its largest neighbourhoods, for tests.
#[cfg(feature = "testing")]
#[doc(hidden)]
pub fn fit_cubic(normal: Vector3, around: &[Vector3]) -> Option<Principal> {
    fit::<CUBIC>(normal, around)
}

/// Fits `z = c₀ + c₁x + c₂y + c₃x² + c₄xy + c₅y² + …` over the tangent plane of `normal` to these
/// places relative to the vertex, and to the vertex itself; `None` when they do not determine it.
///
/// The normal equations of a weighted least-squares fit, by Cholesky: lengths are scaled to at most 1 first, which
/// keeps them solvable, and a weight that falls with the distance lets near vertices decide without silencing the far
/// ones. Curvatures are the eigenvalues of the shape operator of the fitted graph at the vertex, not those of its
/// quadratic part: the fit may be tilted against `normal`.
fn fit<const N: usize>(normal: Vector3, around: &[Vector3]) -> Option<Principal> {
    if around.len() + 1 < N {
        return None;
    }
    let u = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let w = normal.cross(&u);
    // Lengths in units of the farthest neighbour's, so that all coefficients are alike.
    let scale = around
        .iter()
        .map(|d| d.norm_squared())
        .fold(0.0, f64::max)
        .sqrt();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let terms = |d: &Vector3| {
        let (x, y) = (d.dot(&u) / scale, d.dot(&w) / scale);
        let all = [
            1.0,
            x,
            y,
            x * x,
            x * y,
            y * y,
            x * x * x,
            x * x * y,
            x * y * y,
            y * y * y,
        ];
        SVector::<f64, N>::from_fn(|k, _| all[k])
    };
    let height = |d: &Vector3| d.dot(&normal) / scale;
    let mut matrix = SMatrix::<f64, N, N>::zeros();
    let mut right = SVector::<f64, N>::zeros();
    for d in std::iter::once(&Vector3::zeros()).chain(around) {
        let t = terms(d);
        // Nearer neighbours count more.
        let weight = 1.0 / (0.1 + d.norm_squared() / (scale * scale));
        right += t * (height(d) * weight);
        // Column by column, down from the diagonal, which is all that the factorization reads. As a product of vectors it
        // took a third of the fit.
        for j in 0..N {
            let weighted = t[j] * weight;
            for i in j..N {
                matrix[(i, j)] += t[i] * weighted;
            }
        }
    }
    // Pivots of the scaled matrix far below the largest: the places lie on a curve of the degree.
    let cholesky = matrix.cholesky()?;
    let diagonal = cholesky.l_dirty().diagonal();
    if diagonal.min() < 1e-5 * diagonal.max() {
        return None;
    }
    let c = cholesky.solve(&right);
    let misfit: f64 = around
        .iter()
        .map(|d| (terms(d).dot(&c) - height(d)).powi(2))
        .sum();
    let residual = (misfit / around.len() as f64).sqrt();

    // First and second fundamental form of the graph at the vertex; outward is positive z, so a
    // convex surface bends down.
    let (p, q) = (c[1], c[2]);
    let length = (1.0 + p * p + q * q).sqrt();
    let first = Matrix2::new(1.0 + p * p, p * q, p * q, 1.0 + q * q);
    let second = Matrix2::new(2.0 * c[3], c[4], c[4], 2.0 * c[5]) / (-length * scale);
    // Symmetric in the orthonormal frame L⁻¹ of the first form.
    let inverse = first.cholesky()?.l().try_inverse()?;
    let eigen = SymmetricEigen::new(inverse * second * inverse.transpose());
    let (low, high) = if eigen.eigenvalues[0] <= eigen.eigenvalues[1] {
        (0, 1)
    } else {
        (1, 0)
    };
    let (max, min) = (eigen.eigenvalues[high], eigen.eigenvalues[low]);
    let (along_u, along_w) = (u + normal * p, w + normal * q);
    let normal = along_u.cross(&along_w).normalize();
    let in_plane = inverse.transpose() * eigen.eigenvectors.column(high);
    let max_direction = (along_u * in_plane[0] + along_w * in_plane[1]).normalize();
    let both = max.abs() + min.abs();
    let apart = if both > 0.0 { (max - min) / both } else { 0.0 };
    Some(Principal {
        max,
        min,
        max_direction,
        min_direction: normal.cross(&max_direction),
        normal,
        residual,
        confidence: apart * (1.0 - 10.0 * residual).max(0.0),
    })
}

/// Gaussian curvature gathered at each vertex, radians: 2π minus the angles around it, on a boundary
/// π minus them. The sum over all vertices is 2π times the Euler characteristic, whatever the mesh
/// (at a vertex with E edges and F triangles it is 2π − π (E − F) minus the angles, so that also
/// non-manifold meshes keep the sum). 0 at unused vertices.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::curvature;
/// let total: f64 = curvature::angle_defects(&shapes::icosphere(1.0, 2)).iter().sum();
/// assert!((total - 4.0 * std::f64::consts::PI).abs() < 1e-12);
/// ```
pub fn angle_defects(mesh: &TriMesh) -> Vec<f64> {
    use std::f64::consts::{PI, TAU};
    let adjacency = Adjacency::of(mesh);
    let mut triangles = vec![0u32; mesh.positions().len()];
    let mut angles = vec![0.0; mesh.positions().len()];
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let p = mesh.corners(t);
        let angle = |k: usize| {
            let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            u.cross(&v).norm().atan2(u.dot(&v))
        };
        // The third from the others, so that degenerate triangles have π too.
        let (first, second) = (angle(0), angle(1));
        for (k, angle) in [first, second, PI - first - second].into_iter().enumerate() {
            angles[corners[k] as usize] += angle;
            triangles[corners[k] as usize] += 1;
        }
    }
    (0..mesh.positions().len())
        .map(|v| match triangles[v] {
            0 => 0.0,
            n => {
                let edges = adjacency.of_vertex(v as u32).len() as f64;
                TAU - PI * (edges - f64::from(n)) - angles[v]
            }
        })
        .collect()
}

/// The neighbours of each vertex along edges. Ascending; the neighbours of `v` lie at `starts[v]..starts[v + 1]`.
struct Adjacency {
    starts: Vec<usize>,
    neighbors: Vec<u32>,
}

impl Adjacency {
    fn of(mesh: &TriMesh) -> Self {
        const ENDS: [[usize; 2]; 6] = [[0, 1], [1, 0], [1, 2], [2, 1], [2, 0], [0, 2]];
        let pair = |i: usize| {
            let corners = mesh.triangles()[i / 6];
            let [a, b] = ENDS[i % 6].map(|k| corners[k]);
            (a, b)
        };
        let mut pairs = parallel::sorted_by_number(6 * mesh.triangles().len(), pair, |p| p.0);
        pairs.dedup();
        let mut counts = vec![0u32; mesh.positions().len()];
        for &(v, _) in &pairs {
            counts[v as usize] += 1;
        }
        let neighbors = pairs.into_iter().map(|(_, w)| w).collect();
        Self {
            starts: parallel::starts_of(&counts),
            neighbors,
        }
    }

    fn of_vertex(&self, v: u32) -> &[u32] {
        &self.neighbors[self.starts[v as usize]..self.starts[v as usize + 1]]
    }

    /// The vertices of `rings` rings around `v`, and of further ones while they are fewer than
    /// `least`; without `v`. In no order that means anything.
    fn rings(&self, v: u32, rings: usize, least: usize, out: &mut Vec<u32>) {
        out.clear();
        out.push(v);
        let mut start = 0;
        for ring in 0..MAX_RINGS {
            if ring >= rings && out.len() > least {
                break;
            }
            let end = out.len();
            for i in start..end {
                for &w in self.of_vertex(out[i]) {
                    // Tens of vertices: a search is faster than marks.
                    if !out.contains(&w) {
                        out.push(w);
                    }
                }
            }
            start = end;
        }
        out.swap_remove(0);
    }
}
