//! What to compute.

use geom_core::options::require;
use geom_core::surface::laplace::EdgeWeights;

use crate::Error;
use crate::anisotropy::Anisotropy;
use crate::guidance::Guidance;

/// Options of [`cross_field`](crate::cross_field).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FieldOptions {
    /// Bumps smaller than this length, Å, get no singularities of their own, and singularities nearer to each other are
    /// moved apart; 0: neither.
    /// [`quadrangulate`](crate::quadrangulate) sets it to the side of a quad.
    pub smoothing: f64,
    /// What one pair of opposite singularities is worth, rad²: pairs that cost less energy to remove go; of those nearer to
    /// each other than twice the smoothing, the more the nearer they are. Without smoothing, 0 keeps the energy's minimum; 1
    /// comes near to the smallest possible number.
    pub singularity_penalty: f64,
    /// How much edges count: all the same as in the thesis, or by their shape.
    pub weights: EdgeWeights,
}

impl Default for FieldOptions {
    fn default() -> Self {
        Self {
            smoothing: 0.0,
            singularity_penalty: 0.25,
            weights: EdgeWeights::One,
        }
    }
}

impl FieldOptions {
    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Option`] for a number that is negative, infinite or none.
    pub fn check(&self) -> Result<(), Error> {
        not_negative("field.smoothing", self.smoothing)?;
        not_negative("field.singularity_penalty", self.singularity_penalty)
    }
}

/// How large the quads shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Size {
    /// So many quads, within about a tenth; more where the surface cannot be had with so few.
    Quads(usize),
    /// Sides of this length, Å; where quads are narrower along a gradient, the longer ones.
    Spacing(f64),
    /// A third as many quads as triangles.
    Triangles,
}

impl Size {
    /// The wanted side of a quad, Å, on a surface of this area, Å², and so many triangles.
    ///
    /// Infinite for no quads or no triangles.
    pub fn spacing(self, area: f64, triangles: usize) -> f64 {
        match self {
            Self::Spacing(h) => h,
            Self::Quads(n) => (area / n as f64).sqrt(),
            Self::Triangles => (3.0 * area / triangles as f64).sqrt(),
        }
    }
}

/// What happens where the map of the field folds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Ladder {
    /// The first failure is an error.
    /// For comparisons, where another field in place of the wanted one would spoil the result.
    Off,
    /// Other fields, smaller quads, and at last quads without a field, as the report says.
    /// Its end needs no field and no map, so that every manifold surface gets quads.
    #[default]
    Full,
}

/// Options of [`quadrangulate`](crate::quadrangulate).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// How large the quads shall be.
    pub size: Size,
    /// Irregular vertices lie multiples of 2^nested sides apart, so that squares of so many quads fit together everywhere, as
    /// adaptive T-meshes want it (Eq. 5.3: a map of lines 2^nested as far apart, with the lines between); at most 10. The
    /// quads of the last rung of the ladder are not nested, and where the direct map fails the others remesh at half of
    /// 2^nested sides, which loses details smaller than that. 0 is no condition, and more ask for larger parts without
    /// irregular vertices.
    pub nested: u8,
    /// What the field follows, together: of a triangle that several name, the first has it.
    pub guidance: Vec<Guidance>,
    /// Where quads are narrower in one direction than in the other; `None`: nowhere. Those of the last rung of the ladder are
    /// not.
    pub anisotropy: Option<Anisotropy>,
    /// Edges whose triangles' normals differ by more than this many degrees are kept as sides of quads; `None`: only
    /// boundaries are.
    /// The smaller, the more edges are kept, and each of them binds the map; a smooth surface of coarse triangles needs
    /// more than the angles between its triangles.
    pub crease: Option<f64>,
    /// [`FieldOptions::smoothing`] in sides of quads, of 2^nested of them if they are nested.
    /// With 0 every bump has a say in where the field turns, and more maps fold; above 1 large features are overlooked
    /// as well.
    pub smoothing: f64,
    /// [`FieldOptions::singularity_penalty`], rad². By default six times that of a field alone: at each singularity of a map its
    /// lines are bent, and all of them have to be integer points.
    pub singularity_penalty: f64,
    /// [`FieldOptions::weights`].
    pub weights: EdgeWeights,
    /// What happens where the map of the field folds.
    pub ladder: Ladder,
    /// Move the vertices on the surface until the quads' corners are right angles.
    /// Without it they are only put onto the surface.
    pub improve: bool,
    /// Largest estimated working memory, bytes: what would need more by [`Options::bytes`] is
    /// [`Error::TooLarge`] before anything is made. 16 GiB by default.
    pub max_memory: u64,
}

impl Default for Options {
    fn default() -> Self {
        let field = FieldOptions::default();
        Self {
            size: Size::Triangles,
            nested: 0,
            guidance: Vec::new(),
            anisotropy: None,
            crease: None,
            smoothing: 1.0,
            singularity_penalty: 6.0 * field.singularity_penalty,
            weights: field.weights,
            ladder: Ladder::Full,
            improve: true,
            max_memory: 16 << 30,
        }
    }
}

impl Options {
    /// About how many bytes the quads of a surface of this area, Å², and so many triangles need while they are made: ten triangles
    /// on the way to each quad, and their matrices factored.
    pub fn bytes(&self, area: f64, triangles: usize) -> f64 {
        const PER_QUAD: f64 = 16384.0;
        let narrow = match (self.size, &self.anisotropy) {
            (Size::Spacing(_), Some(anisotropy)) => anisotropy.ratio,
            _ => 1.0,
        };
        PER_QUAD * area / self.size.spacing(area, triangles).powi(2) / narrow
    }

    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Option`] names the first option that is wrong. What can only be checked with a surface, such as the
    /// number of values of a function, is checked by [`quadrangulate`](crate::quadrangulate).
    pub fn check(&self) -> Result<(), Error> {
        not_negative("smoothing", self.smoothing)?;
        not_negative("singularity_penalty", self.singularity_penalty)?;
        require(self.nested <= 10, "nested", self.nested, "be at most 10")?;
        match self.size {
            Size::Quads(n) => require(n > 0, "size", n, "be at least one quad")?,
            Size::Spacing(h) => {
                require(h > 0.0 && h.is_finite(), "size", h, "be above 0 and finite")?;
            }
            Size::Triangles => {}
        }
        if let Some(degrees) = self.crease {
            let fine = degrees > 0.0 && degrees < 180.0;
            require(fine, "crease", degrees, "lie between 0 and 180 degrees")?;
        }
        if let Some(anisotropy) = &self.anisotropy {
            anisotropy.check()?;
        }
        self.guidance.iter().try_for_each(Guidance::check)
    }
}

pub(crate) fn not_negative(option: &'static str, value: f64) -> Result<(), Error> {
    let fine = value >= 0.0 && value.is_finite();
    Ok(require(fine, option, value, "be at least 0 and finite")?)
}
