//! Densities of blocks of bricks.

use bytemuck::{Pod, Zeroable};
use geom_core::grid::{BRICK, BRICK_POINTS, Brick};
use geom_core::shaders::{GAUSS_DENSITY_COMPACT, GAUSS_DENSITY_CULL, GAUSS_DENSITY_DENSITY};
use geom_core::{Point3, Wgpu};
use rayon::prelude::*;

use super::{Items, MAX_GROUPS};
use crate::backend::{Block, BlockValues, Job};
use crate::error::Error;
use crate::kernel::cull::ActiveSet;
use crate::kernel::prepared::Prepared;
use crate::model::Level;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct CullParams {
    depth: u32,
    half: f32,
    floor: f32,
    eps: f32,
}

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

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct DensityBrick {
    corner: [f32; 3],
    first: u32,
    count: u32,
    pad: [u32; 3],
}

/// Samples blocks in batches none of whose arrays takes more than so many bytes.
pub(super) fn sample_within(
    bytes: usize,
    backend: &Wgpu,
    model: &Prepared<'_>,
    job: &Job,
    blocks: &[Block],
    results: &mut Vec<BlockValues>,
) -> Result<(), Error> {
    let trees: Vec<ActiveSet> = blocks
        .par_iter()
        .map(|b| ActiveSet::gather(model, &b.atoms))
        .collect();
    // 16 bytes of state per item and brick, and the values.
    let of_brick = |tree: &ActiveSet| {
        let nodes: usize = tree.levels.iter().map(Level::len).sum();
        (tree.len() + nodes) * 16
    };
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
            let most = bytes / of_brick(&trees[first]).max(BRICK_POINTS * 4);
            let (block, tree) = (&blocks[first], &trees[first]);
            results.push(sample_parts(backend, model, job, block, tree, most.max(1))?);
            first += 1;
        } else {
            let range = first..end;
            let (blocks, trees) = (&blocks[range.clone()], &trees[range]);
            results.extend(sample_batch(backend, model, job, blocks, trees)?);
            first = end;
        }
    }
    Ok(())
}

/// Samples a block, at most so many of its bricks at a time.
fn sample_parts(
    backend: &Wgpu,
    model: &Prepared<'_>,
    job: &Job,
    block: &Block,
    tree: &ActiveSet,
    most: usize,
) -> Result<BlockValues, Error> {
    let mut all = BlockValues::default();
    all.clear(block);
    let wanted: Vec<usize> = (0..block.len()).filter(|&i| block.wants(i)).collect();
    for bricks in wanted.chunks(most) {
        let part = Block {
            mask: bricks.iter().fold(0, |mask, i| mask | 1 << i),
            ..block.clone()
        };
        let before = (all.values.len() / BRICK_POINTS) as u32;
        for found in sample_batch(backend, model, job, &[part], std::slice::from_ref(tree))? {
            for &i in bricks {
                all.kinds[i] = match found.kinds[i] {
                    Brick::Stored(s) => Brick::Stored(before + s),
                    other => other,
                };
            }
            all.values.extend_from_slice(&found.values);
            all.pairs += found.pairs;
        }
    }
    Ok(all)
}

