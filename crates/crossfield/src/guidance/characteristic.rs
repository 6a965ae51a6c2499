//! Guidance by characteristic values: each eigenfunction where it is steepest (Eq. 4.8).
//!
//! Every triangle belongs to the function that is steepest there, and neighbours with the same function are a patch. At
//! the border of patches two functions are equally steep and their directions differ; in the depth of a patch is often
//! an extreme or a saddle, where the gradient vanishes. Half-way between is a band where one function has a say, and a
//! clear one.

use geom_core::compute::sets::DisjointSets;
use geom_core::surface::distance::{Graph, shortest_paths};
use geom_core::surface::laplace;
use geom_core::{TriMesh, Vector3};

use super::modes::Mode;
use crate::Error;
use crate::field::frames::Frames;
use crate::field::{Guide, Toward};

/// Bands reach from this to that share of a patch's depth.
const BAND: [f64; 2] = [0.45, 0.55];
/// The same where a patch would have fewer triangles than [`FEW`].
const WIDE_BAND: [f64; 2] = [0.35, 0.65];
/// Fewer triangles than this are no band.
const FEW: usize = 3;
/// Below this share of a mode's root mean square, a gradient has no direction.
const FLAT: f64 = 1e-3;
/// Rounds in which each triangle takes the label of most of its neighbours.
const FILTERS: usize = 2;

/// How the gradients of different eigenfunctions compare.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Normalization {
    /// As they are (thesis): high modes are steeper, since `∫ |∇F|² = λ`.
    Raw,
    /// Divided by √λ, so that every mode has its share of the surface.
    #[default]
    Normalized,
}

/// Patches of triangles where one mode is steeper than the others; in each the triangles half-way between its border and
/// its deepest triangle, along the gradient there.
///
/// Patches are found over sides of triangles, and depth is a length along the dual graph, from centre to centre of
/// neighbours, Å. The wide band is for patches that are a few triangles across. No modes, no guides.
pub(super) fn guides(
    mesh: &TriMesh,
    frames: &Frames,
    modes: &[Mode],
    normalization: Normalization,
    weight: f64,
) -> Result<Vec<Guide>, Error> {
    let gradients: Vec<Vec<Vector3>> = modes
        .iter()
        .map(|mode| laplace::gradient(mesh, &mode.function))
        .collect::<Result<_, _>>()?;
    let mut label = steepest(frames, modes, &gradients, normalization);
    for _ in 0..FILTERS {
        label = filtered(frames, &label);
    }
    let patch = patches(frames, &label);
    let depth = depths(mesh, frames, &label)?;
    let mut deepest = vec![0.0f64; frames.faces()];
    for f in (0..frames.faces()).filter(|&f| depth[f].is_finite()) {
        let slot = &mut deepest[patch[f] as usize];
        *slot = slot.max(depth[f]);
    }
    let within = |f: usize, [from, to]: [f64; 2]| {
        let whole = deepest[patch[f] as usize];
        depth[f] > from * whole && depth[f] < to * whole
    };
    let mut count = vec![0; frames.faces()];
    for f in (0..frames.faces()).filter(|&f| within(f, BAND)) {
        count[patch[f] as usize] += 1;
    }
    let flat: Vec<f64> = gradients
        .iter()
        .map(|g| FLAT * root_mean_square(frames, g))
        .collect();
    Ok((0..frames.faces())
        .filter(|&f| {
            let few = count[patch[f] as usize] < FEW;
            within(f, if few { WIDE_BAND } else { BAND })
        })
        .filter(|&f| gradients[label[f]][f].norm() > flat[label[f]])
        .map(|f| Guide {
            face: f as u32,
            toward: Toward::Angle(frames.angle(f, &gradients[label[f]][f])),
            weight,
        })
        .collect())
}

/// Of the length of a gradient, weighted by area.
fn root_mean_square(frames: &Frames, gradient: &[Vector3]) -> f64 {
    let areas = frames.areas();
    let sum: f64 = gradient
        .iter()
        .zip(areas)
        .map(|(g, a)| a * g.norm_squared())
        .sum();
    (sum / areas.iter().sum::<f64>()).sqrt()
}

/// Which of the modes is steepest in each triangle; of equal ones the first.
fn steepest(
    frames: &Frames,
    modes: &[Mode],
    gradients: &[Vec<Vector3>],
    normalization: Normalization,
) -> Vec<usize> {
    let scale: Vec<f64> = modes
        .iter()
        .map(|mode| match normalization {
            Normalization::Raw => 1.0,
            Normalization::Normalized => 1.0 / mode.value.max(f64::MIN_POSITIVE).sqrt(),
        })
        .collect();
    (0..frames.faces())
        .map(|f| {
            let steepness = |k: usize| gradients[k][f].norm() * scale[k];
            (0..modes.len())
                .max_by(|&a, &b| steepness(a).total_cmp(&steepness(b)).then(b.cmp(&a)))
                .unwrap_or(0)
        })
        .collect()
}

/// The label that two of three neighbours share, else the own one.
fn filtered(frames: &Frames, label: &[usize]) -> Vec<usize> {
    (0..label.len())
        .map(|f| {
            let near: Vec<usize> = (3 * f..3 * f + 3)
                .filter_map(|h| frames.twin(h))
                .map(|t| label[t / 3])
                .collect();
            let shared = near
                .iter()
                .find(|&&a| near.iter().filter(|&&b| b == a).count() >= 2);
            shared.copied().unwrap_or(label[f])
        })
        .collect()
}

/// The lowest triangle of the patch of each triangle.
fn patches(frames: &Frames, label: &[usize]) -> Vec<u32> {
    let mut sets = DisjointSets::new(label.len());
    for (h, t) in frames.interior() {
        if label[h / 3] == label[t / 3] {
            sets.join((h / 3) as u32, (t / 3) as u32);
        }
    }
    sets.into_roots()
}

/// Distance from the border of the own patch over the dual graph; on a surface that is one patch, from its lowest
/// triangle.
fn depths(mesh: &TriMesh, frames: &Frames, label: &[usize]) -> Result<Vec<f64>, Error> {
    let mut border: Vec<u32> = frames
        .interior()
        .filter(|&(h, t)| label[h / 3] != label[t / 3])
        .flat_map(|(h, t)| [(h / 3) as u32, (t / 3) as u32])
        .collect();
    border.sort_unstable();
    border.dedup();
    if border.is_empty() {
        border.push(0);
    }
    let sources: Vec<(u32, f64)> = border.into_iter().map(|f| (f, 0.0)).collect();
    Ok(shortest_paths(&Graph::of_dual(mesh)?, &sources, f64::INFINITY)?.distance)
}
