//! Refinement where a fitted surface is too far away.

use geom_core::options::require;
use geom_core::{Run, TriMesh};

use super::basis::suitable::{GROWTH, suitable};
use super::errors::{Errors, errors};
use super::fit::{FitOptions, FitReport, MeshTarget, fit};
use super::{Basis, Surface};
use crate::backend::{On, SplineBackend};
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
    /// Each round: before the first refinement, after each, and after vertices without need went.
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
    /// Is this the surface after four elements each became one where the distance allows it?
    pub pruned: bool,
}

/// Four elements may become one where they are nearer than this share of the tolerance.
const SPARE: f64 = 0.5;
/// How often it is tried.
const TRIES: usize = 8;

/// Fits a surface to a mesh, cuts the elements, with those around them, that are farther from it than `tolerance` (Å; infinite: none), and goes on
/// until none is left that can be cut. Then vertices without need go: four elements become one where the surface, fitted
/// anew, stays within the tolerance. Rules of T-meshes are those of [`TMeshOptions::default`], whatever the mesh was made
/// by. For [`Basis::Suitable`] elements are cut until the T-mesh is, before the first fit and after each cut.
///
/// # Errors
/// [`Error::NotSuitable`] if that takes more than [`GROWTH`] times as many;
/// [`Error::Option`] for a tolerance that is not positive; those of [`fit`], [`errors`] and [`Surface::new`].
///
/// ```
/// use tspline::geom_core::{Cpu, Run, mesh::shapes};
/// use tspline::{Basis, TMesh, TMeshOptions, surface::adapt::adapt, surface::fit::FitOptions};
///
/// // A sphere in elements of 2 × 2 fine quads, which may become smaller where they are farther away than 0.01 Å.
/// let target = shapes::icosphere(1.0, 4);
/// let quads = shapes::quad_sphere(1.0, 16);
/// let coarse = vec![1; quads.quads().len()];
/// let mesh = TMesh::build(&quads, &coarse, &TMeshOptions::default())?;
/// let made = adapt(mesh, Basis::default(), &target, 0.01, &FitOptions::default(), Run::on(&Cpu))?;
/// assert!(made.reached && made.errors.hausdorff < 0.01);
/// # Ok::<(), tspline::Error>(())
/// ```
pub fn adapt<B: SplineBackend + ?Sized>(
    mesh: TMesh,
    basis: Basis,
    target: &TriMesh,
    tolerance: f64,
    options: &FitOptions,
    run: Run<'_, B>,
) -> Result<Adapted, Error> {
    adapt_on(
        mesh,
        basis,
        target,
        tolerance,
        options,
        run.with(run.backend.as_spline()),
    )
}

fn adapt_on(
    mesh: TMesh,
    basis: Basis,
    target: &TriMesh,
    tolerance: f64,
    options: &FitOptions,
    run: On<'_>,
) -> Result<Adapted, Error> {
    require(tolerance > 0.0, "tolerance", tolerance, "be positive, Å")?;
    let near = MeshTarget::new(target)?;
    let mut surface = of_mesh(mesh, basis, run)?;
    let mut rounds = Vec::new();
    let rules = TMeshOptions::default();
    loop {
        let state = State::of(surface, &near, target, tolerance, options, run)?;
        let cut = to_cut(state.surface.mesh(), &state.too_far);
        rounds.push(state.round(cut.len(), false));
        if cut.is_empty() {
            let (state, was_pruned) = if tolerance.is_finite() {
                pruned(state, &near, target, tolerance, options, run)?
            } else {
                (state, false)
            };
            if was_pruned {
                rounds.push(state.round(0, true));
            }
            return Ok(Adapted {
                reached: state.too_far.is_empty(),
                surface: state.surface,
                errors: state.errors,
                of_elements: state.of_elements,
                fit: state.fit,
                rounds,
            });
        }
        surface = match basis {
            Basis::Hierarchical => state.surface.cut(&cut, &rules, run)?,
            Basis::Rational | Basis::Suitable => {
                of_mesh(state.surface.mesh().cut(&cut, &rules)?, basis, run)?
            }
        };
    }
}

