//! Values and region labels at the points of the mesh lattice, stored in blocks where they matter.
//!
//! A surface of area A in a lattice of spacing h crosses about A / h² cells, of which there are V / h³ in all:
//! the finer the lattice, the smaller their share. A block of 8 × 8 × 8 cells that has one label throughout is therefore one byte, and only
//! blocks where labels change keep their 9³ values. Which those are is found by reading each block once and comparing with
//! the level; a sparse grid says so of its empty bricks without being read.

use geom_core::compute::parallel;
use geom_core::mesh::{EXTERIOR, INTERIOR, Region};
use geom_core::{Aabb, LatticeValues, Vector3};

use super::domain::{Domain, Labels};
use super::source::Source;
use super::tree::{BLOCK, BLOCK_LOG, block_index, corner_of};
use crate::Error;
use crate::kernel::{self, BLOCK_CELLS, BLOCK_POINTS, BLOCK_SIDE};

pub(crate) mod prune;
mod read;

use read::{Found, Known, OpenBlock, Reader, Scratch, known_blocks};

/// Points per side of a stored block: its cells are closed, so blocks share their faces.
pub(crate) const SIDE: usize = BLOCK_SIDE;
/// Points per stored block.
pub(crate) const POINTS: usize = BLOCK_POINTS;
/// Blocks that a thread reads at a time: as many as stay in the cache of a core.
const AT_ONCE: usize = 64;
/// Marks a block whose points all have one label, which stands in the low byte.
const UNIFORM: u32 = 0xffff_ff00;

/// Labels of all points of the mesh lattice, and values in the blocks where labels change.
pub(crate) struct Samples<'a> {
    pub(crate) domain: Domain,
    pub(crate) labels: Labels,
    /// The box of the given values.
    pub(crate) bounds: Aabb,
    /// Per block: its number among the stored ones, or [`UNIFORM`] and its label.
    state: Vec<u32>,
    /// The stored blocks in order.
    stored: Vec<u32>,
    /// Where each of them is in each of the following.
    places: Vec<Place>,
    /// Of closed blocks: 9³ values, x fastest; points that blocks share are in each of them.
    values: Pieces<f32>,
    /// Labels of the same points; nothing if labels are plain.
    regions: Pieces<Region>,
    /// A value of at least this is inside.
    threshold: f32,
    /// Signs of the corners of each finest cell of each stored block; nothing unless labels are plain.
    masks: Pieces<u8>,
    /// Lowest and highest value seen.
    pub(crate) range: (f32, f32),
    /// The value at any lattice point from where values come, for the few that are asked for off the stored blocks.
    read: Box<dyn Fn([i32; 3]) -> f32 + Sync + 'a>,
}

/// So many items per stored block, in the lists in which they were made: joining them would cost as much
/// as making them.
struct Pieces<T> {
    lists: Vec<Vec<T>>,
    per_block: usize,
}

/// A list and the number of a block in it.
#[derive(Clone, Copy)]
struct Place {
    list: u32,
    number: u32,
}

impl<T> Pieces<T> {
    fn none(per_block: usize) -> Self {
        Self {
            lists: Vec::new(),
            per_block,
        }
    }

    /// The items of a block; `None` if there are none of any.
    /// For lists that are not always made: signs, and labels.
    #[inline]
    fn get(&self, place: Place) -> Option<&[T]> {
        let list = self.lists.get(place.list as usize)?;
        list.get(place.number as usize * self.per_block..)?
            .get(..self.per_block)
    }

    fn get_mut(&mut self, place: Place) -> Option<&mut [T]> {
        let list = self.lists.get_mut(place.list as usize)?;
        list.get_mut(place.number as usize * self.per_block..)?
            .get_mut(..self.per_block)
    }
}

impl<T> std::ops::Index<Place> for Pieces<T> {
    type Output = [T];

    fn index(&self, place: Place) -> &[T] {
        &self.lists[place.list as usize][place.number as usize * self.per_block..][..self.per_block]
    }
}

/// The lowest f32 that is not below `level`: comparing with it is comparing with `level`.
fn at_least(level: f64) -> f32 {
    let v = level as f32;
    if f64::from(v) < level { v.next_up() } else { v }
}

