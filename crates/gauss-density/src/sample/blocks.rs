//! What dense and narrow-band sampling share: the lattice, and the way to the blocks that some atom can reach.

use std::collections::BTreeMap;

use geom_core::compute::parallel;
use geom_core::grid::BRICK;
use geom_core::{Aabb, Lattice};

use crate::backend::{BLOCK, Block, BlockValues, Job, On, check_blocks};
use crate::error::Error;
use crate::kernel::boxes::lattice_box;
use crate::kernel::prepared::Prepared;
use crate::model::reach::Reach;
use crate::options::Options;

/// A grid and how it came about.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampled<G> {
    /// The density; the surface is where it is 1, inside it is larger.
    pub grid: G,
    /// Counts.
    pub report: Report,
}

/// Counts of a sampling.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// Name of the backend.
    pub backend: String,
    /// Number of atoms.
    pub atoms: usize,
    /// Lattice points.
    pub points: u64,
    /// Points whose value is stored.
    /// Of a band those of stored bricks, 512 each, even where these stick out of the lattice.
    pub stored_points: u64,
    /// `k_A`: the share of points that are stored.
    pub stored_share: f64,
    /// Pairs of an atom and a point that were evaluated.
    /// What sampling takes time for; it depends on the cut-off and on the backend, which culls in its own way.
    pub pairs: u64,
    /// Pairs of brute force: atoms × points.
    pub brute_force_pairs: f64,
    /// Does the body (`G ≥ 1`) reach the low and high side of the box, per axis?
    pub touches_box: [[bool; 2]; 3],
}

impl Report {
    /// Does the body reach the box anywhere? Then the surface is cut open there.
    pub fn touches_any_side(&self) -> bool {
        self.touches_box.iter().flatten().any(|&t| t)
    }
}

/// With what is known before anything is sampled.
pub(crate) fn start_report(model: &Prepared<'_>, lattice: &Lattice, backend: String) -> Report {
    let atoms = model.model().atoms();
    Report {
        backend,
        atoms,
        points: lattice.points() as u64,
        brute_force_pairs: atoms as f64 * lattice.points() as f64,
        ..Report::default()
    }
}

/// The lattice that the options ask for.
pub(crate) fn lattice_of(model: &Prepared<'_>, options: &Options) -> Result<Lattice, Error> {
    lattice_around(&model.reach, || model.model().center_bounds(), options)
}

/// The same for atoms of which only their reach and the box around their centres are known.
pub(crate) fn lattice_around(
    reach: &Reach,
    center_bounds: impl FnOnce() -> Aabb,
    options: &Options,
) -> Result<Lattice, Error> {
    let bounds = match options.bounds {
        Some(bounds) => bounds,
        None => {
            let margin = options
                .margin
                .unwrap_or_else(|| reach.beyond(options.band[0]).max(4.0));
            center_bounds().inflated(margin)
        }
    };
    let lattice = Lattice::covering(&bounds, options.spacing);
    if lattice.counts.iter().any(|&n| n > u32::MAX as usize) {
        return Err(too_large(
            &lattice,
            lattice.points().saturating_mul(4),
            options,
        ));
    }
    Ok(lattice)
}

/// In u128, since a user's counts may leave u64 before they are refused.
pub(crate) fn check_memory(lattice: &Lattice, bytes: u128, options: &Options) -> Result<(), Error> {
    if bytes > u128::from(options.max_memory) {
        return Err(too_large(lattice, bytes, options));
    }
    Ok(())
}

fn too_large(lattice: &Lattice, bytes: u128, options: &Options) -> Error {
    let limit = options.max_memory.max(1);
    // The bytes of a dense grid grow with the cube of the resolution; one percent more for what is rounded up.
    let factor = (bytes as f64 / limit as f64).cbrt() * 1.01;
    refused(lattice, bytes, factor, options)
}

