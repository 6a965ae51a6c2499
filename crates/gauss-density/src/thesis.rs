//! What only the thesis's comparisons need, off the road of [`Options`]: its four searches for the atoms that
//! matter at a point (§3.2.3), and its bare cut (Eq. 3.15). All run on the CPU, and on the dense lattice only.
//!
//! ```
//! use gauss_density::{Model, Options, sample, thesis};
//! use geom_core::{Cpu, LatticeValues, Point3, Run};
//! # fn main() -> Result<(), gauss_density::Error> {
//! let model = Model::new(vec![Point3::origin()], vec![1.7], vec![1.0], vec![])?;
//! let options = Options { spacing: 1.0, ..Options::default() };
//! let all = thesis::all_atoms(&model, &options)?;
//! let searched = thesis::kd_tree(&model, &options, thesis::Cut::AfterPowers)?;
//! assert!(searched.report.pairs < all.report.pairs);
//! assert_eq!(sample(&model, &options, Run::on(&Cpu))?.grid.lattice(), searched.grid.lattice());
//! # Ok(())
//! # }
//! ```

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use geom_core::compute::parallel;
use geom_core::grid::{BRICK, BRICK_POINTS};
use geom_core::options::{OutOfRange, require};
use geom_core::search::nearest::PointTree;
use geom_core::{Aabb, Backend, Cpu, ImplicitField, Lattice, Point3, ScalarGrid};

use crate::error::Error;
use crate::kernel::boxes::middle;
use crate::kernel::cull::ActiveSet;
use crate::kernel::plain::{self, narrow, plain_cube};
use crate::kernel::prepared::Prepared;
use crate::kernel::relative::{self, Cube};
use crate::model::Model;
use crate::options::Options;
use crate::sample::blocks::{Sampled, check_memory, lattice_of, start_report};
use crate::sample::dense::{FLOOR, finish};
use crate::sample::point::PointSampler;

/// Which atom kernels count at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Cut {
    /// All but those that [`Options::cutoff`] allows to leave out, after the powers.
    #[default]
    AfterPowers,
    /// In place of that the thesis's cut (Eq. 3.15): kernels below `ε` count as zero, point by point, *before*
    /// the powers. For powers below about 0.5 this is another model, and a discontinuous one.
    Bare(f64),
}

impl Cut {
    fn check(self) -> Result<(), OutOfRange> {
        match self {
            Self::AfterPowers => Ok(()),
            Self::Bare(eps) => {
                let fine = eps > 0.0 && eps < 0.25;
                require(fine, "cut", eps, "be above 0 and below 0.25")
            }
        }
    }
}

/// Every atom at every point, without a cut: brute force in f32 with as many lanes as the processor has and one
/// exponential per pair. Slow, and the yardstick of speed. [`Options::cutoff`] and the floor have no meaning here.
///
/// It takes time in proportion to atoms times points.
///
/// # Errors
/// As of [`sample`](crate::sample()), here and for the searches below; a cut that is out of its range for these.
pub fn all_atoms(model: &Model, options: &Options) -> Result<Sampled<ScalarGrid>, Error> {
    Task::new(model, options, Cut::AfterPowers)?
        .finish(|task| Ok(brute_force(&task.model, &task.lattice)))
}

/// A k-d tree over the atom centres, asked at every point.
/// All atoms within one radius are summed, in f64 and in the order of the model; so what it costs is the number of
/// atoms in a ball, times the points.
pub fn kd_tree(model: &Model, options: &Options, cut: Cut) -> Result<Sampled<ScalarGrid>, Error> {
    Task::new(model, options, cut)?.finish(|task| {
        // The model has checked all that the tree asks of its points: finite, and no more than an index can name.
        let tree = PointTree::of_positions(model.centers()).expect("a model's centres make a tree");
        let reach = task.reach();
        Ok(task.at_every_point(|x, found| {
            let near = tree.within(&[x.x, x.y, x.z], reach);
            found.extend(near.iter().map(|n| n.index));
            found.sort_unstable();
        }))
    })
}

