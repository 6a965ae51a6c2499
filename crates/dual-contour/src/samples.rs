//! Values and region labels at the points of the mesh lattice, stored in blocks where they matter.

use geom_core::mesh::{EXTERIOR, INTERIOR, OUTSIDE, Region};
use geom_core::sets::DisjointSets;
use geom_core::{Aabb, ImplicitField, Lattice, LatticeValues, Point3, Vector3};
use rayon::prelude::*;

use crate::backend::{BLOCK_CELLS, BLOCK_POINTS, BLOCK_SIDE, ContourBackend};
use crate::lanes;
use crate::octree::{BLOCK, BLOCK_LOG, block_index};
use crate::{Error, Material, Shape};

/// Points per side of a stored block: its cells are closed, so blocks share their faces.
pub(crate) const SIDE: usize = BLOCK_SIDE;
/// Points per stored block.
pub(crate) const POINTS: usize = BLOCK_POINTS;
/// Marks a block whose points all have one label, which stands in the low byte.
const UNIFORM: u32 = 0xffff_ff00;

/// The lattice of the finest cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Domain {
    pub(crate) origin: Point3,
    pub(crate) spacing: f64,
    pub(crate) cells: [i32; 3],
    pub(crate) blocks: [i32; 3],
    /// The point where the lattice of the values begins.
    pub(crate) anchor: [i32; 3],
}

impl Domain {
    pub(crate) fn new(origin: Point3, spacing: f64, cells: [i32; 3], anchor: [i32; 3]) -> Self {
        let blocks = cells.map(|n| (n + BLOCK - 1) / BLOCK);
        Self {
            origin,
            spacing,
            cells,
            blocks,
            anchor,
        }
    }
    /// From units of the finest cells to Å.
    pub(crate) fn world(&self, local: &Point3) -> Point3 {
        self.origin + local.coords * self.spacing
    }
    pub(crate) fn point(&self, p: [i32; 3]) -> Point3 {
        self.world(&local(p))
    }
    pub(crate) fn block_len(&self) -> usize {
        self.blocks.iter().map(|&b| b as usize).product()
    }
    pub(crate) fn block(&self, b: usize) -> [i32; 3] {
        let [nx, ny, _] = self.blocks.map(|n| n as usize);
        [b % nx, b / nx % ny, b / (nx * ny)].map(|c| c as i32)
    }
}

/// A lattice point in units of the finest cells.
pub(crate) fn local(p: [i32; 3]) -> Point3 {
    Point3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))
}

/// Which material a point belongs to: the molecule, then the listed ones, then the exterior; beyond
/// the outer sphere nothing.
#[derive(Clone, Debug)]
pub(crate) struct Labels {
    pub(crate) level: f64,
    pub(crate) materials: Vec<Material>,
    pub(crate) outer: Option<Shape>,
}

impl Labels {
    /// With nothing but molecule and exterior, labels follow from values alone.
    pub(crate) fn plain(&self) -> bool {
        self.materials.is_empty() && self.outer.is_none()
    }

    pub(crate) fn at(&self, value: f64, x: &Point3) -> Region {
        if value >= self.level {
            return INTERIOR;
        }
        if self.outer.is_some_and(|s| s.depth(x) < 0.0) {
            return OUTSIDE;
        }
        self.materials
            .iter()
            .find(|m| m.shape.depth(x) >= 0.0)
            .map_or(EXTERIOR, |m| m.region)
    }

    /// The label of all points within `reach` of `x` that are not in the molecule, if they have one.
    fn around(&self, x: &Point3, reach: f64) -> Option<Region> {
        let mut shapes = self
            .outer
            .iter()
            .chain(self.materials.iter().map(|m| &m.shape));
        if shapes.any(|s| s.depth(x).abs() <= reach) {
            None
        } else {
            Some(self.at(f64::NEG_INFINITY, x))
        }
    }
}

/// Where the values of the mesh lattice come from.
#[derive(Clone, Copy)]
pub(crate) enum Source<'a, V: ?Sized> {
    /// The lattice of the values, shifted by whole cells; beyond it `outside`.
    Aligned {
        values: &'a V,
        shift: [i32; 3],
        outside: f32,
    },
    /// Another lattice: the field, or the values interpolated, within the box of the values.
    Resampled {
        values: &'a V,
        field: Option<&'a dyn ImplicitField>,
        outside: f32,
    },
}

