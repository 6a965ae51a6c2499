//! Values and region labels at the points of the mesh lattice, stored in blocks where they matter.

use geom_core::mesh::{EXTERIOR, INTERIOR, Region};
use geom_core::{Aabb, LatticeValues, Point3, Vector3};
use rayon::prelude::*;

use super::domain::{Domain, Labels, local};
use super::source::Source;
use super::tree::{BLOCK, BLOCK_LOG, block_index};
use crate::backend::{BLOCK_CELLS, BLOCK_POINTS, BLOCK_SIDE, ContourBackend};
use crate::{Error, kernel};

mod prune;

/// Points per side of a stored block: its cells are closed, so blocks share their faces.
pub(crate) const SIDE: usize = BLOCK_SIDE;
/// Points per stored block.
pub(crate) const POINTS: usize = BLOCK_POINTS;
/// Marks a block whose points all have one label, which stands in the low byte.
const UNIFORM: u32 = 0xffff_ff00;

/// Labels of all points of the mesh lattice, and values in the blocks where labels change.
pub(crate) struct Samples<'a> {
    pub(crate) domain: Domain,
    pub(crate) labels: Labels,
    /// The box of the given values.
    pub(crate) bounds: Aabb,
    state: Vec<u32>,
    /// The stored blocks in order.
    stored: Vec<u32>,
    /// Where each of them is in each of the following.
    places: Vec<Place>,
    values: Pieces<f32>,
    /// Labels of the same points; nothing if labels are plain.
    regions: Pieces<Region>,
    /// A value of at least this is inside.
    threshold: f32,
    /// Signs of the corners of each finest cell of each stored block; nothing unless labels are plain.
    masks: Pieces<u8>,
    /// Lowest and highest value seen.
    pub(crate) range: (f32, f32),
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

/// What reading some blocks has told.
struct Judged {
    /// The label of a block, if all of it has one.
    labels: Vec<Option<Region>>,
    /// Values of the others.
    values: Vec<f32>,
    /// Their labels, unless labels are plain.
    regions: Vec<Region>,
    range: (f32, f32),
}

/// Reads blocks.
struct Judge<'a, 'b, V: ?Sized, B: ?Sized> {
    source: &'a Source<'b, V>,
    domain: &'a Domain,
    labels: &'a Labels,
    backend: &'a B,
}

impl<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized> Judge<'_, '_, V, B> {
    /// Blocks come with the label around them, if they have one off the molecule.
    fn judge(
        &self,
        open: &[(usize, Option<Region>)],
        buffer: &mut Vec<f32>,
    ) -> Result<Judged, Error> {
        let (domain, labels) = (self.domain, self.labels);
        buffer.resize(POINTS * open.len(), 0.0);
        let row = domain.blocks[0] as usize;
        let low = |b: usize| domain.block(b).map(|c| c * BLOCK);
        let follows = |p: usize, q: usize| {
            let within = |b: usize| self.source.is_within(domain, low(b)[0]);
            q == p + 1 && !q.is_multiple_of(row) && within(p) && within(q)
        };
        let mut rest = buffer.as_mut_slice();
        let mut runs = Vec::new();
        let mut first = 0;
        for run in open.chunk_by(|p, q| follows(p.0, q.0)) {
            let (out, others) = std::mem::take(&mut rest).split_at_mut(POINTS * run.len());
            rest = others;
            runs.push((first, run[0].0, out));
            first += run.len();
        }
        let bad = runs
            .into_par_iter()
            .with_min_len(16)
            .filter_map(|(first, b, out)| {
                self.source.gather(domain, low(b), out);
                let bad = out
                    .chunks_exact(POINTS)
                    .position(|block| !kernel::all_finite(block));
                bad.map(|i| first + i)
            })
            .min();
        if let Some(bad) = bad {
            let block = &buffer[POINTS * bad..][..POINTS];
            let i = block
                .iter()
                .position(|v| !v.is_finite())
                .expect("one is bad");
            let p = point_of(domain, open[bad].0, i);
            return Err(Error::NotFinite {
                index: self.source.index(domain, p),
                value: block[i],
            });
        }
        let ranges = self.backend.min_max(buffer)?;
        let both = |[low, high]: &&[f32; 2]| {
            f64::from(*low) < labels.level && f64::from(*high) >= labels.level
        };
        let mut out = Judged {
            labels: Vec::with_capacity(open.len()),
            values: Vec::with_capacity(POINTS * ranges.iter().filter(both).count()),
            regions: Vec::new(),
            range: (f32::INFINITY, f32::NEG_INFINITY),
        };
        for ((&(b, around), &[low, high]), values) in
            open.iter().zip(&ranges).zip(buffer.chunks_exact(POINTS))
        {
            out.range = (out.range.0.min(low), out.range.1.max(high));
            let above = f64::from(high) >= labels.level;
            let below = f64::from(low) < labels.level;
            let mut label = match (below, above, around) {
                (false, ..) => Some(INTERIOR),
                (true, false, label) => label,
                _ => None,
            };
            if label.is_none() && !labels.plain() {
                let regions = regions_of(domain, labels, b, values, around);
                if regions.iter().all(|&r| r == regions[0]) {
                    label = Some(regions[0]);
                } else {
                    out.regions.extend(regions);
                }
            }
            if label.is_none() {
                out.values.extend_from_slice(values);
            }
            out.labels.push(label);
        }
        Ok(out)
    }
}

