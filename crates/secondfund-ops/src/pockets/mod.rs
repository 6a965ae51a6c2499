//! Pockets: where a ligand may bind between the atoms of polymers, and which part of the surface that is.

mod atoms;
mod outline;
mod score;
mod shell;
mod sites;

pub use outline::{Outline, outline};
pub use score::{SiteScore, distance_to_ligand, site_ranks};
pub use shell::burial;
pub use sites::{Pocket, Pockets, find};