impl<'a> Samples<'a> {
    /// Reads all blocks that may hold a surface, and keeps the values of those that do, as long as they take no
    /// more than `max_memory` bytes.
    ///
    /// # Errors
    /// The first value that is not finite, and more blocks near the surface than memory, with an estimate of what all
    /// would take. Values that need not be read, in bricks of one constant, are not looked at.
    pub(crate) fn new<V: LatticeValues + ?Sized>(
        source: Source<'a, V>,
        domain: Domain,
        labels: Labels,
        max_memory: u64,
    ) -> Result<Self, Error> {
        let known = known_blocks(&source, &domain, &labels);
        let mut out = Self {
            bounds: source.bounds(),
            threshold: at_least(labels.level),
            state: Vec::with_capacity(known.len()),
            stored: Vec::new(),
            places: Vec::new(),
            values: Pieces::none(POINTS),
            regions: Pieces::none(POINTS),
            masks: Pieces::none(BLOCK_CELLS),
            range: (f32::INFINITY, f32::NEG_INFINITY),
            domain,
            labels,
            read: Box::new(move |p| source.at(&domain, p)),
        };
        // Most blocks are known to lie on one side; the rest must be read.
        let mut open = Vec::new();
        for (number, known) in known.into_iter().enumerate() {
            match known {
                Known::Uniform(label, v) => {
                    out.widen((v, v));
                    out.state.push(UNIFORM | u32::from(label));
                }
                Known::Open(around) => {
                    out.state.push(u32::MAX);
                    open.push(OpenBlock { number, around });
                }
            }
        }
        let labels = out.labels.clone();
        let reader = Reader {
            source: &source,
            domain: &domain,
            labels: &labels,
        };
        // As many at once as would fit if all were kept: what is kept is known only when they have been read.
        let mut rest = open.as_slice();
        while !rest.is_empty() {
            let left = max_memory.saturating_sub(out.stored_bytes()) / out.bytes_per_block();
            let fits = usize::try_from(left).unwrap_or(usize::MAX).max(AT_ONCE);
            let (now, later) = rest.split_at(fits.min(rest.len()));
            let chunks: Vec<&[OpenBlock]> = now.chunks(AT_ONCE).collect();
            let found: Vec<Result<Found, Error>> =
                parallel::map_each_init(&chunks, Scratch::default, |scratch, open| {
                    reader.read(open, scratch)
                });
            let mut now = now.iter();
            for found in found {
                out.keep(found?, &mut now);
            }
            if out.stored_bytes() > max_memory {
                return Err(out.too_many_blocks(later.len(), open.len(), max_memory));
            }
            rest = later;
        }
        Ok(out)
    }

    /// What a stored block takes: values, signs or labels, and where they are.
    fn bytes_per_block(&self) -> u64 {
        let labels = if self.labels.plain() {
            BLOCK_CELLS
        } else {
            POINTS
        };
        (POINTS * size_of::<f32>() + labels + size_of::<Place>() + size_of::<u32>()) as u64
    }

    /// What all stored blocks take.
    pub(crate) fn stored_bytes(&self) -> u64 {
        self.stored.len() as u64 * self.bytes_per_block()
    }

    /// With `unread` of `open` blocks to come, of which as many will be kept as of those before.
    fn too_many_blocks(&self, unread: usize, open: usize, limit: u64) -> Error {
        let read = (open - unread).max(1) as u128;
        Error::TooLarge {
            what: "values near the surface",
            bytes: u128::from(self.stored_bytes()) * open as u128 / read,
            limit: limit.into(),
            cure: "take a larger spacing, or allow more memory",
        }
    }

    /// Lets the range of what has been seen include another one.
    fn widen(&mut self, range: (f32, f32)) {
        self.range = (self.range.0.min(range.0), self.range.1.max(range.1));
    }

