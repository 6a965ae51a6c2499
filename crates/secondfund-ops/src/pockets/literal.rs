//! The method of the thesis as it is printed (§7.5): patches of the secondary operator with Ψ = e^{−H} whose mean
//! curvature is negative.
//!
//! It stands beside the method of this crate to be compared with it. Where a body is concave Ψ = e^{−H} is large and
//! modes hardly change; groups of their rows are patches, and those that bulge in on the whole are called pockets.
//! Burial takes no part in the ranking.

use geom_core::{Point3, Run, Structure, TriMesh, Vector3};

use super::atoms::Atoms;
use super::measure::{Outline, measured};
use super::shell::burial;
use super::sites::{Lining, Pocket};
use crate::Error;
use crate::backend::{On, OperatorBackend};
use crate::forms::Normals;
use crate::operators::{Element, Spectrum, spectrum};
use crate::options::{OutlineOptions, PatchOptions};
use crate::segment::{Faces, segment};

/// The concave patches of a molecule's surface. The first modes cut it into groups; patches of negative mean
/// curvature are pockets, cut again with two more modes. With a `field` (a number per vertex: the thesis takes the
/// Gaussian density of a known ligand, Eq. 7.27) they are ranked by its mean over the patch, the highest first;
/// without one the most concave comes first, by −H in Å⁻¹. The thesis means smooth surfaces (decay 0.15) with a handful of
/// features; those of whole proteins mostly have no such patch, which is no error.
///
/// # Errors
/// Options out of range, [`Error::Length`] of the field, [`Error::NoAtoms`], those of [`spectrum`] and [`segment`].
pub fn concave_patches<B: OperatorBackend + ?Sized>(
    surface: &TriMesh,
    structure: &Structure,
    field: Option<&[f64]>,
    options: &PatchOptions,
    run: Run<'_, B>,
) -> Result<Vec<(Pocket, Outline)>, Error> {
    concave_patches_on(
        surface,
        structure,
        field,
        options,
        run.with(run.backend.as_operators()),
    )
}

fn concave_patches_on(
    surface: &TriMesh,
    structure: &Structure,
    field: Option<&[f64]>,
    options: &PatchOptions,
    run: On<'_>,
) -> Result<Vec<(Pocket, Outline)>, Error> {
    options.check()?;
    if let Some(field) = field {
        let (found, expected) = (field.len(), surface.positions().len());
        if found != expected {
            return Err(Error::Length {
                what: "the field that ranks patches",
                found,
                expected,
            });
        }
    }
    let atoms = Atoms::of(structure)?;
    let normals = Normals::OfMesh {
        rounds: options.normal_rounds,
    };
    let element = Element::Triangles(surface, &normals);
    let modes = spectrum(&element, &options.spectrum(), run)?;
    let mean: Vec<f64> = modes.mean.iter().map(|h| h / modes.scale).collect();
    let pieces = concave_pieces(surface, &modes, &mean, options, run)?;
    let score = |outline: &Outline| match field {
        Some(field) => mean_over(surface, outline, field),
        None => -outline.mean_curvature,
    };
    let mut ranked: Vec<(f64, Outline)> = pieces
        .into_iter()
        .map(|triangles| measured(0, surface, &mean, triangles))
        .map(|outline| (score(&outline), outline))
        .collect();
    // Equal ones stay in the order of their faces.
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    ranked.truncate(options.most);
    let up = surface.vertex_normals();
    let numbered = ranked.into_iter().zip(1..);
    numbered
        .map(|((score, outline), rank)| {
            let points = above(surface, &outline, &up, options.probe);
            let found = pocket(rank, score, points, &outline, &atoms, structure)?;
            Ok((found, Outline { rank, ..outline }))
        })
        .collect()
}

/// Pieces of less than this share of the surface are what two cuts leave between their borders.
/// Two partitions that cut alike still do not cut at the same faces.
const TINY: f64 = 0.005;

