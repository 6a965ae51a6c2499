//! Integers for the seams of a map.
//!
//! The energy over the integers alone is [`Quadratic`] (`round`), which rounds them; [`Regions`] does so where they are too many for
//! its matrices. Where rounding lays singular vertices onto each other, `coarse` decimates the relaxed map to triangles between
//! them, `upright` is what these demand of the integers, `mend` moves them until it holds, several together (`joint`) if need be, and `spread` keeps what is left and lays such a
//! decimated map on the surface. `plane` has what two of them need: places and transitions with exact parts; `dense` is the linear
//! algebra of rounding.

mod coarse;
mod dense;
mod joint;
mod mend;
mod plane;
mod regions;
mod round;
mod spread;
mod upright;

pub(crate) use mend::Energy;
pub(super) use mend::Means;
pub(super) use regions::Regions;
#[cfg(feature = "testing")]
pub(crate) use regions::mended;
pub(crate) use round::MOST_DENSE;
pub(super) use round::{Quadratic, cube};
#[cfg(feature = "testing")]
pub(crate) use round::{inverse, rounded};
pub(super) use spread::Decimated;
pub(crate) use spread::Spread;
pub(crate) use upright::AtLeast;
pub(super) use upright::Upright;
#[cfg(feature = "testing")]
pub(crate) use upright::guarded;
