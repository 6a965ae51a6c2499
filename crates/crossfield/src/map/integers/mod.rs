//! Integers for the seams of a map.

mod coarse;
mod plane;
mod round;
mod spread;
mod upright;

pub(super) use coarse::Coarse;
pub(super) use round::Quadratic;
pub(crate) use spread::Spread;
