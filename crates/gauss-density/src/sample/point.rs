//! The density at any point, with analytic derivatives.
//!
//! Meshers ask here for roots and normals, elimination and refit for the places of their samples. The sampler borrows
//! the model: whoever changes the model makes a new one.

use std::sync::Arc;

use geom_core::compute::BackendError;
use geom_core::compute::parallel;
use geom_core::field::{Precision, crossing};
use geom_core::nalgebra::Matrix3;
use geom_core::{Aabb, BrickGrid, FieldAtMany, ImplicitField, LatticeValues, Point3, Vector3};

use crate::backend::{CellPoint, DensityBackend, PointCells, PointKernel};
use crate::error::Error;
use crate::kernel;
use crate::kernel::cull::{ActiveSet, Scratch};
use crate::kernel::plain;
use crate::kernel::point::LANES;
use crate::kernel::prepared::Prepared;
use crate::model::{Model, slopes};
use crate::options::Cutoff;

/// The density as a continuous field: 1 on the surface, larger inside.
///
/// Space around the atoms is cut into cells, each with the atoms that matter there (a share `ε` of the
/// density at most is lost, wherever it is above 1e-9), so that a point costs some tens of kernels. Where no surface can
/// be, far from the atoms, all of them are summed. Points are summed on the CPU in f64, those of a cell side by side where
/// [many are asked with one call](ImplicitField::at_many), with the same bits; [`PointSampler::on`] takes the model to a
/// backend, which then serves such calls.
///
/// A point with a coordinate that is not a number has the value NaN; beyond 10¹⁰⁰ Å the density is 0.
///
/// ```
/// use gauss_density::{Cutoff, Model, PointSampler};
/// use geom_core::{ImplicitField, Point3};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let model = Model::new(vec![Point3::origin()], vec![2.0], vec![0.5], vec![])?;
/// let field = PointSampler::new(&model, Cutoff::default())?;
/// let on_the_sphere = Point3::new(0.0, 2.0, 0.0);
/// assert!((field.value(&on_the_sphere) - 1.0).abs() < 1e-12);
/// assert!((field.mean_curvature(&on_the_sphere) - 0.5).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct PointSampler<'a> {
    model: Prepared<'a>,
    bounds: Aabb,
    edge: f64,
    cells: [usize; 3],
    /// Per cell: where its active start, and their number at the end.
    starts: Vec<usize>,
    active: Vec<u32>,
    /// The model where a backend keeps it.
    kernel: Option<Kernel>,
}

#[derive(Clone)]
struct Kernel(Arc<dyn PointKernel>);

impl std::fmt::Debug for Kernel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Kernel")
    }
}

/// Derivatives of the density with respect to the parameters of one atom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtomGradient {
    /// Index of the atom.
    pub atom: u32,
    /// With respect to its centre, Å⁻¹.
    pub center: Vector3,
    /// With respect to its radius, Å⁻¹.
    pub radius: f64,
    /// With respect to its decay, Å².
    pub decay: f64,
}

/// Where the density is below this, more of it may be lost.
const FLOOR: f64 = 1e-9;
/// Space around the atom centres that is cut into cells, at least, Å.
const AROUND: f64 = 4.0;
/// Cells reach as far as the density may be above this: the surface, and what is looked at near it, lies within.
const OUTERMOST: f64 = 0.25;
/// Most cells, per atom and besides.
const MOST_CELLS: [f64; 2] = [16.0, 4096.0];
/// Points per call on the CPU: enough that most cells have several of them, few enough to go round among threads.
const BATCH: usize = 1024;
/// Fewer points of a cell than this are summed one at a time.
const SIDE_BY_SIDE: usize = 3;

impl<'a> PointSampler<'a> {
    /// Prepares the cells.
    ///
    /// Time and memory go with the number of cells, about 16 per atom and 4096 besides at most, times the atoms that
    /// matter in each, some tens for moderate powers and many more for small ones.
    ///
    /// # Errors
    /// A cut-off that is not above 0 and below 0.25.
    pub fn new(model: &'a Model, cutoff: Cutoff) -> Result<Self, Error> {
        Self::above(FLOOR, model, cutoff)
    }

