//! The hot kernels, and what each backend owes to the specification.
//!
//! A backend may come from outside of this crate; this one counts its calls and leaves the work to the CPU:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//! use spectral_corresp::backend::{CorrespBackend, HistogramTask, Nearest, RotationTask, Rows, SweepTask};
//! use spectral_corresp::geom_core::algebra::eigen::{self, backend::{Cycle, Multigrid, SpectralBackend}};
//! use spectral_corresp::geom_core::nalgebra::Matrix3;
//! use spectral_corresp::geom_core::{Backend, Cpu, Lattice, Point3, Run};
//! use spectral_corresp::{Error, MatchOptions, ShapeOptions, Start, VoxelShape, correspond};
//!
//! #[derive(Default)]
//! struct Counting(AtomicUsize);
//!
//! impl Backend for Counting {
//!     fn name(&self) -> String {
//!         "counting".to_owned()
//!     }
//! }
//! impl SpectralBackend for Counting {
//!     fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, eigen::Error> {
//!         Cpu.prepare(hierarchy)
//!     }
//! }
//! impl CorrespBackend for Counting {
//!     fn squared_distances(&self, counts: [usize; 3], inside: &[bool], out: &mut Vec<u32>) -> Result<(), Error> {
//!         Cpu.squared_distances(counts, inside, out)
//!     }
//!     fn histograms(&self, task: &HistogramTask<'_>, out: &mut Vec<u32>) -> Result<(), Error> {
//!         Cpu.histograms(task, out)
//!     }
//!     fn nearest(&self, queries: Rows<'_>, targets: Rows<'_>, out: &mut Vec<Nearest>) -> Result<(), Error> {
//!         Cpu.nearest(queries, targets, out)
//!     }
//!     fn rotations(&self, task: &RotationTask<'_>, out: &mut Vec<Matrix3<f64>>) -> Result<(), Error> {
//!         self.0.fetch_add(1, Ordering::Relaxed);
//!         Cpu.rotations(task, out)
//!     }
//!     fn sweep(&self, task: &SweepTask<'_>, out: &mut Vec<Point3>) -> Result<(), Error> {
//!         Cpu.sweep(task, out)
//!     }
//! }
//!
//! let lattice = Lattice { origin: Point3::origin(), spacing: 1.5, counts: [12, 8, 5] };
//! let body = VoxelShape::of_flags(&lattice, vec![true; 480], &ShapeOptions::default(), Run::on(&Cpu))?;
//! let itself = (0..body.boundary().len() as u32).collect();
//! let options = MatchOptions { start: Start::Given(itself), ..MatchOptions::default() };
//! let counting = Counting::default();
//! correspond(&body, &body, &options, Run::on(&counting))?;
//! assert!(counting.0.into_inner() > 0);
//! # Ok::<(), Error>(())
//! ```

use geom_core::algebra::eigen::backend::SpectralBackend;
use geom_core::compute::BackendError;
use geom_core::nalgebra::Matrix3;
use geom_core::{Agreement, Point3};

use crate::Error;
use crate::near::Neighbourhoods;

/// The hot kernels of this crate. [`Cpu`](geom_core::Cpu) and [`Wgpu`](geom_core::Wgpu) have them; what they compute
/// stands in `specification` (feature `testing`) as the equations read.
pub trait CorrespBackend: SpectralBackend + CorrespObject {
    /// The square of the distance of each point of a lattice of `counts` points per axis to the nearest that is not
    /// `inside`, in spacings, in place of what was in `out`; what lies beyond the lattice is outside. Every backend owes
    /// the same ([`Agreement::Exact`]).
    /// One entry per lattice point, the first axis fastest; 0 outside, at least 1 inside.
    fn squared_distances(
        &self,
        counts: [usize; 3],
        inside: &[bool],
        out: &mut Vec<u32>,
    ) -> Result<(), Error>;