/// A hierarchy of boxes over the nodes of the model, asked at every point.
/// (The thesis's bounding volume hierarchy; the boxes are those of residues, chains and domains, not of a tree made for
/// the search.) It finds what [`kd_tree`] finds.
pub fn hierarchy(model: &Model, options: &Options, cut: Cut) -> Result<Sampled<ScalarGrid>, Error> {
    Task::new(model, options, cut)?.finish(|task| {
        let boxes = Boxes::new(model);
        let reach = task.reach();
        Ok(task.at_every_point(|x, found| boxes.within(model, x, reach, found)))
    })
}

/// The thesis's neighbouring search: the band point nearest to the box's low x side on its centre line, then
/// neighbours of band points while they lie in the band. What the band does not shut off from the box is
/// outside (0), the rest inside (`2 g_u`). Misses every other component and every cavity.
/// Where the line meets no point of the band, nothing is found and all is outside.
pub fn single_seed(
    model: &Model,
    options: &Options,
    cut: Cut,
) -> Result<Sampled<ScalarGrid>, Error> {
    Task::new(model, options, cut)?.finish(|task| {
        let search = OneSeed::new(task)?;
        Ok(search.run())
    })
}

/// A dense lattice to fill without blocks.
struct Task<'a> {
    model: Prepared<'a>,
    lattice: Lattice,
    options: &'a Options,
    cut: Cut,
    floor: f64,
}

/// Values per lattice point, and pairs of an atom and a point that were evaluated.
struct Filled {
    values: Vec<f32>,
    pairs: u64,
}

impl<'a> Task<'a> {
    fn new(model: &'a Model, options: &'a Options, cut: Cut) -> Result<Self, Error> {
        options.check()?;
        cut.check()?;
        let model = Prepared::new(model);
        let lattice = lattice_of(&model, options)?;
        check_memory(&lattice, lattice.points().saturating_mul(4), options)?;
        Ok(Self {
            model,
            lattice,
            options,
            cut,
            floor: options.floor.unwrap_or(FLOOR),
        })
    }

    fn finish(
        &self,
        fill: impl FnOnce(&Self) -> Result<Filled, Error>,
    ) -> Result<Sampled<ScalarGrid>, Error> {
        let mut report = start_report(&self.model, &self.lattice, Cpu.name());
        let Filled { values, pairs } = fill(self)?;
        report.pairs = pairs;
        finish(report, self.lattice, values)
    }

    /// How far from a point the atoms that count may lie, Å.
    fn reach(&self) -> f64 {
        match self.cut {
            Cut::AfterPowers => self.model.reach.radius(self.options.cutoff.0, self.floor),
            Cut::Bare(eps) => self.model.reach.bare(eps),
        }
    }

    /// Point by point, with the atoms (ascending) that `find` gives.
    fn at_every_point(&self, find: impl Fn(&Point3, &mut Vec<u32>) + Sync) -> Filled {
        let [nx, ny, nz] = self.lattice.counts;
        let mut values = vec![0.0f32; nx * ny * nz];
        let pairs = AtomicU64::new(0);
        parallel::for_chunks(&mut values, nx, |row, out| {
            let (mut found, mut pairs_of_row) = (Vec::new(), 0);
            for (x, value) in out.iter_mut().enumerate() {
                let at = self.lattice.point([x, row % ny, row / ny]);
                found.clear();
                find(&at, &mut found);
                pairs_of_row += found.len() as u64;
                *value = self.density(&found, &at);
            }
            pairs.fetch_add(pairs_of_row, Relaxed);
        });
        Filled {
            values,
            pairs: pairs.into_inner(),
        }
    }

    fn density(&self, atoms: &[u32], x: &Point3) -> f32 {
        let counts = |&a: &u32| match self.cut {
            Cut::Bare(eps) => self.model.ln_kernel(a as usize, x) >= eps.ln(),
            Cut::AfterPowers => true,
        };
        narrow(plain::value(
            &self.model,
            atoms.iter().copied().filter(counts),
            x,
        ))
    }
}

