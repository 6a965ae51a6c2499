//! Weights Ψ: which features an operator sees.
//!
//! Curvatures have a unit, so that exponents of them mean something in one scale only: here the largest extent of the body is 1. A
//! ball then has radius ½, `H = 2` and `K = 4`. Ψ is kept within bounds, because `e^K` of a sharp corner has no bound.

use crate::Error;

/// The weight Ψ of an operator, a function of the curvatures in unit scale and of fields.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Weight {
    /// 1: modes are constant on faces and change at every crease.
    One,
    /// `e^K`: small in concave creases that bend, where modes then change. The one for parts.
    #[default]
    ExpK,
    /// `e^{−H}`: large where the surface is concave. For concavities of convex bodies.
    ExpMinusH,
    /// `e^H`: small in concave creases, straight ones included.
    ExpH,
    /// A factor per vertex, e.g. a potential: positive.
    Field(Vec<f64>),
    /// The product of several.
    Product(Vec<Weight>),
}

/// A weight taken apart: coefficients of K and H in the exponent, and the product of the fields.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Factor {
    pub(crate) gauss: f64,
    pub(crate) mean: f64,
    /// One value per vertex; empty without fields.
    pub(crate) field: Vec<f64>,
}

impl Factor {
    /// Takes a weight for `vertices` vertices apart.
    pub(crate) fn of(weight: &Weight, vertices: usize) -> Result<Self, Error> {
        let mut factor = Self::default();
        factor.join(weight, vertices)?;
        Ok(factor)
    }

    /// Exponents add up, fields multiply: a product of several weights is one clamped value, not a product of clamped
    /// ones.
    fn join(&mut self, weight: &Weight, vertices: usize) -> Result<(), Error> {
        match weight {
            Weight::One => {}
            Weight::ExpK => self.gauss += 1.0,
            Weight::ExpMinusH => self.mean -= 1.0,
            Weight::ExpH => self.mean += 1.0,
            Weight::Field(values) => self.multiply(values, vertices)?,
            Weight::Product(weights) => {
                for weight in weights {
                    self.join(weight, vertices)?;
                }
            }
        }
        Ok(())
    }

    fn multiply(&mut self, values: &[f64], vertices: usize) -> Result<(), Error> {
        if values.len() != vertices {
            return Err(Error::Length {
                what: "the field of the weight",
                found: values.len(),
                expected: vertices,
            });
        }
        if let Some(vertex) = values.iter().position(|&v| !(v > 0.0 && v.is_finite())) {
            return Err(Error::Field { vertex });
        }
        if self.field.is_empty() {
            self.field = vec![1.0; vertices];
        }
        for (product, value) in self.field.iter_mut().zip(values) {
            *product *= value;
        }
        Ok(())
    }
}