/// What is known of a block.
enum Known {
    Uniform(Region, f32),
    /// The label around, if the block has one off the molecule.
    Open(Option<Region>),
}

impl<'a> Samples<'a> {
    pub(crate) fn new<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
        source: Source<'a, V>,
        domain: Domain,
        labels: Labels,
        backend: &B,
    ) -> Result<Self, Error> {
        // A little more, so that a corner that just touches a boundary counts.
        let radius = (0.5 * f64::from(BLOCK) * 3f64.sqrt() + 1e-3) * domain.spacing;
        let known: Vec<Known> = (0..domain.block_len())
            .into_par_iter()
            .with_min_len(64)
            .map(|b| {
                let low = domain.block(b).map(|c| c * BLOCK);
                let middle = domain.world(&(local(low) + Vector3::repeat(0.5 * f64::from(BLOCK))));
                let around = if labels.plain() {
                    Some(EXTERIOR)
                } else {
                    labels.around(&middle, radius)
                };
                match (around, source.constant(&domain, low, labels.level)) {
                    (_, Some(v)) if f64::from(v) >= labels.level => Known::Uniform(INTERIOR, v),
                    (Some(label), Some(v)) => Known::Uniform(label, v),
                    _ => Known::Open(around),
                }
            })
            .collect();
        let mut range = (f32::INFINITY, f32::NEG_INFINITY);
        let mut state = Vec::with_capacity(known.len());
        let mut open = Vec::new();
        for (b, known) in known.into_iter().enumerate() {
            match known {
                Known::Uniform(label, v) => {
                    range = (range.0.min(v), range.1.max(v));
                    state.push(UNIFORM | u32::from(label));
                }
                Known::Open(around) => {
                    state.push(u32::MAX);
                    open.push((b, around));
                }
            }
        }
        let judge = Judge {
            source: &source,
            domain: &domain,
            labels: &labels,
            backend,
        };
        let judged: Vec<Result<Judged, Error>> = open
            .par_chunks(backend.blocks_per_call())
            .map_init(Vec::new, |buffer, open| judge.judge(open, buffer))
            .collect();
        let (mut stored, mut places) = (Vec::new(), Vec::new());
        let (mut values, mut regions) = (Pieces::none(POINTS), Pieces::none(POINTS));
        let mut open = open.into_iter();
        for judged in judged {
            let judged = judged?;
            range = (range.0.min(judged.range.0), range.1.max(judged.range.1));
            let mut number = 0;
            for (label, (b, _)) in judged.labels.into_iter().zip(&mut open) {
                state[b] = match label {
                    Some(label) => UNIFORM | u32::from(label),
                    None => {
                        let list = values.lists.len() as u32;
                        places.push(Place { list, number });
                        number += 1;
                        stored.push(b as u32);
                        stored.len() as u32 - 1
                    }
                };
            }
            if number > 0 {
                values.lists.push(judged.values);
                regions.lists.push(judged.regions);
            }
        }
        let threshold = at_least(labels.level);
        Ok(Self {
            domain,
            labels,
            bounds: source.bounds(),
            state,
            stored,
            places,
            values,
            regions,
            masks: Pieces::none(BLOCK_CELLS),
            threshold,
            range,
            read: Box::new(move |p| source.at(&domain, p)),
        })
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
    pub(crate) fn find_crossings<B: ContourBackend + ?Sized>(
        &mut self,
        backend: &B,
    ) -> Result<(), Error> {
        if self.labels.plain() {
            let level = at_least(self.labels.level);
            let lists = self.values.lists.par_iter();
            let masks = lists.map(|values| backend.crossings(values, level));
            self.masks.lists = masks.collect::<Result<_, Error>>()?;
        }
        Ok(())
    }

    /// Does a point lie in the molecule or beyond?
    pub(crate) fn holds_both_sides(&self) -> bool {
        let any = |inside: bool| {
            let is = |r: Region| (r == INTERIOR) == inside;
            self.state.iter().any(|&s| s >= UNIFORM && is(s as u8))
                || (0..self.stored.len())
                    .any(|slot| (0..POINTS).any(|i| is(self.stored_label(slot, i))))
        };
        any(true) && any(false)
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
    pub(crate) fn regions_of(&self, b: usize) -> Option<impl Fn(usize) -> Region + '_> {
        let slot = self.slot(b)?;
        Some(move |i| self.stored_label(slot, i))
    }

    /// Values of the closed block `b`, if stored.
    pub(crate) fn values_of(&self, b: usize) -> Option<&[f32]> {
        self.slot(b).map(|slot| self.block_values(slot))
    }

    /// The block that holds a lattice point, and the point's place in it.
    #[inline]
    fn place(&self, p: [i32; 3]) -> (usize, usize) {
        let b = [0, 1, 2].map(|k| (p[k] >> BLOCK_LOG).min(self.domain.blocks[k] - 1));
        let d = [0, 1, 2].map(|k| (p[k] - b[k] * BLOCK) as usize);
        (
            block_index(self.domain.blocks, b),
            (d[2] * SIDE + d[1]) * SIDE + d[0],
        )
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

    /// Trilinear value and gradient (per finest cell) at `x` in the closed block of cell `cell`.
    pub(crate) fn trilinear(&self, cell: [i32; 3], x: &Point3) -> Option<(f64, Vector3)> {
        let b = cell.map(|c| c >> BLOCK_LOG);
        let values = self.values_of(block_index(self.domain.blocks, b))?;
        let (mut base, mut t) = ([0usize; 3], [0.0; 3]);
        for k in 0..3 {
            let c = (x[k] - f64::from(b[k] * BLOCK)).clamp(0.0, f64::from(BLOCK));
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

/// The labels of the points of a block.
fn regions_of(
    domain: &Domain,
    labels: &Labels,
    b: usize,
    values: &[f32],
    around: Option<Region>,
) -> Vec<Region> {
    let threshold = at_least(labels.level);
    values
        .iter()
        .enumerate()
        .map(|(i, &v)| match around {
            Some(label) => {
                if v >= threshold {
                    INTERIOR
                } else {
                    label
                }
            }
            None => labels.at(f64::from(v), &domain.point(point_of(domain, b, i))),
        })
        .collect()
}
