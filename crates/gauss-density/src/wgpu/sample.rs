//! Densities of blocks of bricks.
//!
//! Three passes per lot of blocks, each of which reads what the one before has left on the device:
//!
//! 1. **cull** bounds for every atom the share of the density that a brick loses without it, and drops as many, from the
//!    smallest bound on, as together stay below ε;
//! 2. **density** sums at each point what is left, as logarithms relative to the largest term, and finds the range of the brick;
//! 3. **compact** copies the values of the bricks that meet the band to the front, so that the others are not downloaded.
//!
//! A lot is as many blocks as fit into the device's buffers; several are under way at once, so that the processor gathers
//! trees and takes values over while the device works.

use std::borrow::Cow;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use bytemuck::{Pod, Zeroable};
use geom_core::compute::parallel;
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::shaders::{GAUSS_DENSITY_COMPACT, GAUSS_DENSITY_CULL, GAUSS_DENSITY_DENSITY};
use geom_core::{Point3, Wgpu};

use super::{Items, MAX_GROUPS};
use crate::backend::{Block, BlockValues, Job};
use crate::error::Error;
use crate::kernel::cull::ActiveSet;
use crate::kernel::prepared::Prepared;
use crate::model::Level;

/// What all bricks of a lot share: levels of the tree, half the edge of a brick in Å, the floor and ε of the cut-off.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct CullParams {
    depth: u32,
    half: f32,
    floor: f32,
    eps: f32,
}

/// A brick to cull for: its middle relative to its block, and where its tree, its state and its members stand.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct CullBrick {
    center: [f32; 3],
    row: u32,
    state: u32,
    members: u32,
    pad: [u32; 2],
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct DensityParams {
    spacing: f32,
    pad: [u32; 3],
}

/// A brick to sum: its first point, and its run of members.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct DensityBrick {
    corner: [f32; 3],
    first: u32,
    count: u32,
    pad: [u32; 3],
}

/// Lots that are under way at once: while the device has one, the processor gathers the next and takes over the one before.
const LOTS: usize = 3;

/// Samples blocks in batches none of whose arrays takes more than so many bytes.
pub(super) fn sample_within(
    bytes: usize,
    backend: &Wgpu,
    model: &Prepared<'_>,
    job: &Job,
    blocks: &[Block],
    results: &mut Vec<BlockValues>,
) -> Result<(), Error> {
    let trees: Vec<ActiveSet> = parallel::map_each(blocks, |b| ActiveSet::gather(model, &b.atoms));
    // 16 bytes of state per item and brick, and the values.
    let of_brick = |tree: &ActiveSet| {
        let nodes: usize = tree.levels.iter().map(Level::len).sum();
        (tree.len() + nodes) * 16
    };
    let lots = lots(bytes, blocks, &trees, of_brick);
    // Each lot fills results of its own, whose memory is that of an earlier call.
    results.resize_with(blocks.len(), BlockValues::default);
    let mut old = results.drain(..);
    let own: Vec<Mutex<Vec<BlockValues>>> = lots
        .iter()
        .map(|lot| Mutex::new(old.by_ref().take(lot.blocks.len()).collect()))
        .collect();
    drop(old);
    let next = AtomicUsize::new(0);
    let work = |_| -> Result<(), Error> {
        loop {
            let at = next.fetch_add(1, Relaxed);
            let Some(lot) = lots.get(at) else {
                return Ok(());
            };
            let mut own = own[at].lock().unwrap_or_else(PoisonError::into_inner);
            own.resize_with(lot.blocks.len(), BlockValues::default);
            let gathered = lot.gather(model, job);
            sample_lot(backend, model, job, lot, &gathered, &mut own)?;
        }
    };
    let outcomes = parallel::map(LOTS.min(lots.len()), work);
    outcomes.into_iter().collect::<Result<(), Error>>()?;
    for (i, (lot, own)) in lots.iter().zip(own).enumerate() {
        let own = own.into_inner().unwrap_or_else(PoisonError::into_inner);
        match lot.part {
            None => results.extend(own),
            Some(whole) => {
                if i == 0 || lots[i - 1].part != lot.part {
                    let mut all = BlockValues::default();
                    all.clear(&blocks[whole]);
                    results.push(all);
                }
                let all = results.last_mut().expect("there is one for the first part");
                merge(&lot.blocks[0], own, all);
            }
        }
    }
    Ok(())
}

/// Blocks that go to the device together, or some bricks of a block that is too large as a whole.
struct Lot<'a> {
    blocks: Cow<'a, [Block]>,
    trees: &'a [ActiveSet],
    /// Of which block it has some bricks.
    part: Option<usize>,
}

