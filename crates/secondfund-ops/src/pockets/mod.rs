//! operator.

mod atoms;
mod score;
mod shell;
mod sites;

pub use score::{SiteScore, distance_to_ligand, site_ranks};
pub use shell::burial;
pub use sites::{Pocket, Pockets, find};
