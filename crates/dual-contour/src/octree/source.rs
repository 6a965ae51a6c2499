//! Where the values of the mesh lattice come from: the given lattice, or another one.
//!
//! The given lattice is read in rows, which a dense grid has side by side in memory; and it is asked first for what is
//! constant, so that empty bricks of a sparse one are never read.

use geom_core::{Aabb, ImplicitField, Lattice, LatticeValues, Point3};

use super::domain::Domain;
use super::tree::BLOCK;
use crate::kernel::{BLOCK_POINTS, BLOCK_SIDE};

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

impl<V: ?Sized> Clone for Source<'_, V> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<V: ?Sized> Copy for Source<'_, V> {}

impl<V: LatticeValues + ?Sized> Source<'_, V> {
    /// The box of the given values, Å.
    pub(super) fn bounds(&self) -> Aabb {
        let (Self::Aligned { values, .. } | Self::Resampled { values, .. }) = self;
        values.lattice().bounds()
    }

    /// The point of the given lattice that a point of the mesh lattice stands for.
    /// For errors: the nearest one, where the lattices differ.
    pub(super) fn index(&self, domain: &Domain, p: [i32; 3]) -> [usize; 3] {
        let (Self::Aligned { values, .. } | Self::Resampled { values, .. }) = self;
        let lattice = values.lattice();
        let local = lattice.local(&domain.point(p));
        [0, 1, 2].map(|k| (local[k].round().max(0.0) as usize).min(lattice.counts[k] - 1))
    }

    /// The value at a point of the mesh lattice.
    pub(super) fn at(&self, domain: &Domain, p: [i32; 3]) -> f32 {
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
    pub(super) fn is_within(&self, domain: &Domain, low: i32) -> bool {
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
    pub(super) fn gather(&self, domain: &Domain, low: [i32; 3], out: &mut [f32]) {
        let blocks = out.len() / BLOCK_POINTS;
        let mut along = vec![0.0; blocks * BLOCK as usize + 1];
        let within = self.is_within(domain, low[0]);
        for row in 0..BLOCK_SIDE * BLOCK_SIDE {
            let y = (low[1] + (row % BLOCK_SIDE) as i32).min(domain.cells[1]);
            let z = (low[2] + (row / BLOCK_SIDE) as i32).min(domain.cells[2]);
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
                .chunks_exact_mut(BLOCK_POINTS)
                .map(|block| &mut block[row * BLOCK_SIDE..]);
            for (to, from) in rows.zip(along.windows(BLOCK_SIDE).step_by(BLOCK as usize)) {
                if let (Some(to), Some(from)) =
                    (to.first_chunk_mut::<BLOCK_SIDE>(), from.first_chunk())
                {
                    *to = *from;
                }
            }
        }
    }

    /// The value of the closed block at `low`, if all of its points are known to have it, or at least
    /// its side of the level.
    /// For another lattice: if all given points that the interpolant, or a field that they stand for, could depend on
    /// there are on one side. A field may have bumps between given points; the mesh has them where blocks are read, and
    /// not elsewhere.
    pub(super) fn constant(&self, domain: &Domain, low: [i32; 3], level: f64) -> Option<f32> {
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

/// The values interpolated at a point (Å) of their box. Corners without weight are not read, so that a point on a face,
/// an edge or a lattice point has the value that either side gives.
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

/// Does a lattice have the row along x at these two indices?
fn holds_row(lattice: &Lattice, y: i32, z: i32) -> bool {
    let [_, ny, nz] = lattice.counts;
    y >= 0 && (y as usize) < ny && z >= 0 && (z as usize) < nz
}
