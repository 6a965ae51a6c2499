//! Integers for the seams of a map.

mod coarse;
mod round;
mod upright;

pub(super) use coarse::Coarse;
pub(super) use round::Quadratic;
