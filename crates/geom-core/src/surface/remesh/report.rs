//! What was done, and what came of it.

use crate::TriMesh;
use crate::mesh::TriangleReport;

/// How long the edges are, in units of what [`Options::sizing`](super::Options::sizing) wants there. Each edge counts once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RelativeLengths {
    /// Shortest.
    pub min: f64,
    /// One in a hundred is shorter.
    pub percent_1: f64,
    /// Half are shorter.
    pub median: f64,
    /// One in a hundred is longer.
    pub percent_99: f64,
    /// Longest.
    pub max: f64,
    /// Share of the edges from 4/5 to 4/3, which are neither split nor contracted.
    pub within: f64,
}

/// Distances from the surface to follow, Å.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Deviation {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

/// Why a triangle stays below [`Options::min_angle_deg`](super::Options::min_angle_deg).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Cause {
    /// The angle lies between two kept edges that the input has so.
    KeptEdges,
    /// The level set and the input disagree here, as on necks and tunnels that only one of them has.
    OffLevel,
    /// The surface is folded so sharply that the triangle cannot face as its corners do.
    Fold,
    /// The surface is narrower than the shortest edges allowed here.
    Narrow,
    /// Nothing that was tried helped.
    NothingHelped,
}

/// A triangle below [`Options::min_angle_deg`](super::Options::min_angle_deg). Listed by the number of the triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Exception {
    /// Which triangle of the result.
    pub triangle: u32,
    /// Its smallest angle, degrees.
    pub angle_deg: f64,
    /// Why.
    pub cause: Cause,
}

/// What was done, and what came of it. Splits, contractions, flips and rounds are those of the last start, where the
/// work began anew.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// The input.
    pub before: TriangleReport,
    /// The result.
    pub after: TriangleReport,
    /// Rounds done.
    pub iterations: usize,
    /// Edges split.
    pub splits: usize,
    /// Edges contracted.
    pub contractions: usize,
    /// Edges flipped.
    pub flips: usize,
    /// How often edges were made shorter where a goal was missed.
    pub refinements: usize,
    /// Share of the result's vertices where edges are now wanted shorter than [`Options::sizing`](super::Options::sizing) says.
    pub shortened: f64,
    /// Lengths of the result's edges.
    pub lengths: RelativeLengths,
    /// Edges of the result that are kept: features and boundaries.
    pub feature_edges: usize,
    /// From the result's vertices to the level set, or to the input mesh where that is nearer.
    pub vertex_deviation: Deviation,
    /// From the middles of the result's edges and triangles to the same.
    pub inner_deviation: Deviation,
    /// From the surface to the result: the largest distance of the input's vertices and middles of edges
    /// and triangles, after their way to the level set.
    pub reverse_deviation: f64,
    /// What [`Options::max_deviation`](super::Options::max_deviation) allowed.
    pub allowed_deviation: f64,
    /// Vertices farther from the level set than a hundredth of the wanted edge length: they lie on
    /// necks, tunnels and pieces of the input that the level set has not, and follow the input there.
    pub off_level: usize,
    /// The triangles below [`Options::min_angle_deg`](super::Options::min_angle_deg), with the cause.
    pub exceptions: Vec<Exception>,
    /// Did the last round change less than one edge in a hundred, are all angles at least
    /// [`Options::min_angle_deg`](super::Options::min_angle_deg) and all distances within what is allowed?
    pub converged: bool,
}

/// A remeshed surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Remeshed {
    /// The surface.
    pub mesh: TriMesh,
    /// The label of each triangle, if the input had labels.
    pub labels: Vec<u32>,
    /// Measures before and after.
    pub report: Report,
}