/// Runs of blocks none of whose arrays takes more than so many bytes, given what the states of a brick take.
fn lots<'a>(
    bytes: usize,
    blocks: &'a [Block],
    trees: &'a [ActiveSet],
    of_brick: impl Fn(&ActiveSet) -> usize,
) -> Vec<Lot<'a>> {
    let mut lots = Vec::new();
    let mut first = 0;
    while first < blocks.len() {
        let (mut end, mut states, mut bricks) = (first, 0, 0);
        while end < blocks.len() {
            let own = blocks[end].len();
            let states_then = states + of_brick(&trees[end]) * own;
            let full = states_then > bytes
                || (bricks + own) * BRICK_POINTS * 4 > bytes
                || bricks + own > MAX_GROUPS;
            if full {
                break;
            }
            (states, bricks, end) = (states_then, bricks + own, end + 1);
        }
        if end == first {
            // Too large as a whole: some of its bricks at a time.
            let block = &blocks[first];
            let most = bytes / of_brick(&trees[first]).max(BRICK_POINTS * 4);
            let wanted: Vec<usize> = (0..block.len()).filter(|&i| block.wants(i)).collect();
            // Even of none there is a result.
            let none = wanted.is_empty().then_some(&wanted[..]);
            let parts = wanted.chunks(most.max(1)).chain(none);
            lots.extend(parts.map(|bricks| Lot {
                blocks: Cow::Owned(vec![Block {
                    mask: bricks.iter().fold(0, |mask, i| mask | 1 << i),
                    ..block.clone()
                }]),
                trees: &trees[first..=first],
                part: Some(first),
            }));
            first += 1;
        } else {
            lots.push(Lot {
                blocks: Cow::Borrowed(&blocks[first..end]),
                trees: &trees[first..end],
                part: None,
            });
            first = end;
        }
    }
    lots
}

/// Puts the bricks of a part to those that came before.
/// Numbers of stored bricks go on where those before ended.
fn merge(part: &Block, found: Vec<BlockValues>, all: &mut BlockValues) {
    let before = (all.values.len() / BRICK_POINTS) as u32;
    for found in found {
        for i in (0..part.len()).filter(|&i| part.wants(i)) {
            all.kinds[i] = match found.kinds[i] {
                Brick::Stored(s) => Brick::Stored(before + s),
                other => other,
            };
        }
        all.values.extend_from_slice(&found.values);
        all.pairs += found.pairs;
    }
}

/// What the device gets of a lot.
struct Gathered {
    /// Each block's atoms relative to its middle.
    items: Items,
    bricks: Vec<CullBrick>,
    /// Per brick: block, place in it, first point from the block's middle.
    places: Vec<(usize, usize, [f32; 3])>,
    /// Numbers of states and of places for members.
    states: usize,
    members: usize,
}

impl Lot<'_> {
    /// On the processor, in f64 until differences have been taken.
    fn gather(&self, model: &Prepared<'_>, job: &Job) -> Gathered {
        let depth = model.levels.len();
        let lattice = &job.lattice;
        let h = lattice.spacing;
        let mut out = Gathered {
            items: Items::default(),
            bricks: Vec::new(),
            places: Vec::new(),
            states: 0,
            members: 0,
        };
        for (b, (block, tree)) in self.blocks.iter().zip(self.trees).enumerate() {
            let low = lattice.point(block.brick.map(|b| b * BRICK));
            let half = block.bricks.map(|n| 0.5 * h * (n * BRICK) as f64);
            let center = Point3::new(low.x + half[0], low.y + half[1], low.z + half[2]);
            let items = &mut out.items;
            let row = items.add(model.model(), &tree.atom, &tree.levels, &center);
            let states = items.len(row, depth);
            for i in (0..block.len()).filter(|&i| block.wants(i)) {
                let corner = lattice.point(block.brick_at(i).map(|b| b * BRICK)) - center;
                // One cell more on the low sides, as on the CPU.
                let middle = corner.map(|c| c + 0.5 * h * (BRICK as f64 - 1.0));
                out.bricks.push(CullBrick {
                    center: [middle.x as f32, middle.y as f32, middle.z as f32],
                    row,
                    state: out.states as u32,
                    members: out.members as u32,
                    pad: [0; 2],
                });
                let corner = [corner.x as f32, corner.y as f32, corner.z as f32];
                out.places.push((b, i, corner));
                out.states += states;
                out.members += tree.len();
            }
        }
        out
    }
}

