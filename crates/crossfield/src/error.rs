use geom_core::algebra::{self, eigen};
use geom_core::compute::BackendError;
use geom_core::options::OutOfRange;
use geom_core::search::bvh::TreeError;
use geom_core::surface::distance::DistanceError;
use geom_core::surface::{laplace, repair};
use geom_core::{Cancelled, MeshError};

/// Why there is no field, no map or no quad mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// The surface has no triangle.
    #[error("the surface has no triangle")]
    Empty,
    /// The surface has no area, or one that is no number in double precision.
    #[error(
        "the surface has an area of {area} Å²; are all of its triangles flat, or its coordinates too large?"
    )]
    Area {
        /// As it was summed up.
        area: f64,
    },
    /// More memory would be needed than allowed.
    #[error(
        "the quads need about {:.1} GB, more than the {:.1} GB of max_memory; fewer quads or a larger spacing help",
        bytes / 1e9, *limit as f64 / 1e9
    )]
    TooLarge {
        /// Estimated bytes.
        bytes: f64,
        /// The limit.
        limit: u64,
    },
    /// The map folds: two singularities are too near to each other for the spacing, or the field cannot be integrated.
    #[error(
        "{triangles} triangles of the map are inverted and {cones} vertices have a wrong angle after {stage}; {}",
        if *relaxed { "a larger smoothing or singularity penalty helps" } else { "a smaller spacing or a larger smoothing helps" }
    )]
    Folded {
        /// Triangles without positive area in the map.
        triangles: usize,
        /// Vertices around which the map's angles do not add up to what the field says.
        cones: usize,
        /// What was done last before the map was to be unfolded for good.
        stage: &'static str,
        /// Whether it folds with real numbers in place of the integers: then no spacing helps, only another field.
        relaxed: bool,
    },
    /// The map has room only for far more quads than wanted.
    #[error(
        "the map has {quads} quads where {wanted} are wanted; a smaller spacing or a larger smoothing helps"
    )]
    TooMany {
        /// Quads of the map.
        quads: usize,
        /// Quads wanted.
        wanted: usize,
    },
    /// Quads of the map face the wrong way, or nearly, wherever their vertices are moved.
    #[error(
        "{quads} quads of the map face the wrong way or nearly; a smaller spacing or a smaller smoothing helps"
    )]
    Inverted {
        /// So many.
        quads: usize,
    },
    /// The rungs before have done the work that a surface of so many triangles is worth.
    #[error(
        "the work that so many triangles are worth has been done; fewer quads or a larger smoothing help"
    )]
    Spent,
    /// The map has too many integers, two or so for each singular vertex and each handle, for the work that so many triangles are
    /// worth.
    #[error(
        "the map has {integers} integers, more than so many triangles are worth; fewer quads, a larger smoothing or singularity penalty help"
    )]
    Integers {
        /// How many.
        integers: usize,
    },
    /// A line of the map leads nowhere: the map is not an integer-grid map.
    #[error("a line of the map cannot be followed from triangle {face}: {why}")]
    Torn {
        /// The triangle it starts in.
        face: usize,
        /// What was met.
        why: &'static str,
    },
    /// The quads of a map have another Euler characteristic or other boundaries than the surface.
    #[error(
        "the quads have Euler characteristic {euler} and {loops} boundary loops, the surface {wanted_euler} and \
         {wanted_loops}; a smaller spacing helps"
    )]
    Topology {
        /// Euler characteristic of the quads.
        euler: i64,
        /// Boundary loops of the quads.
        loops: usize,
        /// Euler characteristic of the surface.
        wanted_euler: i64,
        /// Boundary loops of the surface.
        wanted_loops: usize,
    },
    /// The mesh is not an oriented manifold, or not finite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A triangle without area, or another number of values.
    #[error(transparent)]
    Operator(#[from] laplace::Error),
    /// A matrix cannot be factored.
    #[error(transparent)]
    Matrix(#[from] algebra::Error),
    /// The nearest point of the surface cannot be found: a point is not finite.
    #[error(transparent)]
    Tree(#[from] TreeError),
    /// Distances cannot be found.
    #[error(transparent)]
    Distance(#[from] DistanceError),
    /// The eigenfunctions of the guidance cannot be found.
    #[error(transparent)]
    Eigen(#[from] eigen::Error),
    /// The input cannot be repaired.
    #[error(transparent)]
    Repair(#[from] repair::RepairError),
    /// The backend failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// The watcher asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

#[cfg(feature = "wgpu")]
impl From<geom_core::GpuError> for Error {
    fn from(error: geom_core::GpuError) -> Self {
        Self::Backend(BackendError::new(error))
    }
}
