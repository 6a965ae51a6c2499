//! What surface to make, and why none can be made.

use crate::options::{OutOfRange, require};
use crate::surface::distance::DistanceError;
use crate::{Cancelled, MeshError};

/// How long the edges shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Sizing {
    /// The same everywhere.
    Uniform {
        /// Edge length, Å; `None` for the mean of the input's edges.
        edge_length: Option<f64>,
    },
    /// As long as the chords may be: an edge of length √(6 ε/κ − 3 ε²) stays within ε of a surface
    /// of curvature κ.
    Curvature {
        /// Allowed distance ε between triangles and surface, Å.
        tolerance: f64,
        /// Shortest wanted edge, Å.
        min_edge: f64,
        /// Longest wanted edge, Å.
        max_edge: f64,
        /// Growth of the wanted length per Å of way along the surface; 0.2…0.5 keeps triangles good.
        gradation: f64,
    },
}

/// Which edges stay, besides the boundary.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Features {
    /// None: the surface is smooth, and what looks like an edge is noise.
    #[default]
    None,
    /// Those where the normals of the two triangles differ by more than this many degrees.
    Angle(f64),
    /// These, as pairs of vertices of the input.
    Edges(Vec<[u32; 2]>),
}

/// What surface to make.
///
/// Only [`Options::sizing`] has to be set for most surfaces. [`Options::check`] refuses what is out of range before the
/// work starts.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Wanted edge lengths.
    pub sizing: Sizing,
    /// Edges to keep. Boundaries are always kept.
    pub features: Features,
    /// A label per triangle of the input, or empty. The lines where labels meet are kept, zigzags
    /// shorter than the edges excepted, and the result's triangles have the labels of those they
    /// come from.
    pub labels: Vec<u32>,
    /// The surface is where the field has this value; without a field it is not used.
    pub level: f64,
    /// Most rounds of split, contract, flip and move; fewer when nothing changes any more. Fewer save time and leave
    /// angles worse.
    pub iterations: usize,
    /// After the rounds, triangles with a smaller angle than this many degrees are worked on. 0 to below 60; a higher
    /// goal takes longer and leaves more exceptions.
    pub min_angle_deg: f64,
    /// Largest distance between the result and the surface, both ways, Å. `None` for 0.3 of a uniform
    /// edge length or twice the tolerance of [`Sizing::Curvature`]; infinite for no bound.
    pub max_deviation: Option<f64>,
    /// Where angles or distances miss these goals after the rounds, the surface is too narrow or too
    /// curved for the wanted edges: this often they become shorter there, down to 1/16 of a uniform
    /// length or to `min_edge`. 0 for edges as wanted everywhere. Each costs some rounds where edges became shorter,
    /// and nothing elsewhere.
    pub refinements: usize,
    /// More triangles than this are refused before the work starts. The estimate is that of equilateral triangles of
    /// the wanted edges on the input's area; refinement may exceed it.
    pub max_triangles: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            sizing: Sizing::Uniform { edge_length: None },
            features: Features::None,
            labels: Vec::new(),
            level: 1.0,
            iterations: 10,
            min_angle_deg: 30.0,
            max_deviation: None,
            refinements: 6,
            max_triangles: 50_000_000,
        }
    }
}

impl Options {
    /// Are all numbers in their ranges?
    ///
    /// # Errors
    /// [`Error::Option`] names the first that is not.
    pub fn check(&self) -> Result<(), Error> {
        let positive = |option, value: f64| {
            let holds = value.is_finite() && value > 0.0;
            require(holds, option, value, "be a positive number")
        };
        match self.sizing {
            Sizing::Uniform {
                edge_length: Some(length),
            } => positive("edge_length", length)?,
            Sizing::Uniform { edge_length: None } => {}
            Sizing::Curvature {
                tolerance,
                min_edge,
                max_edge,
                gradation,
            } => {
                positive("tolerance", tolerance)?;
                positive("min_edge", min_edge)?;
                positive("gradation", gradation)?;
                let holds = max_edge.is_finite() && max_edge >= min_edge;
                require(
                    holds,
                    "max_edge",
                    max_edge,
                    "be a number that is not below min_edge",
                )?;
                // A length is spread as the way along which it would grow from nothing.
                let holds = (max_edge / gradation).is_finite();
                let must = "be so large that max_edge / gradation is a finite number";
                require(holds, "gradation", gradation, must)?;
            }
        }
        if let Features::Angle(angle) = self.features {
            let holds = angle > 0.0 && angle <= 180.0;
            require(
                holds,
                "features",
                angle,
                "be an angle above 0° and at most 180°",
            )?;
        }
        require(
            self.level.is_finite(),
            "level",
            self.level,
            "be a finite number",
        )?;
        if let Some(value) = self.max_deviation {
            let must = "be a positive number, or infinite for no bound";
            require(value > 0.0, "max_deviation", value, must)?;
        }
        let holds = (0.0..60.0).contains(&self.min_angle_deg);
        let must = "be an angle from 0° to below 60°";
        require(holds, "min_angle_deg", self.min_angle_deg, must)?;
        Ok(())
    }
}

/// Why a surface cannot be remeshed. Options first, then the triangles, labels, connectivity, and the number of
/// triangles to expect. Once rounds have begun, only [`Error::Cancelled`] can end them.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The mesh has no triangles.
    #[error("the mesh has no triangles")]
    Empty,
    /// The mesh is no oriented manifold.
    #[error("{0}; geom_core::surface::repair::repair can cure that")]
    NotManifold(#[from] MeshError),
    /// A triangle without area has no normal to follow.
    #[error(
        "triangle {triangle} has no area; geom_core::surface::repair::repair drops such triangles"
    )]
    Degenerate {
        /// The first such triangle.
        triangle: usize,
    },
    /// The square of a triangle's area is no finite number.
    #[error("triangle {triangle} is too large to be measured; scale the mesh down")]
    TooLarge {
        /// The first such triangle.
        triangle: usize,
    },
    /// The wanted lengths cannot be spread over the surface.
    #[error(transparent)]
    Distance(#[from] DistanceError),
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// An edge to keep is no edge of the mesh.
    #[error("feature {feature} joins vertices {from} and {to}, which no edge of the mesh does")]
    NoSuchEdge {
        /// Which of [`Features::Edges`].
        feature: usize,
        /// One vertex.
        from: u32,
        /// The other.
        to: u32,
    },
    /// Not one label per triangle.
    #[error("{labels} labels for {triangles} triangles; give one per triangle or none")]
    Labels {
        /// Number of labels.
        labels: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// The wanted edges are too short for the memory granted.
    #[error(
        "the wanted edges make about {estimate} triangles, more than max_triangles = {limit}; \
         ask for longer edges or allow more"
    )]
    TooMany {
        /// Expected number of triangles.
        estimate: u64,
        /// [`Options::max_triangles`].
        limit: usize,
    },
    /// The watcher asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
