//! What the field follows: eigenfunctions, curvature, directions given by the caller.

mod characteristic;
mod curvature;
mod directions;
mod isocontour;
mod modes;

pub use characteristic::Normalization;
#[cfg(feature = "testing")]
pub(crate) use modes::standing_apart;

use geom_core::options::require;
use geom_core::{TriMesh, Vector3};

use crate::Error;
use crate::field::{Frames, Guide};

/// Which eigenfunctions of the surface's Laplace operator guide the field; the constant one is number 0.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Modes {
    /// Chosen by the surface: as many of the lowest as stand apart from the next one by a gap of their own, at most six.
    #[default]
    Auto,
    /// These.
    Numbers(Vec<usize>),
}

impl Modes {
    /// Refuses no numbers, the constant mode and numbers named twice.
    fn check(&self) -> Result<(), Error> {
        let Self::Numbers(numbers) = self else {
            return Ok(());
        };
        let listed = || format!("{numbers:?}");
        let any = !numbers.is_empty();
        require(any, "guidance.modes", listed(), "name at least one mode")?;
        let varied = !numbers.contains(&0);
        require(
            varied,
            "guidance.modes",
            listed(),
            "be above 0: mode 0 is constant",
        )?;
        let mut sorted = numbers.clone();
        sorted.sort_unstable();
        let once = sorted.windows(2).all(|pair| pair[0] != pair[1]);
        Ok(require(
            once,
            "guidance.modes",
            listed(),
            "name each mode once",
        )?)
    }
}

/// Something that the field follows.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Guidance {
    /// Isocontours at both ends of the range of each eigenfunction (Eqs. 4.6–4.7).
    Isocontours {
        /// Which eigenfunctions.
        modes: Modes,
        /// The share of the range that is left off at either end: 0.125 in the thesis.
        inset: f64,
        /// λ̄ of Eq. 4.9; infinite: hard.
        weight: f64,
    },
    /// Where each eigenfunction is steepest, along its gradient, in bands in the middle of these patches (Eq. 4.8).
    Characteristic {
        /// Which eigenfunctions.
        modes: Modes,
        /// How gradients of different eigenfunctions compare.
        normalization: Normalization,
        /// λ̄ of Eq. 4.9; infinite: hard.
        weight: f64,
    },
    /// Principal directions where the principal curvatures differ: `| |κ₁| − |κ₂| | / (|κ₁| + |κ₂|)` above a threshold.
    Curvature {
        /// The threshold: 0.8 in the thesis.
        threshold: f64,
        /// λ̄ of Eq. 4.9; infinite: hard.
        weight: f64,
    },
    /// Directions at points of the surface, e.g. strokes: each guides the triangle nearest to its point.
    Strokes {
        /// Points, Å, and directions of any length.
        strokes: Vec<(geom_core::Point3, Vector3)>,
        /// λ̄ of Eq. 4.9; infinite: hard.
        weight: f64,
    },
}

impl Guidance {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), Error> {
        let (Self::Isocontours { weight, .. }
        | Self::Characteristic { weight, .. }
        | Self::Curvature { weight, .. }
        | Self::Strokes { weight, .. }) = self;
        if *weight != f64::INFINITY {
            let fine = *weight >= 0.0 && weight.is_finite();
            require(fine, "guidance.weight", weight, "be at least 0")?;
        }
        match *self {
            Self::Isocontours { inset, .. } => {
                let fine = inset > 0.0 && inset < 0.5;
                require(fine, "guidance.inset", inset, "lie between 0 and 0.5")?;
            }
            Self::Curvature { threshold, .. } => {
                let fine = (0.0..1.0).contains(&threshold);
                require(
                    fine,
                    "guidance.threshold",
                    threshold,
                    "be at least 0 and below 1",
                )?;
            }
            Self::Characteristic { .. } => {}
            Self::Strokes { ref strokes, .. } => {
                for (k, (point, direction)) in strokes.iter().enumerate() {
                    let mut all = point.iter().chain(direction.iter());
                    let fine = all.all(|x| x.is_finite()) && direction.norm() > 0.0;
                    let must = "have finite coordinates and a direction";
                    require(fine, "guidance.strokes", k, must)?;
                }
            }
        }
        if let Self::Isocontours { modes, .. } | Self::Characteristic { modes, .. } = self {
            modes.check()?;
        }
        Ok(())
    }
}

/// One eigenfunction of a connected surface, by its number; all zeros for one that it does not have.
pub(crate) fn eigenfunction(mesh: &TriMesh, number: usize) -> Result<Vec<f64>, Error> {
    let found = modes::eigenfunctions(mesh, &Modes::Numbers(vec![number]))?;
    let first = found.into_iter().next().map(|mode| mode.function);
    Ok(first.unwrap_or_else(|| vec![0.0; mesh.positions().len()]))
}

/// The guides of a connected surface; of a triangle that several name, the first has it.
pub fn guides(mesh: &TriMesh, frames: &Frames, guidance: &[Guidance]) -> Result<Vec<Guide>, Error> {
    let mut named = vec![false; frames.faces()];
    let mut all = Vec::new();
    for one in guidance {
        one.check()?;
        let more = match one {
            Guidance::Isocontours {
                modes,
                inset,
                weight,
            } => {
                let modes = modes::eigenfunctions(mesh, modes)?;
                isocontour::guides(mesh, frames, &modes, *inset, *weight)?
            }
            Guidance::Characteristic {
                modes,
                normalization,
                weight,
            } => {
                let modes = modes::eigenfunctions(mesh, modes)?;
                characteristic::guides(mesh, frames, &modes, *normalization, *weight)?
            }
            Guidance::Curvature { threshold, weight } => {
                curvature::guides(mesh, frames, *threshold, *weight)
            }
            Guidance::Strokes { strokes, weight } => {
                directions::guides(mesh, frames, strokes, *weight)?
            }
        };
        for guide in more {
            if !std::mem::replace(&mut named[guide.face as usize], true) {
                all.push(guide);
            }
        }
    }
    Ok(all)
}
