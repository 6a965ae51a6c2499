//! What others cut surfaces by, to compare with: both give a [`Spectrum`] for [`segment`](super::segment()), so that a
//! comparison is of operators and not of the steps after them. On triangles.

use std::f64::consts::{PI, TAU};

use geom_core::algebra::{Mass, SparseMatrix, eigen};
use geom_core::compute::parallel;
use geom_core::search::bvh::{Hit, TriangleTree};
use geom_core::surface::curvature::angle_defects;
use geom_core::{Point3, Run, TriMesh, Vector3};

use crate::backend::{On, OperatorBackend};
use crate::forms::{Neighbors, Normals, Operator};
use crate::operators::{Element, Matrices, Spectrum, assemble, modes_of};
use crate::{Error, SpectrumOptions};

/// An edge is concave where the normals approach each other along it by more than this.
const CONCAVE: f64 = 0.01;
/// How much an edge at a concave vertex conducts.
const HELD: f64 = 0.01;

/// Modes of a graph Laplacian whose edges conduct little at concave vertices (after Au, Zheng, Chen, Xu and Tai, *Mesh
/// segmentation with concavity-aware fields*, 2012): the edge ij has `|e| β / (|Gᵢ| + |Gⱼ| + 0.01)` with the angle
/// defects G and β = 0.01 if i or j is concave, else 1.
///
/// # Errors
/// Those of [`spectrum`](crate::spectrum()).
pub fn concavity_aware<B: OperatorBackend + ?Sized>(
    mesh: &TriMesh,
    modes: usize,
    run: Run<'_, B>,
) -> Result<Spectrum, Error> {
    concavity_aware_on(mesh, modes, run.with(run.backend.as_operators()))
}

fn concavity_aware_on(mesh: &TriMesh, modes: usize, run: On<'_>) -> Result<Spectrum, Error> {
    let options = SpectrumOptions {
        operator: Operator::Lbo,
        modes,
        ..SpectrumOptions::default()
    };
    let normals = Normals::OfMesh { rounds: 0 };
    let plain = assemble(&Element::Triangles(mesh, &normals), &options, run)?;
    let matrices = Matrices {
        stiffness: concavity_laplacian(mesh)?,
        mass: Mass::Lumped(vec![1.0; mesh.positions().len()]),
        ..plain
    };
    modes_of(matrices, &options, run.monitor)
}

fn concavity_laplacian(mesh: &TriMesh) -> Result<SparseMatrix, Error> {
    let (positions, normals) = (mesh.positions(), mesh.vertex_normals());
    let (ring, defects) = (Neighbors::of_triangles(mesh), angle_defects(mesh));
    let turns_in = |v: usize, w: usize| {
        let edge = (positions[v] - positions[w]).try_normalize(0.0);
        edge.is_some_and(|e| e.dot(&(normals[w] - normals[v])) > CONCAVE)
    };
    let n = positions.len();
    let around = |v: usize| ring.of_vertex(v).iter().map(|&w| w as usize);
    let concave: Vec<bool> = (0..n).map(|v| around(v).any(|w| turns_in(v, w))).collect();
    let mut entries = Vec::new();
    for v in 0..n {
        let mut diagonal = 0.0;
        for w in around(v) {
            let held = if concave[v] || concave[w] { HELD } else { 1.0 };
            let length = (positions[v] - positions[w]).norm();
            let weight = length * held / (defects[v].abs() + defects[w].abs() + 0.01);
            diagonal += weight;
            entries.push((v as u32, w as u32, -weight));
        }
        entries.push((v as u32, v as u32, diagonal));
    }
    Ok(SparseMatrix::from_triplets(n, n, &entries)?)
}

/// Rays per triangle, within this angle of the inward normal.
const RAYS: usize = 30;
const CONE: f64 = PI / 3.0;
/// α of the logarithm that evens out small and large diameters.
const ALPHA: f64 = 4.0;

/// The shape diameter of each triangle, in the unit of the mesh (Shapira, Shamir and Cohen-Or, *Consistent mesh
/// partitioning and skeletonisation using the shape diameter function*, 2008): rays in a cone of 120° against the
/// normal until they leave the body; of their lengths the mean, weighted by the inverse angle, of those within a
/// standard deviation of the median. 0 where no ray meets the other side.
///
/// # Errors
/// No triangles.
pub fn shape_diameter(mesh: &TriMesh) -> Result<Vec<f64>, Error> {
    let tree = TriangleTree::new(mesh).map_err(|_| Error::NoExtent)?;
    Ok(parallel::map(mesh.triangles().len(), |t| {
        diameter(mesh, &tree, t)
    }))
}

