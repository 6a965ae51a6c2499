//! What to compute: spacing, box, cut-off.

use geom_core::Aabb;
use geom_core::options::{OutOfRange, require};

/// `ε`: what may be left out, *after* the powers. Wherever the density `G` reaches the lower end of the band,
/// the result lies in `[(1 − ε) G, G]`; elsewhere in `[0, G]`. Proved, see the crate's front page.
///
/// (The thesis leaves out atom kernels below a threshold *before* the powers, Eq. 3.15; that other model is
/// `thesis::Cut::Bare`, under the feature `thesis`.)
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Cutoff(
    /// Above 0 and below 0.25.
    pub f64,
);

impl Default for Cutoff {
    fn default() -> Self {
        Self(1e-4)
    }
}

impl Cutoff {
    /// Is ε in its range?
    pub fn check(&self) -> Result<(), OutOfRange> {
        let eps = self.0;
        let fine = eps > 0.0 && eps < 0.25;
        require(fine, "cutoff", eps, "be above 0 and below 0.25")
    }
}

/// What to sample.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Distance between lattice points, Å.
    pub spacing: f64,
    /// What is left out.
    pub cutoff: Cutoff,
    /// Space between the outermost atom centres and the box, Å. `None`: far enough that the density on
    /// the box is below the band, at least 4 Å.
    pub margin: Option<f64>,
    /// The box, instead of atoms and margin; within ±1e8 Å.
    pub bounds: Option<Aabb>,
    /// `g_l < 1 < g_u`: bricks whose density stays below or above need no values. The values are exact
    /// (within the cut-off) wherever they lie in the band.
    pub band: [f64; 2],
    /// Below this the density may be returned as anything between 0 and itself. `None`: the lower end of the
    /// band for [`sample_band`](crate::sample_band), 0.001 for [`sample`](crate::sample()).
    pub floor: Option<f64>,
    /// Most bytes that the grid may take.
    pub max_memory: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            spacing: 0.5,
            cutoff: Cutoff::default(),
            margin: None,
            bounds: None,
            band: [0.5, 2.0],
            floor: None,
            max_memory: 4 << 30,
        }
    }
}

impl Options {
    /// Is every field in its range?
    pub fn check(&self) -> Result<(), OutOfRange> {
        let h = self.spacing;
        require(
            (1e-6..=1e6).contains(&h),
            "spacing",
            h,
            "be in [1e-6, 1e6] Å",
        )?;
        self.cutoff.check()?;
        if let Some(m) = self.margin {
            require((0.0..=1e4).contains(&m), "margin", m, "be in [0, 10000] Å")?;
        }
        if let Some(b) = &self.bounds {
            for k in 0..3 {
                for corner in [b.min[k], b.max[k]] {
                    let fine = (-1e8..=1e8).contains(&corner);
                    require(fine, "bounds", corner, "lie within ±1e8 Å")?;
                }
                let extent = b.max[k] - b.min[k];
                require(
                    extent >= 0.0,
                    "bounds",
                    extent,
                    "be a box that is not empty",
                )?;
            }
        }
        let [low, high] = self.band;
        require(
            low > 0.0 && low < 1.0,
            "band[0]",
            low,
            "be above 0 and below 1",
        )?;
        require(
            high > 1.0 && high < 1e6,
            "band[1]",
            high,
            "be above 1 and below 1e6",
        )?;
        // After the band, which it is measured by.
        if let Some(floor) = self.floor {
            let fine = floor > 0.0 && floor <= low;
            require(fine, "floor", floor, "be above 0 and at most band[0]")?;
        }
        Ok(())
    }
}
