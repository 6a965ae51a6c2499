//! Quad meshes: from an integer-grid map, exactly; improved; and the ladder that always ends with one.
//!
//! **Extraction** ([`extract`]). Points of the surface whose two coordinates in the map are integers become vertices. From
//! each, lines of integer coordinate leave in as many directions as the vertex will have sides: four, three or five at a
//! singular one. A line is followed through the triangles, turned and shifted over seams, until it meets the next vertex; the
//! faces that lines go round are the quads. All this is done in whole numbers: a map has its coordinates in units of 2⁻²⁴
//! lines, so that whether a line passes left or right of a vertex is the sign of an integer, never a matter of rounding (Ebke
//! et al., *QEx: robust quad mesh extraction*, 2013). Nothing is repaired afterwards, since nothing can be broken.
//!
//! Around a handle one or two quads wide the quads would be no mesh: a side returns to its vertex, or two have the same ends.
//! Such a path along sides is a sum of the map's integers, and that it be three sides long is one more condition on these.
//!
//! **Improvement.** The vertices then move on the surface until the corners of the quads are as near to right angles as they
//! get (Eqs. 5.5–5.7 with a sign), and those of the worst quads search for better places one by one. Where no places are good,
//! at a tip or in a tunnel as narrow as the quads, a few quads give way to others that join the same vertices differently.
//!
//! **The ladder** ([`Rung`]). Not every field has a map whose triangles are all upright, and not every surface has triangles
//! fine enough to hold one. [`quadrangulate`] climbs down from what was asked for to what must work: finer triangles, fewer
//! singularities, smaller quads, at last pairs of triangles without any field. Each connected part has a rung of its own, and
//! [`PartReport`] names it with the reasons why the ones before failed.
//!
//! **Quality** ([`quality`]) is the scaled Jacobian of each quad, the sine of its worst corner, signed by the surface's
//! normals over the quad: 1 for rectangles, 0 where three corners lie on a line, negative where the quad is folded over.

mod extract;
mod improve;
mod ladder;
mod narrow;
mod parts;
pub mod quality;
mod rungs;
mod smooth;
mod split;
mod trace;

pub use extract::{Extracted, SurfacePoint, extract};
#[cfg(feature = "testing")]
pub(crate) use improve::{changes, improve, lengths};
pub use ladder::{Quadrangulation, Report, quadrangulate};
#[cfg(feature = "testing")]
pub(crate) use parts::Cuts;
pub use rungs::{PartReport, Rung};
