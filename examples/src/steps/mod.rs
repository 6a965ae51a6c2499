//! The steps of the chain as the programs do them: what is asked is computed, noted in the report and written, with
//! pictures. A program per step asks for one with all of its options, `00_pipeline` for several with their defaults.

pub mod anisotropy;
pub mod density;
pub mod elements;
pub mod modes;
pub mod pockets;
pub mod quads;
pub mod segments;
pub mod spline;
pub mod spline_modes;
pub mod tiles;