/// The patches of negative mean curvature of the first cut, in the pieces of the second.
/// A face belongs to the piece that both of its labels name, if its first label is a concave patch's.
fn concave_pieces(
    surface: &TriMesh,
    modes: &Spectrum,
    mean: &[f64],
    options: &PatchOptions,
    run: On<'_>,
) -> Result<Vec<Vec<u32>>, Error> {
    let faces = Faces::from(surface);
    let cut = |modes_in: usize, groups: usize| {
        segment(modes, &faces, &options.segments(modes_in, groups), run).map(|s| s.labels)
    };
    let first = cut(options.modes, options.groups)?;
    let concave: Vec<bool> = parts(&first)
        .into_iter()
        .map(|t| measured(0, surface, mean, t).mean_curvature < 0.0)
        .collect();
    let hollow = concave.iter().filter(|c| **c).count();
    if hollow == 0 {
        return Ok(Vec::new());
    }
    let second = cut(options.modes + 2, options.groups + hollow)?;
    // Named by both cuts.
    let width = second.iter().max().map_or(0, |l| l + 1);
    let named = first.iter().zip(&second).map(|(a, b)| a * width + b);
    let mut pieces = parts(&named.collect::<Vec<_>>());
    let least = TINY * faces.areas().iter().sum::<f64>();
    pieces.retain(|triangles| {
        let area: f64 = triangles.iter().map(|&f| faces.areas()[f as usize]).sum();
        let patch = triangles.first().map(|&f| first[f as usize] as usize);
        area >= least && patch.is_some_and(|patch| concave[patch])
    });
    Ok(pieces)
}

/// Points this far above the vertices of an outline, Å.
/// Along the normals of the vertices, each vertex once.
fn above(surface: &TriMesh, outline: &Outline, up: &[Vector3], probe: f64) -> Vec<Point3> {
    let corners = |&f: &u32| surface.triangles()[f as usize];
    let mut vertices: Vec<u32> = outline.triangles.iter().flat_map(corners).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let raised = |&v: &u32| surface.positions()[v as usize] + up[v as usize] * probe;
    vertices.iter().map(raised).collect()
}

/// A patch as a pocket: its points lie above its vertices, its centre is their mean.
fn pocket(
    rank: usize,
    score: f64,
    points: Vec<Point3>,
    outline: &Outline,
    atoms: &Atoms,
    structure: &Structure,
) -> Result<Pocket, Error> {
    let sum: Vector3 = points.iter().map(|p| p.coords).sum();
    let deep = OutlineOptions::default();
    let depths = burial(&points, structure, deep.radius, deep.foreign)?;
    let lining = Lining::of(
        points.iter().map(|p| atoms.frame.enter(p)),
        atoms,
        structure,
    );
    Ok(Pocket {
        rank,
        score,
        center: Point3::from(sum / points.len().max(1) as f64),
        burial: depths.into_iter().fold(0.0, f64::max),
        volume: outline.volume,
        points,
        atoms: lining.atoms,
        residues: lining.residues,
        chains: lining.chains,
    })
}

/// The faces of each label.
/// In the order of the labels, faces ascending.
fn parts(labels: &[u32]) -> Vec<Vec<u32>> {
    let count = labels.iter().max().map_or(0, |&l| l as usize + 1);
    let mut parts = vec![Vec::new(); count];
    for (&label, f) in labels.iter().zip(0..) {
        parts[label as usize].push(f);
    }
    parts
}

/// The mean of a field over an outline, by area.
/// Linear on each triangle; 0 for an outline without area.
pub(super) fn mean_over(surface: &TriMesh, outline: &Outline, field: &[f64]) -> f64 {
    let (mut sum, mut area) = (0.0, 0.0);
    for &f in &outline.triangles {
        let part = surface.doubled_area_normal(f as usize).norm();
        let corners = surface.triangles()[f as usize];
        sum += part * corners.map(|v| field[v as usize]).iter().sum::<f64>() / 3.0;
        area += part;
    }
    if area > 0.0 { sum / area } else { 0.0 }
}
