//! Pockets: where a ligand may bind between the atoms of polymers, and which part of the surface that is.
//!
//! Three steps, each a file. A ligand's atoms lie in a thin shell outside of the polymer's atoms, and where they bind that shell lies
//! deep: `shell` counts for each of its points the atoms around. Deep points that hang together are a candidate, ranked by
//! how deep and how many they are: `sites`. The faces of the surface that look at these points, cut out along patches on which the
//! modes of the secondary operator hardly change, are the pocket on the surface: `patches`, `outline`. `measure` says how large
//! it is, and `score` how often a known ligand is found.
//!
//! ```
//! use geom_core::io::structure::{ReadOptions, read};
//! use secondfund_ops::{PocketOptions, geom_core, pockets};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A protease with its inhibitor, which is left out of the search.
//! let structure = read(fixtures::path("1hvr.pdb"), &ReadOptions::default())?.structure;
//! let found = pockets::find(&structure, &PocketOptions::default())?;
//! let ligand = structure.of_kind(geom_core::structure::ResidueKind::Ligand);
//! let center = ligand.center_bounds().center();
//! assert!((found.pockets[0].center - center).norm() < 4.0);
//! # Ok(())
//! # }
//! ```

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
