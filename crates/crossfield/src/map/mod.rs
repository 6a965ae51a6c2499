//! Integer-grid maps: a surface cut open and laid out so that the lines of integer coordinates are quads'
//! sides.

mod cones;
mod cut;
pub(crate) mod exact;
mod integers;
mod parameterize;
mod spacing;
mod system;
mod transition;
mod untangle;

pub(crate) use parameterize::parameterized;
pub(crate) use untangle::Effort;

pub use exact::{GridMap, MapReport};
pub use parameterize::{MapOptions, parameterize};
pub use spacing::{Chart, Spacing};
