//! What others cut surfaces by, to compare with: both give a [`Spectrum`] for [`segment`](super::segment()), so that a
//! comparison is of operators and not of the steps after them. On triangles.

use geom_core::algebra::{Mass, SparseMatrix, eigen};
use geom_core::surface::curvature::angle_defects;
use geom_core::{Run, TriMesh};

use crate::backend::{On, OperatorBackend};
use crate::forms::{Neighbors, Normals, Operator, at_vertices, shape_diameter};
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

/// α of the logarithm that evens out small and large diameters.
const ALPHA: f64 = 4.0;

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
    let means = at_vertices(mesh, &shape_diameter(mesh)?);
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
