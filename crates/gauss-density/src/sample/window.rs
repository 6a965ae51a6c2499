//! The density in a part of a lattice that is too large to be sampled at once.

use geom_core::grid::lattice::Window;
use geom_core::grid::{BRICK, Brick};
use geom_core::options::require;
use geom_core::{Aabb, BrickGrid, Run};

use crate::backend::{BLOCK, DensityBackend, On};
use crate::error::Error;
use crate::kernel::boxes::lattice_box;
use crate::model::Model;
use crate::model::copies::Copies;
use crate::options::{Cutoff, Options};
use crate::sample::band::{Band, interior};
use crate::sample::blocks::Bricks;

impl Copies {
    /// The atoms that matter in a box, as a model of their own; `None` if there are none. Its density is that of all within
    /// the cut-off where it reaches 1/2.
    ///
    /// Its nodes are those of the whole that have an atom there, so a residue may come in part. For a sampler of points
    /// near a tile's surface.
    ///
    /// # Errors
    /// A cut-off out of its range.
    pub fn part(&self, region: &Aabb, cutoff: Cutoff) -> Result<Option<Model>, Error> {
        cutoff.check()?;
        Ok(self.near(region, self.reach().radius(cutoff.0, 0.5)))
    }
}

/// Samples a window of the lattice of [`Copies::lattice`] as [`sample_band`](crate::sample_band) samples the whole: on
/// the processor with the same bits, kinds of bricks and values, since every sum takes the atoms in the order of all and
/// every place is counted from the origin of the whole. What a brick holds depends on the atoms that reach its block and
/// on its neighbours alone.
///
/// The window begins with a whole brick; of the grid, only the number of its points and their values mean anything,
/// not its origin.
///
/// ```
/// use gauss_density::{Copies, Model, Options, sample_band, sample_window};
/// use geom_core::grid::lattice::Window;
/// use geom_core::structure::Transform;
/// use geom_core::{Cpu, LatticeValues, Point3, Run};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let model = Model::new(vec![Point3::origin()], vec![6.0], vec![1.0], vec![])?;
/// let copies = Copies::new(&model, vec![Transform::identity()])?;
/// let options = Options::default();
/// let window = Window::around(copies.lattice(&options)?, [8; 3], [16; 3], 0);
/// let part = sample_window(&copies, &options, &window, Run::on(&Cpu))?;
/// let whole = sample_band(&model, &options, Run::on(&Cpu))?;
/// assert_eq!(part.at([3, 4, 5]), whole.grid.at([11, 12, 13]));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// A window that does not begin with a brick of the lattice that the options ask for; what `sample_band` refuses.
pub fn sample_window<B: DensityBackend + ?Sized>(
    copies: &Copies,
    options: &Options,
    window: &Window,
    run: Run<'_, B>,
) -> Result<BrickGrid, Error> {
    sample_window_on(copies, options, window, run.with(run.backend.as_density()))
}

fn sample_window_on(
    copies: &Copies,
    options: &Options,
    window: &Window,
    run: On<'_>,
) -> Result<BrickGrid, Error> {
    options.check()?;
    let lattice = window.whole;
    let last = [0, 1, 2].map(|k| window.low[k] + window.counts[k]);
    let fits = (0..3).all(|k| window.low[k].is_multiple_of(BRICK) && last[k] <= lattice.counts[k]);
    let told = format!("{:?} + {:?}", window.low, window.counts);
    require(
        fits,
        "window",
        told,
        "begin with a whole brick and lie in the lattice",
    )?;
    let wanted = Bricks {
        low: window.low.map(|p| p / BRICK),
        high: last.map(|p| p.div_ceil(BRICK)),
    };
    let counts = wanted.counts();
    let exterior = || vec![Brick::Exterior; counts.iter().product()];
    // One brick more on every side: whether an interior brick needs values is for its neighbours to say.
    let all = Bricks::all(&lattice).high;
    let range = Bricks {
        low: wanted.low.map(|b| b.saturating_sub(1)),
        high: [0, 1, 2].map(|k| (wanted.high[k] + 1).min(all[k])),
    };
    let floor = options.floor.unwrap_or(options.band[0]);
    let reach = copies.reach().radius(options.cutoff.0 / 4.0, floor);
    let [first, end] = range.blocks();
    let region = lattice_box(
        &lattice.origin,
        lattice.spacing,
        first.map(|b| (b * BLOCK * BRICK) as i64 - 1),
        end.map(|b| (b * BLOCK * BRICK) as i64),
    );
    let (kinds, values) = match copies.near(&region, reach) {
        None => (exterior(), Vec::new()),
        Some(part) => {
            let prepared = copies.prepared(&part);
            let band = Band::sample(&prepared, &lattice, range, options, run)?;
            band.only(&wanted)
        }
    };
    let grid = BrickGrid::new(window.lattice(), &kinds, values, 0.0, interior(options))?;
    Ok(grid)
}