/// Of one triangle; 0 if it has no area.
fn diameter(mesh: &TriMesh, tree: &TriangleTree, triangle: usize) -> f64 {
    let [a, b, c] = mesh.corners(triangle);
    let center = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let Some(outwards) = mesh.doubled_area_normal(triangle).try_normalize(0.0) else {
        return 0.0;
    };
    // Off the surface, by less than anything that matters.
    let origin = center - outwards * (1e-4 * (b - a).norm());
    let leaves = |hit: &Hit| !hit.entering;
    let mut found: Vec<(f64, f64)> = cone(-outwards)
        .filter_map(|(angle, ray)| {
            let hit = tree.first_hit(&origin, &ray).filter(leaves)?;
            Some((hit.time, 1.0 / angle))
        })
        .collect();
    found.sort_by(|x, y| x.0.total_cmp(&y.0));
    let Some(&(median, _)) = found.get(found.len() / 2) else {
        return 0.0;
    };
    let count = found.len() as f64;
    let mean = found.iter().map(|x| x.0).sum::<f64>() / count;
    let variance = found.iter().map(|x| (x.0 - mean).powi(2)).sum::<f64>() / count;
    let near = found
        .iter()
        .filter(|x| (x.0 - median).abs() <= variance.sqrt());
    let (sum, weights) = near.fold((0.0, 0.0), |(s, w), x| (s + x.0 * x.1, w + x.1));
    if weights > 0.0 { sum / weights } else { median }
}

/// Directions spread over the cone around an axis (a sunflower), with their angles from it.
fn cone(axis: Vector3) -> impl Iterator<Item = (f64, Vector3)> {
    let mut off = Vector3::zeros();
    off[axis.iamin()] = 1.0;
    let side = off.cross(&axis).normalize();
    let up = axis.cross(&side);
    let golden = TAU * (1.0 - 1.0 / 1.618_033_988_749_895);
    (0..RAYS).map(move |k| {
        let share = (k as f64 + 0.5) / RAYS as f64;
        let angle = (1.0 - share * (1.0 - CONE.cos())).acos();
        let (sin, cos) = (golden * k as f64).sin_cos();
        (
            angle,
            axis * angle.cos() + (side * cos + up * sin) * angle.sin(),
        )
    })
}

/// The shape diameter as the one mode of a spectrum: `ln(1 + α d) / ln(1 + α)` with d from 0 to 1 over the surface, at
/// each vertex the mean over its triangles.
///
/// # Errors
/// Those of [`shape_diameter`] and [`assemble`].
pub fn shape_diameter_mode<B: OperatorBackend + ?Sized>(
    mesh: &TriMesh,
    run: Run<'_, B>,
) -> Result<Spectrum, Error> {
    shape_diameter_mode_on(mesh, run.with(run.backend.as_operators()))
}

fn shape_diameter_mode_on(mesh: &TriMesh, run: On<'_>) -> Result<Spectrum, Error> {
    let options = SpectrumOptions {
        operator: Operator::Lbo,
        ..SpectrumOptions::default()
    };
    let normals = Normals::OfMesh { rounds: 0 };
    let matrices = assemble(&Element::Triangles(mesh, &normals), &options, run)?;
    let diameters = shape_diameter(mesh)?;
    let (mut sums, mut weights) = (vec![0.0; matrices.areas.len()], matrices.areas.clone());
    weights.fill(0.0);
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let area = mesh.doubled_area_normal(t).norm();
        for &v in corners {
            sums[v as usize] += area * diameters[t];
            weights[v as usize] += area;
        }
    }
    let means = sums
        .iter()
        .zip(&weights)
        .map(|(s, w)| if *w > 0.0 { s / w } else { 0.0 });
    let means: Vec<f64> = means.collect();
    let least = means.iter().copied().fold(f64::INFINITY, f64::min);
    let most = means.iter().copied().fold(0.0, f64::max);
    let reach = (most - least).max(f64::MIN_POSITIVE);
    let even = |d: &f64| (ALPHA * (d - least) / reach).ln_1p() / ALPHA.ln_1p();
    let mode = means.iter().map(even).collect();
    Ok(Spectrum::of(
        matrices,
        vec![1.0],
        vec![mode],
        eigen::Report::default(),
    ))
}
