//! Why a density cannot be computed: one enum, each variant names the element and the cure.

use geom_core::compute::BackendError;
use geom_core::options::OutOfRange;
use geom_core::{Cancelled, GridError};

/// Why a density cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is nothing to sum.
    #[error(
        "the structure has no atoms; look at the reader's options for hydrogens, water and models"
    )]
    NoAtoms,
    /// More atoms than a 32-bit index can name.
    #[error("{atoms} atoms are more than an index can name (4,294,967,294)")]
    TooManyAtoms {
        /// Number of atoms.
        atoms: usize,
    },
    /// A coordinate, radius or decay is NaN, infinite or out of its range.
    #[error(
        "atom {atom} has {field} {value}; coordinates must lie within ±1e7 Å, radii in [0, 1e4] Å, decays in [1e-6, 1e6] Å⁻²"
    )]
    BadAtom {
        /// Index of the atom, from 0.
        atom: usize,
        /// Which of its numbers.
        field: &'static str,
        /// The number.
        value: f64,
    },
    /// Lists of different lengths.
    #[error("{found} {what} for {atoms} atoms; there must be one per atom")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Number of centres.
        atoms: usize,
    },
    /// A level does not partition the one below it.
    #[error(
        "level {level} of the tree is no partition of the {below} nodes below it: {fault}; its starts must rise from 0 to {below}, with a power for each but the last"
    )]
    BadTree {
        /// The level, 0 for the lowest.
        level: usize,
        /// Nodes or atoms below.
        below: usize,
        /// What is wrong.
        fault: &'static str,
    },
    /// An option that has no meaning.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// A node or atom that the model does not have.
    #[error("{what} {index} does not exist, the model has {count}")]
    NoSuchNode {
        /// Kind of node.
        what: &'static str,
        /// The index that was asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A structure that the model was not made of.
    #[error("the structure has {atoms} atoms, the model {model}; use the structure it was made of")]
    OtherStructure {
        /// Atoms of the structure.
        atoms: usize,
        /// Atoms of the model.
        model: usize,
    },
    /// A selector that means nothing.
    #[error(transparent)]
    Select(#[from] geom_core::structure::SelectError),
    /// The samples near the surface need more memory than allowed.
    #[error(
        "{samples} samples near the surface need about {bytes} bytes, the limit is {limit}; take a larger spacing"
    )]
    TooManySamples {
        /// Number of samples.
        samples: usize,
        /// What they need; of a band, of which that is seen while it is sampled, by the part done so far.
        bytes: u128,
        /// What `max_memory` allows.
        limit: u64,
    },
    /// Every atom would go: the density reaches 1 nowhere that the samples see.
    #[error("no atom would remain: no sample sees a surface; take a smaller spacing")]
    NothingLeft,
    /// The spectrum of a low-pass filter needs more memory than allowed.
    #[error("filtering needs {bytes} bytes, the limit is {limit}; take a coarser grid")]
    TooLargeToFilter {
        /// What the spectrum needs.
        bytes: u128,
        /// What `max_memory` allows.
        limit: u64,
    },
    /// What a backend or a function cannot do.
    #[error("{what}; {cure}")]
    Unsupported {
        /// What was asked for.
        what: String,
        /// What can be done instead.
        cure: &'static str,
    },
    /// The grid needs more memory than allowed.
    #[error(
        "a grid of {points} points needs {bytes} bytes, the limit is {limit}; a spacing of {} Å fits",
        rounded_up(*spacing)
    )]
    GridTooLarge {
        /// Number of points.
        points: u128,
        /// What they need.
        bytes: u128,
        /// What `max_memory` allows.
        limit: u64,
        /// A spacing that fits, Å: about the smallest.
        spacing: f64,
    },
    /// The grid cannot be made.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The watcher asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The backend failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

/// With three digits, and no less than it is.
pub(crate) fn rounded_up(value: f64) -> f64 {
    let digits = (2.0 - value.abs().log10().floor()).clamp(0.0, 300.0) as i32;
    let scale = 10f64.powi(digits);
    (value * scale).ceil() / scale
}

#[cfg(feature = "wgpu")]
impl From<geom_core::GpuError> for Error {
    fn from(error: geom_core::GpuError) -> Self {
        Self::Backend(BackendError::new(error))
    }
}
