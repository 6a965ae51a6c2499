//! Small groups of points change sides.

use geom_core::Point3;
use geom_core::mesh::{INTERIOR, Region};
use geom_core::sets::DisjointSets;

use super::{BLOCK, POINTS, SIDE, Samples, UNIFORM, at_least, block_index, point_of};

impl Samples<'_> {
    /// Gives groups of fewer than `least` lattice points on one side of the level to the other side;
    /// groups are connected by lattice edges. Returns how many groups and points were changed.
    pub(crate) fn prune(&mut self, least: u32) -> (usize, u64) {
        let (mut groups, mut points) = (0, 0);
        loop {
            let (g, p) = self.prune_once(least);
            if g == 0 {
                return (groups, points);
            }
            (groups, points) = (groups + g, points + p);
        }
    }

    fn prune_once(&mut self, least: u32) -> (usize, u64) {
        // One node per block without values, then one per point of each stored block.
        let blocks = self.state.len();
        let mut groups = DisjointSets::new(blocks + POINTS * self.stored.len());
        let mut join = |a: usize, b: usize| groups.join(a as u32, b as u32);
        let node = |p: [i32; 3]| {
            let (b, i) = self.place(p);
            match self.slot(b) {
                Some(slot) => blocks + slot * POINTS + i,
                None => b,
            }
        };
        let inside = |r: Region| r == INTERIOR;
        for b in 0..blocks {
            let at = self.domain.block(b);
            let Some(slot) = self.slot(b) else {
                for axis in 0..3 {
                    let mut next = at;
                    next[axis] += 1;
                    if next[axis] < self.domain.blocks[axis] {
                        let other = block_index(self.domain.blocks, next);
                        let same = |x: u32, y: u32| inside(x as u8) == inside(y as u8);
                        if self.slot(other).is_none() && same(self.state[b], self.state[other]) {
                            join(b, other);
                        }
                    }
                }
                continue;
            };
            let first = blocks + slot * POINTS;
            let within = |i: usize| inside(self.stored_label(slot, i));
            for i in 0..POINTS {
                let d = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)];
                for (axis, step) in [1, SIDE, SIDE * SIDE].into_iter().enumerate() {
                    if d[axis] + 1 < SIDE && within(i) == within(i + step) {
                        join(first + i, first + i + step);
                    }
                }
                if d.iter().all(|&c| c != 0 && c + 1 != SIDE) {
                    continue;
                }
                // The copies of this point in other blocks.
                let p = point_of(&self.domain, b, i);
                join(first + i, node(p));
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
        let groups = groups.into_roots();
        let mut sizes = vec![0u64; groups.len()];
        for b in 0..blocks {
            match self.slot(b) {
                None => sizes[groups[b] as usize] += (BLOCK * BLOCK * BLOCK) as u64,
                Some(slot) => {
                    for i in 0..POINTS {
                        if self.place(point_of(&self.domain, b, i)) == (b, i) {
                            sizes[groups[blocks + slot * POINTS + i] as usize] += 1;
                        }
                    }
                }
            }
        }
        let small: Vec<usize> = (0..sizes.len())
            .filter(|&i| sizes[i] > 0 && sizes[i] < u64::from(least))
            .collect();
        // All has one sign: nothing to give to.
        let total = (0..sizes.len()).filter(|&i| sizes[i] > 0).count();
        if small.is_empty() || small.len() == total {
            return (0, 0);
        }
        let is_small = |root: usize| small.binary_search(&root).is_ok();
        for b in 0..blocks {
            let low = self.domain.block(b).map(|c| c * BLOCK);
            match self.slot(b) {
                None => {
                    if is_small(groups[b] as usize) {
                        let r = self.state[b] as u8;
                        let x = self.domain.point(low);
                        self.state[b] = UNIFORM | u32::from(self.flipped(r, &x));
                    }
                }
                Some(slot) => {
                    for i in 0..POINTS {
                        if is_small(groups[blocks + slot * POINTS + i] as usize) {
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
        }
        (small.len(), small.iter().map(|&i| sizes[i]).sum())
    }

    fn flipped(&self, r: Region, x: &Point3) -> Region {
        if r == INTERIOR {
            self.labels.at(f64::NEG_INFINITY, x)
        } else {
            INTERIOR
        }
    }

    /// The value as far on the other side of the level.
    fn mirrored(&self, v: f32) -> f32 {
        let level = self.labels.level;
        let other = (2.0 * level - f64::from(v)) as f32;
        let threshold = at_least(level);
        if v >= threshold {
            other.min(threshold.next_down())
        } else {
            other.max(threshold)
        }
    }
}