/// Every atom at every point, brick by brick.
/// In layers of bricks, a thread each; where f32 does not hold the numbers, point by point in f64.
fn brute_force(model: &Prepared<'_>, lattice: &Lattice) -> Filled {
    let atoms: Vec<u32> = (0..model.model().atoms() as u32).collect();
    let all = ActiveSet::gather(model, &atoms);
    let bricks = lattice.counts.map(|n| n.div_ceil(BRICK));
    let [nx, ny, _] = lattice.counts;
    let mut values = vec![0.0f32; lattice.len()];
    parallel::for_chunks(&mut values, nx * ny * BRICK, |c, slab| {
        let mut sums = relative::Scratch::default();
        let mut brick = vec![0.0f32; BRICK_POINTS];
        for (b, a) in (0..bricks[1]).flat_map(|b| (0..bricks[0]).map(move |a| (b, a))) {
            let first = [a, b, c].map(|b| b * BRICK);
            let cube = Cube {
                center: middle(lattice, first, BRICK),
                spacing: lattice.spacing,
                separable: false,
            };
            if !relative::density::<8, 64>(&all, &cube, &mut sums, &mut brick) {
                plain_cube(model, lattice, first, BRICK, &all.atom, &mut brick);
            }
            for (row, line) in brick.chunks_exact(BRICK).enumerate() {
                let (y, z) = (first[1] + row % BRICK, row / BRICK);
                let start = (z * ny + y) * nx + first[0];
                if y < ny && start < slab.len() {
                    let width = BRICK.min(nx - first[0]);
                    slab[start..][..width].copy_from_slice(&line[..width]);
                }
            }
        }
    });
    let pairs = lattice.points() as u64 * atoms.len() as u64;
    Filled { values, pairs }
}

/// A box around the centres below each node of each level.
/// It is the model's own tree, so that no other one is built.
struct Boxes {
    /// Lowest level first.
    levels: Vec<Vec<Aabb>>,
}

impl Boxes {
    fn new(model: &Model) -> Self {
        let levels = model.levels();
        let mut boxes: Vec<Vec<Aabb>> = Vec::with_capacity(levels.len());
        for level in levels {
            let of = |node: usize| match boxes.last() {
                None => Aabb::of_points(&model.centers()[level.children(node)]),
                Some(below) => below[level.children(node)]
                    .iter()
                    .fold(Aabb::EMPTY, |a, b| a.union(b)),
            };
            let own = (0..level.len()).map(of).collect();
            boxes.push(own);
        }
        Self { levels: boxes }
    }

    /// The atoms at most `reach` from `x`, ascending.
    fn within(&self, model: &Model, x: &Point3, reach: f64, found: &mut Vec<u32>) {
        let depth = self.levels.len();
        let top = self.levels.last().map_or(model.atoms(), Vec::len);
        for node in 0..top {
            self.descend(model, depth, node, x, reach * reach, found);
        }
    }

    /// `depth` 0 is an atom, 1 a node of the lowest level.
    fn descend(
        &self,
        model: &Model,
        depth: usize,
        node: usize,
        x: &Point3,
        squared: f64,
        found: &mut Vec<u32>,
    ) {
        if depth == 0 {
            if (x - model.centers()[node]).norm_squared() <= squared {
                found.push(node as u32);
            }
        } else if self.levels[depth - 1][node].distance_squared(x) <= squared {
            for child in model.levels()[depth - 1].children(node) {
                self.descend(model, depth - 1, child, x, squared, found);
            }
        }
    }
}

/// How the search from one seed finds the atoms of a point.
enum Near<'a> {
    Cells(Box<PointSampler<'a>>),
    Boxes(Boxes),
}

/// The search from one seed, with the values that are known; the others are not numbers.
struct OneSeed<'t, 'a> {
    task: &'t Task<'a>,
    near: Near<'a>,
    filled: Filled,
}

