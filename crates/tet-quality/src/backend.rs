//! The hot kernels, what they are handed, and what each backend owes to the specification.
//!
//! A backend of your own is a type with these two kernels; here one that counts the calls:
//!
//! ```
//! use std::sync::atomic::{AtomicUsize, Ordering};
//! use tet_quality::backend::{QualityBackend, Relaxation};
//! use tet_quality::geom_core::{Backend, Cpu, Point3, Run, TetMesh, Vector3};
//! use tet_quality::{Error, Measures, Options, improve};
//!
//! #[derive(Default)]
//! struct Counting {
//!     measured: AtomicUsize,
//!     relaxed: AtomicUsize,
//! }
//!
//! impl Backend for Counting {
//!     fn name(&self) -> String {
//!         "counting".into()
//!     }
//! }
//!
//! impl QualityBackend for Counting {
//!     fn measure(&self, x: &[Point3], tets: &[[u32; 4]], out: &mut Vec<Measures>) -> Result<(), Error> {
//!         self.measured.fetch_add(1, Ordering::Relaxed);
//!         Cpu.measure(x, tets, out)
//!     }
//!     fn relax(&self, task: &Relaxation<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
//!         self.relaxed.fetch_add(1, Ordering::Relaxed);
//!         Cpu.relax(task, out)
//!     }
//! }
//!
//! // Four tetrahedra around a vertex that lies too near to one side.
//! let x = [[0., 0., 0.], [4., 0., 0.], [0., 4., 0.], [0., 0., 4.], [0.1, 0.2, 0.1]];
//! let tets = vec![[4, 1, 2, 3], [0, 4, 2, 3], [0, 1, 4, 3], [0, 1, 2, 4]];
//! let mesh = TetMesh::new(x.map(Point3::from).to_vec(), tets)?;
//! let backend = Counting::default();
//! let improved = improve(mesh, None, &Options::default(), Run::on(&backend))?;
//! // Measured before and after, smoothed in between.
//! assert_eq!(backend.measured.into_inner(), 2);
//! assert!(backend.relaxed.into_inner() > 0);
//! assert_eq!(improved.report.backend, "counting");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::ops::Range;

use geom_core::{Agreement, Backend, Point3, Vector3};

use crate::error::Error;
use crate::measure::metrics::Measures;

/// The hot kernels of this crate. [`Cpu`](geom_core::Cpu) and [`Wgpu`](geom_core::Wgpu) have them; what
/// they compute stands in `specification` (feature `testing`) as the equations read.
pub trait QualityBackend: Backend + QualityObject {
    /// The measures of each tetrahedron, in place of what was in `out`, whose memory is used again: that
    /// of a million new ones takes as long as half of the work. Corners must be in range.
    fn measure(
        &self,
        positions: &[Point3],
        tets: &[[u32; 4]],
        out: &mut Vec<Measures>,
    ) -> Result<(), Error>;

    /// Sweeps over the vertices of `task`, colour by colour, each moving to where the worst
    /// tetrahedron around it is best. Gives one displacement (Å) per vertex of the task, in place of what
    /// was in `out`: a *proposal*, which the caller accepts or refuses on the CPU.
    fn relax(&self, task: &Relaxation<'_>, out: &mut Vec<Vector3>) -> Result<(), Error>;

    /// Is [`QualityBackend::relax`] to propose where vertices of the isosurface slide too? By default it is not: then
    /// each colour is searched and pulled back to the isosurface before the next. A backend with a cost per call gets
    /// all colours at once, in their tangent planes, and only what it found is pulled back.
    fn slides(&self) -> bool {
        false
    }
}

geom_core::backend_object!(QualityObject, as_quality -> QualityBackend);

/// A run on any of them.
pub(crate) type On<'a> = geom_core::Run<'a, dyn QualityBackend + 'a>;

/// What a backend owes to [`QualityBackend::measure`] on the CPU, for Joe–Liu, edge ratio and angles
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
    /// For vertices that slide along a surface.
    pub slide: Option<Slide>,
    /// Rounds of the search per vertex: each tries the neighbours' mean or the compass directions,
    /// and shortens the step when none is better.
    pub rounds: u32,
}

/// How vertices slide.
#[derive(Clone, Debug, PartialEq)]
pub struct Slide {
    /// Per vertex to move: from it to the mean of its neighbours on the surface, Å, which the first round tries in place
    /// of the mean of all; `None` if there is none.
    pub means: Vec<Option<Vector3>>,
    /// No vertex goes farther than this from where it started, in mean lengths of the edges around its faces.
    pub reach: f64,
}
