//! Refinement where a fitted surface is too far away.

use geom_core::options::require;
use geom_core::{Run, TriMesh};

use super::errors::{Errors, errors};
use super::fit::{FitOptions, FitReport, MeshTarget, fit};
use super::{Basis, Surface};
use crate::backend::SplineBackend;
use crate::{Error, TMesh, TMeshOptions};

/// A surface fitted to a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Adapted {
    /// The surface.
    pub surface: Surface,
    /// How far both are apart.
    pub errors: Errors,
    /// The largest distance of each element, Å.
    pub of_elements: Vec<f64>,
    /// How its last fit went.
    pub fit: FitReport,
    /// Each round: before the first refinement, and after each.
    pub rounds: Vec<Round>,
    /// Is no element farther away than asked? Where elements of the finest level are, a finer mesh is needed.
    pub reached: bool,
}

/// A round of refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Round {
    /// Elements of the T-mesh.
    pub elements: usize,
    /// Functions of the basis.
    pub functions: usize,
    /// Root of the mean squared distance, Å.
    pub rms: f64,
    /// Largest distance both ways, Å.
    pub hausdorff: f64,
    /// Elements that are too far away.
    pub too_far: usize,
    /// Elements that are cut for it, those around them included.
    pub cut: usize,
}

/// Fits a surface to a mesh, cuts the elements, with those around them, that are farther from it than `tolerance` (Å; infinite: none), and goes on
/// until none is left that can be cut.
///
/// # Errors
/// [`Error::Option`] for a tolerance that is not positive; those of [`fit`], [`errors`] and [`Surface::new`].
pub fn adapt<B: SplineBackend + ?Sized>(
    mesh: TMesh,
    basis: Basis,
    target: &TriMesh,
    tolerance: f64,
    options: &FitOptions,
    run: Run<'_, B>,
) -> Result<Adapted, Error> {
    let run = run.with(run.backend.as_spline());
    require(tolerance > 0.0, "tolerance", tolerance, "be positive, Å")?;
    let near = MeshTarget::new(target)?;
    let mut surface = Surface::new(mesh, basis, run)?;
    let mut rounds = Vec::new();
    loop {
        let fit = fit(&mut surface, &near, options, run)?;
        let (errors, of_elements) = errors(&surface, target, run)?;
        let far = |e: &usize| of_elements[*e] > tolerance;
        let levels: Vec<u8> = surface.mesh().elements().iter().map(|e| e.level).collect();
        let too_far: Vec<usize> = (0..levels.len()).filter(far).collect();
        let cut = to_cut(surface.mesh(), &too_far);
        rounds.push(Round {
            elements: levels.len(),
            functions: surface.controls().len(),
            rms: errors.rms,
            hausdorff: errors.hausdorff,
            too_far: too_far.len(),
            cut: cut.len(),
        });
        if !cut.is_empty() {
            let options = TMeshOptions::default();
            surface = match basis {
                Basis::Hierarchical => surface.cut(&cut, &options, run)?,
                Basis::Rational => Surface::new(surface.mesh().cut(&cut, &options)?, basis, run)?,
            };
            continue;
        }
        return Ok(Adapted {
            surface,
            errors,
            of_elements,
            fit,
            rounds,
            reached: too_far.is_empty(),
        });
    }
}

/// The elements of these that are not of the finest level, and those around them that are no finer: a function of the next
/// level needs four by four elements.
fn to_cut(mesh: &TMesh, far: &[usize]) -> Vec<usize> {
    let level = |e: usize| mesh.elements()[e].level;
    let vertices = |e: usize| (0..4).flat_map(move |side| mesh.side(e, side));
    let mut highest = vec![0; mesh.positions().len()];
    for &e in far {
        for &v in vertices(e) {
            highest[v as usize] = level(e).max(highest[v as usize]);
        }
    }
    let reached = |e: usize| {
        let mut near = vertices(e).map(|&v| highest[v as usize]);
        near.any(|l| l > 0 && level(e) >= l)
    };
    (0..mesh.elements().len()).filter(|&e| reached(e)).collect()
}
