//! How far a surface and a mesh are apart, both ways.

use geom_core::algebra::quadrature::gauss;
use geom_core::compute::parallel;
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, Run, TriMesh};

use super::Surface;
use super::inverse::Search;
use crate::Error;
use crate::backend::{On, SplineBackend};

/// How far a surface and a mesh are apart, Å, and what they measure.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Errors {
    /// Root of the mean squared distance of the surface from the mesh, over its area.
    pub rms: f64,
    /// Largest distance of a sample of the surface from the mesh.
    pub to_mesh: f64,
    /// Largest distance of a vertex or centre of a triangle of the mesh from the surface.
    pub from_mesh: f64,
    /// The larger of both.
    pub hausdorff: f64,
    /// 99 % of the samples' normals differ less from that of the nearest triangle, degrees.
    pub normal_99: f64,
    /// Area of the surface, Å².
    pub area: f64,
    /// Area of the mesh, Å².
    pub mesh_area: f64,
    /// Volume that the surface encloses, Å³, if it is closed.
    /// Signed: negative if the surface is inside out.
    pub volume: Option<f64>,
    /// That of the mesh.
    pub mesh_volume: Option<f64>,
}

/// Distances between a surface and a mesh: 8 × 8 samples per patch to the nearest triangles, vertices and centres of
/// triangles to the nearest points of the surface. With them the largest distance of each element's samples.
///
/// A spike of the mesh is seen at its vertices, one of the surface only where a sample lies on it. The second part of
/// the answer has one number per element, in which distances of the mesh count for the element nearest to them.
///
/// # Errors
/// [`Error::Tree`] for a mesh of no triangles.
pub fn errors<B: SplineBackend + ?Sized>(
    surface: &Surface,
    mesh: &TriMesh,
    run: Run<'_, B>,
) -> Result<(Errors, Vec<f64>), Error> {
    errors_on(surface, mesh, run.with(run.backend.as_spline()))
}

fn errors_on(surface: &Surface, mesh: &TriMesh, run: On<'_>) -> Result<(Errors, Vec<f64>), Error> {
    const POINTS: usize = 8;
    let tree = TriangleTree::new(mesh)?;
    // Ends and middles between, so that corners and seams are seen.
    let parameters: Vec<f64> = (0..POINTS)
        .map(|i| i as f64 / (POINTS - 1) as f64)
        .collect();
    run.progress("errors", 0, 3)?;
    let samples = surface.sample_on(&parameters, run)?;
    let per = POINTS * POINTS;
    let distances: Vec<(f64, f64)> = parallel::map_each(&samples, |sample| {
        let near = tree.closest(&sample.point);
        let [a, b, c] = mesh.corners(near.triangle as usize);
        let normal = (b - a).cross(&(c - a));
        let cosine = normal.dot(&sample.normal) / normal.norm();
        (near.distance, cosine.clamp(-1.0, 1.0).acos().to_degrees())
    });
    run.progress("errors", 1, 3)?;
    let search = Search::new(surface)?;
    let centre = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    };
    let mut queries = mesh.positions().to_vec();
    queries.extend((0..mesh.triangles().len()).map(centre));
    let back = search.nearest_to_all(&queries);
    run.progress("errors", 2, 3)?;

    let weights: f64 = samples.iter().map(|s| s.area).sum();
    let squares: f64 = (samples.iter().zip(&distances))
        .map(|(s, d)| s.area * d.0 * d.0)
        .sum();
    let largest = |d: &mut dyn Iterator<Item = f64>| d.fold(0.0, f64::max);
    let to_mesh = largest(&mut distances.iter().map(|d| d.0));
    let from_mesh = largest(&mut back.iter().map(|n| n.distance));
    // A sample or triangle without area has no normal.
    let mut angles: Vec<f64> = distances
        .iter()
        .map(|d| d.1)
        .filter(|a| a.is_finite())
        .collect();
    angles.sort_unstable_by(f64::total_cmp);
    let [area, volume] = measures(surface, run)?;
    let edges = surface.mesh().fine_edges();
    let closed = edges.iter().all(|h| edges.twin(h).is_some());
    let errors = Errors {
        rms: (squares / weights).sqrt(),
        to_mesh,
        from_mesh,
        hausdorff: to_mesh.max(from_mesh),
        normal_99: angles.get(angles.len() * 99 / 100).copied().unwrap_or(0.0),
        area,
        mesh_area: mesh.area(),
        volume: closed.then_some(volume),
        mesh_volume: closed.then(|| mesh.volume()),
    };
    let mut of_elements = vec![0.0; surface.mesh().elements().len()];
    for (patch, d) in surface
        .extraction()
        .patches()
        .iter()
        .zip(distances.chunks_exact(per))
    {
        let worst: &mut f64 = &mut of_elements[patch.element as usize];
        *worst = d.iter().map(|d| d.0).fold(*worst, f64::max);
    }
    // What lies off the surface counts for the element that is nearest to it.
    for near in &back {
        let element = surface.extraction().patches()[near.patch as usize].element;
        let worst: &mut f64 = &mut of_elements[element as usize];
        *worst = worst.max(near.distance);
    }
    Ok((errors, of_elements))
}

/// Area and enclosed volume (of an open surface, of the cone over it from the origin) of a surface, by 10 × 10 Gauss points per patch: exact for the volume of polynomial patches.
///
/// # Errors
/// Those of the backend.
pub fn measures<B: SplineBackend + ?Sized>(
    surface: &Surface,
    run: Run<'_, B>,
) -> Result<[f64; 2], Error> {
    measures_on(surface, run.with(run.backend.as_spline()))
}

fn measures_on(surface: &Surface, run: On<'_>) -> Result<[f64; 2], Error> {
    const RULE: usize = 10;
    let rule = gauss(RULE);
    let parameters: Vec<f64> = rule.iter().map(|r| r.0).collect();
    let samples = surface.sample_on(&parameters, run)?;
    let (mut area, mut volume) = (0.0, 0.0);
    for (i, sample) in samples.iter().enumerate() {
        let weight = rule[i % RULE].1 * rule[i / RULE % RULE].1 * sample.area;
        area += weight;
        volume += weight * sample.normal.dot(&sample.point.coords) / 3.0;
    }
    Ok([area, volume])
}