impl<'t, 'a> OneSeed<'t, 'a> {
    fn new(task: &'t Task<'a>) -> Result<Self, Error> {
        let model = task.model.model();
        let near = match task.cut {
            Cut::AfterPowers => {
                let sampler = PointSampler::above(task.floor, model, task.options.cutoff)?;
                Near::Cells(Box::new(sampler))
            }
            Cut::Bare(_) => Near::Boxes(Boxes::new(model)),
        };
        let filled = Filled {
            values: vec![f32::NAN; task.lattice.len()],
            pairs: 0,
        };
        Ok(Self { task, near, filled })
    }

    fn run(mut self) -> Filled {
        if let Some(seed) = self.seed() {
            self.grow(seed);
        }
        self.fill();
        self.filled
    }

    fn evaluate(&mut self, p: [usize; 3]) -> f32 {
        let x = self.task.lattice.point(p);
        let (g, pairs) = match &self.near {
            Near::Cells(sampler) => (narrow(sampler.value(&x)), sampler.atoms_at(&x)),
            Near::Boxes(boxes) => {
                let mut found = Vec::new();
                boxes.within(self.task.model.model(), &x, self.task.reach(), &mut found);
                (self.task.density(&found, &x), found.len())
            }
        };
        self.filled.pairs += pairs as u64;
        self.filled.values[self.task.lattice.index(p)] = g;
        g
    }

    /// Does the search go on at a point of density `g`, reached from one of density `before`? In the band, and
    /// across the surface too, so that it has values on both sides.
    fn goes_on(&self, g: f32, before: f32) -> bool {
        let [low, high] = self.task.options.band.map(|g| g as f32);
        (g > low && g < high) || (g >= 1.0) != (before >= 1.0)
    }

    /// The first point of the band on the centre line.
    fn seed(&mut self) -> Option<[usize; 3]> {
        let [nx, ny, nz] = self.task.lattice.counts;
        let mut last = 0.0;
        (0..nx).map(|x| [x, ny / 2, nz / 2]).find(|&p| {
            let before = std::mem::replace(&mut last, self.evaluate(p));
            self.goes_on(last, before)
        })
    }

    /// From the seed to all that the band connects with it.
    fn grow(&mut self, seed: [usize; 3]) {
        let lattice = self.task.lattice;
        let mut open = vec![seed];
        while let Some(p) = open.pop() {
            let own = self.filled.values[lattice.index(p)];
            for q in neighbours(&lattice, p) {
                if self.filled.values[lattice.index(q)].is_nan() {
                    let g = self.evaluate(q);
                    if self.goes_on(g, own) {
                        open.push(q);
                    }
                }
            }
        }
    }

    /// Outside is what is reached from the box without crossing the band; the rest is inside.
    fn fill(&mut self) {
        let (lattice, values) = (self.task.lattice, &mut self.filled.values);
        let mut outside: Vec<[usize; 3]> = Vec::new();
        for i in 0..values.len() {
            let p = lattice.coordinates(i);
            let on_box = (0..3).any(|k| p[k] == 0 || p[k] + 1 == lattice.counts[k]);
            if !(on_box && values[i].is_nan()) {
                continue;
            }
            values[i] = 0.0;
            outside.push(p);
            while let Some(p) = outside.pop() {
                for q in neighbours(&lattice, p) {
                    let at = lattice.index(q);
                    if values[at].is_nan() {
                        values[at] = 0.0;
                        outside.push(q);
                    }
                }
            }
        }
        let inside = 2.0 * self.task.options.band[1] as f32;
        for value in values.iter_mut().filter(|v| v.is_nan()) {
            *value = inside;
        }
    }
}

/// The lattice points beside a point, along the axes.
fn neighbours(lattice: &Lattice, p: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    let counts = lattice.counts;
    (0..6).filter_map(move |i| {
        let (axis, up) = (i / 2, i % 2 == 1);
        let mut q = p;
        q[axis] = if up {
            q[axis] + 1
        } else {
            q[axis].checked_sub(1)?
        };
        (q[axis] < counts[axis]).then_some(q)
    })
}
