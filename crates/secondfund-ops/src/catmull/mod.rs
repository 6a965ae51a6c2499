//! Catmull–Clark limit surfaces: subdivision, limit positions, patches and their tables.

mod ghosts;
mod limit;
pub(crate) mod net;
mod patches;
mod rim;
mod subdivide;
pub(crate) mod surface;
pub(crate) mod tables;

pub use subdivide::subdivide;
pub use surface::{Jet, Surface};
pub(crate) use surface::{jet, turned};

pub(crate) use patches::Patch;
pub(crate) use tables::{Corner, ROWS, Tables};
