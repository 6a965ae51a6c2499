//! The tangential part of a step (Eqs. 7.24–7.25): vertices spread along the lines of curvature.

use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, TriMesh, Vector3};
use rayon::prelude::*;

use crate::forms::{Neighbors, Symmetric};

/// Curvatures below this, in unit scale, give no direction.
const FLAT: f64 = 0.1;
/// The least weight of a neighbour.
const LEAST: f64 = 0.05;

/// Normal and direction of the larger principal curvature at a vertex, and how much it is larger.
#[derive(Clone, Copy)]
struct Line {
    normal: Vector3,
    direction: Vector3,
    /// `(||κ₁| − |κ₂||) / (|κ₁| + |κ₂| + 0.1)`.
    anisotropy: f64,
}

/// Per vertex the way to the weighted mean of its neighbours, in its tangent plane. The mesh is in unit
/// scale.
pub(crate) fn relaxation(mesh: &TriMesh, ring: &Neighbors, positions: &[Point3]) -> Vec<Vector3> {
    let normals = crate::forms::smoothed_normals(mesh, 0);
    let lines = lines(mesh, &normals);
    parallel::map(positions.len(), |v| {
        let around = ring.of_vertex(v);
        let own = &lines[v];
        let (mut sum, mut total) = (Vector3::zeros(), 0.0);
        for &w in around {
            let other = &lines[w as usize];
            let a = own.anisotropy.min(other.anisotropy);
            let along = (own.direction.dot(&other.direction) * own.normal.dot(&other.normal)).abs();
            let weight = LEAST + (1.0 - a) + a * along;
            sum += (positions[w as usize] - positions[v]) * weight;
            total += weight;
        }
        if total == 0.0 {
            return Vector3::zeros();
        }
        let mean = sum / total;
        mean - own.normal * own.normal.dot(&mean)
    })
}

/// The lines of curvature at the vertices, from the shape operators of the triangles around them.
fn lines(mesh: &TriMesh, normals: &[Vector3]) -> Vec<Line> {
    let tensor = |t: usize| {
        let corners = mesh.triangles()[t].map(|v| normals[v as usize]);
        let area = mesh.doubled_area_normal(t).norm();
        (
            crate::forms::shape_tensor(mesh.corners(t), corners) * area,
            area,
        )
    };
    let triangles = (0..mesh.triangles().len()).into_par_iter();
    let of_triangles: Vec<(Matrix3<f64>, f64)> = triangles.map(tensor).collect();
    let mut sums = vec![(Matrix3::zeros(), 0.0); normals.len()];
    for (corners, (tensor, area)) in mesh.triangles().iter().zip(of_triangles) {
        for &v in corners {
            sums[v as usize].0 += tensor;
            sums[v as usize].1 += area;
        }
    }
    let of_vertex = |(normal, (tensor, area)): (&Vector3, (Matrix3<f64>, f64))| {
        line(*normal, tensor / f64::max(area, f64::MIN_POSITIVE))
    };
    normals.par_iter().zip(sums).map(of_vertex).collect()
}

fn line(normal: Vector3, tensor: Matrix3<f64>) -> Line {
    let x = normal.cross(&Vector3::ith(normal.iamin(), 1.0));
    let Some(x) = x.try_normalize(0.0) else {
        return Line {
            normal,
            direction: Vector3::x(),
            anisotropy: 0.0,
        };
    };
    let y = normal.cross(&x);
    let shape = Symmetric::new(
        x.dot(&(tensor * x)),
        x.dot(&(tensor * y)),
        y.dot(&(tensor * y)),
    );
    let (large, small, [p, q]) = shape.eigen();
    let first = x * p + y * q;
    let direction = if large.abs() >= small.abs() {
        first
    } else {
        normal.cross(&first)
    };
    let (a, b) = (large.abs(), small.abs());
    Line {
        normal,
        direction,
        anisotropy: (a - b).abs() / (a + b + FLAT),
    }
}
