//! Small groups of points change sides.
//!
//! Connected components, by union and find. A block of one label is one node, however many points it has, so that the
//! cost is that of the points near the surface.

use geom_core::Point3;
use geom_core::compute::sets::DisjointSets;
use geom_core::mesh::{INTERIOR, Region};

use super::{BLOCK, POINTS, SIDE, Samples, UNIFORM, block_index, point_of};
use crate::Error;

/// What has been given to the other side.
#[derive(Clone, Copy, Default)]
pub(crate) struct Pruned {
    /// How many groups, over all rounds.
    pub(crate) groups: usize,
    /// Lattice points.
    pub(crate) points: u64,
}

/// Bytes of a node while groups are found: its parent, its root, and the size of its group.
const NODE_BYTES: u128 = 16;

/// Refuses more nodes (see [`Samples::first_node`]) than have numbers, or than there is memory for.
fn check_nodes(blocks: usize, stored: usize, max_memory: u64) -> Result<(), Error> {
    let nodes = blocks as u128 + POINTS as u128 * stored as u128;
    let limit = u128::from(u32::MAX).min(u128::from(max_memory) / NODE_BYTES);
    if nodes <= limit {
        return Ok(());
    }
    Err(Error::TooLarge {
        what: "finding small groups",
        bytes: nodes * NODE_BYTES,
        limit: limit * NODE_BYTES,
        cure: "take a larger spacing, allow more memory, or leave prune at 0",
    })
}

