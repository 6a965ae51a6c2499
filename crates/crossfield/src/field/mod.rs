//! Cross fields: four directions per triangle, smooth but for a few singular vertices.
//!
//! The sides of a quad mesh run in two directions at each point, and nobody can tell which of the four senses is the first.
//! So a cross is an angle θ (radians) in the frame of its triangle ([`Frames`]) *up to quarter turns*, and what two neighbours
//! have to agree on is which arm of the one continues which of the other. That is the period jump, an integer p per edge:
//!
//! ```text
//! δ = θ_j − θ_i − κ − (π/2) p        zero where the crosses of triangles i and j are parallel
//! E = Σ w δ² + λ̄ Σ (θ − γ)²          smoothness, and how far from the guides γ          (Eq. 4.9)
//! ```
//!
//! with κ the angle between the frames of the two triangles, laid flat at their edge, and w the weight of the edge
//! ([`FieldOptions::weights`](crate::FieldOptions::weights)). With all p given this is a sparse linear system; the p are what
//! is hard, as the number of choices grows exponentially with the edges.
//!
//! Around a vertex the p and κ add up to its **index** in quarters ([`singularity::indices`]): 0 where four quads will meet,
//! +1 where three do, −1 where five do. The sum over a closed surface is four times its Euler characteristic, whatever the
//! field: a sphere has eight vertices of three quads at least, a torus needs none. Fewer singular vertices make a more regular
//! mesh and more of them a smoother field; [`FieldOptions`](crate::FieldOptions) says what one is worth.
//!
//! ```
//! use crossfield::field::{Frames, Guide, Toward, cross_field};
//! use crossfield::geom_core::{Cpu, Run, mesh::shapes};
//! use crossfield::FieldOptions;
//!
//! let sphere = shapes::icosphere(2.0, 3);
//! let options = FieldOptions::default();
//! // In triangle 7 an arm along its first side, exactly.
//! let guide = Guide { face: 7, toward: Toward::Side(0), weight: f64::INFINITY };
//! let field = cross_field(&sphere, &[guide], &options, Run::on(&Cpu))?;
//! assert_eq!(field.index.iter().sum::<i32>(), 4 * 2);
//!
//! let frames = Frames::of(&sphere, options.weights)?;
//! let side = sphere.corners(7)[1] - sphere.corners(7)[0];
//! let arms = field.arms(&frames, 7);
//! assert!(arms.iter().any(|arm| arm.dot(&side.normalize()) > 0.999));
//! # Ok::<(), crossfield::Error>(())
//! ```

mod descend;
mod diffuse;
#[expect(clippy::module_inception, reason = "the field of the folder's name")]
mod field;
pub mod frames;
mod near;
mod parallel;
pub mod singularity;
pub(crate) mod smooth;
pub(crate) mod solve;

#[cfg(feature = "testing")]
pub(crate) use descend::{NEAR, price};
pub use field::{CrossField, FieldReport, Guide, Toward};
pub use frames::Frames;
pub use solve::cross_field;
