//! Catmull–Clark limit surfaces: subdivision, limit positions, patches and their tables.
//!
//! A mesh of quads is read as the control net of a smooth surface: each step of subdivision (Catmull and Clark, 1978) cuts every
//! quad into four and takes means, and what that converges to is the limit surface. Where four quads meet at every corner of a
//! quad its part of the surface is a bicubic B-spline patch, whose forms are exact; at other corners, *extraordinary* ones, it is
//! such patches in rings that shrink towards the corner. So curvature is had from quads without any estimate.
//!
//! | file | answers |
//! |---|---|
//! | `subdivide` | what one step makes of a mesh |
//! | `limit` | where a vertex ends, and which control points end at given places |
//! | `patches`, `net`, `rim`, `ghosts` | which control points shape the surface over a quad, at extraordinary corners and boundaries too |
//! | `tables` | the functions of these points, with derivatives, at the points of quadrature |
//! | `surface` | positions, forms and nearest places on the whole |

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
