//! Work in batches of any size, for tests.

use geom_core::Wgpu;

use super::refit::Resident;
use super::{sample, sites};
use crate::backend::{Block, BlockValues, Job, RefitSamples as _, RefitSums, SampleCell};
use crate::error::Error;
use crate::kernel::prepared::Prepared;

/// Most bytes of an array, if nobody says otherwise.
pub const BATCH_BYTES: usize = super::BATCH_BYTES;

/// Samples blocks in batches none of whose arrays takes more than so many bytes.
pub fn sample_within(
    bytes: usize,
    backend: &Wgpu,
    model: &Prepared<'_>,
    job: &Job,
    blocks: &[Block],
) -> Result<Vec<BlockValues>, Error> {
    let mut results = Vec::new();
    sample::sample_within(bytes, backend, model, job, blocks, &mut results)?;
    Ok(results)
}

/// How many runs cells come in.
pub fn runs(bytes: usize, cells: &[SampleCell]) -> usize {
    sites::ranges(bytes, cells).len()
}

/// The sums of a refit, in runs none of whose arrays takes more than so many bytes.
pub fn refit_sums(
    bytes: usize,
    backend: &Wgpu,
    model: &Prepared<'_>,
    cells: &[SampleCell],
) -> Result<RefitSums, Error> {
    let depth = model.levels.len() as u32;
    let mut samples = Resident::new(bytes, backend, model, depth, cells)?;
    let mut sums = RefitSums::default();
    samples.sums(model.model, &mut sums)?;
    Ok(sums)
}
