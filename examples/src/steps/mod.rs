//! The steps of the chain as the programs do them: what is asked is computed, noted in the report and written, with
//! pictures. A program per step asks for one with all of its options, `00_pipeline` for several with their defaults.

#[cfg(feature = "analysis")]
pub mod anisotropy;
pub mod density;
#[cfg(feature = "analysis")]
pub mod elements;
#[cfg(feature = "analysis")]
pub mod modes;
#[cfg(feature = "analysis")]
pub mod pockets;
#[cfg(feature = "analysis")]
pub mod quads;
#[cfg(feature = "analysis")]
pub mod segments;
#[cfg(feature = "analysis")]
pub mod spline;
#[cfg(feature = "analysis")]
pub mod spline_modes;
pub mod tiles;
