//! What to compute: spacing, box, cut-off.
//!
//! How it is computed (backend, threads, watcher) is for the `Run` of each verb to say. Elimination, refit and filter
//! have options of their own, beside their verbs.

use geom_core::Aabb;
use geom_core::options::{OutOfRange, require};

/// `ε`: what may be left out, *after* the powers. Wherever the density `G` reaches the lower end of the band,
/// the result lies in `[(1 − ε) G, G]`; elsewhere in `[0, G]`. Proved, see the crate's front page.
///
/// (The thesis leaves out atom kernels below a threshold *before* the powers, Eq. 3.15; that other model is
/// `thesis::Cut::Bare`, under the feature `thesis`.)
///
/// A smaller `ε` takes more atoms into each sum, since an atom's reach grows as `√ln(1/ε)`, and stretches where powers
/// below 1 lift small terms. The default moves the surface by at most 0.001 Å where the density falls by a tenth per
/// ångström or faster, as it does on nearly all of a surface; on a grid, whose sums are f32, little is gained below
/// about 10⁻⁵.
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
    ///
    /// # Errors
    /// `cutoff`, if it is not above 0 and below 0.25, or not a number.
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
    /// Halved, a dense grid takes 8 times and a band about 4 times the memory. For a mesher that shall follow the atoms
    /// take at most about `0.6 / √κ`; necks and holes narrower than the spacing may be missed. In `[1e-6, 1e6]`.
    pub spacing: f64,
    /// What is left out.
    pub cutoff: Cutoff,
    /// Space between the outermost atom centres and the box, Å. `None`: far enough that the density on
    /// the box is below the band, at least 4 Å.
    /// In `[0, 10000]`. Small powers reach far, so that the box grows with them; a margin that is too small cuts the
    /// surface open, which the report says (`touches_box`).
    pub margin: Option<f64>,
    /// The box, instead of atoms and margin; within ±1e8 Å.
    /// Its lowest corner is the lattice's first point; the last one lies at its highest corner or less than a spacing
    /// beyond. Two models that are to be compared point by point need the same one. May be flat.
    pub bounds: Option<Aabb>,
    /// `g_l < 1 < g_u`: bricks whose density stays below or above need no values. The values are exact (within the
    /// cut-off) wherever they lie in the band. A wider band stores more bricks, for those who look farther from the
    /// surface than one lattice cell; a lower `g_l` also makes the atoms' reach longer, since the promise of the
    /// cut-off then holds from there on. `0 < g_l < 1 < g_u < 1e6`. Only the lower end matters to
    /// [`sample`](crate::sample()), and only to its default margin.
    pub band: [f64; 2],
    /// Below this the density may be returned as anything between 0 and itself. `None`: the lower end of the band for
    /// [`sample_band`](crate::sample_band), 0.001 for [`sample`](crate::sample()). Above 0 and at most `g_l`. Lower it
    /// where far densities count, as for a filter or a logarithm of them; it lengthens the atoms' reach as an `ε` that
    /// is smaller by the same factor does.
    pub floor: Option<f64>,
    /// Most bytes that the grid may take.
    /// Known before a dense grid is allocated; a band is refused as soon as the bricks found so far are too many. The
    /// working memory of the threads comes on top. 4 GiB by default.
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
    ///
    /// # Errors
    /// The first field that is not, with what it must be; the band comes before the floor, which is measured by it.
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