/// The same in the middle of a band: its bytes so far, and the share of it that has been sampled.
pub(crate) fn too_large_after(
    lattice: &Lattice,
    bytes: u128,
    share: f64,
    options: &Options,
) -> Error {
    let whole = bytes as f64 / share.clamp(f64::EPSILON, 1.0);
    // They grow with the square of the resolution.
    let factor = (whole / options.max_memory.max(1) as f64).sqrt() * 1.05;
    refused(lattice, whole as u128, factor, options)
}

fn refused(lattice: &Lattice, bytes: u128, factor: f64, options: &Options) -> Error {
    Error::GridTooLarge {
        points: lattice.points(),
        bytes,
        limit: options.max_memory,
        spacing: lattice.spacing * factor,
    }
}

/// Blocks per side of a region, whose blocks are looked for at once.
const REGION: usize = 16;
/// A box of bricks of a lattice, `low..high` per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bricks {
    pub(crate) low: [usize; 3],
    pub(crate) high: [usize; 3],
}

impl Bricks {
    /// All bricks of a lattice.
    pub(crate) fn all(lattice: &Lattice) -> Self {
        Self {
            low: [0; 3],
            high: lattice.counts.map(|n| n.div_ceil(BRICK)),
        }
    }

    /// Bricks per axis.
    pub(crate) fn counts(&self) -> [usize; 3] {
        [0, 1, 2].map(|k| self.high[k] - self.low[k])
    }

    /// The blocks that hold them, `low..high` per axis.
    pub(crate) fn blocks(&self) -> [[usize; 3]; 2] {
        [
            self.low.map(|b| b / BLOCK),
            self.high.map(|b| b.div_ceil(BLOCK)),
        ]
    }

    /// About how much of the range has been looked at up to a block, in the order of [`for_each_batch`].
    pub(crate) fn share_up_to(&self, block: &Block) -> f64 {
        let [first, end] = self.blocks();
        let regions = [0, 1, 2].map(|k| (end[k] - first[k]).div_ceil(REGION));
        let at = [0, 1, 2].map(|k| (block.brick[k] / BLOCK - first[k]) / REGION);
        let before = (at[2] * regions[1] + at[1]) * regions[0] + at[0];
        (before + 1) as f64 / regions.iter().product::<usize>() as f64
    }

    /// Those of a block: bit `i` is its `i`-th brick.
    fn mask(&self, block: &Block) -> u64 {
        let holds = |b: [usize; 3]| (0..3).all(|k| (self.low[k]..self.high[k]).contains(&b[k]));
        let own = (0..block.len()).filter(|&i| holds(block.brick_at(i)));
        own.fold(0, |mask, i| mask | 1 << i)
    }
}

