//! The element of a triangle mesh: the forms from the change of the normals across a triangle.
//!
//! With the edges of a triangle as the matrix J in an orthonormal frame E of its plane, `dn = [n₁−n₀,
//! n₂−n₀] J⁻¹` and the shape operator is the symmetric part of `Eᵀ dn` (Rusinkiewicz, *Estimating
//! curvatures and their derivatives on triangle meshes*, 2004). No quads, no extraordinary vertices, no
//! quadrature.

use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, TriMesh, Vector3};

use super::conduct::Conductor;
use super::symmetric::{Forms, Symmetric};

/// Where the normals of the vertices come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Normals {
    /// The mesh: area-weighted, then smoothed by this many rounds of half a Laplacian step.
    OfMesh {
        /// Rounds.
        rounds: u32,
    },
    /// Given, one unit vector per vertex: the gradient of the density whose surface it is.
    Given(Vec<Vector3>),
}

impl Default for Normals {
    fn default() -> Self {
        Self::OfMesh { rounds: 3 }
    }
}

/// The matrices of one triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TriangleMatrix {
    /// The stiffness, entries 00, 01, 02, 11, 12, 22.
    pub stiffness: [f64; 6],
    /// A third of the area: the lumped mass of each corner. 0 of a triangle without area, whose
    /// stiffness is 0 too.
    pub mass: f64,
    /// Mean curvature.
    pub mean: f64,
    /// Gaussian curvature.
    pub gauss: f64,
}

/// An orthonormal frame of a triangle's plane with its edges in it.
struct Plane {
    frame: [Vector3; 2],
    /// The edges from the first corner; the first lies along the first axis.
    length: f64,
    side: [f64; 2],
}

impl Plane {
    /// `None` if the triangle's height is below 1e-12 of its longest side.
    fn of([a, b, c]: [Point3; 3]) -> Option<Self> {
        let (p, q) = (b - a, c - a);
        let length = p.norm();
        let x = p / length;
        let along = q.dot(&x);
        let height = q - x * along;
        let above = height.norm();
        let longest = length.max(q.norm()).max((c - b).norm());
        (above > 1e-12 * longest && length > 1e-12 * longest).then(|| Self {
            frame: [x, height / above],
            length,
            side: [along, above],
        })
    }

    /// The derivatives along both axes of a function with these changes from the first corner:
    /// `[d₁, d₂] J⁻¹`.
    fn derivatives<T>(&self, first: T, second: T) -> [T; 2]
    where
        T: Copy + std::ops::Mul<f64, Output = T> + std::ops::Sub<Output = T>,
    {
        let x = first * (1.0 / self.length);
        [x, (second - x * self.side[0]) * (1.0 / self.side[1])]
    }

    /// The symmetric part of `Eᵀ dn`.
    fn shape(&self, [n0, n1, n2]: [Vector3; 3]) -> Symmetric {
        let [along, across] = self.derivatives(n1 - n0, n2 - n0);
        let [e, f] = self.frame;
        let mixed = 0.5 * (e.dot(&across) + f.dot(&along));
        Symmetric::new(e.dot(&along), mixed, f.dot(&across))
    }
}

/// The matrices of a triangle with these corners and vertex normals; `factor` is the value of the
/// weight's fields on it.
pub(crate) fn element(
    corners: [Point3; 3],
    normals: [Vector3; 3],
    factor: f64,
    conductor: &Conductor,
) -> TriangleMatrix {
    let Some(plane) = Plane::of(corners) else {
        return TriangleMatrix::default();
    };
    let forms = Forms::of_shape(plane.shape(normals));
    let conductivity = conductor.at(&forms, factor);
    let gradients = [(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)].map(|(a, b)| plane.derivatives(a, b));
    let area = 0.5 * plane.length * plane.side[1];
    let entry = |i: usize, j: usize| area * conductivity.between(gradients[i], gradients[j]);
    let stiffness = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(i, j)| entry(i, j));
    TriangleMatrix {
        stiffness,
        mass: area / 3.0,
        mean: forms.mean(),
        gauss: forms.gaussian(),
    }
}

/// Area-weighted unit normals of the vertices, smoothed by `rounds` rounds of
/// `n ← unit(½ n + ½ mean of the neighbours)`.
/// Neighbouring normals come nearer to each other from round to round, and the curvature of noise falls; a vertex of no
/// face has a zero normal.
pub(crate) fn smoothed_normals(mesh: &TriMesh, rounds: u32) -> Vec<Vector3> {
    let mut normals = vec![Vector3::zeros(); mesh.positions().len()];
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let n = mesh.doubled_area_normal(t);
        for &v in corners {
            normals[v as usize] += n;
        }
    }
    let unit = |n: Vector3| n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    normals.iter_mut().for_each(|n| *n = unit(*n));
    let ring = super::ring::Neighbors::of_triangles(mesh);
    for _ in 0..rounds {
        normals = parallel::map(normals.len(), |v| {
            let around = ring.of_vertex(v);
            let sum: Vector3 = around.iter().map(|&w| normals[w as usize]).sum();
            unit(normals[v] * 0.5 + sum * (0.5 / around.len().max(1) as f64))
        });
    }
    normals
}

/// The shape operator of a triangle as a symmetric 3 × 3 matrix; zero where it has no area.
pub(crate) fn shape_tensor(corners: [Point3; 3], normals: [Vector3; 3]) -> Matrix3<f64> {
    let Some(plane) = Plane::of(corners) else {
        return Matrix3::zeros();
    };
    let shape = plane.shape(normals);
    let [e, f] = plane.frame;
    e * e.transpose() * shape.xx
        + (e * f.transpose() + f * e.transpose()) * shape.xy
        + f * f.transpose() * shape.yy
}
