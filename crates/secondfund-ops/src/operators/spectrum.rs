//! The smallest eigenpairs of an operator.

use geom_core::algebra::Error as MatrixError;
use geom_core::algebra::eigen::{self, Report, eigenpairs};
use geom_core::{Cpu, Monitor, Run};

use super::assemble::assemble;
use super::element::Element;
use super::pattern::Matrices;
use crate::backend::OperatorBackend;
use crate::forms::Operator;
use crate::{Error, SpectrumOptions};

/// The modes of an operator: its eigenfunctions without the constants.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// Eigenvalues, ascending, in unit scale.
    pub values: Vec<f64>,
    /// Per mode its values at the vertices (of a Catmull–Clark surface: at their limit positions; of Bézier elements: the
    /// coefficients of the nodes), of unit length in the product of the mass.
    pub modes: Vec<Vec<f64>>,
    /// The area around each vertex, of the surface in unit scale.
    pub areas: Vec<f64>,
    /// Mean curvature per vertex, in unit scale.
    pub mean: Vec<f64>,
    /// Gaussian curvature per vertex, in unit scale.
    pub gauss: Vec<f64>,
    /// The connected component of each vertex, by its lowest vertex.
    pub components: Vec<u32>,
    /// Å per unit of length: an eigenvalue of the Laplace–Beltrami operator in Å⁻² is `value / scale²`.
    pub scale: f64,
    /// Triangles or quadrature points without area, left out.
    pub skipped: usize,
    /// How the pairs were found.
    pub report: Report,
}

/// The smallest eigenpairs `∫ f_a A^{ab} h_b = λ ∫ f h` of an operator, the constant of each connected
/// component left out. Matrices come from the backend; the pairs are found on the CPU with any.
///
/// # Errors
/// [`Error::TooManyModes`]; [`Error::Indefinite`] for [`Operator::Gho`] and [`Operator::Ggho`] on a surface with saddles; those of
/// [`assemble`].
pub fn spectrum<B: OperatorBackend + ?Sized>(
    element: &Element<'_>,
    options: &SpectrumOptions,
    run: Run<'_, B>,
) -> Result<Spectrum, Error> {
    let run = run.with(run.backend.as_operators());
    let matrices = assemble(element, options, run)?;
    let mut found = modes_of(matrices, options, run.monitor)?;
    if let Element::CatmullClark(surface) = *element {
        found.modes = surface.limit_values(&found.modes);
    }
    Ok(found)
}

/// The smallest eigenpairs of matrices, the modes at the degrees of freedom.
pub(crate) fn modes_of(
    matrices: Matrices,
    options: &SpectrumOptions,
    monitor: &dyn Monitor,
) -> Result<Spectrum, Error> {
    let constants = count_components(&matrices);
    let wanted = options.modes + constants;
    if wanted >= matrices.areas.len() {
        return Err(Error::TooManyModes {
            asked: options.modes,
            vertices: matrices.areas.len(),
        });
    }
    let spectral = eigen::Options {
        tolerance: options.tolerance,
        verify: options.verify,
        ..eigen::Options::default()
    };
    // A sparse factor: no kernel of a backend takes part.
    let on_cpu = Run {
        backend: &Cpu,
        monitor,
    };
    let (stiffness, mass) = (&matrices.stiffness, &matrices.mass);
    let mut pairs = eigenpairs(stiffness, mass, wanted, &spectral, on_cpu)
        .map_err(|e| named(e, &options.operator))?;
    if pairs
        .values
        .first()
        .is_some_and(|&v| v < -1e-6 * pairs.values[pairs.values.len() - 1].abs())
    {
        return Err(Error::Indefinite);
    }
    // The zeros of the components come first.
    pairs.values.drain(..constants.min(pairs.values.len()));
    pairs.vectors.drain(..constants.min(pairs.vectors.len()));
    Ok(Spectrum::of(
        matrices,
        pairs.values,
        pairs.vectors,
        pairs.report,
    ))
}

impl Spectrum {
    /// These modes on the surface of these matrices.
    pub(crate) fn of(
        matrices: Matrices,
        values: Vec<f64>,
        modes: Vec<Vec<f64>>,
        report: Report,
    ) -> Self {
        Self {
            values,
            modes,
            areas: matrices.areas,
            mean: matrices.mean,
            gauss: matrices.gauss,
            components: matrices.components,
            scale: matrices.scale,
            skipped: matrices.skipped,
            report,
        }
    }
}

/// Components with area.
fn count_components(matrices: &Matrices) -> usize {
    let mut roots: Vec<u32> = matrices
        .components
        .iter()
        .zip(&matrices.areas)
        .filter(|(_, area)| **area > 0.0)
        .map(|(&root, _)| root)
        .collect();
    roots.sort_unstable();
    roots.dedup();
    roots.len()
}

/// A factor that does not exist says that the operator is indefinite, if it is one that may be.
fn named(error: eigen::Error, operator: &Operator) -> Error {
    match (&error, operator) {
        (
            eigen::Error::Matrix(MatrixError::NotPositiveDefinite { .. }),
            Operator::Gho | Operator::Ggho(_),
        ) => Error::Indefinite,
        (eigen::Error::Cancelled(cancelled), _) => Error::Cancelled(*cancelled),
        _ => Error::Spectral(error),
    }
}
