//! Why a mesh cannot be improved.

use geom_core::Cancelled;
use geom_core::compute::BackendError;
use geom_core::options::OutOfRange;

/// Why a mesh cannot be improved.
///
/// All but the last two come before the first pass. The mesh has been moved into the verb: who wants to try again with
/// other options keeps a copy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// More than two tetrahedra share a face.
    #[error(
        "face {face:?} of tetrahedron {element} belongs to more than two tetrahedra; remove the overlapping elements"
    )]
    NonManifoldFace {
        /// One of the tetrahedra, the third in number.
        element: usize,
        /// The corners of the face.
        face: [u32; 3],
    },
    /// No choice of sides makes all neighbours lie on opposite sides of their common faces.
    #[error(
        "the tetrahedra around {element} and {neighbour} cannot be oriented alike: some of them overlap; remove one"
    )]
    NotOrientable {
        /// The lower-numbered tetrahedron.
        element: usize,
        /// The other one.
        neighbour: usize,
    },
    /// Tetrahedra are inverted or flat, and [`Options::untangle`](crate::Options::untangle) could not
    /// change that or is off.
    #[error(
        "{} tetrahedra are inverted or flat and could not be untangled, the first is {}", elements.len(), elements[0]
    )]
    StillInverted {
        /// The tetrahedra of the input, in order.
        elements: Vec<u32>,
    },
    /// The field is not a finite number at a surface vertex.
    #[error(
        "the implicit field is not a finite number at vertex {vertex}; is the vertex outside of the field?"
    )]
    FieldNotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// The watcher asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The backend failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

#[cfg(feature = "wgpu")]
impl From<geom_core::GpuError> for Error {
    fn from(error: geom_core::GpuError) -> Self {
        Self::Backend(error.into())
    }
}
