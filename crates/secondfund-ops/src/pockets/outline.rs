//! The part of a surface that is a pocket.
//!
//! A pocket is found from atoms alone; here it becomes triangles of a surface, with area and depth. Both sources give
//! an owner per triangle or none, so that outlines never overlap.

use geom_core::{Run, Structure, TriMesh};

use super::measure::{Outline, measured};
use super::patches::Patches;
use super::probes::{between_probes, shared_out, triangles_at};
use super::sites::Pocket;
use crate::Error;
use crate::backend::{On, OperatorBackend};
use crate::forms::Normals;
use crate::operators::{Element, assemble};
use crate::options::{OutlineOptions, OutlineSource};

/// The outlines of pockets on the molecule's surface. No triangle is in two of them: what two pockets claim is shared
/// out by the nearest pocket point. A pocket that no part of the surface is near, because the surface has
/// closed over it, has no triangles; a surface that follows the atoms more closely has it.
///
/// One outline per pocket, in the order of the pockets.
///
/// # Errors
/// Options out of range, and those of [`spectrum`](crate::spectrum()) and [`segment`](crate::segment()).
pub fn outline<B: OperatorBackend + ?Sized>(
    surface: &TriMesh,
    structure: &Structure,
    pockets: &[Pocket],
    options: &OutlineOptions,
    run: Run<'_, B>,
) -> Result<Vec<Outline>, Error> {
    outline_on(
        surface,
        structure,
        pockets,
        options,
        run.with(run.backend.as_operators()),
    )
}

fn outline_on(
    surface: &TriMesh,
    structure: &Structure,
    pockets: &[Pocket],
    options: &OutlineOptions,
    run: On<'_>,
) -> Result<Vec<Outline>, Error> {
    options.check()?;
    let (owners, hollows, mean) = match &options.source {
        OutlineSource::Patches => {
            let patches = Patches::of(surface, structure, options, run)?;
            (
                patches.owners(surface, pockets)?,
                vec![Vec::new(); pockets.len()],
                patches.mean,
            )
        }
        OutlineSource::Probes(probes) => {
            let points = between_probes(structure, probes)?;
            let hollows = shared_out(&points, pockets, probes.reach)?;
            let normals = Normals::OfMesh {
                rounds: options.normal_rounds,
            };
            let element = Element::Triangles(surface, &normals);
            let curved = assemble(&element, &options.spectrum(), run)?;
            let mean = curved.mean.iter().map(|h| h / curved.scale).collect();
            (triangles_at(surface, pockets, &hollows)?, hollows, mean)
        }
    };
    let mut triangles: Vec<Vec<u32>> = vec![Vec::new(); pockets.len()];
    for (owner, f) in owners.into_iter().zip(0..) {
        if let Some(owner) = owner {
            triangles[owner as usize].push(f);
        }
    }
    Ok(pockets
        .iter()
        .zip(triangles)
        .zip(hollows)
        .map(|((pocket, triangles), hollow)| Outline {
            hollow,
            ..measured(pocket.rank, surface, &mean, triangles)
        })
        .collect())
}
