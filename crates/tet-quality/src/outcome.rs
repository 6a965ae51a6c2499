//! What comes out of an improvement: the mesh, and an account of what was done and what falls short.

use geom_core::TetMesh;

use crate::measure::report::QualityReport;
use crate::measure::unmet::{SurfaceFit, Unmet};

/// What happened in a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pass {
    /// Smallest objective after the pass: see [`quality`](crate::measure::metrics::quality).
    pub worst: f64,
    /// Moves of vertices inside, on box faces and on plane boundaries.
    /// A vertex that moves in both sweeps of a pass counts twice.
    pub moved: usize,
    /// Moves of vertices on the isosurface.
    pub slid: usize,
    /// Moves of vertices back to the isosurface, and of those where a plane wall meets it to both.
    pub projected: usize,
    /// Edges removed.
    pub edges_removed: usize,
    /// Faces swapped.
    pub faces_swapped: usize,
    /// Surface edges flipped.
    pub surface_flips: usize,
    /// Edges contracted.
    /// Each takes one vertex from the mesh.
    pub contracted: usize,
    /// Vertices inserted.
    pub inserted: usize,
}

impl Pass {
    /// All that was done; a pass without any would be repeated in vain.
    pub(crate) fn changes(&self) -> usize {
        self.moved
            + self.slid
            + self.projected
            + self.edges_removed
            + self.faces_swapped
            + self.surface_flips
            + self.contracted
            + self.inserted
    }
}

/// What [`improve`](crate::improve()) did.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// Name of the backend.
    pub backend: String,
    /// Quality of the input, its tetrahedra oriented alike.
    pub before: QualityReport,
    /// Quality of the result.
    pub after: QualityReport,
    /// Does every tetrahedron meet the goals?
    /// Decided in f64 on the CPU, while [`Report::after`] is as exact as the backend.
    pub converged: bool,
    /// What each pass did; those that mend what parting of walls has cost come last.
    pub passes: Vec<Pass>,
    /// Tetrahedra of the input whose corners were reordered, because their neighbours said so.
    pub reoriented: usize,
    /// Inverted and flat tetrahedra of the input that were untangled.
    pub untangled: usize,
    /// Moves of the averaged mean curvature flow.
    pub flowed: usize,
    /// Tetrahedra that do not meet the goals, and why.
    pub unmet: Unmet,
    /// How often the boundary goes through itself.
    pub crossings: Crossings,
    /// How well the surface vertices lie on the isosurface.
    pub surface: SurfaceFit,
    /// Vertices of the input around which the interface is not one disk. They stay where they are, but where the isosurface
    /// and a plane wall between two other regions meet: there they move along the curve of both, and may be contracted along it.
    pub junctions: Vec<u32>,
}

/// Pairs of boundary triangles that go through each other. Where the other side of a boundary is meshed,
/// there are none; where it is not, walls of narrow gaps may cross though every tetrahedron is positive. They are parted after
/// the passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Crossings {
    /// In the input.
    pub before: usize,
    /// After the passes.
    pub after_passes: usize,
    /// In the result: what could not be parted without falling below the goals.
    pub after: usize,
}

/// An improved mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Improved {
    /// The mesh. Unchanged vertices keep their order; removed ones leave no gap.
    /// Tetrahedra keep their regions, vertices their kinds; new tetrahedra stand in the places of those that are gone,
    /// so that their order tells nothing.
    pub mesh: TetMesh,
    /// What was done.
    pub report: Report,
}
