use geom_core::{Cancelled, MeshError, distance::DistanceError, laplace, linalg, spectral};

/// Why there is no field, no map or no quad mesh.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option is out of its range.
    #[error("option {option} is {value}, it must be {must}")]
    InvalidOption {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What is allowed.
        must: &'static str,
    },
    /// The surface has no triangle.
    #[error("the surface has no triangle")]
    Empty,
    /// A value per triangle or vertex is missing.
    #[error("{found} {what}, {expected} are needed")]
    Length {
        /// What the values are.
        what: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        expected: usize,
    },
    /// The map folds: the spacing is too wide for the distances of the singularities, or the field cannot be
    /// integrated.
    #[error(
        "{triangles} triangles of the map are inverted and {cones} vertices have a wrong angle after {stage}; \
         a smaller spacing or a larger smoothing helps"
    )]
    Folded {
        /// Triangles without positive area in the map.
        triangles: usize,
        /// Vertices around which the map's angles do not add up to what the field says.
        cones: usize,
        /// The last stage that tried.
        stage: &'static str,
    },
    /// A line of the map leads nowhere: the map is not an integer-grid map.
    #[error("a line of the map cannot be followed from triangle {face}: {why}")]
    Torn {
        /// The triangle it starts in.
        face: usize,
        /// What was met.
        why: &'static str,
    },
    /// The mesh is not an oriented manifold, or not finite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A triangle without area, or another number of values.
    #[error(transparent)]
    Operator(#[from] laplace::Error),
    /// A matrix cannot be factored.
    #[error(transparent)]
    Matrix(#[from] linalg::Error),
    /// Distances cannot be found.
    #[error(transparent)]
    Distance(#[from] DistanceError),
    /// The eigenfunctions of the guidance cannot be found.
    #[error(transparent)]
    Spectral(#[from] spectral::Error),
    /// The input cannot be repaired.
    #[error(transparent)]
    Repair(#[from] geom_core::repair::RepairError),
    /// The backend failed.
    #[error("the backend failed: {0}")]
    Backend(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The watcher asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

#[cfg(feature = "wgpu")]
impl From<geom_core::GpuError> for Error {
    fn from(error: geom_core::GpuError) -> Self {
        Self::Backend(Box::new(error))
    }
}
