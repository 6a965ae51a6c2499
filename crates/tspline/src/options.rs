//! What is asked for.

use geom_core::options::{OutOfRange, require};

/// Highest level: a fine quad more than 4^10 times smaller than the largest element is a mistake.
pub const MAX_LEVEL: u8 = 10;

/// Options of [`levels::cleaned`](crate::levels::cleaned).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CleanOptions {
    /// Rounds of the majority filter.
    /// Each takes away strips one quad wide; 0 leaves labels as they are.
    pub rounds: u32,
    /// Islands of fewer elements of their level vanish, at most 1,000.
    /// Both ways: coarse islands in the fine and fine ones in the coarse. 0 keeps all.
    pub island: u32,
    /// Width of the bands between levels, in elements of the coarser, at most 1,000.
    /// A band of the level between is what elements need anyway; a wider one spares T-junctions close behind each
    /// other. 0 leaves that to the T-mesh.
    pub band: u32,
}

impl Default for CleanOptions {
    fn default() -> Self {
        Self {
            rounds: 2,
            island: 16,
            band: 2,
        }
    }
}

impl CleanOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let must = "be at most 1000";
        require(self.rounds <= 1000, "rounds", self.rounds, must)?;
        require(self.island <= 1000, "island", self.island, must)?;
        require(self.band <= 1000, "band", self.band, must)
    }
}

/// Options of [`TMesh::build`](crate::TMesh::build).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TMeshOptions {
    /// Rings of elements around an extraordinary vertex that are all of one level, and rings of blocks of its own level
    /// that must exist around an element, 1…8. Bases of two levels need 3.
    pub rings: u32,
}

impl Default for TMeshOptions {
    fn default() -> Self {
        Self { rings: 3 }
    }
}

impl TMeshOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let rings = self.rings;
        require((1..=8).contains(&rings), "rings", rings, "lie within 1…8")
    }
}

/// Which distortion is lowered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Method {
    /// That of corners from right angles between sides in the proportion they have (Eqs. 5.5–5.7): long elements stay
    /// long.
    #[default]
    Corners,
    /// That of triangles from those of a square (Eqs. 5.8–5.9): all elements become squares. The thesis's comparison.
    Triangles,
}

/// Options of [`improve`](crate::improve).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct QualityOptions {
    /// Which distortion.
    pub method: Method,
    /// Vertices on edges of the surface whose triangles' normals differ by more than this many degrees stay on them; `None`:
    /// only those on its boundary do.
    pub crease: Option<f64>,
    /// Steps of the flow at most, for the sum of the distortions and then for that of their fourth powers. It ends before where
    /// twenty of them gain less than a hundredth.
    /// 0 leaves the vertices where they came to lie on the surface, but for the worst elements.
    pub steps: usize,
    /// The flow stands still when the distortion falls by less in a step, relatively.
    /// 0 goes on until no step lowers it, or there are no more.
    pub tolerance: f64,
    /// Rounds in which the vertices of elements with a scaled Jacobian below 0.86 are moved one by one after the flow, those
    /// below 0.6 after a flow for them alone; 0 for the flow alone.
    pub rounds: usize,
    /// Elements whose scaled Jacobian stays below this are cut into four, with those around them, −1…0.5; −1: none.
    pub least: f64,
}

impl Default for QualityOptions {
    fn default() -> Self {
        Self {
            method: Method::default(),
            crease: None,
            steps: 100,
            tolerance: 1e-5,
            rounds: 64,
            least: 0.3,
        }
    }
}

impl QualityOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        if let Some(degrees) = self.crease {
            let fine = degrees > 0.0 && degrees < 180.0;
            require(fine, "crease", degrees, "lie between 0 and 180 degrees")?;
        }
        let within = (0.0..1.0).contains(&self.tolerance);
        let must = "be at least 0 and below 1";
        require(within, "tolerance", self.tolerance, must)?;
        let within = (-1.0..=0.5).contains(&self.least);
        require(within, "least", self.least, "lie within −1…0.5")
    }
}
