//! Integer-grid maps: a surface cut open and laid out so that the lines of integer coordinates are quads'
//! sides.

mod cones;
mod cut;
pub(crate) mod exact;
mod integers;
mod net;
mod parameterize;
mod spacing;
mod system;
mod transition;
mod untangle;

pub(crate) use integers::Spread;
pub(crate) use net::Net;
#[cfg(feature = "testing")]
pub(crate) use parameterize::decimated;
pub(crate) use parameterize::{Laid, Relaxation, parameterized, relaxation};
pub(crate) use untangle::Effort;

pub use exact::{GridMap, MapReport};
pub use parameterize::{MapOptions, parameterize};
pub use spacing::{Chart, Spacing};
