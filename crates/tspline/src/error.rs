use geom_core::compute::BackendError;
use geom_core::options::OutOfRange;
use geom_core::search::bvh::TreeError;
use geom_core::{Cancelled, MeshError};

/// Why there is no T-mesh or no surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// There is no quad.
    #[error("the mesh has no quad")]
    Empty,
    /// Per-element values and elements differ in number.
    #[error("{found} {what} for {expected}; there must be one each")]
    Count {
        /// What the values are.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// A quad allows a level beyond the highest.
    #[error(
        "quad {quad} allows level {level}; the highest is {}",
        crate::options::MAX_LEVEL
    )]
    Level {
        /// The quad.
        quad: usize,
        /// Its level.
        level: u8,
    },
    /// A coarse element lacks neighbours of its level.
    #[error(
        "around vertex {vertex} of the fine mesh a block of level {level} is missing; build the T-mesh with more rings"
    )]
    Ring {
        /// The fine vertex.
        vertex: u32,
        /// The level.
        level: u8,
    },
    /// A basis or file that is for closed surfaces only.
    #[error(
        "{what} needs a closed surface, and this one has a boundary; use the hierarchical basis"
    )]
    Open {
        /// What needs it.
        what: &'static str,
    },
    /// The functions of a cut T-mesh do not contain those of the one before.
    #[error("T-splines are not nested; make the surface of the cut T-mesh anew and fit it")]
    NotNested,
    /// Extensions of T-junctions meet across, and cutting elements until none does is not asked for or takes too many.
    #[error(
        "extensions of T-junctions meet in {meetings} places of {before} elements, which cutting makes {elements} or more; use \
         the hierarchical basis"
    )]
    NotSuitable {
        /// Places where they meet.
        meetings: usize,
        /// Elements at which it was given up.
        elements: usize,
        /// Elements that there were.
        before: usize,
    },
    /// A control point is NaN or infinite, or its weight is not positive.
    #[error(
        "control point {control} has a coordinate that is not a finite number, or a weight that is not positive"
    )]
    NotFinite {
        /// The control point.
        control: usize,
    },
    /// A file is not what it should be.
    #[error("line {line}: {expected} expected, found {found:?}")]
    File {
        /// The line, from 1 on.
        line: usize,
        /// What should be there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// A matrix cannot be made or factored.
    #[error(transparent)]
    Matrix(#[from] geom_core::algebra::Error),
    /// There are no eigenpairs.
    #[error(transparent)]
    Spectral(#[from] geom_core::algebra::eigen::Error),
    /// A system of equations was not solved to its tolerance.
    #[error(
        "the equations are solved to a relative residual of {residual:e} only; is the surface in one piece?"
    )]
    NotSolved {
        /// The residual that is left.
        residual: f64,
    },
    /// A recorded T-mesh contradicts itself.
    #[error(
        "the {what} of the recorded T-mesh do not follow from its fine quads and levels; write it anew"
    )]
    Record {
        /// Which of its numbers.
        what: &'static str,
    },
    /// The mesh is not an oriented manifold, or not finite.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The nearest point of the surface cannot be found.
    #[error(transparent)]
    Tree(#[from] TreeError),
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
