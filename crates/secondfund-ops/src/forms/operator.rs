//! Which operator.

use super::conduct::{Conductor, Law};
use super::weight::{Factor, Weight};
use crate::Error;

/// An operator, by its form `∫ f_a A^{ab} h_b dA`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Operator {
    /// Laplace–Beltrami: `A = g⁻¹`.
    Lbo,
    /// Giaquinta–Hildebrandt: `A = K b⁻¹`. Indefinite where the surface is a saddle, so that it has
    /// eigenpairs on convex surfaces only.
    Gho,
    /// The secondary Laplace operator: `A = Ψ² III⁻¹`, with the metric III of the Gauss image.
    Slo(Weight),
    /// The secondary Laplace operator of the concave directions: `A = Ψ² III₋⁻¹` with the third form III₋ of the negative
    /// part of b. It sees how far the normal turns in concave creases, straight ones too, and nothing else.
    Concave(Weight),
    /// The generalized Giaquinta–Hildebrandt operator: `A = Ψ b⁻¹`. Indefinite like [`Operator::Gho`].
    Ggho(Weight),
}

impl Default for Operator {
    fn default() -> Self {
        Self::Slo(Weight::ExpK)
    }
}

impl Operator {
    /// The formula to evaluate, and the values of the weight's fields on `vertices` vertices.
    pub(crate) fn prepared(
        &self,
        vertices: usize,
        bounds: [f64; 2],
        regularization: f64,
    ) -> Result<(Conductor, Vec<f64>), Error> {
        let (law, weight) = match self {
            Self::Lbo => (Law::Metric, &Weight::One),
            Self::Gho => (Law::Adjugate, &Weight::One),
            Self::Slo(weight) => (Law::GaussImage, weight),
            Self::Concave(weight) => (Law::Concave, weight),
            Self::Ggho(weight) => (Law::Generalized, weight),
        };
        let factor = Factor::of(weight, vertices)?;
        let conductor = Conductor {
            law,
            gauss: factor.gauss,
            mean: factor.mean,
            bounds,
            regularization,
            limit: f64::INFINITY,
            sharpen: 0.0,
        };
        Ok((conductor, factor.field))
    }
}
