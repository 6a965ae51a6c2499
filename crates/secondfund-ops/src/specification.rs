//! What each kernel computes, as the equations read: f64, one element at a time, sharing no code with the
//! kernels.
//!
//! In space coordinates a conductivity is a symmetric 3 × 3 matrix that is zero along the normal. So nothing here needs
//! frames or metrics of parameters, in which the kernels work, and a sign or a transposition that is wrong there shows
//! here.

use geom_core::nalgebra::{Matrix2, Matrix3};
use geom_core::{Point3, Vector3};

use crate::backend::PatchTask;
use crate::forms::{Conductor, Law, TriangleMatrix};

/// The matrices of a triangle in space coordinates: with the gradients `∇φ = n × e / 2A` of the hat functions,
/// `dn = Σ nᵢ ∇φᵢᵀ`, the shape operator `S = sym(P dn P)` with the projector P, and the conductivity as a
/// matrix on the tangent plane.
/// Not finite for a triangle without area, of which the kernels make zeros.
pub fn triangle_matrix(
    corners: [Point3; 3],
    normals: [Vector3; 3],
    factor: f64,
    conductor: &Conductor,
) -> TriangleMatrix {
    let [a, b, c] = corners;
    let doubled = (b - a).cross(&(c - a));
    let n = doubled.normalize();
    let gradients = [c - b, a - c, b - a].map(|e| n.cross(&e) / doubled.norm());
    let project = Matrix3::identity() - n * n.transpose();
    let dn: Matrix3<f64> = (0..3).map(|k| normals[k] * gradients[k].transpose()).sum();
    let tangential = project * dn * project;
    let shape = (tangential + tangential.transpose()) * 0.5;
    let conductivity = conductivity(&shape, &project, factor, conductor);
    let area = 0.5 * doubled.norm();
    let entry = |i: usize, j: usize| area * gradients[i].dot(&(conductivity * gradients[j]));
    TriangleMatrix {
        stiffness: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(i, j)| entry(i, j)),
        mass: area / 3.0,
        mean: 0.5 * shape.trace(),
        gauss: gaussian(&shape),
    }
}

/// What a patch adds: per pair of functions `∫ ∇Nᵢ · A ∇Nⱼ dA` and `∫ Nᵢ Nⱼ dA`, row after row; per function
/// `∫ Nᵢ dA`, `∫ Nᵢ H dA` and `∫ Nᵢ K dA`, and `∫ A ∇Nᵢ · ∇x dA`. All in space coordinates: with the dual vectors
/// `xᵃ = g^{ab} x_b`, gradients are `∇f = f_a xᵃ` and the shape operator is `−(n · x_ab) xᵃ xᵇ`.
/// With n functions, `stiffness` and `mass` have n² entries each, the others n.
#[derive(Clone, Debug, Default)]
pub struct PatchValues {
    /// Stiffness, all pairs.
    pub stiffness: Vec<f64>,
    /// Mass, all pairs.
    pub mass: Vec<f64>,
    /// Integrals of each function alone, with H and with K.
    pub sums: Vec<[f64; 3]>,
    /// The stiffness applied to the surface.
    pub forces: Vec<Vector3>,
}