/// Culls, densities and classification of the bricks of some blocks.
fn sample_batch(
    backend: &Wgpu,
    model: &Prepared<'_>,
    job: &Job,
    blocks: &[Block],
    trees: &[ActiveSet],
) -> Result<Vec<BlockValues>, Error> {
    let gpu = backend.gpu();
    let depth = model.levels.len();
    let lattice = &job.lattice;
    let h = lattice.spacing;
    // The descent to blocks took a quarter.
    let eps = 0.75 * job.cutoff.0;
    // Each block's atoms relative to its middle.
    let mut items = Items::default();
    // Block, place in it, first point from the block's middle.
    let mut places: Vec<(usize, usize, [f32; 3])> = Vec::new();
    let mut bricks: Vec<CullBrick> = Vec::new();
    let (mut state, mut member_slots) = (0usize, 0usize);
    for (b, (block, tree)) in blocks.iter().zip(trees).enumerate() {
        let low = lattice.point(block.brick.map(|b| b * BRICK));
        let half = block.bricks.map(|n| 0.5 * h * (n * BRICK) as f64);
        let center = Point3::new(low.x + half[0], low.y + half[1], low.z + half[2]);
        let row = items.add(model.model(), &tree.atom, &tree.levels, &center);
        for i in (0..block.len()).filter(|&i| block.wants(i)) {
            let corner = lattice.point(block.brick_at(i).map(|b| b * BRICK)) - center;
            // One cell more on the low sides, as on the CPU.
            let middle = corner.map(|c| c + 0.5 * h * (BRICK as f64 - 1.0));
            bricks.push(CullBrick {
                center: [middle.x as f32, middle.y as f32, middle.z as f32],
                row,
                state: state as u32,
                members: member_slots as u32,
                pad: [0; 2],
            });
            places.push((b, i, [corner.x as f32, corner.y as f32, corner.z as f32]));
            state += items.len(row, depth);
            member_slots += tree.len();
        }
    }
    let mut results: Vec<BlockValues> = blocks
        .iter()
        .map(|block| BlockValues {
            kinds: vec![Brick::Exterior; block.len()],
            ..BlockValues::default()
        })
        .collect();
    if bricks.is_empty() {
        return Ok(results);
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
    let brick_buffer = gpu.upload("bricks", &bricks)?;
    let states = gpu.output::<[f32; 4]>("states", state)?;
    let bounds = gpu.output::<[f32; 2]>("bounds", state)?;
    let members = gpu.output::<u32>("members", member_slots)?;
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
        return Ok(results);
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
        return Ok(results);
    }
    let slots: Vec<u32> = chosen.iter().map(|c| c.1).collect();
    let slots = gpu.upload("chosen", &slots)?;
    let compact = gpu.output::<f32>("compact", chosen.len() * BRICK_POINTS)?;
    gpu.dispatch(
        &GAUSS_DENSITY_COMPACT,
        &[&slots, &values, &compact],
        [chosen.len() as u32, 1, 1],
    )?;
    let compact: Vec<f32> = gpu.download(&compact)?;
    for (&(i, _), values) in chosen.iter().zip(compact.chunks_exact(BRICK_POINTS)) {
        let (b, place, _) = places[i];
        let result = &mut results[b];
        result.kinds[place] = Brick::Stored((result.values.len() / BRICK_POINTS) as u32);
        result.values.extend_from_slice(values);
    }
    Ok(results)
}

#[cfg(all(test, feature = "testing"))]
mod tests {
    use super::super::BATCH_BYTES;
    use super::*;
    use crate::model::{Levels, Model};
    use crate::options::Cutoff;
    use crate::testing::globule;
    use geom_core::testing::gpu_or_skip;
    use geom_core::{Aabb, Lattice};

    /// As many calls as the bytes ask for, and the same values.
    #[test]
    fn a_block_that_is_too_large_is_sampled_in_parts() {
        let Some(gpu) = gpu_or_skip() else { return };
        let levels = Levels {
            residue_power: 0.5,
            ..Levels::default()
        };
        let model = Model::uniform(&globule(1, 40, 5), &levels).unwrap();
        let prepared = Prepared::new(&model);
        let all = model.center_bounds();
        let bounds = Aabb::new(all.center(), all.max);
        let job = Job {
            lattice: Lattice::covering(&bounds, bounds.extent().max() / 28.0),
            cutoff: Cutoff::default(),
            floor: 0.5,
            ceiling: 2.0,
        };
        let block = Block {
            brick: [0; 3],
            bricks: job.lattice.counts.map(|n| n.div_ceil(BRICK).min(4)),
            mask: u64::MAX - 6,
            atoms: (0..model.atoms() as u32).collect(),
        };
        let sampled = |bytes: usize| {
            let before = gpu.gpu().usage();
            let mut results = Vec::new();
            let blocks = [block.clone(), block.clone()];
            sample_within(bytes, &gpu, &prepared, &job, &blocks, &mut results).unwrap();
            let used = gpu.gpu().usage().since(&before);
            let culls = used.kernels().find(|k| k.0 == GAUSS_DENSITY_CULL.name);
            (results, culls.unwrap().1.calls)
        };
        let (whole, calls) = sampled(BATCH_BYTES);
        assert_eq!(calls, 1);
        assert!(whole[0].values.len() > 2 * BRICK_POINTS);
        let wanted = (0..block.len()).filter(|&i| block.wants(i)).count() as u64;
        for (bytes, expected) in [(BATCH_BYTES / 1024, None), (1, Some(2 * wanted))] {
            let (parts, calls) = sampled(bytes);
            assert_eq!(parts, whole);
            assert!(
                calls > 2 && expected.is_none_or(|n| calls == n),
                "{calls} calls"
            );
        }
    }
}
