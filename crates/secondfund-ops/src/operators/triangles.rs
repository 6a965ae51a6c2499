//! The matrices of a triangle mesh.
//!
//! Functions are linear on a triangle, so that its stiffness is exact for the conductivity that its normals give; the
//! mass is lumped, a third of the area for each corner. Everything is computed in unit scale: weights and
//! regularizations then mean the same on any body.

use geom_core::compute::BackendError;
use geom_core::surface::laplace::Mass;
use geom_core::{TriMesh, Vector3};

use super::pattern::{Matrices, Pattern, components};
use super::scale::UnitScale;
use crate::backend::{On, TriangleTask};
use crate::forms::{Conductor, Normals, Operator, TriangleMatrix, smoothed_normals};
use crate::{Error, SpectrumOptions};

/// The matrices of an operator on a triangle mesh.
///
/// # Errors
/// [`Error::NoExtent`]; [`Error::Flat`] names the first triangle on which the operator is not finite; normals or fields
/// of the wrong number.
pub(crate) fn matrices(
    mesh: &TriMesh,
    normals: &Normals,
    operator: &Operator,
    options: &SpectrumOptions,
    run: On<'_>,
) -> Result<Matrices, Error> {
    let vertices = mesh.positions().len();
    let (conductor, factors) =
        operator.prepared(vertices, options.bounds, options.regularization)?;
    // Of the surface: a vertex of no triangle has no part in its extent.
    let corners = mesh.triangles().as_flattened().iter();
    let corners: Vec<_> = corners.map(|&v| mesh.positions()[v as usize]).collect();
    let scale = UnitScale::of(&corners)?;
    let normals = vertex_normals(mesh, normals)?;
    let elements = triangle_elements(mesh, &normals, &scale, &conductor, &factors, run)?;
    let flat = |e: &TriangleMatrix| e.stiffness.iter().any(|k| !k.is_finite());
    if let Some(element) = elements.iter().position(flat) {
        return Err(Error::Flat { element });
    }
    let pattern = Pattern::of(vertices, mesh.triangles())?;
    let values: Vec<f64> = elements.iter().flat_map(|e| e.stiffness).collect();
    let averages = Averages::of(vertices, mesh.triangles(), &elements);
    Ok(Matrices {
        stiffness: pattern.sum(&values),
        mass: Mass::Lumped(averages.areas.clone()),
        areas: averages.areas,
        mean: averages.mean,
        gauss: averages.gauss,
        components: components(vertices, mesh.triangles()),
        scale: scale.length,
        skipped: elements.iter().filter(|e| e.mass == 0.0).count(),
    })
}

/// The normals of the vertices, as asked.
/// Given ones are taken as they are, not made unit vectors: all that is asked is that their lengths are finite.
pub(crate) fn vertex_normals(mesh: &TriMesh, normals: &Normals) -> Result<Vec<Vector3>, Error> {
    match normals {
        Normals::OfMesh { rounds } => Ok(smoothed_normals(mesh, *rounds)),
        Normals::Given(given) => {
            let (found, expected) = (given.len(), mesh.positions().len());
            if found != expected {
                let what = "the normals";
                return Err(Error::Length {
                    what,
                    found,
                    expected,
                });
            }
            if let Some(vertex) = given.iter().position(|n| !n.norm().is_finite()) {
                return Err(Error::Normal { vertex });
            }
            Ok(given.clone())
        }
    }
}

/// The matrices of all triangles.
/// One per triangle, in order; a backend that gives another number is an error.
pub(crate) fn triangle_elements(
    mesh: &TriMesh,
    normals: &[Vector3],
    scale: &UnitScale,
    conductor: &Conductor,
    factors: &[f64],
    run: On<'_>,
) -> Result<Vec<TriangleMatrix>, Error> {
    let positions: Vec<_> = mesh.positions().iter().map(|p| scale.apply(p)).collect();
    let mut elements = Vec::new();
    let task = TriangleTask {
        positions: &positions,
        normals,
        triangles: mesh.triangles(),
        factors,
        conductor: *conductor,
    };
    run.backend.triangle_matrices(&task, &mut elements)?;
    let (found, of) = (elements.len(), task.triangles.len());
    BackendError::unless(found == of, &run.backend.name(), || {
        format!("{found} matrices for {of} triangles")
    })?;
    Ok(elements)
}

/// What a vertex has of the triangles around it.
/// Weighted by the areas of the triangles. A vertex without any has zeros.
struct Averages {
    areas: Vec<f64>,
    mean: Vec<f64>,
    gauss: Vec<f64>,
}

impl Averages {
    fn of(vertices: usize, triangles: &[[u32; 3]], elements: &[TriangleMatrix]) -> Self {
        let mut sums = Self {
            areas: vec![0.0; vertices],
            mean: vec![0.0; vertices],
            gauss: vec![0.0; vertices],
        };
        for (corners, element) in triangles.iter().zip(elements) {
            for &v in corners {
                let v = v as usize;
                sums.areas[v] += element.mass;
                sums.mean[v] += element.mass * element.mean;
                sums.gauss[v] += element.mass * element.gauss;
            }
        }
        for (v, &area) in sums.areas.iter().enumerate() {
            if area > 0.0 {
                sums.mean[v] /= area;
                sums.gauss[v] /= area;
            }
        }
        sums
    }
}
