//! The density on a lattice, at every point.

use geom_core::compute::parallel;
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Lattice, Run, ScalarGrid};

use crate::backend::{Block, BlockValues, DensityBackend, Job, On};
use crate::error::Error;
use crate::kernel::prepared::Prepared;
use crate::model::Model;
use crate::options::Options;
use crate::sample::blocks::{
    Bricks, Report, Sampled, check_memory, for_each_batch, lattice_of, start_report, touched,
};

/// Below this density of a dense grid any value between 0 and the density may stand, unless the options say
/// otherwise.
pub(crate) const FLOOR: f64 = 1e-3;

/// Samples the density at every point of a lattice: 4 bytes per point.
///
/// Where the density is below the floor (see [`Options`]) any value between 0 and the density may stand.
/// The values are summed on the backend; the search for the blocks that some atom can reach stays on the CPU.
///
/// ```
/// use gauss_density::{Model, Options, sample};
/// use geom_core::{Cpu, LatticeValues, Point3, Run};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let atom = Model::new(vec![Point3::origin()], vec![1.7], vec![1.0], vec![])?;
/// let dense = sample(&atom, &Options { spacing: 1.0, ..Options::default() }, Run::on(&Cpu))?;
/// let [inside, outside] = [[4, 4, 4], [0, 0, 0]].map(|p| dense.grid.at(p));
/// assert!(inside > 1.0 && outside < 1.0);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// An option out of range; [`Error::GridTooLarge`], before anything is allocated; [`Error::Cancelled`]; what the
/// backend refuses.
pub fn sample<B: DensityBackend + ?Sized>(
    model: &Model,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Sampled<ScalarGrid>, Error> {
    sample_on(model, options, run.with(run.backend.as_density()))
}

fn sample_on(model: &Model, options: &Options, run: On<'_>) -> Result<Sampled<ScalarGrid>, Error> {
    options.check()?;
    let prepared = Prepared::new(model);
    let lattice = lattice_of(&prepared, options)?;
    let bytes = lattice.points().saturating_mul(4);
    check_memory(&lattice, bytes, options)?;
    let job = Job {
        lattice,
        cutoff: options.cutoff,
        floor: options.floor.unwrap_or(FLOOR),
        ceiling: f64::INFINITY,
    };
    let mut report = start_report(&prepared, &lattice, run.backend.name());
    let mut values = vec![0.0f32; lattice.len()];
    let all = Bricks::all(&lattice);
    for_each_batch(&prepared, &job, &all, None, run, |blocks, results| {
        report.pairs += results.iter().map(|r| r.pairs).sum::<u64>();
        put(&lattice, blocks, results, &mut values);
        Ok(())
    })?;
    finish(report, lattice, values)
}

/// Puts the values of bricks where they belong among those of the lattice.
fn put(lattice: &Lattice, blocks: &[Block], results: &[BlockValues], values: &mut [f32]) {
    /// A brick's place among those of its layer, and its values.
    struct Placed<'a> {
        bx: usize,
        by: usize,
        values: &'a [f32; BRICK_POINTS],
    }
    let [nx, ny, nz] = lattice.counts;
    let mut layers: Vec<Vec<Placed<'_>>> = (0..nz.div_ceil(BRICK)).map(|_| Vec::new()).collect();
    for (block, result) in blocks.iter().zip(results) {
        let (stored, _) = result.values.as_chunks::<BRICK_POINTS>();
        for (i, kind) in result.kinds.iter().enumerate() {
            if let Brick::Stored(s) = *kind {
                let [bx, by, bz] = block.brick_at(i);
                let values = &stored[s as usize];
                layers[bz].push(Placed { bx, by, values });
            }
        }
    }
    // By planes, so that every thread writes into its own part.
    parallel::for_chunks(values, nx * ny, |z, plane| {
        for Placed { bx, by, values } in &layers[z / BRICK] {
            let slab = &values[z % BRICK * BRICK * BRICK..][..BRICK * BRICK];
            let width = BRICK.min(nx - bx * BRICK);
            for (y, row) in slab.chunks_exact(BRICK).enumerate() {
                let y = by * BRICK + y;
                if y < ny {
                    plane[y * nx + bx * BRICK..][..width].copy_from_slice(&row[..width]);
                }
            }
        }
    });
}

/// The grid of all values, with its counts.
pub(crate) fn finish(
    mut report: Report,
    lattice: Lattice,
    values: Vec<f32>,
) -> Result<Sampled<ScalarGrid>, Error> {
    report.stored_points = report.points;
    report.stored_share = 1.0;
    let grid = ScalarGrid::new(lattice, values)?;
    report.touches_box = touched(&grid);
    Ok(Sampled { grid, report })
}
