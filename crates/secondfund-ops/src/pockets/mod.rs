//! Pockets: where a ligand may bind between the atoms of polymers, and which part of the surface that is.

mod atoms;
mod literal;
pub(crate) mod measure;
mod outline;
mod patches;
mod probes;
mod score;
mod shell;
pub(crate) mod sites;

pub use literal::concave_patches;
pub use measure::Outline;
pub use outline::outline;
pub use probes::between_probes;
pub use score::{FieldScore, SiteScore, distance_to_ligand, field_in, site_ranks};
pub use shell::burial;
pub use sites::{Pocket, Pockets, find};
