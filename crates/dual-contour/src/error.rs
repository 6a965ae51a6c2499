//! Why no mesh can be made.
//!
//! Nothing is half made: a verb gives a closed, positive mesh or one of these.

use geom_core::compute::BackendError;
use geom_core::options::OutOfRange;

/// Why no mesh can be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Every value lies on one side of the level.
    /// For a density of another isovalue, set [`Options::level`](crate::Options::level); one that is inside throughout
    /// was sampled in too small a box.
    #[error(
        "no surface at level {level}: the values lie between {min} and {max}; choose a level between them"
    )]
    NoSurface {
        /// The level asked for.
        level: f64,
        /// Lowest value.
        min: f64,
        /// Highest value.
        max: f64,
    },
    /// The lattice has no cell.
    #[error("a lattice of {counts:?} points has no cell; at least 2 points per axis are needed")]
    NoCells {
        /// Points per axis.
        counts: [usize; 3],
    },
    /// A value is NaN or infinite.
    #[error("the value at lattice point {index:?} is {value}, not a finite number")]
    NotFinite {
        /// Lattice coordinates.
        index: [usize; 3],
        /// The value.
        value: f32,
    },
    /// A field of [`Options`](crate::Options) makes no sense, for itself or for these values.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// The surface meets the box of the lattice, and [`AtBox::Refuse`](crate::AtBox) is set.
    #[error(
        "the surface meets the {} side of the lattice at {points} points; enlarge the margin of the density, or choose to cap or clip the surface",
        SIDES[*side]
    )]
    SurfaceTouchesBox {
        /// The first side that is met: 0 low x, 1 high x, 2 low y, … 5 high z.
        side: usize,
        /// Lattice points inside of the surface on that side.
        points: u64,
    },
    /// More memory or elements than allowed.
    /// By [`Options::max_memory`](crate::Options::max_memory), or since vertices have 32-bit numbers.
    #[error("{what} would need {bytes} bytes, more than the {limit} allowed; {cure}")]
    TooLarge {
        /// What is too large.
        what: &'static str,
        /// Bytes needed, estimated before allocation.
        bytes: u128,
        /// Bytes allowed.
        limit: u128,
        /// What would help.
        cure: &'static str,
    },
    /// More separate parts of the exterior than regions to name them.
    #[error(
        "the exterior has {parts} separate parts, but only {regions} region numbers are left; prune small ones or leave separate_exterior off"
    )]
    TooManyParts {
        /// Parts of the exterior.
        parts: usize,
        /// Numbers for them.
        regions: usize,
    },
    /// The watcher asked to stop.
    /// It is asked between the steps of a mesh.
    #[error(transparent)]
    Cancelled(#[from] geom_core::Cancelled),
    /// The backend cannot serve: a [`GpuError`](geom_core::GpuError), or what a backend of the caller's own says.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

const SIDES: [&str; 6] = ["low x", "high x", "low y", "high y", "low z", "high z"];

#[cfg(feature = "wgpu")]
impl From<geom_core::GpuError> for Error {
    fn from(error: geom_core::GpuError) -> Self {
        Self::Backend(error.into())
    }
}
