//! Quads that are narrower along a function's gradient, the steeper the function (Eqs. 4.11–4.13).

mod adapt;
mod metric;
mod slope;

pub use metric::{Metric, Misalignment, steepest};

pub(crate) use adapt::adapted;
pub(crate) use slope::{Slope, slopes};
#[cfg(feature = "testing")]
pub(crate) use {
    adapt::{turn, turned_by},
    metric::{narrowed, ratio_at},
    slope::carried,
};

use geom_core::options::require;

use crate::Error;

/// The function F along whose gradient quads are narrower.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Function {
    /// This eigenfunction of the Laplace operator of each connected part; the constant one is number 0.
    Mode(usize),
    /// A value per vertex of the surface, of any unit.
    Values(Vec<f64>),
}

/// Quads that are narrower along a function's gradient, the steeper the function.
///
/// Eq. 4.13 as a metric: a length along ∇F counts 1/r times, so that the spacing along a direction U is
/// `h / √(1 + (1/r² − 1) (U · ∇F / |∇F|)²)`. r falls from 1 to `ratio` while |∇F| rises through the ramp.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Anisotropy {
    /// The function F.
    pub function: Function,
    /// The side of a quad along ∇F over that across, where F is steepest: 0.2 in the thesis.
    pub ratio: f64,
    /// Shares of the largest |∇F| (see [`steepest`]) at which quads begin to be narrower, and from which on they have the
    /// ratio. The thesis's step is 0.5 twice.
    pub ramp: [f64; 2],
    /// λ̄ of Eq. 4.9 for the direction of ∇F where |∇F| is above half its largest; infinite: hard. [`Options::guidance`] comes
    /// before it.
    ///
    /// [`Options::guidance`]: crate::Options::guidance
    pub weight: f64,
    /// Whether the field gives way to the map around the steep part of the surface (Eqs. 4.11–4.12).
    pub adaptation: Option<Adaptation>,
}

/// Between where the field follows ∇F and where F is flatter than 0.45 of its steepest, crosses turn towards the gradients of
/// the map that is best for them, again and again; the field with the fewest folded triangles, then with the best map, stays.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Adaptation {
    /// r_c: the part of the way that a cross turns in each round.
    pub rate: f64,
    /// Rounds at most, each with a map of its own.
    pub rounds: u32,
}

impl Default for Adaptation {
    fn default() -> Self {
        Self {
            rate: 0.1,
            rounds: 40,
        }
    }
}

impl Anisotropy {
    /// Along the gradient of a function, with the thesis's ratio.
    pub fn of(function: Function) -> Self {
        Self {
            function,
            ratio: 0.2,
            ramp: [0.3, 0.9],
            weight: 1.0,
            adaptation: None,
        }
    }

    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), Error> {
        let ratio = self.ratio;
        let fine = ratio > 0.0 && ratio <= 1.0;
        let must = "be above 0 and at most 1";
        require(fine, "anisotropy.ratio", ratio, must)?;
        let [low, high] = self.ramp;
        require(
            (0.0..=1.0).contains(&low) && low <= high && high <= 1.0,
            "anisotropy.ramp",
            format!("{low}, {high}"),
            "rise within 0…1",
        )?;
        let must = "be at least 0";
        require(self.weight >= 0.0, "anisotropy.weight", self.weight, must)?;
        match &self.function {
            Function::Mode(0) => require(
                false,
                "anisotropy.function",
                "mode 0",
                "vary: mode 0 is constant",
            )?,
            Function::Mode(_) => {}
            Function::Values(values) => {
                if let Some(v) = values.iter().position(|x| !x.is_finite()) {
                    let value = format!("{} at vertex {v}", values[v]);
                    require(false, "anisotropy.function", value, "be finite")?;
                }
            }
        }
        if let Some(Adaptation { rate, .. }) = self.adaptation {
            let must = "be above 0 and at most 1";
            require(rate > 0.0 && rate <= 1.0, "anisotropy.rate", rate, must)?;
        }
        Ok(())
    }
}
