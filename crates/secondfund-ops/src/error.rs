use geom_core::algebra;
use geom_core::algebra::eigen;
use geom_core::compute::BackendError;
use geom_core::options::OutOfRange;
use geom_core::search::nearest;
use geom_core::surface::laplace;
use geom_core::{Cancelled, MeshError};

/// Why there is no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// The surface has no extent: no vertices, or all in one place.
    #[error("the surface has no extent, so it has no scale; is it empty?")]
    NoExtent,
    /// Values and what should carry them differ in number.
    #[error("{what}: {found} values where {expected} are needed")]
    Length {
        /// What the values are.
        what: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        expected: usize,
    },
    /// A field of a weight is not positive.
    #[error("the field of the weight is not a positive finite number at vertex {vertex}")]
    Field {
        /// The vertex.
        vertex: usize,
    },
    /// A given normal is not finite.
    #[error("the normal of vertex {vertex} is not finite")]
    Normal {
        /// The vertex.
        vertex: usize,
    },
    /// More modes than the surface has.
    #[error(
        "{asked} modes of a surface of {vertices} vertices, of which it must have more: fewer modes or smaller faces help"
    )]
    TooManyModes {
        /// Modes asked for.
        asked: usize,
        /// Vertices of the surface.
        vertices: usize,
    },
    /// The operator has no smallest eigenvalue.
    #[error(
        "the operator is indefinite on this surface (it has saddles), so it has no smallest eigenpairs; \
         use the Laplace–Beltrami or the secondary Laplace operator"
    )]
    Indefinite,
    /// A vertex of the control mesh has a number of quads that is not built.
    #[error("vertex {vertex} has {quads} quads; {must}")]
    Valence {
        /// The vertex.
        vertex: usize,
        /// Its quads.
        quads: usize,
        /// What is allowed.
        must: &'static str,
    },
    /// Without regularization the conductivity is infinite where a principal curvature vanishes.
    #[error(
        "a principal curvature vanishes in triangle or quad {element}, so that the operator is infinite there; \
         use a regularization above 0"
    )]
    Flat {
        /// The triangle or quad.
        element: usize,
    },
    /// More than a hundredth of a surface's quadrature points have no area.
    #[error("{skipped} quadrature points have no area, the first of them in quad {quad}")]
    DegeneratePatch {
        /// The first quad.
        quad: usize,
        /// Points without area.
        skipped: usize,
    },
    /// A node of a spline has no place or no weight.
    #[error("node {node} has no finite place or no positive finite weight")]
    Node {
        /// The node.
        node: usize,
    },
    /// An element of a spline cannot be evaluated.
    #[error("element {element} must {must}")]
    Element {
        /// The element.
        element: usize,
        /// What it must.
        must: &'static str,
    },
    /// The surface has a boundary where it must have none.
    #[error(
        "{what} needs a closed surface; the edge from vertex {from} to vertex {to} has one face"
    )]
    Open {
        /// What needs it.
        what: &'static str,
        /// One end of a boundary edge.
        from: u32,
        /// The other end.
        to: u32,
    },
    /// An atom has a coordinate or a radius that makes no sense.
    #[error(
        "atom {atom} has {field} {value}; coordinates must lie within ±1e7 Å, radii in [0, 20] Å"
    )]
    BadAtom {
        /// Index of the atom, from 0.
        atom: usize,
        /// Which of its numbers.
        field: &'static str,
        /// The number.
        value: f64,
    },
    /// The structure has no atoms to look for pockets between.
    #[error("the structure has no polymer atoms, so it has no pockets; are they ligands only?")]
    NoAtoms,
    /// The mesh is not manifold or not oriented.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A matrix cannot be made or factored.
    #[error(transparent)]
    Matrix(#[from] algebra::Error),
    /// There are no eigenpairs.
    #[error(transparent)]
    Spectral(#[from] eigen::Error),
    /// The Laplace operator of a triangle mesh cannot be made.
    #[error(transparent)]
    Laplace(#[from] laplace::Error),
    /// Distances along the surface cannot be found.
    #[error(transparent)]
    Distance(#[from] geom_core::surface::distance::DistanceError),
    /// Points are not finite.
    #[error(transparent)]
    Nearest(#[from] nearest::NearestError),
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
        Self::Backend(BackendError::new(error))
    }
}