/// Calls the backend for batch after batch of blocks with bricks in `range` that some atom can reach, in a fixed order;
/// with `wanted` (masks by lowest brick) for these only. Between batches the watcher is asked.
pub(crate) fn for_each_batch(
    model: &Prepared<'_>,
    job: &Job,
    range: &Bricks,
    wanted: Option<&BTreeMap<[usize; 3], u64>>,
    run: On<'_>,
    mut take: impl FnMut(&[Block], &[BlockValues]) -> Result<(), Error> + Send,
) -> Result<(), Error> {
    let bricks = job.lattice.counts.map(|n| n.div_ceil(BRICK));
    let [first, end] = range.blocks();
    let regions = [0, 1, 2].map(|k| (end[k] - first[k]).div_ceil(REGION));
    let total = regions.iter().product::<usize>();
    // A quarter of what the cut-off allows; the culls of boxes take the rest.
    let reach = model.reach.radius(job.cutoff.0 / 4.0, job.floor);
    let all = model.clusters();
    let name = run.backend.name();
    let (mut results, mut before) = (Vec::new(), Vec::new());
    for region in 0..total {
        run.progress("density", region as u64, total as u64)?;
        let [nx, ny, _] = regions;
        let at = [region % nx, region / nx % ny, region / (nx * ny)];
        let low = [0, 1, 2].map(|k| first[k] + at[k] * REGION);
        let high = [0, 1, 2].map(|k| (low[k] + REGION).min(end[k]));
        let mut found = Vec::new();
        let way = Descent {
            model,
            job,
            bricks,
            reach,
        };
        way.descend(&all, low, high, &mut found);
        found.retain_mut(|block| {
            block.mask &= range.mask(block);
            if let Some(wanted) = wanted {
                block.mask &= wanted.get(&block.brick).copied().unwrap_or(0);
            }
            block.mask != 0
        });
        found.sort_by_key(|b| [b.brick[2], b.brick[1], b.brick[0]]);
        let mut blocks_before: &[Block] = &[];
        // While blocks are sampled, the values of those before are taken.
        for batch in found.chunks(run.backend.blocks_per_call().max(1)) {
            run.progress("density", region as u64, total as u64)?;
            let (sampled, taken) = rayon::join(
                || (run.backend).sample_blocks(model, job, batch, &mut results),
                || take(blocks_before, &before[..blocks_before.len()]),
            );
            taken?;
            sampled?;
            check_blocks(&name, batch, &results)?;
            std::mem::swap(&mut results, &mut before);
            blocks_before = batch;
        }
        take(blocks_before, &before[..blocks_before.len()])?;
    }
    run.progress("density", total as u64, total as u64)?;
    Ok(())
}

/// The way from all clusters to the blocks that they can reach.
struct Descent<'a> {
    model: &'a Prepared<'a>,
    job: &'a Job,
    bricks: [usize; 3],
    reach: f64,
}

impl Descent<'_> {
    /// Halves a range of blocks until one is left, keeping the clusters that can reach it.
    /// (A k-d tree over space that is walked and never built.) Halves are searched side by side and their finds joined
    /// in order.
    fn descend(&self, clusters: &[u32], low: [usize; 3], high: [usize; 3], found: &mut Vec<Block>) {
        let first = low.map(|b| (b * BLOCK * BRICK) as i64 - 1);
        let last = [0, 1, 2].map(|k| ((high[k] * BLOCK).min(self.bricks[k]) * BRICK) as i64);
        let lattice = &self.job.lattice;
        let region = lattice_box(&lattice.origin, lattice.spacing, first, last);
        let near = self.model.near(clusters, &region, self.reach);
        if near.is_empty() {
            return;
        }
        let axis = (0..3)
            .max_by_key(|&k| high[k] - low[k])
            .expect("three axes");
        if high[axis] - low[axis] > 1 {
            let middle = (low[axis] + high[axis]) / 2;
            let (mut left, mut right) = (high, low);
            left[axis] = middle;
            right[axis] = middle;
            let mut others = Vec::new();
            rayon::join(
                || self.descend(&near, low, left, found),
                || self.descend(&near, right, high, &mut others),
            );
            found.append(&mut others);
            return;
        }
        let atoms = self.model.atoms_near(&near, &region, self.reach);
        if !atoms.is_empty() {
            let brick = low.map(|b| b * BLOCK);
            found.push(Block {
                brick,
                bricks: [0, 1, 2].map(|k| BLOCK.min(self.bricks[k] - brick[k])),
                mask: u64::MAX,
                atoms,
            });
        }
    }
}

/// Does a value of 1 or more stand on a side of the box?
/// Per axis, the low side and the high one; the six faces are read, nothing else.
pub(crate) fn touched(grid: &impl geom_core::LatticeValues) -> [[bool; 2]; 3] {
    let counts = grid.lattice().counts;
    std::array::from_fn(|axis| {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        [0, counts[axis].saturating_sub(1)].map(|side| {
            let row = parallel::first(counts[v], |b| {
                (0..counts[u]).any(|a| {
                    let mut p = [0; 3];
                    (p[axis], p[u], p[v]) = (side, a, b);
                    grid.at(p) >= 1.0
                })
            });
            row.is_some()
        })
    })
}