impl Samples<'_> {
    /// Gives groups of fewer than `least` lattice points on one side of the level to the other side;
    /// groups are connected by lattice edges. A group that was given away may leave another small one,
    /// so this goes on until there is none.
    ///
    /// Refuses lattices with more nodes than have numbers, or than fit into `max_memory` bytes.
    pub(crate) fn prune(&mut self, least: u32, max_memory: u64) -> Result<Pruned, Error> {
        check_nodes(self.state.len(), self.stored.len(), max_memory)?;
        let mut all = Pruned::default();
        loop {
            let pruned = self.prune_once(least);
            if pruned.groups == 0 {
                return Ok(all);
            }
            all.groups += pruned.groups;
            all.points += pruned.points;
        }
    }

    /// One round: all small groups of either side at once. Two small groups beside each other swap sides, which the
    /// next round sees; where all groups are small, nothing is done, since there is nothing to give them to.
    fn prune_once(&mut self, least: u32) -> Pruned {
        let groups = self.sides();
        let sizes = self.sizes(&groups);
        let small: Vec<usize> = (0..sizes.len())
            .filter(|&i| sizes[i] > 0 && sizes[i] < u64::from(least))
            .collect();
        // All has one sign: nothing to give to.
        let total = (0..sizes.len()).filter(|&i| sizes[i] > 0).count();
        if small.is_empty() || small.len() == total {
            return Pruned::default();
        }
        self.flip(&groups, |root| small.binary_search(&root).is_ok());
        Pruned {
            groups: small.len(),
            points: small.iter().map(|&i| sizes[i]).sum(),
        }
    }

    /// Where the nodes of a stored block begin: there is one node per block, which stands for all of its points
    /// if it is not stored, then one per point of each stored block.
    fn first_node(&self, slot: usize) -> usize {
        self.state.len() + slot * POINTS
    }

    /// The node of a lattice point.
    fn node(&self, p: [i32; 3]) -> usize {
        let (b, i) = self.place(p);
        self.slot(b).map_or(b, |slot| self.first_node(slot) + i)
    }

    /// The root of the group of each node: neighbours on one side of the level are in one.
    fn sides(&self) -> Vec<u32> {
        let blocks = self.state.len();
        let mut groups = DisjointSets::new(blocks + POINTS * self.stored.len());
        for b in 0..blocks {
            match self.slot(b) {
                None => self.join_blocks(b, &mut groups),
                Some(slot) => self.join_points(b, slot, &mut groups),
            }
        }
        groups.into_roots()
    }

    /// Joins a block of one label with the next such blocks along the axes.
    fn join_blocks(&self, b: usize, groups: &mut DisjointSets) {
        let at = self.domain.block(b);
        let is_inside = |b: usize| self.state[b] as u8 == INTERIOR;
        for axis in 0..3 {
            let mut next = at;
            next[axis] += 1;
            if next[axis] < self.domain.blocks[axis] {
                let other = block_index(self.domain.blocks, next);
                if self.slot(other).is_none() && is_inside(b) == is_inside(other) {
                    groups.join(b as u32, other as u32);
                }
            }
        }
    }

    /// Joins the points of a stored block with each other, and with their copies in other blocks.
    fn join_points(&self, b: usize, slot: usize, groups: &mut DisjointSets) {
        let mut join = |a: usize, b: usize| groups.join(a as u32, b as u32);
        let at = self.domain.block(b);
        let first = self.first_node(slot);
        let is_inside = |i: usize| self.stored_label(slot, i) == INTERIOR;
        for i in 0..POINTS {
            let d = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)];
            for (axis, step) in [1, SIDE, SIDE * SIDE].into_iter().enumerate() {
                if d[axis] + 1 < SIDE && is_inside(i) == is_inside(i + step) {
                    join(first + i, first + i + step);
                }
            }
            if d.iter().all(|&c| c != 0 && c + 1 != SIDE) {
                continue;
            }
            // The block that a point on the high sides belongs to has its own copy of it.
            join(first + i, self.node(point_of(&self.domain, b, i)));
            // Blocks of one label before this one hold the point on their high sides.
            for shift in 1..8 {
                let to = [0, 1, 2].map(|k| at[k] - (shift >> k & 1));
                let touches = (0..3).all(|k| shift >> k & 1 == 0 || d[k] == 0 && to[k] >= 0);
                if touches {
                    let other = block_index(self.domain.blocks, to);
                    if self.slot(other).is_none() {
                        join(first + i, other);
                    }
                }
            }
        }
    }

    /// The number of lattice points of each group, by its root. Each point counts in the block it belongs to.
    fn sizes(&self, groups: &[u32]) -> Vec<u64> {
        let mut sizes = vec![0u64; groups.len()];
        for b in 0..self.state.len() {
            let Some(slot) = self.slot(b) else {
                sizes[groups[b] as usize] += (BLOCK * BLOCK * BLOCK) as u64;
                continue;
            };
            for i in 0..POINTS {
                if self.place(point_of(&self.domain, b, i)) == (b, i) {
                    sizes[groups[self.first_node(slot) + i] as usize] += 1;
                }
            }
        }
        sizes
    }

    /// Lets the points of small groups change sides.
    /// Values are mirrored at the level, so that the cut of an edge to a neighbour is still found by them.
    fn flip(&mut self, groups: &[u32], is_small: impl Fn(usize) -> bool) {
        for b in 0..self.state.len() {
            let Some(slot) = self.slot(b) else {
                if is_small(groups[b] as usize) {
                    let x = self.domain.point(self.domain.block(b).map(|c| c * BLOCK));
                    let label = self.flipped(self.state[b] as u8, &x);
                    self.state[b] = UNIFORM | u32::from(label);
                }
                continue;
            };
            for i in 0..POINTS {
                if is_small(groups[self.first_node(slot) + i] as usize) {
                    let x = self.domain.point(point_of(&self.domain, b, i));
                    let label = self.flipped(self.stored_label(slot, i), &x);
                    let value = self.mirrored(self.block_values(slot)[i]);
                    let place = self.places[slot];
                    if let Some(regions) = self.regions.get_mut(place) {
                        regions[i] = label;
                    }
                    if let Some(values) = self.values.get_mut(place) {
                        values[i] = value;
                    }
                }
            }
        }
    }

    /// The label of a point on the other side.
    /// A bubble in the molecule becomes molecule; a speck becomes what its place belongs to, a material or the
    /// exterior.
    fn flipped(&self, r: Region, x: &Point3) -> Region {
        if r == INTERIOR {
            self.labels.at(f64::NEG_INFINITY, x)
        } else {
            INTERIOR
        }
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;

    pub fn more_nodes_than_numbers_are_refused() {
        assert!(check_nodes(1000, 1000, 1 << 30).is_ok());
        // 729 nodes per stored block: these would wrap around.
        let error = check_nodes(6_000_000, 5_900_000, u64::MAX).unwrap_err();
        assert!(matches!(error, Error::TooLarge { bytes, .. } if bytes > 1 << 36));
        assert!(check_nodes(1000, 1000, 1 << 20).is_err());
    }
}
