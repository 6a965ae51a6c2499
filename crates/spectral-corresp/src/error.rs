use geom_core::algebra;
use geom_core::algebra::{eigen, graph};
use geom_core::compute::BackendError;
use geom_core::options::OutOfRange;
use geom_core::search::nearest;
use geom_core::{Cancelled, GridError, MeshError};

/// Why there is no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// No lattice point lies inside.
    #[error(
        "no lattice point lies inside the shape: the level is above all values ({largest}), or the spacing too large"
    )]
    Empty {
        /// The largest value.
        largest: f64,
    },
    /// All lattice points lie inside.
    #[error(
        "every lattice point lies inside the shape; is the level below all values ({smallest})?"
    )]
    Full {
        /// The smallest value.
        smallest: f64,
    },
    /// A value or place is not a number.
    #[error("the value or place of lattice point {point} is not finite")]
    NotFinite {
        /// Its place in memory.
        point: usize,
    },
    /// The flags do not fit the lattice.
    #[error("{found} flags for a lattice of {expected} points")]
    Flags {
        /// Flags given.
        found: usize,
        /// Points of the lattice.
        expected: u128,
    },
    /// The lattice has no spacing.
    #[error("the spacing of the lattice is {spacing}; it must be positive and finite")]
    Spacing {
        /// The spacing, Å.
        spacing: f64,
    },
    /// A shape has too few boundary nodes to be matched.
    #[error(
        "a shape of {boundary} boundary nodes; at least {least} are needed: use a smaller spacing"
    )]
    TooSmall {
        /// Its boundary nodes.
        boundary: usize,
        /// How many are needed.
        least: usize,
    },
    /// A lattice takes more memory than allowed.
    #[error(
        "a lattice of {points} points needs about {bytes} bytes, more than the {limit} allowed: use a larger spacing"
    )]
    TooLarge {
        /// Points of the lattice.
        points: u128,
        /// Bytes that they would take.
        bytes: u128,
        /// Bytes allowed.
        limit: u64,
    },
    /// The search takes more memory than allowed.
    #[error(
        "to match {nodes} nodes takes about {bytes} bytes, more than the {limit} allowed: use a larger spacing"
    )]
    Memory {
        /// Nodes of both shapes.
        nodes: usize,
        /// Bytes that they would take.
        bytes: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// Two shapes on lattices of different spacing.
    #[error(
        "the spacings of the shapes are {a} and {b} Å; they may differ by 1 %: make both on one spacing"
    )]
    SpacingMismatch {
        /// Spacing of the first, Å.
        a: f64,
        /// Spacing of the second, Å.
        b: f64,
    },
    /// More modes than a shape has nodes.
    #[error("{asked} modes of a shape of {nodes} nodes")]
    TooManyModes {
        /// Modes asked for.
        asked: usize,
        /// Nodes of the shape.
        nodes: usize,
    },
    /// Too few anchors, or all on one line.
    #[error(
        "{count} anchors do not fix a position in space; at least three that are not on one line are needed"
    )]
    Anchors {
        /// Anchors given.
        count: usize,
    },
    /// A given correspondence does not fit the shapes.
    #[error("{what}: {found} where {expected} are needed")]
    Length {
        /// What is given.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// A map leads between other shapes.
    #[error(
        "the map does not lead from the first of these shapes to the second; is it turned round?"
    )]
    Direction,
    /// A given correspondence names a node that does not exist.
    #[error(
        "boundary node {node} is given to boundary node {image}, but the other shape has {count}"
    )]
    Image {
        /// The node.
        node: usize,
        /// What it is given to.
        image: usize,
        /// Boundary nodes of the other shape.
        count: usize,
    },
    /// A landmark of a morph does not fit the shape.
    #[error("landmark {node} of a shape of {count} nodes, or where it goes is not finite")]
    Landmark {
        /// The node.
        node: u32,
        /// Nodes of the shape.
        count: usize,
    },
    /// A morph is asked for a time that is no number, or so far from both shapes that nothing of them is left.
    #[error(
        "the time of a frame is {time}; it must lie within -10…10 (0 is the first shape, 1 the second)"
    )]
    Time {
        /// The time.
        time: f64,
    },
    /// The joint modes lose all pairs that move in phase.
    #[error("only {kept} joint modes move in phase; the links join too little of the shapes")]
    Unlinked {
        /// Modes that do.
        kept: usize,
    },
    /// The equations of a morph were not solved.
    #[error(
        "the equations of the morph are solved to a relative residual of {residual:e} only; lead more landmarks"
    )]
    NotSolved {
        /// The residual that is left.
        residual: f64,
    },
    /// The mesh is not closed, so it has no inside.
    #[error(
        "the mesh is not closed: the line of lattice row ({j}, {k}) crosses it {crossings} times"
    )]
    Open {
        /// Row along the second axis.
        j: usize,
        /// Row along the third axis.
        k: usize,
        /// Crossings found.
        crossings: usize,
    },
    /// The grid of a frame cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The mesh is not valid.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The graph of a shape cannot be made.
    #[error(transparent)]
    Graph(#[from] graph::Error),
    /// A matrix cannot be made or factored.
    #[error(transparent)]
    Matrix(#[from] algebra::Error),
    /// There are no eigenpairs.
    #[error(transparent)]
    Spectral(#[from] eigen::Error),
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