/// Culls, densities and classification of the bricks of a lot.
/// Two numbers per brick come back before the densities are dispatched, and two after, so that only bricks that count
/// are summed, and only those with a value below the ceiling are downloaded.
fn sample_lot(
    backend: &Wgpu,
    model: &Prepared<'_>,
    job: &Job,
    lot: &Lot<'_>,
    gathered: &Gathered,
    results: &mut [BlockValues],
) -> Result<(), Error> {
    let gpu = backend.gpu();
    let depth = model.levels.len();
    let h = job.lattice.spacing;
    // The descent to blocks took a quarter.
    let eps = 0.75 * job.cutoff.0;
    let Gathered {
        items,
        bricks,
        places,
        ..
    } = gathered;
    for (result, block) in results.iter_mut().zip(&*lot.blocks) {
        result.clear(block);
    }
    if bricks.is_empty() {
        return Ok(());
    }

    let params = gpu.uniform(
        "cull params",
        &CullParams {
            depth: depth as u32,
            half: (0.5 * h * (BRICK as f64 + 1.0)) as f32 * 1.000_001,
            floor: job.floor.log2() as f32,
            eps: eps.log2() as f32,
        },
    )?;
    let item_buffer = gpu.upload("items", &items.items)?;
    let ranges = gpu.upload("ranges", &items.ranges)?;
    let brick_buffer = gpu.upload("bricks", bricks)?;
    let states = gpu.output::<[f32; 4]>("states", gathered.states)?;
    let bounds = gpu.output::<[f32; 2]>("bounds", gathered.states)?;
    let members = gpu.output::<u32>("members", gathered.members)?;
    let found = gpu.output::<[u32; 2]>("found", bricks.len())?;
    gpu.dispatch(
        &GAUSS_DENSITY_CULL,
        &[
            &params,
            &item_buffer,
            &ranges,
            &brick_buffer,
            &states,
            &bounds,
            &members,
            &found,
        ],
        [bricks.len() as u32, 1, 1],
    )?;
    let found: Vec<[u32; 2]> = gpu.download(&found)?;

    // Bricks with the most members first, so that none of these is the last to finish.
    let mut live: Vec<usize> = (0..bricks.len()).filter(|&i| found[i][1] == 1).collect();
    live.sort_by_key(|&i| std::cmp::Reverse(found[i][0]));
    for &i in &live {
        results[places[i].0].pairs += u64::from(found[i][0]) * BRICK_POINTS as u64;
    }
    if live.is_empty() {
        return Ok(());
    }
    let density_bricks: Vec<DensityBrick> = live
        .iter()
        .map(|&i| DensityBrick {
            corner: places[i].2,
            first: bricks[i].members,
            count: found[i][0],
            pad: [0; 3],
        })
        .collect();
    let params = gpu.uniform(
        "density params",
        &DensityParams {
            spacing: h as f32,
            pad: [0; 3],
        },
    )?;
    let density_bricks = gpu.upload("bricks", &density_bricks)?;
    let values = gpu.output::<f32>("values", live.len() * BRICK_POINTS)?;
    let lowest = gpu.output::<[f32; 2]>("lowest", live.len())?;
    // Compiled for the depth of the tree, so that the open sums stay in registers.
    gpu.together("density", |batch| {
        batch.dispatch_for(
            &GAUSS_DENSITY_DENSITY,
            &[("DEPTH", depth as u32)],
            &[
                &params,
                &item_buffer,
                &members,
                &density_bricks,
                &values,
                &lowest,
            ],
            [live.len() as u32, 2, 1],
        )
    })?;

    // Only bricks with a value below the ceiling come back.
    let mut chosen: Vec<(usize, u32)> = Vec::with_capacity(live.len());
    if job.ceiling.is_finite() {
        let lowest: Vec<[f32; 2]> = gpu.download(&lowest)?;
        for (slot, (&i, low)) in live.iter().zip(&lowest).enumerate() {
            if f64::from(low[0].min(low[1])) >= job.ceiling {
                results[places[i].0].kinds[places[i].1] = Brick::Interior;
            } else {
                chosen.push((i, slot as u32));
            }
        }
    } else {
        chosen.extend(live.iter().enumerate().map(|(slot, &i)| (i, slot as u32)));
    }
    // Back in the order of blocks, x fastest.
    chosen.sort_unstable();
    if chosen.is_empty() {
        return Ok(());
    }
    let slots: Vec<u32> = chosen.iter().map(|c| c.1).collect();
    let slots = gpu.upload("chosen", &slots)?;
    let compact = gpu.output::<f32>("compact", chosen.len() * BRICK_POINTS)?;
    gpu.dispatch(
        &GAUSS_DENSITY_COMPACT,
        &[&slots, &values, &compact],
        [chosen.len() as u32, 1, 1],
    )?;
    // A block's bricks follow each other.
    let of_block = |b: usize| chosen.partition_point(|&(i, _)| places[i].0 < b);
    gpu.read(&compact, |compact: &[f32]| {
        parallel::for_each(results, |b, result| {
            let own = of_block(b)..of_block(b + 1);
            for (number, &(i, _)) in chosen[own.clone()].iter().enumerate() {
                result.kinds[places[i].1] = Brick::Stored(number as u32);
            }
            let values = own.start * BRICK_POINTS..own.end * BRICK_POINTS;
            result.values.extend_from_slice(&compact[values]);
        });
    })?;
    Ok(())
}