impl<V: LatticeValues + ?Sized> Source<'_, V> {
    fn bounds(&self) -> Aabb {
        let (Self::Aligned { values, .. } | Self::Resampled { values, .. }) = self;
        values.lattice().bounds()
    }

    /// The point of the given lattice that a point of the mesh lattice stands for.
    fn index(&self, domain: &Domain, p: [i32; 3]) -> [usize; 3] {
        let (Self::Aligned { values, .. } | Self::Resampled { values, .. }) = self;
        let lattice = values.lattice();
        let local = lattice.local(&domain.point(p));
        [0, 1, 2].map(|k| (local[k].round().max(0.0) as usize).min(lattice.counts[k] - 1))
    }

    /// The value at a point of the mesh lattice.
    pub(crate) fn at(&self, domain: &Domain, p: [i32; 3]) -> f32 {
        match self {
            Self::Aligned {
                values,
                shift,
                outside,
            } => {
                let counts = values.lattice().counts;
                let q = [0, 1, 2].map(|k| p[k] - shift[k]);
                if (0..3).all(|k| q[k] >= 0 && (q[k] as usize) < counts[k]) {
                    values.at(q.map(|c| c as usize))
                } else {
                    *outside
                }
            }
            Self::Resampled {
                values,
                field,
                outside,
            } => {
                let x = domain.point(p);
                if !values.lattice().bounds().contains(&x) {
                    return *outside;
                }
                match field {
                    Some(field) => field.value(&x) as f32,
                    None => trilinear(*values, &x),
                }
            }
        }
    }

    /// Does the block at `low` lie within the lattice of the values, along x?
    fn is_within(&self, domain: &Domain, low: i32) -> bool {
        let Self::Aligned { values, shift, .. } = self else {
            return false;
        };
        let from = low - shift[0];
        from >= 0
            && ((from + BLOCK) as usize) < values.lattice().counts[0]
            && low + BLOCK <= domain.cells[0]
    }

    /// The values of closed blocks that follow each other along x, the first at `low`. Beyond the domain
    /// the nearest point stands in, so that nothing mixes there. Of more than one block each
    /// [is within](Self::is_within) the lattice of the values.
    fn gather(&self, domain: &Domain, low: [i32; 3], out: &mut [f32]) {
        let blocks = out.len() / POINTS;
        let mut along = vec![0.0; blocks * BLOCK as usize + 1];
        let within = self.is_within(domain, low[0]);
        for row in 0..SIDE * SIDE {
            let y = (low[1] + (row % SIDE) as i32).min(domain.cells[1]);
            let z = (low[2] + (row / SIDE) as i32).min(domain.cells[2]);
            match self {
                Self::Aligned { values, shift, .. }
                    if within && holds_row(values.lattice(), y - shift[1], z - shift[2]) =>
                {
                    let start = [low[0] - shift[0], y - shift[1], z - shift[2]];
                    values.read_row(start.map(|c| c as usize), &mut along);
                }
                _ => {
                    for (x, value) in (low[0]..).zip(&mut along) {
                        *value = self.at(domain, [x.min(domain.cells[0]), y, z]);
                    }
                }
            }
            let rows = out
                .chunks_exact_mut(POINTS)
                .map(|block| &mut block[row * SIDE..]);
            for (to, from) in rows.zip(along.windows(SIDE).step_by(BLOCK as usize)) {
                if let (Some(to), Some(from)) = (to.first_chunk_mut::<SIDE>(), from.first_chunk()) {
                    *to = *from;
                }
            }
        }
    }

    /// The value of the closed block at `low`, if all of its points are known to have it, or at least
    /// its side of the level.
    fn constant(&self, domain: &Domain, low: [i32; 3], level: f64) -> Option<f32> {
        match self {
            Self::Aligned {
                values,
                shift,
                outside,
            } => {
                let counts = values.lattice().counts.map(|n| n as i32);
                let from = [0, 1, 2].map(|k| low[k] - shift[k]);
                let to = [0, 1, 2].map(|k| (low[k] + BLOCK).min(domain.cells[k]) - shift[k]);
                if (0..3).any(|k| to[k] < 0 || from[k] >= counts[k]) {
                    return Some(*outside);
                }
                let within = (0..3).all(|k| from[k] >= 0 && to[k] < counts[k]);
                within.then(|| {
                    let [from, to] = [from, to].map(|p| p.map(|c| c as usize));
                    values.constant(from, to)
                })?
            }
            Self::Resampled {
                values, outside, ..
            } => {
                let lattice = values.lattice();
                let from = lattice.local(&domain.point(low));
                let to = lattice.local(&domain.point(low.map(|c| c + BLOCK)));
                let last = lattice.counts.map(|n| n as f64 - 1.0);
                if (0..3).any(|k| to[k] < 0.0 || from[k] > last[k]) {
                    return Some(*outside);
                }
                let crosses = (0..3).any(|k| from[k] < 0.0 || to[k] > last[k]);
                let low = [0, 1, 2].map(|k| from[k].floor().clamp(0.0, last[k]) as usize);
                let high = [0, 1, 2].map(|k| to[k].ceil().clamp(0.0, last[k]) as usize);
                let first = values.at(low);
                let side = |v: f32| f64::from(v) >= level;
                if crosses && side(first) != side(*outside) {
                    return None;
                }
                if values.constant(low, high).is_some() {
                    return Some(first);
                }
                let mut row = vec![0.0; high[0] - low[0] + 1];
                for z in low[2]..=high[2] {
                    for y in low[1]..=high[1] {
                        values.read_row([low[0], y, z], &mut row);
                        if row.iter().any(|&v| side(v) != side(first)) {
                            return None;
                        }
                    }
                }
                Some(first)
            }
        }
    }
}

fn trilinear<V: LatticeValues + ?Sized>(values: &V, x: &Point3) -> f32 {
    let lattice = values.lattice();
    let l = lattice.local(x);
    let (mut base, mut t) = ([0usize; 3], [0.0; 3]);
    for k in 0..3 {
        let last = lattice.counts[k] - 1;
        let c = l[k].clamp(0.0, last as f64);
        base[k] = (c as usize).min(last.saturating_sub(1));
        t[k] = c - base[k] as f64;
    }
    let mut sum = 0.0;
    for corner in 0..8usize {
        let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
        let w: f64 = (0..3)
            .map(|k| if bit[k] == 1 { t[k] } else { 1.0 - t[k] })
            .product();
        if w > 0.0 {
            sum += w * f64::from(values.at([0, 1, 2].map(|k| base[k] + bit[k])));
        }
    }
    sum as f32
}

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

/// Does a lattice have the row along x at these two indices?
fn holds_row(lattice: &Lattice, y: i32, z: i32) -> bool {
    let [_, ny, nz] = lattice.counts;
    y >= 0 && (y as usize) < ny && z >= 0 && (z as usize) < nz
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
                    .position(|block| !lanes::all_finite(block));
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