    /// Takes the model to a backend, for those who ask many points with one call: a device gets the atoms once. A
    /// backend that is no better than a point at a time, as the CPU, leaves it as it is.
    ///
    /// Single points ([`ImplicitField::value`]) stay on the CPU all the same, in f64.
    ///
    /// # Errors
    /// What the backend refuses: too many levels of powers, no memory.
    pub fn on<B: DensityBackend + ?Sized>(mut self, backend: &B) -> Result<Self, Error> {
        let cells = PointCells {
            model: &self.model,
            starts: &self.starts,
            atoms: &self.active,
        };
        self.kernel = backend.point_kernel(&cells)?.map(|k| Kernel(k.into()));
        Ok(self)
    }

    /// For points near the surface: the loss is bounded where the density is above `floor`.
    pub(crate) fn above(floor: f64, model: &'a Model, cutoff: Cutoff) -> Result<Self, Error> {
        cutoff.check()?;
        let eps = cutoff.0;
        let prepared = Prepared::new(model);
        let volume = |of: &Aabb| of.extent().product();
        let around = prepared.reach.beyond(OUTERMOST).max(AROUND);
        let bounds = model.center_bounds().inflated(around);
        let extent = bounds.extent();
        // About one atom and a half per cell in a packed structure; coarser for sparse ones, and where much of the space is
        // beyond the atoms.
        let packed = volume(&model.center_bounds().inflated(AROUND)) / (1.5 * model.atoms() as f64);
        let most = MOST_CELLS[0] * model.atoms() as f64 + MOST_CELLS[1];
        let edge = packed.max(volume(&bounds) / most).cbrt().clamp(2.5, 1e6);
        let cells = [0, 1, 2].map(|k| ((extent[k] / edge).ceil() as usize).max(1));
        let mut sampler = Self {
            model: prepared,
            bounds,
            edge,
            cells,
            starts: Vec::new(),
            active: Vec::new(),
            kernel: None,
        };
        let lists = sampler.cull_cells(eps, floor);
        sampler.starts = Vec::with_capacity(lists.len() + 1);
        sampler.starts.push(0);
        for list in lists {
            sampler.active.extend(list);
            sampler.starts.push(sampler.active.len());
        }
        Ok(sampler)
    }

    /// The atoms that matter in each cell, x fastest. A quarter of `ε` goes with the search for groups of cells, a
    /// quarter with their cull, half with that of the cell.
    fn cull_cells(&self, eps: f64, floor: f64) -> Vec<Vec<u32>> {
        // Slabs of cells share a first, coarse cull.
        const SIDE: usize = 4;
        let groups = self.cells.map(|n| n.div_ceil(SIDE));
        let clusters = self.model.clusters();
        let reach = self.model.reach.radius(eps / 4.0, floor);
        let lists: Vec<Vec<(usize, Vec<u32>)>> = parallel::map_init(
            groups.iter().product::<usize>(),
            Scratch::default,
            |scratch, group| {
                let [nx, ny, _] = groups;
                let low = [group % nx, group / nx % ny, group / (nx * ny)].map(|g| g * SIDE);
                let high = [0, 1, 2].map(|k| (low[k] + SIDE).min(self.cells[k]));
                let (mut coarse, mut kept) = (ActiveSet::default(), ActiveSet::default());
                let around = self.cell_box(low, high);
                let near = self.model.near(&clusters, &around, reach);
                let atoms = self.model.atoms_near(&near, &around, reach);
                let all = ActiveSet::gather(&self.model, &atoms);
                all.cull_into(&(&around).into(), eps / 4.0, floor, scratch, &mut coarse);
                let mut lists = Vec::new();
                for z in low[2]..high[2] {
                    for y in low[1]..high[1] {
                        for x in low[0]..high[0] {
                            let cell = self.cell_box([x, y, z], [x + 1, y + 1, z + 1]);
                            coarse.cull_into(&(&cell).into(), eps / 2.0, floor, scratch, &mut kept);
                            let index = (z * self.cells[1] + y) * self.cells[0] + x;
                            lists.push((index, kept.atom.clone()));
                        }
                    }
                }
                lists
            },
        );
        let mut by_cell = vec![Vec::new(); self.cells.iter().product()];
        for (cell, list) in lists.into_iter().flatten() {
            by_cell[cell] = list;
        }
        by_cell
    }

    fn cell_box(&self, low: [usize; 3], high: [usize; 3]) -> Aabb {
        let at = |c: [usize; 3]| {
            self.bounds.min + Vector3::new(c[0] as f64, c[1] as f64, c[2] as f64) * self.edge
        };
        Aabb::new(at(low), at(high))
    }