    /// Takes what has been read of the next open blocks.
    fn keep<'b>(&mut self, found: Found, open: &mut impl Iterator<Item = &'b OpenBlock>) {
        self.widen(found.range);
        let list = self.values.lists.len() as u32;
        let mut number = 0;
        for (label, block) in found.labels.into_iter().zip(open) {
            self.state[block.number] = match label {
                Some(label) => UNIFORM | u32::from(label),
                None => {
                    self.places.push(Place { list, number });
                    number += 1;
                    self.stored.push(block.number as u32);
                    self.stored.len() as u32 - 1
                }
            };
        }
        if number > 0 {
            self.values.lists.push(found.values);
            self.regions.lists.push(found.regions);
        }
    }

    /// The signs of the finest cells of block `b`, if it is stored and labels are plain.
    pub(crate) fn masks_of(&self, b: usize) -> Option<&[u8]> {
        self.masks.get(self.places[self.slot(b)?])
    }

    /// The stored blocks in order.
    pub(crate) fn stored(&self) -> &[u32] {
        &self.stored
    }

    /// The signs of the finest cells of a stored block, if labels are plain.
    pub(crate) fn masks_at(&self, slot: usize) -> &[u8] {
        &self.masks[self.places[slot]]
    }

    /// Finds the signs of all stored cells; after this values stay as they are.
    /// With labels of materials, which are kept themselves, there is nothing to find.
    pub(crate) fn find_crossings(&mut self) {
        if self.labels.plain() {
            let level = at_least(self.labels.level);
            self.masks.lists = parallel::map_each(&self.values.lists, |values| {
                let mut masks = vec![0; values.len() / BLOCK_POINTS * BLOCK_CELLS];
                kernel::crossings(values, level, &mut masks);
                masks
            });
        }
    }

    /// Does a point lie in the molecule or beyond?
    /// If so, there is a surface.
    pub(crate) fn holds_both_sides(&self) -> bool {
        let any = |inside: bool| {
            let is = |r: Region| (r == INTERIOR) == inside;
            self.state.iter().any(|&s| s >= UNIFORM && is(s as u8))
                || (0..self.stored.len())
                    .any(|slot| (0..POINTS).any(|i| is(self.stored_label(slot, i))))
        };
        any(true) && any(false)
    }

    /// Does any point have a label?
    pub(crate) fn holds(&self, label: Region) -> bool {
        let uniform = |s: &u32| *s >= UNIFORM && *s as u8 == label;
        let stored = |slot: usize| (0..POINTS).any(|i| self.stored_label(slot, i) == label);
        self.state.iter().any(uniform) || (0..self.stored.len()).any(stored)
    }

    /// The value at any lattice point, on the side of the level that its label says.
    pub(crate) fn value(&self, p: [i32; 3]) -> f64 {
        let (b, i) = self.place(p);
        if let Some(slot) = self.slot(b) {
            return f64::from(self.block_values(slot)[i]);
        }
        let v = (self.read)(p);
        let inside = self.state[b] as u8 == INTERIOR;
        f64::from(if (f64::from(v) >= self.labels.level) == inside {
            v
        } else {
            self.mirrored(v)
        })
    }

    /// The value as far on the other side of the level.
    /// For points that have changed sides: a root on an edge to a neighbour stays where a mirror would have it.
    /// Rounding never leaves it on the side that it came from.
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

    /// The signs of the corners of a finest cell, if labels are plain and its block is stored.
    #[inline]
    pub(crate) fn mask(&self, cell: [i32; 3]) -> Option<u8> {
        let slot = self.slot_of(cell)?;
        let i = (cell[0] & 7) | (cell[1] & 7) << 3 | (cell[2] & 7) << 6;
        Some(self.masks.get(self.places[slot])?[i as usize])
    }

    /// Place of a block among the stored ones.
    pub(crate) fn slot(&self, b: usize) -> Option<usize> {
        (self.state[b] < UNIFORM).then(|| self.state[b] as usize)
    }

    /// Place of the block of a finest cell among the stored ones.
    #[inline]
    pub(crate) fn slot_of(&self, cell: [i32; 3]) -> Option<usize> {
        self.slot(block_index(
            self.domain.blocks,
            cell.map(|c| c >> BLOCK_LOG),
        ))
    }

    /// Labels of the closed block `b`, if stored.
    /// As a function of the place in it, x fastest.
    pub(crate) fn regions_of(&self, b: usize) -> Option<impl Fn(usize) -> Region + '_> {
        let slot = self.slot(b)?;
        Some(move |i| self.stored_label(slot, i))
    }

    /// Values of the closed block `b`, if stored.
    pub(crate) fn values_of(&self, b: usize) -> Option<&[f32]> {
        self.slot(b).map(|slot| self.block_values(slot))
    }

    /// The block that holds a lattice point, and the point's place in it.
    /// A point on a face between two blocks is taken from the one above, at the end of the domain from the last.
    #[inline]
    fn place(&self, p: [i32; 3]) -> (usize, usize) {
        let b = [0, 1, 2].map(|k| (p[k] >> BLOCK_LOG).min(self.domain.blocks[k] - 1));
        let d = [0, 1, 2].map(|k| (p[k] - b[k] * BLOCK) as usize);
        (
            block_index(self.domain.blocks, b),
            (d[2] * SIDE + d[1]) * SIDE + d[0],
        )
    }

    /// The labels of the corners of a cell of edge `s` at `o`.
    pub(crate) fn corner_labels(&self, o: [i32; 3], s: i32) -> [Region; 8] {
        std::array::from_fn(|i| {
            let p = corner_of(i);
            self.label([0, 1, 2].map(|k| o[k] + s * p[k]))
        })
    }

    /// The label of a lattice point.
    #[inline]
    pub(crate) fn label(&self, p: [i32; 3]) -> Region {
        let (b, i) = self.place(p);
        let state = self.state[b];
        if state >= UNIFORM {
            state as u8
        } else {
            self.stored_label(state as usize, i)
        }
    }

    /// The values of a stored block.
    #[inline]
    fn block_values(&self, slot: usize) -> &[f32] {
        &self.values[self.places[slot]]
    }

    /// The label of a point of a stored block.
    #[inline]
    fn stored_label(&self, slot: usize, i: usize) -> Region {
        match self.regions.get(self.places[slot]) {
            Some(regions) => regions[i],
            None if self.block_values(slot)[i] >= self.threshold => INTERIOR,
            None => EXTERIOR,
        }
    }

    /// The values at the corners of a finest cell of a stored block, minus the level; corner
    /// `x + 2y + 4z`.
    #[inline]
    pub(crate) fn corners_in(&self, slot: usize, cell: [i32; 3]) -> [f32; 8] {
        let values = self.block_values(slot);
        let d = cell.map(|c| (c & 7) as usize);
        let i = (d[2] * SIDE + d[1]) * SIDE + d[0];
        std::array::from_fn(|c| {
            let step = (c & 1) + (c >> 1 & 1) * SIDE + (c >> 2) * SIDE * SIDE;
            (f64::from(values[i + step]) - self.labels.level) as f32
        })
    }

    /// The same for any finest cell.
    pub(crate) fn corners_over_level(&self, cell: [i32; 3]) -> [f32; 8] {
        match self.slot_of(cell) {
            Some(slot) => self.corners_in(slot, cell),
            None => std::array::from_fn(|c| {
                let p = [0, 1, 2].map(|k| cell[k] + (c >> k & 1) as i32);
                (self.value(p) - self.labels.level) as f32
            }),
        }
    }

    /// Trilinear value and gradient (per finest cell) at `x`, seen from the lowest corner of cell `cell`, in its closed
    /// block. `None` where the block is not stored. A point beyond the block has the value of the nearest one in it.
    pub(crate) fn trilinear(&self, cell: [i32; 3], x: &Vector3) -> Option<(f64, Vector3)> {
        let b = cell.map(|c| c >> BLOCK_LOG);
        let values = self.values_of(block_index(self.domain.blocks, b))?;
        let (mut base, mut t) = ([0usize; 3], [0.0; 3]);
        for k in 0..3 {
            let c = (x[k] + f64::from(cell[k] - b[k] * BLOCK)).clamp(0.0, f64::from(BLOCK));
            base[k] = (c as usize).min(SIDE - 2);
            t[k] = c - base[k] as f64;
        }
        let corner = (base[2] * SIDE + base[1]) * SIDE + base[0];
        let v = |i: usize| f64::from(values[corner + i]);
        const Y: usize = SIDE;
        const Z: usize = SIDE * SIDE;
        let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let x00 = lerp(v(0), v(1), t[0]);
        let x10 = lerp(v(Y), v(Y + 1), t[0]);
        let x01 = lerp(v(Z), v(Z + 1), t[0]);
        let x11 = lerp(v(Z + Y), v(Z + Y + 1), t[0]);
        let (y0, y1) = (lerp(x00, x10, t[1]), lerp(x01, x11, t[1]));
        let d00 = v(1) - v(0);
        let d10 = v(Y + 1) - v(Y);
        let d01 = v(Z + 1) - v(Z);
        let d11 = v(Z + Y + 1) - v(Z + Y);
        let gradient = Vector3::new(
            lerp(lerp(d00, d10, t[1]), lerp(d01, d11, t[1]), t[2]),
            lerp(x10 - x00, x11 - x01, t[2]),
            y1 - y0,
        );
        Some((lerp(y0, y1, t[2]), gradient))
    }
}

/// The lattice point at a place of a closed block; beyond the domain the nearest one.
fn point_of(domain: &Domain, b: usize, i: usize) -> [i32; 3] {
    let low = domain.block(b).map(|c| c * BLOCK);
    let d = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)];
    [0, 1, 2].map(|k| (low[k] + d[k] as i32).min(domain.cells[k]))
}