/// The values of patch number `patch` of a task.
/// Points at which the tangents are parallel are left out; it has no bound for small areas as the kernels have.
pub fn patch_values(task: &PatchTask<'_>, patch: usize) -> PatchValues {
    let n = task.functions;
    let own = patch * n..(patch + 1) * n;
    let points = &task.points[own.clone()];
    let mut out = PatchValues {
        stiffness: vec![0.0; n * n],
        mass: vec![0.0; n * n],
        sums: vec![[0.0; 3]; n],
        forces: vec![Vector3::zeros(); n],
    };
    for (q, &weight) in task.weights.iter().enumerate() {
        let row = |k: usize| &task.basis[(6 * q + k) * n..(6 * q + k + 1) * n];
        let derivative = |k: usize| -> Vector3 {
            let pairs = row(k).iter().zip(points);
            pairs.map(|(w, p)| p.coords * *w).sum()
        };
        let along = [derivative(1), derivative(2)];
        let normal = along[0].cross(&along[1]);
        let area = normal.norm();
        let normal = normal / area;
        let metric = Matrix2::from_fn(|a, b| along[a].dot(&along[b]));
        let Some(inverse) = metric.try_inverse() else {
            continue;
        };
        let dual = [0, 1].map(|a| along[0] * inverse[(a, 0)] + along[1] * inverse[(a, 1)]);
        let mut shape = Matrix3::zeros();
        for (a, b, k) in [(0, 0, 3), (0, 1, 4), (1, 0, 4), (1, 1, 5)] {
            shape -= dual[a] * dual[b].transpose() * normal.dot(&derivative(k));
        }
        let factor = match task.factors {
            [] => 1.0,
            f => row(0).iter().zip(&f[own.clone()]).map(|(n, f)| n * f).sum(),
        };
        let project = Matrix3::identity() - normal * normal.transpose();
        let conductivity = conductivity(&shape, &project, factor, &task.conductor);
        let weight = weight * area;
        let gradient = |i: usize| dual[0] * row(1)[i] + dual[1] * row(2)[i];
        for i in 0..n {
            let flux = conductivity * gradient(i) * weight;
            for j in 0..n {
                out.stiffness[i * n + j] += flux.dot(&gradient(j));
                out.mass[i * n + j] += weight * row(0)[i] * row(0)[j];
            }
            let curvatures = [1.0, 0.5 * shape.trace(), gaussian(&shape)];
            (0..3).for_each(|c| out.sums[i][c] += weight * row(0)[i] * curvatures[c]);
            // The gradient of the place is the projector.
            out.forces[i] += project * flux;
        }
    }
    out
}

/// The product of the two eigenvalues of a shape operator that are not that of the normal.
fn gaussian(shape: &Matrix3<f64>) -> f64 {
    0.5 * (shape.trace().powi(2) - (shape * shape).trace())
}

/// The law at a point: curvatures are capped first, then the weight is taken, then the law.
fn conductivity(
    shape: &Matrix3<f64>,
    project: &Matrix3<f64>,
    factor: f64,
    conductor: &Conductor,
) -> Matrix3<f64> {
    let mean = 0.5 * shape.trace();
    let largest = mean.abs() + (mean * mean - gaussian(shape)).max(0.0).sqrt();
    let shape = shape * (conductor.limit / largest).min(1.0);
    let (h, k) = (0.5 * shape.trace(), gaussian(&shape));
    let psi = {
        let exponent = (conductor.gauss * k + conductor.mean * h).clamp(-50.0, 50.0);
        let plain = conductor.gauss == 0.0 && conductor.mean == 0.0 && factor == 1.0;
        let bounded = (exponent.exp() * factor).clamp(conductor.bounds[0], conductor.bounds[1]);
        if plain { 1.0 } else { bounded }
    };
    let delta = conductor.regularization.powi(2);
    // tr(S) P − S is the adjugate on the plane.
    let adjugate = project * shape.trace() - shape;
    match conductor.law {
        Law::Metric => *project,
        Law::Adjugate => adjugate,
        Law::GaussImage => {
            let normal = Matrix3::identity() - project;
            let inverse = (shape * shape + project * delta + normal).try_inverse();
            let inverse = inverse.unwrap_or_else(|| Matrix3::repeat(f64::NAN));
            (inverse - normal) * (psi * psi)
        }
        Law::Concave => {
            let part = |x: f64| x.min(0.0).powi(2);
            of_eigenvalues(&shape, |x| psi * psi / (part(x) + delta), project)
        }
        Law::Generalized => adjugate * (psi * k / (k * k + delta * delta)),
        Law::Flow => {
            let q = adjugate * (h * k / k.hypot(delta));
            of_eigenvalues(
                &q,
                |x| if x > 0.0 { x } else { x * conductor.sharpen },
                project,
            )
        }
    }
}

/// The matrix with the same eigenvectors and this function of the eigenvalues, on the tangent plane.
fn of_eigenvalues(
    matrix: &Matrix3<f64>,
    function: impl Fn(f64) -> f64,
    project: &Matrix3<f64>,
) -> Matrix3<f64> {
    let eigen = matrix.symmetric_eigen();
    let parts = (0..3).map(|i| {
        let v = eigen.eigenvectors.column(i);
        v * v.transpose() * function(eigen.eigenvalues[i])
    });
    project * parts.sum::<Matrix3<f64>>() * project
}

/// The distance between two rows.
/// In f64 from numbers in f32.
pub fn distance(a: &[f32], b: &[f32]) -> f64 {
    let squares = a
        .iter()
        .zip(b)
        .map(|(&x, &y)| (f64::from(x) - f64::from(y)).powi(2));
    squares.sum::<f64>().sqrt()
}