/// The surface of a T-mesh, which is made suitable first if the basis asks for that.
fn of_mesh(mesh: TMesh, basis: Basis, run: On<'_>) -> Result<Surface, Error> {
    let mesh = match basis {
        Basis::Suitable => suitable(mesh, GROWTH, &TMeshOptions::default())?,
        Basis::Hierarchical | Basis::Rational => mesh,
    };
    Surface::new(mesh, basis, run)
}

/// A fitted surface and how far away it is.
struct State {
    surface: Surface,
    fit: FitReport,
    errors: Errors,
    of_elements: Vec<f64>,
    too_far: Vec<usize>,
}

impl State {
    fn of(
        mut surface: Surface,
        near: &MeshTarget,
        target: &TriMesh,
        tolerance: f64,
        options: &FitOptions,
        run: On<'_>,
    ) -> Result<Self, Error> {
        let fit = fit(&mut surface, near, options, run)?;
        let (errors, of_elements) = errors(&surface, target, run)?;
        let far = |e: &usize| of_elements[*e] > tolerance;
        let too_far = (0..of_elements.len()).filter(far).collect();
        Ok(Self {
            surface,
            fit,
            errors,
            of_elements,
            too_far,
        })
    }

    fn round(&self, cut: usize, pruned: bool) -> Round {
        Round {
            elements: self.of_elements.len(),
            functions: self.surface.controls().len(),
            rms: self.errors.rms,
            hausdorff: self.errors.hausdorff,
            too_far: self.too_far.len(),
            cut,
            pruned,
        }
    }
}

/// Fewer elements, none of which is too far away that was not before; whether there are fewer.
///
/// What was merged in vain is not tried again, nor what lies around it, so that each try merges less. The best state is
/// kept: a try that makes an element too far away is thrown away whole.
fn pruned(
    mut state: State,
    near: &MeshTarget,
    target: &TriMesh,
    tolerance: f64,
    options: &FitOptions,
    run: On<'_>,
) -> Result<(State, bool), Error> {
    let rules = TMeshOptions::default();
    let mut fewer = false;
    // By fine quads: where it was tried in vain.
    let mut needed = vec![false; state.surface.mesh().fine().quads().len()];
    for _ in 0..TRIES {
        let mesh = state.surface.mesh();
        let may = |e: &usize| {
            let quads = mesh.fine_quads(*e);
            state.of_elements[*e] <= SPARE * tolerance && quads.iter().all(|&q| !needed[q as usize])
        };
        let spare: Vec<usize> = (0..mesh.elements().len()).filter(may).collect();
        let merged = mesh.merge(&spare, &rules)?;
        if merged.elements().len() == mesh.elements().len() {
            break;
        }
        let surface = match of_mesh(merged, state.surface.basis(), run) {
            // Fewer would not be suitable.
            Err(Error::NotSuitable { .. }) => break,
            made => made?,
        };
        let next = State::of(surface, near, target, tolerance, options, run)?;
        let was_far = |q: u32| state.of_elements[mesh.element_of(q as usize) as usize] > tolerance;
        let is_worse = |&e: &usize| {
            !next
                .surface
                .mesh()
                .fine_quads(e)
                .iter()
                .any(|&q| was_far(q))
        };
        let worse: Vec<usize> = next.too_far.iter().copied().filter(is_worse).collect();
        if worse.is_empty() {
            (state, fewer) = (next, true);
            continue;
        }
        // What was joined there and beside it is needed: functions reach over two elements.
        let next = next.surface.mesh();
        let near = next.with_those_around(&next.with_those_around(&worse));
        for &q in near.iter().flat_map(|&e| next.fine_quads(e)) {
            needed[q as usize] = true;
        }
    }
    Ok((state, fewer))
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
