//! Blocks are read once, and judged: one label, or several.
//!
//! First without reading: where the source knows that a block is constant, and no boundary of a material is near. Then
//! the others, 64 at a time per thread: range first, and only if that does not tell, point by point.

use geom_core::compute::parallel;
use geom_core::mesh::{EXTERIOR, INTERIOR, Region};
use geom_core::{LatticeValues, Vector3};

use super::{POINTS, at_least, point_of};
use crate::octree::domain::{Domain, Labels, local};
use crate::octree::source::Source;
use crate::octree::tree::BLOCK;
use crate::{Error, kernel};

/// What is known of a block before it is read.
pub(super) enum Known {
    /// Its label, and a value on that side of the level.
    Uniform(Region, f32),
    /// The label around, if the block has one off the molecule.
    Open(Option<Region>),
}

/// What the source and the shapes of materials say of each block.
/// In the order of the blocks. Nothing is read but what the source does for [`Source::constant`].
pub(super) fn known_blocks<V: LatticeValues + ?Sized>(
    source: &Source<'_, V>,
    domain: &Domain,
    labels: &Labels,
) -> Vec<Known> {
    // A little more, so that a corner that just touches a boundary counts.
    let radius = (0.5 * f64::from(BLOCK) * 3f64.sqrt() + 1e-3) * domain.spacing;
    parallel::map(domain.block_len(), |b| {
        let low = domain.block(b).map(|c| c * BLOCK);
        let middle = domain.world(&(local(low) + Vector3::repeat(0.5 * f64::from(BLOCK))));
        let around = if labels.plain() {
            Some(EXTERIOR)
        } else {
            labels.around(&middle, radius)
        };
        match (around, source.constant(domain, low, labels.level)) {
            (_, Some(v)) if f64::from(v) >= labels.level => Known::Uniform(INTERIOR, v),
            (Some(label), Some(v)) => Known::Uniform(label, v),
            _ => Known::Open(around),
        }
    })
}

/// A block that must be read, with the label around it, if it has one off the molecule.
#[derive(Clone, Copy)]
pub(super) struct OpenBlock {
    pub(super) number: usize,
    pub(super) around: Option<Region>,
}

/// What reading some blocks has told.
pub(super) struct Found {
    /// The label of a block, if all of it has one.
    pub(super) labels: Vec<Option<Region>>,
    /// Values of the others.
    pub(super) values: Vec<f32>,
    /// Their labels, unless labels are plain.
    pub(super) regions: Vec<Region>,
    pub(super) range: (f32, f32),
}

/// Memory that a thread uses again.
#[derive(Default)]
pub(super) struct Scratch {
    values: Vec<f32>,
    ranges: Vec<[f32; 2]>,
}

/// Reads blocks.
pub(super) struct Reader<'a, 'b, V: ?Sized> {
    pub(super) source: &'a Source<'b, V>,
    pub(super) domain: &'a Domain,
    pub(super) labels: &'a Labels,
}

impl<V: LatticeValues + ?Sized> Reader<'_, '_, V> {
    /// Reads some blocks and keeps the values of those with more than one label.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for the first bad value of these blocks.
    pub(super) fn read(&self, open: &[OpenBlock], scratch: &mut Scratch) -> Result<Found, Error> {
        scratch.values.resize(POINTS * open.len(), 0.0);
        self.gather(open, &mut scratch.values)?;
        scratch.ranges.resize(open.len(), [0.0; 2]);
        kernel::min_max(&scratch.values, &mut scratch.ranges);
        let level = self.labels.level;
        let both = |[low, high]: &&[f32; 2]| f64::from(*low) < level && f64::from(*high) >= level;
        let crossed = scratch.ranges.iter().filter(both).count();
        let mut out = Found {
            labels: Vec::with_capacity(open.len()),
            values: Vec::with_capacity(POINTS * crossed),
            regions: Vec::new(),
            range: (f32::INFINITY, f32::NEG_INFINITY),
        };
        let values = scratch.values.chunks_exact(POINTS);
        for ((block, &[low, high]), values) in open.iter().zip(&scratch.ranges).zip(values) {
            out.range = (out.range.0.min(low), out.range.1.max(high));
            let label = self.label(block, [low, high], values, &mut out.regions);
            if label.is_none() {
                out.values.extend_from_slice(values);
            }
            out.labels.push(label);
        }
        Ok(out)
    }

