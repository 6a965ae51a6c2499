//! f32 values on a [`lattice`]: dense ([`ScalarGrid`]), or sparse in bricks near a surface ([`BrickGrid`]), the
//! latter in the manner of the leaf nodes of OpenVDB (Museth, ACM TOG 32, 2013), without a tree above them.
//!
//! Both are fields, by trilinear interpolation:
//!
//! ```
//! use geom_core::{ImplicitField, Lattice, Point3, ScalarGrid};
//! let lattice = Lattice { origin: Point3::origin(), spacing: 0.5, counts: [3, 3, 3] };
//! let values = (0..27).map(|i| lattice.point(lattice.coordinates(i)).x as f32).collect();
//! let grid = ScalarGrid::new(lattice, values)?;
//! let (value, gradient) = grid.value_gradient(&Point3::new(0.3, 0.2, 0.1));
//! assert!((value - 0.3).abs() < 1e-7 && (gradient.x - 1.0).abs() < 1e-6);
//! # Ok::<(), geom_core::GridError>(())
//! ```
//!
//! A dense grid takes 4 bytes per point; a sparse one 2 KiB per brick of 512 points that is stored, and 4 bytes for
//! every brick. What only reads values takes [`LatticeValues`], and so either.

mod brick;
pub mod lattice;

pub use brick::{BRICK, BRICK_POINTS, Brick, BrickGrid};

use crate::compute::parallel;
use crate::{ImplicitField, Lattice, Point3, Vector3};

/// Why a grid cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GridError {
    /// Values and lattice points differ in number.
    #[error("{values} values for a lattice of {points} points")]
    Length {
        /// Number of values given.
        values: usize,
        /// Number of lattice points.
        points: u128,
    },
    /// A value is NaN or infinite.
    #[error("the value at lattice point {index:?} is {value}, not a finite number")]
    NotFinite {
        /// Lattice coordinates.
        index: [usize; 3],
        /// The value.
        value: f32,
    },
    /// The spacing is not a positive finite length, or the origin is not finite.
    #[error("a lattice needs a finite origin and a positive finite spacing, not {spacing} Å")]
    Lattice {
        /// The spacing, Å.
        spacing: f64,
    },
    /// Bricks, kinds and values differ in number.
    #[error(
        "{kinds} kinds for {expected} bricks, {values} values for {stored} stored ones; \
         one kind per brick and 512 values per stored brick are needed"
    )]
    Bricks {
        /// Kinds given.
        kinds: usize,
        /// Bricks of the lattice.
        expected: u128,
        /// Values given.
        values: usize,
        /// Bricks that are stored.
        stored: usize,
    },
    /// The value of bricks that are not stored is NaN or infinite.
    #[error("the value of {bricks} bricks is {value}, not a finite number")]
    Fill {
        /// "exterior" or "interior".
        bricks: &'static str,
        /// The value.
        value: f32,
    },
    /// The number of a stored brick is too large, or that of another one too.
    #[error(
        "brick {brick} has the number {number}, but the {stored} stored bricks have the numbers from 0, each once"
    )]
    BrickNumber {
        /// Place of the brick, x fastest.
        brick: usize,
        /// Its number.
        number: u32,
        /// Bricks that are stored.
        stored: usize,
    },
}

/// Values at lattice points, however they are stored.
///
/// [`ScalarGrid`] and [`BrickGrid`] hold finite values only, and readers of values rely on it.
pub trait LatticeValues: Sync {
    /// The lattice.
    fn lattice(&self) -> &Lattice;
    /// The value at a lattice point. Panics outside of the lattice.
    ///
    /// One lookup; who reads many values along x takes [`LatticeValues::read_row`].
    fn at(&self, point: [usize; 3]) -> f32;
    /// The values at `start` and the points that follow it along x. Panics outside of the lattice.
    fn read_row(&self, start: [usize; 3], row: &mut [f32]) {
        for (i, value) in row.iter_mut().enumerate() {
            *value = self.at([start[0] + i, start[1], start[2]]);
        }
    }
    /// The value of all points of the closed box from `low` to `high`, if it is known to be one
    /// without reading them.
    ///
    /// `None` says nothing: values may still be equal. Contouring passes over boxes for which it is known.
    fn constant(&self, low: [usize; 3], high: [usize; 3]) -> Option<f32> {
        let _ = (low, high);
        None
    }
}

/// A lattice and one f32 value per point, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct ScalarGrid {
    lattice: Lattice,
    values: Vec<f32>,
}

impl ScalarGrid {
    /// A grid of finite values, x fastest.
    ///
    /// # Errors
    /// [`GridError::Lattice`] for an origin or a spacing that is not finite, or a spacing not above 0;
    /// [`GridError::Length`] unless there is one value per point; [`GridError::NotFinite`] for the first value in
    /// memory that is NaN or infinite.
    pub fn new(lattice: Lattice, values: Vec<f32>) -> Result<Self, GridError> {
        check_lattice(&lattice)?;
        if lattice.points() != values.len() as u128 {
            return Err(GridError::Length {
                values: values.len(),
                points: lattice.points(),
            });
        }
        if let Some(i) = first_not_finite(&values) {
            return Err(GridError::NotFinite {
                index: lattice.coordinates(i),
                value: values[i],
            });
        }
        Ok(Self { lattice, values })
    }

    /// The values, x fastest.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Gives lattice and values away.
    ///
    /// Without a copy.
    pub fn into_parts(self) -> (Lattice, Vec<f32>) {
        (self.lattice, self.values)
    }

