//! Integer-grid maps: a surface cut open and laid out so that the lines of integer coordinates are quads'
//! sides.
//!
//! Draw the lines u = 0, ±1, ±2, … and v = 0, ±1, ±2, … onto a flat copy of the surface, fold it back, and the surface is
//! covered with squares. For that the copy must fit where it was cut, which is what makes a map an *integer-grid* map (Bommes
//! et al., *Integer-grid maps for reliable quad meshing*, 2013):
//!
//! * **Seams.** Over a cut the coordinates may turn by quarters and shift by whole numbers, `(u, v)′ = R(−90° k) (u, v) + t`
//!   with t in ℤ²: lines of the one side then meet lines of the other.
//! * **Singular vertices** lie at points with two integer coordinates, so that a vertex of the quads is there.
//! * **Boundaries and sharp edges** have an integer as one of their coordinates: they are made of sides of quads.
//! * **Every triangle is upright**: its area in the map is positive, and all around a vertex of index I/4 the angles of the map
//!   add up to 2π − I π/2, neither more nor less.
//!
//! Between maps that are so, the energy of Eq. 4.10 decides, the mean over the area of `|h ∇u − U|² + |h ∇v − W|²` for the
//! field's arms U, W and the distance h of neighbouring lines in Å. [`parameterize`] finds one in these steps:
//!
//! | step | what it does | where it may fail |
//! |---|---|---|
//! | cut | opens the surface to a disk with all singular vertices on its rim | |
//! | conditions | all of the above as integer sums of independent unknowns, and of sums of these, by exact elimination | |
//! | relaxation | the optimum with real numbers in place of integers; if it folds, from the sizes its cones ask for to a convex set of upright maps, then place by place, then as a whole | rarely: it stays folded |
//! | integers | rounds them, one by one or region by region, and until a decimated map is upright and no handle too narrow | singular vertices end on one point; no work is left for them |
//! | untangling | unfolds what rounding has folded, the integers held, in the same way | triangles have too little freedom |
//! | check | coordinates in fixed point, areas and angles in integers | says which triangle is folded |
//!
//! A map belongs to its field and its frames; the quads of it are [`quads::extract`](crate::quads::extract). Step by step
//! what [`quadrangulate`](crate::quadrangulate) does at once, where nothing fails:
//!
//! ```
//! use crossfield::field::{Frames, cross_field};
//! use crossfield::geom_core::{Cpu, Run, mesh::shapes};
//! use crossfield::map::{MapOptions, Spacing, parameterize};
//! use crossfield::{FieldOptions, quads};
//!
//! let torus = shapes::torus(3.0, 1.0, 48, 24);
//! let options = FieldOptions::default();
//! let frames = Frames::of(&torus, options.weights)?;
//! let field = cross_field(&torus, &[], &options, Run::on(&Cpu))?;
//!
//! // Lines 0.5 Å apart.
//! let asked = MapOptions { spacing: Spacing::Uniform(0.5), lines: Vec::new() };
//! let map = parameterize(&torus, &frames, &field, &asked, Run::on(&Cpu))?;
//! // No triangle is turned over.
//! for face in 0..torus.triangles().len() {
//!     let [a, b, c] = map.coordinates(face);
//!     assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0);
//! }
//! let made = quads::extract(&torus, &frames, &map)?;
//! assert_eq!(made.mesh.euler_characteristic(), 0);
//! # Ok::<(), crossfield::Error>(())
//! ```

mod cones;
mod conformal;
mod cut;
pub(crate) mod exact;
mod integers;
mod net;
mod parameterize;
mod spacing;
mod system;
mod transition;
mod unfold;

pub(crate) use integers::{AtLeast, MOST_DENSE, Spread};
#[cfg(feature = "testing")]
pub(crate) use integers::{guarded, inverse, mended, rounded};
pub(crate) use net::Net;
pub(crate) use parameterize::{Laid, Narrow, Relaxation, Widening, parameterized, relaxation};
#[cfg(feature = "testing")]
pub(crate) use parameterize::{
    aligned, decimated, of_integers, parameterized_within, settled, sizes, unfolded_places,
    unfolding_costs, untangling_cost, whole_map,
};
#[cfg(feature = "testing")]
pub(crate) use unfold::monotone;
pub(crate) use unfold::{Effort, Ends, Folded, Unfolding};

pub use exact::{GridMap, MapReport};
pub use parameterize::{MapOptions, parameterize};
#[cfg(feature = "testing")]
#[doc(hidden)]
pub use parameterize::{OfIntegers, Settled, Unfolded};
pub use spacing::{Chart, Spacing};