    /// The atoms that matter at `x`, or `None` outside of the cells.
    fn active_at(&self, x: &Point3) -> Option<&[u32]> {
        let index = self.cell_of(x)?;
        Some(&self.active[self.starts[index]..self.starts[index + 1]])
    }

    /// The cell that `x` lies in, if it lies in one.
    fn cell_of(&self, x: &Point3) -> Option<usize> {
        if is_beyond_numbers(x) {
            return None;
        }
        let local = (x - self.bounds.min) / self.edge;
        let mut cell = [0; 3];
        for k in 0..3 {
            if !(local[k] >= 0.0 && local[k] < self.cells[k] as f64) {
                return None;
            }
            cell[k] = local[k] as usize;
        }
        Some((cell[2] * self.cells[1] + cell[1]) * self.cells[0] + cell[0])
    }

    /// The density, its gradient (per Å) and its Hessian (per Å²).
    /// All are those of the same sum, so that differences of values converge to them within a cell; from cell to cell
    /// the sums differ by what `ε` allows. Zeros where the density is too small for f64.
    pub fn value_gradient_hessian(&self, x: &Point3) -> (f64, Vector3, Matrix3<f64>) {
        if is_beyond_numbers(x) {
            return (0.0, Vector3::zeros(), Matrix3::zeros());
        }
        match self.active_at(x) {
            Some(m) => plain::value_gradient_hessian(&self.model, m.iter().copied(), x),
            None => plain::value_gradient_hessian(&self.model, self.all(), x),
        }
    }

    /// Mean curvature of the level set through `x`, Å⁻¹: positive on spheres. NaN where the gradient vanishes, as in the
    /// middle of an atom and far from all of them: there is no level set with a normal.
    pub fn mean_curvature(&self, x: &Point3) -> f64 {
        let (_, g, h) = self.value_gradient_hessian(x);
        let norm = g.norm();
        -(norm * norm * h.trace() - (g.transpose() * h * g)[0]) / (2.0 * norm.powi(3))
    }

    /// The derivatives of the density at `x` with respect to the parameters of every atom that matters there.
    /// By ascending index; atoms that are not listed have next to none. Empty beyond 10¹⁰⁰ Å. Times a change of the
    /// parameters it is, to first order, the change of `G`.
    pub fn parameter_gradient(&self, x: &Point3) -> Vec<AtomGradient> {
        if is_beyond_numbers(x) {
            return Vec::new();
        }
        let all: Vec<u32>;
        let active = match self.active_at(x) {
            Some(active) => active,
            None => {
                all = self.all().collect();
                &all
            }
        };
        let (_, shares) = plain::shares(&self.model, active, x);
        active
            .iter()
            .zip(shares)
            .map(|(&atom, share)| {
                let s = slopes(self.model.model(), atom as usize, x, share);
                AtomGradient {
                    atom,
                    center: Vector3::new(s[0], s[1], s[2]),
                    radius: s[3],
                    decay: s[4],
                }
            })
            .collect()
    }

    /// Number of atoms that are summed at `x`.
    pub fn atoms_at(&self, x: &Point3) -> usize {
        self.active_at(x).map_or(self.all().len(), <[u32]>::len)
    }

    /// The model made ready.
    pub(crate) fn prepared(&self) -> &Prepared<'a> {
        &self.model
    }

    fn all(&self) -> std::ops::Range<u32> {
        0..self.model.model().atoms() as u32
    }
}

/// So far from every atom that squares of distances leave the range of f64: nothing is left there.
fn is_beyond_numbers(x: &Point3) -> bool {
    x.coords.amax() > 1e100
}

impl ImplicitField for PointSampler<'_> {
    fn value(&self, x: &Point3) -> f64 {
        if is_beyond_numbers(x) {
            return 0.0;
        }
        match self.active_at(x) {
            Some(active) => kernel::point::value(&self.model, active, x),
            None => plain::value(&self.model, self.all(), x),
        }
    }

    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        if is_beyond_numbers(x) {
            return (0.0, Vector3::zeros());
        }
        match self.active_at(x) {
            Some(active) => kernel::point::value_gradient(&self.model, active, x),
            None => plain::value_gradient(&self.model, self.all(), x),
        }
    }

    fn at_many(&self) -> Option<&dyn FieldAtMany> {
        Some(self)
    }
}

