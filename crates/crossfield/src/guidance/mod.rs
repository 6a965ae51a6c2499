//! What the field follows: eigenfunctions, curvature, directions given by the caller.
//!
//! A [`Guidance`] is a wish in words of the surface; [`guides`] makes of it a list of [`Guide`]s, an
//! angle and a weight for some of the triangles, which is all that the field knows. The others follow by smoothness.
//!
//! The low eigenfunctions of the Laplace operator are functions that vary as slowly over the surface as functions can: the
//! first has its extremes at the two ends of the body, the next ones halve it across. Their isocontours go around arms and
//! tunnels, their gradients along them, and that is how people would lay quads (chapter 4 of the thesis). Where an
//! eigenfunction passes through its extremes the gradient vanishes and its direction is noise. Hence only the triangles of two
//! isocontours guide, at a share r of the range from either end ([`Guidance::Isocontours`], Eqs. 4.6–4.7), or those of bands
//! in patches where one function is steeper than all others ([`Guidance::Characteristic`], Eq. 4.8).
//!
//! **Weights** are λ̄ of Eq. 4.9 in units of the smoothness of one edge. With 1, a guide counts as much as a neighbour; with
//! `f64::INFINITY` the cross has that direction whatever its neighbours say. Of guides that name the same triangle, the
//! first in the list holds it, and the others are not made. Boundaries and sharp edges come before all of them:
//! [`FieldReport::conflicts`](crate::field::FieldReport::conflicts) counts the triangles where a guide had to give way to one.
//!
//! Eigenvalues that are nearly equal belong to functions that may be mixed at will, so that their gradients say nothing about
//! the surface: [`Modes::Auto`] takes whole clusters only.
//!
//! ```
//! use crossfield::geom_core::{Cpu, Run, Vector3, mesh::shapes};
//! use crossfield::{Guidance, Options, Size, guidance::Modes, quadrangulate};
//!
//! // Along the long axis of an egg, and one stroke across its tip.
//! let egg = shapes::ellipsoid(Vector3::new(3.0, 1.0, 1.0), 4);
//! let along = Guidance::Isocontours { modes: Modes::Numbers(vec![1]), inset: 0.125, weight: 1.0 };
//! let stroke = Guidance::Strokes { strokes: vec![(egg.positions()[0], Vector3::y())], weight: 0.1 };
//! let options = Options { guidance: vec![along, stroke], size: Size::Quads(300), ..Options::default() };
//! let made = quadrangulate(&egg, &options, Run::on(&Cpu))?;
//! assert!(made.report.parts[0].field.as_ref().is_some_and(|field| field.guided > 0));
//! # Ok::<(), crossfield::Error>(())
//! ```

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
use crate::field::{Frames, Guide, Toward};

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
        /// Above 0 and below 0.5, where both contours would be one in the middle. Near 0 they shrink to the extremes,
        /// where directions are noise.
        inset: f64,
        /// λ̄ of Eq. 4.9; infinite: hard.
        #[cfg_attr(
            feature = "serde",
            serde(deserialize_with = "geom_core::options::or_infinite")
        )]
        weight: f64,
    },
    /// Where each eigenfunction is steepest, along its gradient, in bands in the middle of these patches (Eq. 4.8).
    Characteristic {
        /// Which eigenfunctions.
        modes: Modes,
        /// How gradients of different eigenfunctions compare.
        normalization: Normalization,
        /// λ̄ of Eq. 4.9; infinite: hard.
        #[cfg_attr(
            feature = "serde",
            serde(deserialize_with = "geom_core::options::or_infinite")
        )]
        weight: f64,
    },
    /// Principal directions where the principal curvatures differ: `| |κ₁| − |κ₂| | / (|κ₁| + |κ₂|)` above a threshold.
    Curvature {
        /// The threshold: 0.8 in the thesis.
        /// From 0 to below 1: the higher, the fewer triangles, and the clearer their directions.
        threshold: f64,
        /// λ̄ of Eq. 4.9; infinite: hard.
        #[cfg_attr(
            feature = "serde",
            serde(deserialize_with = "geom_core::options::or_infinite")
        )]
        weight: f64,
    },
    /// Directions at points of the surface, e.g. strokes: each guides the triangle nearest to its point.
    Strokes {
        /// Points, Å, and directions of any length.
        strokes: Vec<(geom_core::Point3, Vector3)>,
        /// λ̄ of Eq. 4.9; infinite: hard.
        #[cfg_attr(
            feature = "serde",
            serde(deserialize_with = "geom_core::options::or_infinite")
        )]
        weight: f64,
    },
}

impl Guidance {
    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Option`] names the option: a weight below 0, an inset or threshold out of its range, strokes without a
    /// direction, modes that are none.
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

/// Guides along the boundary, which hold the field exactly: of a map, boundaries are lines.
///
/// [`quadrangulate`](crate::quadrangulate) adds them itself; who asks for a field alone adds them to the others.
pub fn rims(frames: &Frames) -> Vec<Guide> {
    let on_rim = (0..frames.edges().len()).filter(|&h| frames.twin(h).is_none());
    on_rim.map(along).collect()
}

/// The guide that holds the field to a half-edge.
pub(crate) fn along(h: usize) -> Guide {
    Guide {
        face: (h / 3) as u32,
        toward: Toward::Side((h % 3) as u8),
        weight: f64::INFINITY,
    }
}

/// The guides of a connected surface; of a triangle that several name, the first has it.
///
/// `frames` are those of `mesh`, and a surface of several parts has to be split before: the first eigenfunctions of two
/// parts would be constant on each.
///
/// # Errors
/// [`Error::Option`] for values out of range, [`Error::Eigen`] if the eigenfunctions cannot be found,
/// [`Error::Operator`] for triangles without area.
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
