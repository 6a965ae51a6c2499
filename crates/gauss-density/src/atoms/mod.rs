//! Fewer atoms for the same surface: elimination and refit, and the samples that both look at.
//!
//! - `eliminate`: removes atoms while every sample keeps its share of the density (Algorithm 1).
//! - `refit`: moves what remains towards the original density (Eqs. 3.11–3.14).
//! - `samples`: the points near the surface where both look, in cells that share their atoms.

pub(crate) mod eliminate;
pub(crate) mod refit;
pub(crate) mod samples;