    /// Lowest and highest value; `None` for a grid without points.
    ///
    /// O(n), on one thread.
    pub fn range(&self) -> Option<(f32, f32)> {
        let first = *self.values.first()?;
        Some(
            self.values
                .iter()
                .fold((first, first), |(lo, hi), &v| (lo.min(v), hi.max(v))),
        )
    }

    /// The level above which the points of the grid hold this volume, Å³, each standing for one cell:
    /// how an isovalue is chosen for a map whose molecule has a known volume. `None` if the grid has
    /// no points or the volume is not between 0 and that of all of them.
    ///
    /// The level is half-way between the last value inside and the first one outside; equal values cannot be parted, so
    /// that a map of few distinct values encloses a volume near the wanted one. For 0 it lies just above the largest
    /// value, for the whole volume it is the smallest. The number of points is rounded. O(n) in time (a selection, not
    /// a sort), and a copy of the values in memory.
    pub fn level_enclosing(&self, volume: f64) -> Option<f32> {
        let points = volume / self.lattice.spacing.powi(3);
        if !(0.0..=self.values.len() as f64).contains(&points) || self.values.is_empty() {
            return None;
        }
        // Between the last value that belongs inside and the first that does not.
        let inside = points.round() as usize;
        let mut values = self.values.clone();
        let descending = |a: &f32, b: &f32| b.total_cmp(a);
        if inside == values.len() {
            return values.into_iter().min_by(f32::total_cmp);
        }
        let (above, &mut outer, _) = values.select_nth_unstable_by(inside, descending);
        let inner = above.iter().copied().min_by(f32::total_cmp);
        Some(inner.map_or(outer.next_up(), |inner| f32::midpoint(inner, outer)))
    }
}

impl LatticeValues for ScalarGrid {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }
    fn at(&self, point: [usize; 3]) -> f32 {
        self.values[self.lattice.index(point)]
    }
    fn read_row(&self, start: [usize; 3], row: &mut [f32]) {
        assert!(
            start[0] + row.len() <= self.lattice.counts[0],
            "a row ends within the lattice"
        );
        let first = self.lattice.index(start);
        copy_row(row, &self.values[first..first + row.len()]);
    }
}

/// Copies values that are often as few as the points of a block: without a call.
#[inline]
fn copy_row(to: &mut [f32], from: &[f32]) {
    let (to, to_rest) = to.as_chunks_mut::<8>();
    let (from, from_rest) = from.as_chunks::<8>();
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
    for (to, from) in to_rest.iter_mut().zip(from_rest) {
        *to = *from;
    }
}

/// The place of the first value that is not finite.
///
/// In parallel, and still the first: chunks are told apart by their places.
fn first_not_finite(values: &[f32]) -> Option<usize> {
    const CHUNK: usize = 1 << 14;
    // A count, not a search: it uses the lanes of the processor.
    let chunk = parallel::first(values.len().div_ceil(CHUNK), |chunk| {
        let values = &values[chunk * CHUNK..];
        let chunk = &values[..values.len().min(CHUNK)];
        chunk.iter().filter(|v| !v.is_finite()).count() > 0
    })?;
    let place = values[chunk * CHUNK..].iter().position(|v| !v.is_finite());
    place.map(|i| chunk * CHUNK + i)
}

/// Counts are not looked at: a lattice without points is one.
fn check_lattice(lattice: &Lattice) -> Result<(), GridError> {
    let fine = lattice.spacing.is_finite()
        && lattice.spacing > 0.0
        && lattice.origin.iter().all(|c| c.is_finite());
    if fine {
        Ok(())
    } else {
        Err(GridError::Lattice {
            spacing: lattice.spacing,
        })
    }
}

/// Trilinear interpolation; outside of the lattice the value at the nearest point of its box. A lattice without points
/// has the value 0 everywhere.
///
/// Continuous, but its gradient jumps at the faces between cells, where it is that of the cell that begins there; the
/// last point of an axis belongs to the last cell. Along an axis of one point, or beyond the box, the slope is 0.
fn trilinear(grid: &impl LatticeValues, x: &Point3) -> (f64, Vector3) {
    let lattice = grid.lattice();
    if lattice.counts.contains(&0) {
        return (0.0, Vector3::zeros());
    }
    let local = lattice.local(x);
    let (mut base, mut t, mut slope) = ([0usize; 3], [0.0; 3], [0.0; 3]);
    for k in 0..3 {
        let last = lattice.counts[k].saturating_sub(1);
        let clamped = local[k].clamp(0.0, last as f64);
        base[k] = (clamped as usize).min(last.saturating_sub(1));
        t[k] = clamped - base[k] as f64;
        // Beyond the box the field is constant along this axis.
        slope[k] = if clamped == local[k] && last > 0 {
            1.0 / lattice.spacing
        } else {
            0.0
        };
    }
    let (mut value, mut gradient) = (0.0, Vector3::zeros());
    for corner in 0..8usize {
        let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
        let point = [0, 1, 2].map(|k| (base[k] + bit[k]).min(lattice.counts[k] - 1));
        let v = f64::from(grid.at(point));
        let weight = [0, 1, 2].map(|k| if bit[k] == 1 { t[k] } else { 1.0 - t[k] });
        let sign = [0, 1, 2].map(|k| if bit[k] == 1 { slope[k] } else { -slope[k] });
        value += v * weight[0] * weight[1] * weight[2];
        gradient += v * Vector3::new(
            sign[0] * weight[1] * weight[2],
            weight[0] * sign[1] * weight[2],
            weight[0] * weight[1] * sign[2],
        );
    }
    (value, gradient)
}

impl ImplicitField for ScalarGrid {
    fn value(&self, x: &Point3) -> f64 {
        trilinear(self, x).0
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        trilinear(self, x)
    }
}
