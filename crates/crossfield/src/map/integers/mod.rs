//! Integers for the seams of a map.
//!
//! The energy over the integers alone is [`Quadratic`] (`round`), which rounds them. Where rounding lays singular
//! vertices onto each other, `coarse` decimates the relaxed map to triangles between them, `upright` is what these
//! demand of the integers, and `spread` lays such a decimated map on the surface. `plane` has what two of them need:
//! places and transitions with exact parts; `dense` is the linear algebra of rounding.

mod coarse;
mod dense;
mod plane;
mod round;
mod spread;
mod upright;

pub(super) use coarse::Coarse;
pub(super) use round::{Means, Quadratic, cube};
#[cfg(feature = "testing")]
pub(crate) use round::{inverse, rounded};
pub(crate) use spread::Spread;
pub(crate) use upright::AtLeast;
pub(super) use upright::Upright;
#[cfg(feature = "testing")]
pub(crate) use upright::guarded;
