//! The density in bricks near the surface.
//!
//! Two rounds: the first classifies every brick that some atom can reach, the second asks again for those interior
//! bricks that turn out to lie beside a surface, since only then are the values on both sides of every crossed edge
//! known.

use std::collections::BTreeMap;

use geom_core::compute::parallel;
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::{BrickGrid, Lattice, Run};
use rayon::prelude::*;

use crate::backend::{BLOCK, Block, BlockValues, DensityBackend, Job, On, place_in};
use crate::error::Error;
use crate::kernel::prepared::Prepared;
use crate::model::Model;
use crate::options::Options;
use crate::sample::blocks::{
    Bricks, Sampled, check_memory, for_each_batch, lattice_of, start_report, too_large_after,
    touched,
};

/// Samples the density in bricks of 8 × 8 × 8 points near the surface; other bricks hold 0 outside and
/// `2 g_u` inside.
///
/// Nothing is seeded and nothing is followed, so no component and no cavity that the lattice can see is
/// missed: the signs of `G − 1` are those of the dense grid, and so are the values at both ends of every
/// lattice edge that crosses the surface. The values are summed on the backend; the search for the blocks that some
/// atom can reach stays on the CPU.
///
/// ```
/// use gauss_density::{Model, Options, sample_band};
/// use geom_core::{Cpu, Point3, Run};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let model = Model::new(vec![Point3::origin()], vec![6.0], vec![1.0], vec![])?;
/// let options = Options { margin: Some(12.0), ..Options::default() };
/// let band = sample_band(&model, &options, Run::on(&Cpu))?;
/// assert!(band.report.stored_share < 1.0 && !band.report.touches_any_side());
/// # Ok(())
/// # }
/// ```
///
/// Time goes with the number of bricks near atoms, memory with those near the surface (2 KiB each, and 8 bytes for
/// every brick there is), so halving the spacing costs about four times as much in memory. A body so thin that no
/// lattice point lies in it is in no grid.
///
/// # Errors
/// An option out of range; [`Error::GridTooLarge`], when the bricks stored so far exceed [`Options::max_memory`], with
/// a spacing that should fit; [`Error::Cancelled`]; what the backend refuses.
pub fn sample_band<B: DensityBackend + ?Sized>(
    model: &Model,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Sampled<BrickGrid>, Error> {
    sample_band_on(model, options, run.with(run.backend.as_density()))
}

fn sample_band_on(
    model: &Model,
    options: &Options,
    run: On<'_>,
) -> Result<Sampled<BrickGrid>, Error> {
    options.check()?;
    let prepared = Prepared::new(model);
    let lattice = lattice_of(&prepared, options)?;
    let mut report = start_report(&prepared, &lattice, run.backend.name());
    let all = Bricks::all(&lattice);
    let band = Band::sample(&prepared, &lattice, all, options, run)?;
    report.pairs = band.pairs;
    let values = band.values.into_flattened();
    report.stored_points = values.len() as u64;
    let grid = BrickGrid::new(lattice, &band.kinds, values, 0.0, interior(options))?;
    report.stored_share = report.stored_points as f64 / report.points as f64;
    report.touches_box = touched(&grid);
    Ok(Sampled { grid, report })
}

/// What stands in interior bricks.
/// `2 g_u`, far from 1, so that no lattice cell seems to be crossed where none is.
pub(crate) fn interior(options: &Options) -> f32 {
    2.0 * options.band[1] as f32
}

/// Bricks as they come.
/// While blocks are sampled those before are taken over, so values stand in the order of arrival and kinds say which
/// are whose.
pub(crate) struct Band {
    range: Bricks,
    /// Bricks per axis of the whole lattice.
    of: [usize; 3],
    /// Of the range, x fastest.
    pub(crate) kinds: Vec<Brick>,
    /// Of the stored bricks, as they came.
    pub(crate) values: Vec<[f32; BRICK_POINTS]>,
    /// Pairs of an atom and a point that were evaluated.
    pub(crate) pairs: u64,
}

impl Band {
    /// Samples the bricks of a range. Interior ones get values where a neighbour within the range asks for them.
    pub(crate) fn sample(
        model: &Prepared<'_>,
        lattice: &Lattice,
        range: Bricks,
        options: &Options,
        run: On<'_>,
    ) -> Result<Self, Error> {
        let counts = range.counts().into_iter();
        let count = counts.fold(1, |all: u128, n| all.saturating_mul(n as u128));
        check_memory(lattice, count.saturating_mul(8), options)?;
        let job = Job {
            lattice: *lattice,
            cutoff: options.cutoff,
            floor: options.floor.unwrap_or(options.band[0]),
            ceiling: options.band[1],
        };
        let mut band = Self {
            range,
            of: Bricks::all(lattice).high,
            kinds: vec![Brick::Exterior; count as usize],
            values: Vec::new(),
            pairs: 0,
        };
        let collect = |band: &mut Self, blocks: &[Block], results: &[BlockValues], again: bool| {
            band.pairs += results.iter().map(|r| r.pairs).sum::<u64>();
            band.take(blocks, results);
            let stored = band.values.len() as u128 * BRICK_POINTS as u128;
            let bytes = count * 8 + stored * 4;
            match blocks.last() {
                Some(last) if bytes > u128::from(options.max_memory) => {
                    let share = if again { 1.0 } else { range.share_up_to(last) };
                    Err(too_large_after(lattice, bytes, share, options))
                }
                _ => Ok(()),
            }
        };
        for_each_batch(model, &job, &range, None, run, |blocks, results| {
            collect(&mut band, blocks, results, false)
        })?;
        let crossed = band.crossed();
        if !crossed.is_empty() {
            let all = Job {
                ceiling: f64::INFINITY,
                ..job
            };
            let wanted = Some(&crossed);
            for_each_batch(model, &all, &range, wanted, run, |blocks, results| {
                collect(&mut band, blocks, results, true)
            })?;
        }
        Ok(band)
    }

    /// What some bricks of the range hold, the stored ones numbered anew.
    pub(crate) fn only(&self, wanted: &Bricks) -> (Vec<Brick>, Vec<f32>) {
        let (low, counts) = (self.range.low, self.range.counts());
        let mut values = Vec::new();
        let mut kinds = Vec::new();
        for c in wanted.low[2]..wanted.high[2] {
            for b in wanted.low[1]..wanted.high[1] {
                for a in wanted.low[0]..wanted.high[0] {
                    let at = place_in(counts, [a - low[0], b - low[1], c - low[2]]);
                    kinds.push(match self.kinds[at] {
                        Brick::Stored(s) => {
                            values.extend_from_slice(&self.values[s as usize]);
                            Brick::Stored((values.len() / BRICK_POINTS - 1) as u32)
                        }
                        other => other,
                    });
                }
            }
        }
        (kinds, values)
    }

    /// Takes over the bricks that were asked for; what a second round brings replaces what the first said of them.
    fn take(&mut self, blocks: &[Block], results: &[BlockValues]) {
        let [nx, ny, _] = self.range.counts();
        let low = self.range.low;
        let mut found = Vec::new();
        for (block, result) in blocks.iter().zip(results) {
            let (stored, _) = result.values.as_chunks::<BRICK_POINTS>();
            for i in (0..block.len()).filter(|&i| block.wants(i)) {
                let brick = block.brick_at(i);
                let [a, b, c] = [0, 1, 2].map(|k| brick[k] - low[k]);
                self.kinds[(c * ny + b) * nx + a] = match result.kinds[i] {
                    Brick::Stored(s) => {
                        let number = self.values.len() + found.len();
                        found.push(&stored[s as usize]);
                        Brick::Stored(number as u32)
                    }
                    other => other,
                };
            }
        }
        // In place and side by side: most of the time goes into pages that are touched first.
        self.values.par_extend(found.into_par_iter().copied());
    }

    /// The interior bricks with a value below 1 beside them, as masks by block: the surface crosses the
    /// lattice edge in between, so both of its ends need their values.
    fn crossed(&self) -> BTreeMap<[usize; 3], u64> {
        let bricks = self.range.counts();
        let [nx, ny, _] = bricks;
        let strides = [1, nx, nx * ny];
        let coordinates = |at: usize| [at % nx, at / nx % ny, at / (nx * ny)];
        let is_crossed = |at: usize| {
            let brick = coordinates(at);
            (0..3).any(|axis| {
                let below = (brick[axis] > 0).then(|| (at - strides[axis], BRICK - 1));
                let above = (brick[axis] + 1 < bricks[axis]).then(|| (at + strides[axis], 0));
                [below, above]
                    .into_iter()
                    .flatten()
                    .any(|(neighbour, layer)| {
                        let Brick::Stored(s) = self.kinds[neighbour] else {
                            return false;
                        };
                        let values = &self.values[s as usize];
                        let step = [1, BRICK, BRICK * BRICK];
                        let (u, v) = (step[(axis + 1) % 3], step[(axis + 2) % 3]);
                        (0..BRICK * BRICK).any(|p| {
                            values[layer * step[axis] + p % BRICK * u + p / BRICK * v] < 1.0
                        })
                    })
            })
        };
        let found = parallel::flat_map(self.kinds.len(), |at| {
            (self.kinds[at] == Brick::Interior && is_crossed(at)).then_some(at)
        });
        let mut crossed = BTreeMap::new();
        for at in found {
            let inner = coordinates(at);
            let brick = [0, 1, 2].map(|k| self.range.low[k] + inner[k]);
            let block = brick.map(|b| b / BLOCK * BLOCK);
            let side = [0, 1, 2].map(|k| BLOCK.min(self.of[k] - block[k]));
            let bit = place_in(side, [0, 1, 2].map(|k| brick[k] - block[k]));
            *crossed.entry(block).or_insert(0) |= 1 << bit;
        }
        crossed
    }
}

/// [`Band::crossed`] of a band with one stored brick, for tests.
#[cfg(feature = "testing")]
pub(crate) fn crossed(
    bricks: [usize; 3],
    kinds: Vec<Brick>,
    values: [f32; BRICK_POINTS],
) -> BTreeMap<[usize; 3], u64> {
    let band = Band {
        range: Bricks {
            low: [0; 3],
            high: bricks,
        },
        of: bricks,
        kinds,
        values: vec![values],
        pairs: 0,
    };
    band.crossed()
}
