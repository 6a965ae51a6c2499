//! Quads that are narrower along a function's gradient, the steeper the function (Eqs. 4.11–4.13).
//!
//! Where a function on the surface is steep, lines along which it is constant should be close to each other, and may be
//! far apart in the other direction. [`Anisotropy`] is that wish as an option of
//! [`quadrangulate`](crate::quadrangulate); a [`Metric`] is what it comes to in each triangle, for those who make
//! fields and maps step by step: it guides the field along the gradient where that is steep, and says how far apart a
//! map's lines shall be.
//!
//! ```
//! use crossfield::anisotropy::{Anisotropy, Function, Metric, steepest};
//! use crossfield::field::Frames;
//! use crossfield::geom_core::surface::laplace::{self, EdgeWeights};
//! use crossfield::geom_core::{Vector3, mesh::shapes};
//!
//! // On the walls of a cylinder the height has a slope of one, on its ends of zero.
//! let cylinder = shapes::cylinder(1.0, 4.0, 24, 12);
//! let height: Vec<f64> = cylinder.positions().iter().map(|p| p.z).collect();
//! let gradient = laplace::gradient(&cylinder, &height)?;
//! let frames = Frames::of(&cylinder, EdgeWeights::One)?;
//! let options = Anisotropy::of(Function::Values(height.clone()));
//! let metric = Metric::of(&cylinder, &frames, &height, steepest(&cylinder, &gradient), &options)?;
//!
//! // Quads there are a fifth as long along the gradient as across, and squares on the ends.
//! for face in 0..cylinder.triangles().len() {
//!     let [along, across] = metric.spacing(face, frames.angle(face, &Vector3::z()));
//!     let wanted = if gradient[face].norm() > 0.5 { 0.2 } else { 1.0 };
//!     assert!((along - wanted).abs() < 1e-9 && (across - 1.0).abs() < 1e-9);
//! }
//! # Ok::<(), crossfield::Error>(())
//! ```

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
    /// A part that has no such eigenfunction keeps square quads. Each part has a steepest place of its own.
    Mode(usize),
    /// A value per vertex of the surface, of any unit.
    /// The steepest place of the whole surface counts, so that on parts where the function varies little quads stay
    /// nearly square.
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
    /// Above 0 and at most 1, where 1 changes nothing. The smaller it is, the more a map needs the field to follow ∇F:
    /// where it does not, triangles fold, and a ladder makes the ratio milder ([`PartReport::milder`]).
    ///
    /// [`PartReport::milder`]: crate::quads::PartReport::milder
    pub ratio: f64,
    /// Shares of the largest |∇F| (see [`steepest`]) at which quads begin to be narrower, and from which on they have the
    /// ratio. The thesis's step is 0.5 twice.
    /// Between the two the logarithm of the ratio falls linearly. A wide ramp spares the map a jump of the spacing,
    /// which it could only follow with singular vertices or slanted lines.
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
    /// Above 0 and at most 1; a smaller one needs more rounds and passes fewer fields over.
    pub rate: f64,
    /// Rounds at most, each with a map of its own.
    /// It ends before, when no cross turns any more. Each round makes a map up to where its integers
    /// would be rounded.
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
    /// Quads there are five times as long as wide, with a soft weight of 1 and without adaptation.
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
    ///
    /// # Errors
    /// [`Error::Option`] names the option. How many [`Function::Values`] there are is checked where there is a surface.
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
