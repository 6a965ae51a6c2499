//! How far apart the lines shall be.

use geom_core::options::require;

use crate::Error;

/// Distances of neighbouring lines, Å.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Spacing {
    /// The same everywhere.
    Uniform(f64),
    /// Per triangle, along the field's arm θ and across it.
    PerFace(Vec<[f64; 2]>),
}

impl Spacing {
    /// Refuses what is not a positive number, and the wrong number of them.
    pub(crate) fn check(&self, faces: usize) -> Result<(), Error> {
        let fine = |h: f64| h > 0.0 && h.is_finite();
        match self {
            Self::Uniform(h) => require(fine(*h), "spacing", h, "be above 0 and finite")?,
            Self::PerFace(all) => {
                let count = all.len();
                require(
                    count == faces,
                    "spacing",
                    count,
                    "have one value per triangle",
                )?;
                if let Some(h) = all.as_flattened().iter().find(|&&h| !fine(h)) {
                    require(false, "spacing", h, "be above 0 and finite")?;
                }
            }
        }
        Ok(())
    }

    /// Along the first arm after `comb` quarter turns, and along the second.
    pub(crate) fn of_face(&self, face: usize, comb: u8) -> [f64; 2] {
        match self {
            Self::Uniform(h) => [*h, *h],
            Self::PerFace(spacings) => {
                let [along, across] = spacings[face];
                if comb.is_multiple_of(2) {
                    [along, across]
                } else {
                    [across, along]
                }
            }
        }
    }

    /// All distances times `factor`.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        match self {
            Self::Uniform(h) => Self::Uniform(h * factor),
            Self::PerFace(spacings) => {
                Self::PerFace(spacings.iter().map(|s| s.map(|h| h * factor)).collect())
            }
        }
    }

    /// Quads that this spacing makes of triangles with these areas.
    pub(crate) fn quads(&self, areas: &[f64]) -> f64 {
        (0..areas.len())
            .map(|f| {
                let [u, v] = self.of_face(f, 0);
                areas[f] / (u * v)
            })
            .sum()
    }
}
