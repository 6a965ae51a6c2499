//! Values and region labels at the points of the mesh lattice, stored in blocks where they matter.

use geom_core::mesh::{EXTERIOR, INTERIOR, OUTSIDE, Region};
use geom_core::{ImplicitField, LatticeValues, Point3, Vector3};
use rayon::prelude::*;

use crate::octree::{BLOCK, BLOCK_LOG, block_index};
use crate::{Error, Material, Shape};

/// Points per side of a stored block: its cells are closed, so blocks share their faces.
pub(crate) const SIDE: usize = 9;
/// Points per stored block.
pub(crate) const POINTS: usize = SIDE * SIDE * SIDE;
/// Marks a block whose points all have one label, which stands in the low byte.
const UNIFORM: u32 = 0xffff_ff00;

/// The lattice of the finest cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Domain {
    pub(crate) origin: Point3,
    pub(crate) spacing: f64,
    pub(crate) cells: [i32; 3],
    pub(crate) blocks: [i32; 3],
}

impl Domain {
    pub(crate) fn new(origin: Point3, spacing: f64, cells: [i32; 3]) -> Self {
        let blocks = cells.map(|n| (n + BLOCK - 1) / BLOCK);
        Self {
            origin,
            spacing,
            cells,
            blocks,
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
    /// The value at a point of the mesh lattice.
    fn at(&self, domain: &Domain, p: [i32; 3]) -> f32 {
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

    /// Can the closed block of cells at `low` hold values on both sides of the level? Judged from the
    /// values of the given lattice.
    fn may_mix(&self, domain: &Domain, low: [i32; 3], level: f64) -> Option<bool> {
        let Self::Resampled {
            values, outside, ..
        } = self
        else {
            return None;
        };
        let lattice = values.lattice();
        let from = lattice.local(&domain.point(low));
        let to = lattice.local(&domain.point(low.map(|c| c + BLOCK)));
        let mut inside = f64::from(*outside) >= level;
        let mut any = false;
        let mut mixed = false;
        let mut see = |side: bool| {
            mixed |= any && side != inside;
            inside = side;
            any = true;
        };
        let last = lattice.counts.map(|n| n as f64 - 1.0);
        if (0..3).any(|k| from[k] < 0.0 || to[k] > last[k]) {
            see(f64::from(*outside) >= level);
        }
        let low = [0, 1, 2].map(|k| from[k].floor().clamp(0.0, last[k]) as usize);
        let high = [0, 1, 2].map(|k| to[k].ceil().clamp(0.0, last[k]) as usize);
        if (0..3).all(|k| to[k] >= 0.0 && from[k] <= last[k]) {
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    for x in low[0]..=high[0] {
                        see(f64::from(values.at([x, y, z])) >= level);
                    }
                }
            }
        }
        Some(mixed)
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
pub(crate) struct Samples {
    pub(crate) domain: Domain,
    pub(crate) labels: Labels,
    state: Vec<u32>,
    values: Vec<f32>,
    regions: Vec<Region>,
    /// Lowest and highest value seen.
    pub(crate) range: (f32, f32),
}

impl Samples {
    pub(crate) fn new<V: LatticeValues + ?Sized>(
        source: &Source<'_, V>,
        domain: Domain,
        labels: Labels,
    ) -> Result<Self, Error> {
        struct Block {
            state: u32,
            values: Vec<f32>,
            regions: Vec<Region>,
            range: (f32, f32),
            bad: Option<([i32; 3], f32)>,
        }
        let radius = 0.5 * f64::from(BLOCK) * 3f64.sqrt() * domain.spacing;
        let blocks: Vec<Block> = (0..domain.block_len())
            .into_par_iter()
            .map(|b| {
                let low = domain.block(b).map(|c| c * BLOCK);
                let middle = domain.world(&(local(low) + Vector3::repeat(0.5 * f64::from(BLOCK))));
                let around = labels.around(&middle, radius);
                let mut range = (f32::INFINITY, f32::NEG_INFINITY);
                let uniform = |label: Region, range| Block {
                    state: UNIFORM | u32::from(label),
                    values: Vec::new(),
                    regions: Vec::new(),
                    range,
                    bad: None,
                };
                if let (Some(label), Some(false)) =
                    (around, source.may_mix(&domain, low, labels.level))
                {
                    let v = source.at(&domain, low);
                    let inside = f64::from(v) >= labels.level;
                    return uniform(if inside { INTERIOR } else { label }, (v, v));
                }
                let mut values = vec![0.0; POINTS];
                let mut bad = None;
                let (mut above, mut below) = (false, false);
                for (i, value) in values.iter_mut().enumerate() {
                    let d = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)];
                    // Beyond the domain the nearest point stands in, so that nothing mixes there.
                    let p = [0, 1, 2].map(|k| (low[k] + d[k] as i32).min(domain.cells[k]));
                    let v = source.at(&domain, p);
                    if !v.is_finite() {
                        bad = bad.or(Some((p, v)));
                    }
                    range = (range.0.min(v), range.1.max(v));
                    if f64::from(v) >= labels.level {
                        above = true;
                    } else {
                        below = true;
                    }
                    *value = v;
                }
                if bad.is_some() {
                    return Block {
                        bad,
                        ..uniform(0, range)
                    };
                }
                if !below {
                    return uniform(INTERIOR, range);
                }
                if let (false, Some(label)) = (above, around) {
                    return uniform(label, range);
                }
                let regions: Vec<Region> = values
                    .iter()
                    .enumerate()
                    .map(|(i, &v)| {
                        let d = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)];
                        let p = [0, 1, 2].map(|k| (low[k] + d[k] as i32).min(domain.cells[k]));
                        match around {
                            Some(label) if f64::from(v) < labels.level => label,
                            _ => labels.at(f64::from(v), &domain.point(p)),
                        }
                    })
                    .collect();
                if regions.iter().all(|&r| r == regions[0]) {
                    return uniform(regions[0], range);
                }
                Block {
                    state: 0,
                    values,
                    regions,
                    range,
                    bad: None,
                }
            })
            .collect();
        let mut out = Self {
            domain,
            labels,
            state: Vec::with_capacity(blocks.len()),
            values: Vec::new(),
            regions: Vec::new(),
            range: (f32::INFINITY, f32::NEG_INFINITY),
        };
        let stored = blocks.iter().filter(|b| !b.regions.is_empty()).count();
        out.values.reserve_exact(stored * POINTS);
        out.regions.reserve_exact(stored * POINTS);
        for block in blocks {
            if let Some((p, value)) = block.bad {
                return Err(Error::NotFinite {
                    index: p.map(|c| c.max(0) as usize),
                    value,
                });
            }
            out.range = (
                out.range.0.min(block.range.0),
                out.range.1.max(block.range.1),
            );
            if block.regions.is_empty() {
                out.state.push(block.state);
            } else {
                out.state.push((out.regions.len() / POINTS) as u32);
                out.values.extend(block.values);
                out.regions.extend(block.regions);
            }
        }
        Ok(out)
    }

    /// Blocks that are stored.
    pub(crate) fn stored(&self) -> usize {
        self.regions.len() / POINTS
    }

    /// Place of a block among the stored ones.
    pub(crate) fn slot(&self, b: usize) -> Option<usize> {
        (self.state[b] < UNIFORM).then(|| self.state[b] as usize)
    }

    /// Labels of the closed block `b`, if stored.
    pub(crate) fn regions_of(&self, b: usize) -> Option<&[Region]> {
        self.slot(b).map(|s| &self.regions[s * POINTS..][..POINTS])
    }

    /// Values of the closed block `b`, if stored.
    pub(crate) fn values_of(&self, b: usize) -> Option<&[f32]> {
        self.slot(b).map(|s| &self.values[s * POINTS..][..POINTS])
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
            self.regions[state as usize * POINTS + i]
        }
    }

    /// The stored value at a lattice point of the closed block of cell `cell`.
    #[inline]
    pub(crate) fn value_near(&self, cell: [i32; 3], p: [i32; 3]) -> Option<f64> {
        let b = [0, 1, 2].map(|k| cell[k] >> BLOCK_LOG);
        let values = self.values_of(block_index(self.domain.blocks, b))?;
        let d = [0, 1, 2].map(|k| (p[k] - b[k] * BLOCK) as usize);
        Some(f64::from(values[(d[2] * SIDE + d[1]) * SIDE + d[0]]))
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