    /// The label of a block, if all of it has one; else its labels go to `regions`, unless they are plain.
    fn label(
        &self,
        block: &OpenBlock,
        [low, high]: [f32; 2],
        values: &[f32],
        regions: &mut Vec<Region>,
    ) -> Option<Region> {
        // The range tells a block on one side of the level, where nothing else divides it.
        let level = self.labels.level;
        match (f64::from(low) < level, f64::from(high) >= level) {
            (false, _) => return Some(INTERIOR),
            (true, false) if block.around.is_some() => return block.around,
            _ => {}
        }
        if self.labels.plain() {
            return None;
        }
        // Materials divide blocks on one side of the level too.
        let found = regions_of(self.domain, self.labels, block, values);
        if found.iter().all(|&r| r == found[0]) {
            return Some(found[0]);
        }
        regions.extend(found);
        None
    }

    /// The values of some blocks; a value that is not finite is refused, the first of them all.
    /// Runs along x share the layer between two blocks, which is read once.
    fn gather(&self, open: &[OpenBlock], buffer: &mut [f32]) -> Result<(), Error> {
        let domain = self.domain;
        let low = |b: usize| domain.block(b).map(|c| c * BLOCK);
        // Blocks that follow each other along x are read as one: rows are contiguous in the source.
        let row = domain.blocks[0] as usize;
        let follows = |p: usize, q: usize| {
            let within = |b: usize| self.source.is_within(domain, low(b)[0]);
            q == p + 1 && !q.is_multiple_of(row) && within(p) && within(q)
        };
        let mut rest = &mut *buffer;
        let mut runs = Vec::new();
        let mut first = 0;
        for run in open.chunk_by(|p, q| follows(p.number, q.number)) {
            let (out, others) = std::mem::take(&mut rest).split_at_mut(POINTS * run.len());
            rest = others;
            runs.push((first, run[0].number, out, None));
            first += run.len();
        }
        parallel::for_each(&mut runs, |_, (_, b, out, bad)| {
            self.source.gather(domain, low(*b), out);
            let mut blocks = out.chunks_exact(POINTS);
            *bad = blocks.position(|block| !kernel::all_finite(block));
        });
        let mut bad = runs
            .iter()
            .filter_map(|(first, _, _, bad)| Some(first + bad.as_ref()?));
        match bad.next() {
            None => Ok(()),
            Some(bad) => Err(self.not_finite(&open[bad], &buffer[POINTS * bad..][..POINTS])),
        }
    }

    /// Names the first bad value of a block.
    fn not_finite(&self, block: &OpenBlock, values: &[f32]) -> Error {
        let bad = values.iter().position(|v| !v.is_finite());
        let i = bad.expect("one of the block is bad");
        let p = point_of(self.domain, block.number, i);
        Error::NotFinite {
            index: self.source.index(self.domain, p),
            value: values[i],
        }
    }
}

/// The labels of the points of a block.
/// Where no boundary of a material is near, from the values alone; else shape by shape.
fn regions_of(domain: &Domain, labels: &Labels, block: &OpenBlock, values: &[f32]) -> Vec<Region> {
    let threshold = at_least(labels.level);
    values
        .iter()
        .enumerate()
        .map(|(i, &v)| match block.around {
            Some(label) => {
                if v >= threshold {
                    INTERIOR
                } else {
                    label
                }
            }
            None => labels.at(
                f64::from(v),
                &domain.point(point_of(domain, block.number, i)),
            ),
        })
        .collect()
}
