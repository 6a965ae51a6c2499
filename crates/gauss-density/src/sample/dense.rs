//! The density on a lattice, at every point.

use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{Lattice, Run, ScalarGrid};
use rayon::prelude::*;

use crate::backend::{DensityBackend, Job};
use crate::error::Error;
use crate::kernel::prepared::Prepared;
use crate::model::Model;
use crate::options::Options;
use crate::sample::blocks::{
    Report, Sampled, check_memory, for_each_batch, lattice_of, start_report, touched,
};
use crate::thesis::{self, Method, check_backend};

/// Samples the density at every point of a lattice: 4 bytes per point.
///
/// Where the density is below the floor (see [`Options`]) any value between 0 and the density may stand.
pub fn sample<B: DensityBackend + ?Sized>(
    model: &Model,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Sampled<ScalarGrid>, Error> {
    options.check()?;
    let prepared = Prepared::new(model);
    let lattice = lattice_of(&prepared, options)?;
    let bytes = lattice.points().saturating_mul(4);
    check_memory(&lattice, bytes, options)?;
    let job = Job {
        lattice,
        cutoff: options.cutoff,
        floor: options.floor.unwrap_or(1e-3),
        ceiling: f64::INFINITY,
    };
    let mut report = start_report(&prepared, &lattice, run.backend.name());
    check_backend(options.method, &report.backend)?;
    if options.method != Method::Tiles {
        let (values, pairs) = thesis::everywhere(&prepared, &lattice, options, job.floor)?;
        report.pairs = pairs;
        return finish(report, lattice, values);
    }
    let mut values = vec![0.0f32; lattice.len()];
    let [nx, ny, nz] = lattice.counts;
    for_each_batch(&prepared, &job, None, run, |blocks, results| {
        report.pairs += results.iter().map(|r| r.pairs).sum::<u64>();
        let mut layers = vec![Vec::new(); nz.div_ceil(BRICK)];
        for (block, result) in blocks.iter().zip(results) {
            let (stored, _) = result.values.as_chunks::<BRICK_POINTS>();
            for (i, kind) in result.kinds.iter().enumerate() {
                if let Brick::Stored(s) = *kind {
                    let [bx, by, bz] = block.brick_at(i);
                    layers[bz].push(([bx, by], &stored[s as usize]));
                }
            }
        }
        // By planes, so that every thread writes into its own part.
        values
            .par_chunks_mut(nx * ny)
            .enumerate()
            .for_each(|(z, plane)| {
                for ([bx, by], brick) in &layers[z / BRICK] {
                    let slab = &brick[z % BRICK * BRICK * BRICK..][..BRICK * BRICK];
                    let width = BRICK.min(nx - bx * BRICK);
                    for (y, row) in slab.chunks_exact(BRICK).enumerate() {
                        let y = by * BRICK + y;
                        if y < ny {
                            plane[y * nx + bx * BRICK..][..width].copy_from_slice(&row[..width]);
                        }
                    }
                }
            });
        Ok(())
    })?;
    finish(report, lattice, values)
}

fn finish(
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
