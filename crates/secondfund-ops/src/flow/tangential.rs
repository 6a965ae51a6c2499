//! The tangential part of a step (Eqs. 7.24–7.25): vertices spread along the lines of curvature.

use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, TriMesh, Vector3};
use rayon::prelude::*;

use crate::forms::{Neighbors, Symmetric};

/// Curvatures below this, in unit scale, give no direction.
const FLAT: f64 = 0.1;
/// Where normals turn by so many radians along an edge, a tangent plane is not the surface.
const CREASE: f64 = 1.0 / 3.0;
/// The least weight of a neighbour.
const LEAST: f64 = 0.05;

/// Normal and direction of the larger principal curvature at a vertex, and how much it is larger.
#[derive(Clone, Copy)]
struct Line {
    normal: Vector3,
    direction: Vector3,
    /// The absolute curvatures along it and across it.
    curvatures: [f64; 2],
}

impl Line {
    /// `(||κ₁| − |κ₂||) / (|κ₁| + |κ₂| + 0.1)`.
    fn anisotropy(&self) -> f64 {
        let [a, b] = self.curvatures;
        (a - b) / (a + b + FLAT)
    }

    /// What of a step in the tangent plane stays on the surface: nothing in a direction in which the normal turns by [`CREASE`]
    /// from a neighbour to the next, so that vertices of a crease go along it only, and those of a corner nowhere. By how much a step
    /// leaves the surface grows with the square of that.
    fn resolved(&self, step: &Vector3, edge: f64) -> Vector3 {
        let axes = [self.direction, self.normal.cross(&self.direction)];
        let parts = axes.iter().zip(self.curvatures).map(|(axis, curvature)| {
            axis * (axis.dot(step) * (1.0 - (curvature * edge / CREASE).powi(2)).max(0.0))
        });
        parts.sum()
    }
}

/// Per vertex the way to the weighted mean of its neighbours, in its tangent plane, as far as that is the surface. The mesh is
/// in unit scale.
pub(crate) fn relaxation(mesh: &TriMesh, ring: &Neighbors, positions: &[Point3]) -> Vec<Vector3> {
    let normals = crate::forms::smoothed_normals(mesh, 0);
    let lines = lines(mesh, &normals);
    parallel::map(positions.len(), |v| {
        let around = ring.of_vertex(v);
        let own = &lines[v];
        let (mut sum, mut total, mut lengths) = (Vector3::zeros(), 0.0, 0.0);
        for &w in around {
            let other = &lines[w as usize];
            let a = own.anisotropy().min(other.anisotropy());
            let along = (own.direction.dot(&other.direction) * own.normal.dot(&other.normal)).abs();
            let weight = LEAST + (1.0 - a) + a * along;
            let way = positions[w as usize] - positions[v];
            sum += way * weight;
            total += weight;
            lengths += way.norm();
        }
        if total == 0.0 {
            return Vector3::zeros();
        }
        own.resolved(&(sum / total), lengths / around.len() as f64)
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
            curvatures: [0.0; 2],
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
        curvatures: [a.max(b), a.min(b)],
    }
}
