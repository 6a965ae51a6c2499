//! The hot kernels, and what each backend owes to the specification.

use std::ops::Range;

use geom_core::{Agreement, Backend, Point3, Vector3};

use crate::{Error, Measures};

/// The hot kernels of this crate. [`Cpu`](geom_core::Cpu) is the specification.
pub trait QualityBackend: Backend {
    /// The measures of each tetrahedron, in place of what was in `out`, whose memory is used again: that
    /// of a million new ones takes as long as half of the work. Corners must be in range.
    fn measure_into(
        &self,
        positions: &[Point3],
        tets: &[[u32; 4]],
        out: &mut Vec<Measures>,
    ) -> Result<(), Error>;

    /// The measures of each tetrahedron. Corners must be in range.
    fn measure(&self, positions: &[Point3], tets: &[[u32; 4]]) -> Result<Vec<Measures>, Error> {
        let mut out = Vec::new();
        self.measure_into(positions, tets, &mut out)?;
        Ok(out)
    }

    /// Sweeps over the vertices of `task`, colour by colour, each moving to where the worst
    /// tetrahedron around it is best. Gives one displacement per vertex of the task: a *proposal*,
    /// which the caller accepts or refuses on the CPU.
    fn relax(&self, task: &Relaxation<'_>) -> Result<Vec<Vector3>, Error>;
}

/// What a backend owes to [`QualityBackend::measure_into`] on the CPU, for Joe–Liu, edge ratio and angles
/// in units of 180°, on meshes whose edges are longer than a thousandth of the bounding box: f32
/// positions relative to the first corner, so that only flat elements lose digits.
pub const MEASURE: Agreement = Agreement::Bounded {
    relative: 1e-4,
    absolute: 1e-4,
};

/// What a backend owes to [`QualityBackend::relax`] on the CPU with one round, for the objective
/// that each vertex reaches: the best of the candidates is a continuous function of the positions,
/// while the candidate itself may be another one on a tie.
pub const RELAX: Agreement = Agreement::Bounded {
    relative: 1e-3,
    absolute: 2e-3,
};

/// Vertices to move, in colours: no two of a colour share a tetrahedron.
#[derive(Clone, Debug)]
pub struct Relaxation<'a> {
    /// Positions of all vertices of the mesh, Å.
    pub positions: &'a [Point3],
    /// The vertices to move, colour after colour.
    pub vertices: Vec<u32>,
    /// The ranges of `vertices` that are one colour each.
    pub colours: Vec<Range<usize>>,
    /// Per vertex to move: unit directions in which it may move, orthogonal; zero where it may not.
    pub axes: Vec<[Vector3; 3]>,
    /// Per vertex to move: where its faces start in `faces`; one more at the end.
    pub starts: Vec<u32>,
    /// The faces opposite the vertex in the tetrahedra around it, counter-clockwise seen from
    /// outside.
    pub faces: Vec<[u32; 3]>,
    /// Rounds of the search per vertex: each tries the neighbours' mean or the compass directions,
    /// and shortens the step when none is better.
    pub rounds: u32,
}