impl FieldAtMany for PointSampler<'_> {
    fn values_gradients(
        &self,
        points: &[Point3],
        out: &mut Vec<(f64, Vector3)>,
    ) -> Result<(), BackendError> {
        if let Some(Kernel(kernel)) = &self.kernel {
            return self.ask(&**kernel, points, out);
        }
        let one = |x: &Point3| self.value_gradient(x);
        self.by_cells(points, out, one, |active, x| {
            kernel::point::values_gradients(&self.model, active, x)
        });
        Ok(())
    }

    fn values(&self, points: &[Point3], out: &mut Vec<f64>) -> Result<(), BackendError> {
        if let Some(Kernel(kernel)) = &self.kernel {
            let mut both = Vec::new();
            self.ask(&**kernel, points, &mut both)?;
            out.clear();
            out.extend(both.into_iter().map(|(value, _)| value));
            return Ok(());
        }
        let one = |x: &Point3| self.value(x);
        self.by_cells(points, out, one, |active, x| {
            kernel::point::values(&self.model, active, x)
        });
        Ok(())
    }

    fn batch(&self) -> Option<usize> {
        self.kernel.is_none().then_some(BATCH)
    }
}

impl PointSampler<'_> {
    /// What a backend has at these points; what lies far out is summed here.
    fn ask(
        &self,
        kernel: &dyn PointKernel,
        points: &[Point3],
        out: &mut Vec<(f64, Vector3)>,
    ) -> Result<(), BackendError> {
        let cells: Vec<Option<usize>> = parallel::map_each(points, |x| self.cell_of(x));
        let inside = points.iter().zip(&cells);
        let inside: Vec<CellPoint> = inside
            .filter_map(|(&at, cell)| cell.map(|cell| (at, cell as u32)))
            .map(|(at, cell)| CellPoint { at, cell })
            .collect();
        let mut found = Vec::new();
        kernel.values_gradients(&inside, &mut found)?;
        let (answers, asked) = (found.len(), inside.len());
        BackendError::unless(answers == asked, "the backend of the density", || {
            format!("{answers} answers at {asked} points")
        })?;
        let mut found = found.into_iter();
        out.clear();
        out.extend(points.iter().zip(cells).map(|(x, cell)| {
            let answer = cell.and_then(|_| found.next());
            answer.unwrap_or_else(|| self.value_gradient(x))
        }));
        Ok(())
    }

    /// Points on the CPU, in place of what was in `out`: by cells, those of a cell `several` at a time, few ones and
    /// what lies far out by `one`.
    fn by_cells<T: Copy + Default>(
        &self,
        points: &[Point3],
        out: &mut Vec<T>,
        one: impl Fn(&Point3) -> T,
        several: impl Fn(&[u32], &[Point3; LANES]) -> [T; LANES],
    ) {
        out.clear();
        out.resize(points.len(), T::default());
        let mut order = Vec::with_capacity(points.len());
        for (i, x) in points.iter().enumerate() {
            match self.cell_of(x) {
                Some(cell) => order.push((cell, i)),
                None => out[i] = one(x),
            }
        }
        order.sort_unstable();
        for run in order.chunk_by(|a, b| a.0 == b.0) {
            let active = &self.active[self.starts[run[0].0]..self.starts[run[0].0 + 1]];
            for run in run.chunks(LANES) {
                if run.len() < SIDE_BY_SIDE {
                    for &(_, i) in run {
                        out[i] = one(&points[i]);
                    }
                    continue;
                }
                // The last one fills what is left over.
                let x = std::array::from_fn(|l| points[run[l.min(run.len() - 1)].1]);
                for (&(_, i), found) in run.iter().zip(several(active, &x)) {
                    out[i] = found;
                }
            }
        }
    }
}

/// Where the density is 1 on a lattice edge that crosses the surface, within 1e-6 of it, from the grid's values at
/// the ends. As the callers have it, a density of 1 is inside.
pub(crate) fn root_on_edge(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    p: [usize; 3],
    q: [usize; 3],
) -> Point3 {
    let (start, end) = (grid.lattice().point(p), grid.lattice().point(q));
    // The logarithm is nearly a parabola near one atom, the density itself a cliff.
    let ends = [p, q].map(|end| f64::from(grid.at(end)).max(1e-30).ln());
    let at = |t: f64| start + (end - start) * t;
    at(crossing(ends, ROOT, |t| sampler.value(&at(t)).ln()))
}

/// How near to 1 the density at a root is.
const ROOT: Precision = Precision {
    place: 0.0,
    value: 1e-6,
};