    /// Of each node, how much of the nodes near it falls into each bar (Section 6.3.2), node after node, in place of
    /// what was in `out`. Every backend owes the same ([`Agreement::Exact`]).
    /// `bars` numbers per node. A node is near itself.
    fn histograms(&self, task: &HistogramTask<'_>, out: &mut Vec<u32>) -> Result<(), Error>;

    /// The nearest of `targets` to each of `queries`, in place of what was in `out`; of several the first.
    fn nearest(
        &self,
        queries: Rows<'_>,
        targets: Rows<'_>,
        out: &mut Vec<Nearest>,
    ) -> Result<(), Error>;

    /// The rotation of each node's neighbourhood that leaves least between its place now and its place at rest
    /// (Eqs. 6.9–6.11), in place of what was in `out`.
    /// Proper ones; the identity for a node without neighbours, any of the best where several are as good.
    fn rotations(&self, task: &RotationTask<'_>, out: &mut Vec<Matrix3<f64>>) -> Result<(), Error>;

    /// A step of Jacobi's method for the distortion with a pull towards targets, in place of what was in `out`.
    /// All nodes move at once, from the places of the task.
    fn sweep(&self, task: &SweepTask<'_>, out: &mut Vec<Point3>) -> Result<(), Error>;
}

geom_core::backend_object!(CorrespObject, as_corresp -> CorrespBackend);

/// A run on any of them.
pub(crate) type On<'a> = geom_core::Run<'a, dyn CorrespBackend + 'a>;

/// The kernels of a run's backend. One from outside may answer anything: what does not fit the question is an error here, not a
/// panic further on.
pub(crate) trait Kernels {
    fn squared_distances(&self, counts: [usize; 3], inside: &[bool]) -> Result<Vec<u32>, Error>;
    fn histograms(&self, task: &HistogramTask<'_>) -> Result<Vec<u32>, Error>;
    fn nearest(
        &self,
        queries: Rows<'_>,
        targets: Rows<'_>,
        out: &mut Vec<Nearest>,
    ) -> Result<(), Error>;
    fn rotations(&self, task: &RotationTask<'_>, out: &mut Vec<Matrix3<f64>>) -> Result<(), Error>;
    fn sweep(&self, task: &SweepTask<'_>, out: &mut Vec<Point3>) -> Result<(), Error>;
}

impl Kernels for On<'_> {
    fn squared_distances(&self, counts: [usize; 3], inside: &[bool]) -> Result<Vec<u32>, Error> {
        let mut out = Vec::new();
        self.backend.squared_distances(counts, inside, &mut out)?;
        counted(self, "squared distances", out.len(), inside.len())?;
        Ok(out)
    }

    fn histograms(&self, task: &HistogramTask<'_>) -> Result<Vec<u32>, Error> {
        let mut out = Vec::new();
        self.backend.histograms(task, &mut out)?;
        counted(self, "bars", out.len(), task.points.len() * task.bars)?;
        Ok(out)
    }

    fn nearest(
        &self,
        queries: Rows<'_>,
        targets: Rows<'_>,
        out: &mut Vec<Nearest>,
    ) -> Result<(), Error> {
        self.backend.nearest(queries, targets, out)?;
        let asked = if targets.is_empty() { 0 } else { queries.len() };
        counted(self, "nearest rows", out.len(), asked)?;
        let wrong = out.iter().find(|n| n.index as usize >= targets.len());
        let gave = || format!("{wrong:?} of {} rows", targets.len());
        Ok(BackendError::unless(
            wrong.is_none(),
            &self.backend.name(),
            gave,
        )?)
    }

    fn rotations(&self, task: &RotationTask<'_>, out: &mut Vec<Matrix3<f64>>) -> Result<(), Error> {
        self.backend.rotations(task, out)?;
        counted(self, "rotations", out.len(), task.rest.len())?;
        let finite = out.iter().all(|r| r.iter().all(|x| x.is_finite()));
        let gave = || "rotations that are not finite".to_owned();
        Ok(BackendError::unless(finite, &self.backend.name(), gave)?)
    }

    fn sweep(&self, task: &SweepTask<'_>, out: &mut Vec<Point3>) -> Result<(), Error> {
        self.backend.sweep(task, out)?;
        counted(self, "places", out.len(), task.shape.rest.len())?;
        let finite = out.iter().all(|p| p.iter().all(|x| x.is_finite()));
        let gave = || "places that are not finite".to_owned();
        Ok(BackendError::unless(finite, &self.backend.name(), gave)?)
    }
}

/// Refuses an answer of the wrong length.
fn counted(run: &On<'_>, what: &str, found: usize, asked: usize) -> Result<(), Error> {
    let gave = || format!("{found} {what} for {asked}");
    Ok(BackendError::unless(
        found == asked,
        &run.backend.name(),
        gave,
    )?)
}

/// Rows of numbers, one after the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rows<'a> {
    /// The numbers, all finite.
    pub values: &'a [f64],
    /// Numbers per row.
    pub width: usize,
}

impl<'a> Rows<'a> {
    /// How many rows there are.
    pub fn len(&self) -> usize {
        self.values.len().checked_div(self.width).unwrap_or(0)
    }

    /// Is there no row?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A row.
    pub fn row(&self, i: usize) -> &'a [f64] {
        &self.values[i * self.width..][..self.width]
    }
}

/// A row near another.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nearest {
    /// Which row.
    pub index: u32,
    /// How far it is, in the unit of the rows.
    pub distance: f64,
}

/// Nodes on a lattice, and the bars into which they fall. In whole numbers: sums do not depend on their order.
#[derive(Clone, Copy, Debug)]
pub struct HistogramTask<'a> {
    /// The nodes' lattice points.
    pub points: &'a [[i32; 3]],
    /// The square of the radius of a neighbourhood, in spacings.
    pub reach: u32,
    /// What a node counts; all nodes together count less than 2³².
    pub one: u32,
    /// Where each node falls, from 0, the middle of the first bar, to `(bars − 1) · one`, that of the last; in between
    /// it counts for both bars beside it.
    pub places: &'a [u32],
    /// Number of bars, 2…24.
    pub bars: usize,
}

/// Neighbourhoods at rest and as they lie now.
#[derive(Clone, Copy, Debug)]
pub struct RotationTask<'a> {
    /// Where the nodes are at rest, Å.
    pub rest: &'a [Point3],
    /// Where they are now, Å.
    pub now: &'a [Point3],
    /// Who is near whom.
    pub near: &'a Neighbourhoods,
}

/// What a step of Jacobi's method needs.
#[derive(Clone, Copy, Debug)]
pub struct SweepTask<'a> {
    /// Neighbourhoods, and where they are.
    pub shape: RotationTask<'a>,
    /// Their rotations.
    pub rotations: &'a [Matrix3<f64>],
    /// Where each node is drawn to, Å.
    pub targets: &'a [Point3],
    /// How strongly, over the pull of all its neighbours together; 0 for not at all.
    pub pull: &'a [f64],
}

/// What a backend owes to the distances of [`CorrespBackend::nearest`]. Which row it is must be that of the CPU where no
/// other is as near within this.
pub const NEAREST: Agreement = Agreement::Bounded {
    relative: 1e-5,
    absolute: 1e-5,
};

/// What a backend owes to the entries of [`CorrespBackend::rotations`], where the second singular value of a
/// neighbourhood is at least a thousandth of the first.
pub const ROTATIONS: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 2e-4,
};

/// What a backend owes to [`CorrespBackend::sweep`], over the extent of the shape.
pub const SWEEP: Agreement = Agreement::Bounded {
    relative: 0.0,
    absolute: 1e-5,
};
