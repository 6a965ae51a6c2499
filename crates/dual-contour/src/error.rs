//! Why no mesh can be made.

/// Why no mesh can be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Every value lies on one side of the level.
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
    /// An option makes no sense.
    #[error("option {option}: {reason}")]
    InvalidOption {
        /// Name of the field of [`Options`](crate::Options).
        option: &'static str,
        /// What is wrong, and what would be right.
        reason: String,
    },
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
    #[error(transparent)]
    Cancelled(#[from] geom_core::Cancelled),
    /// The GPU cannot serve.
    #[cfg(feature = "wgpu")]
    #[error(transparent)]
    Gpu(#[from] geom_core::GpuError),
}

const SIDES: [&str; 6] = ["low x", "high x", "low y", "high y", "low z", "high z"];
