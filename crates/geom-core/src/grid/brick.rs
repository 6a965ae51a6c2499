//! Values on a lattice that are stored only near the surface.
//!
//! A brick holds 8 × 8 × 8 points, 2 KB. A lattice of n³ points with a surface through it has about n² points near that surface, and
//! only the bricks there are stored; all others have one of two values, that of the outside or that of the inside.
//!
//! Bricks are numbered by their places, x fastest as points are, and those that are stored by a number of their own, in
//! any order: samplers may store bricks as they come. There is no tree: the place of its brick, and one lookup, find a
//! point.

use crate::compute::parallel;

use super::{
    GridError, LatticeValues, ScalarGrid, check_lattice, copy_row, first_not_finite, trilinear,
};
use crate::{ImplicitField, Lattice, Point3, Vector3};

/// Points per side of a brick.
///
/// A power of two, so that the division is a shift.
pub const BRICK: usize = 8;
/// Points per brick.
pub const BRICK_POINTS: usize = BRICK * BRICK * BRICK;

/// What a brick of a [`BrickGrid`] holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brick {
    /// Not stored: every point has the grid's exterior value.
    /// A low value, for fields that are large inside.
    Exterior,
    /// Not stored: every point has the grid's interior value.
    Interior,
    /// Stored: the number of the brick among the stored ones.
    Stored(u32),
}

/// Values on a lattice, stored only in bricks of 8 × 8 × 8 points near the surface; all other points
/// have one of two constants. Brick `(a, b, c)` owns the points `[8a, 8a + 8) × …`; points of a brick
/// beyond the lattice are stored but never read.
///
/// Memory: 2 KiB per stored brick and 4 bytes for every brick. A brick is stored as a whole, so that the two constants
/// may stand only where no level in question passes; who makes the grid decides that.
///
/// ```
/// use geom_core::grid::{BRICK_POINTS, Brick, BrickGrid};
/// use geom_core::{Lattice, LatticeValues, Point3};
/// // Two bricks along x: the first is stored and has the value 1, the second is outside.
/// let lattice = Lattice { origin: Point3::origin(), spacing: 0.5, counts: [16, 8, 8] };
/// let kinds = [Brick::Stored(0), Brick::Exterior];
/// let grid = BrickGrid::new(lattice, &kinds, vec![1.0; BRICK_POINTS], 0.0, 9.0)?;
/// assert_eq!((grid.at([7, 0, 0]), grid.at([8, 0, 0])), (1.0, 0.0));
/// assert_eq!(grid.constant([8, 0, 0], [15, 7, 7]), Some(0.0));
/// assert_eq!(grid.to_dense().range(), Some((0.0, 1.0)));
/// # Ok::<(), geom_core::GridError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct BrickGrid {
    lattice: Lattice,
    bricks: [usize; 3],
    /// Per brick, x fastest: number among the stored ones, or one of the two marks.
    brick_of: Vec<u32>,
    /// `BRICK_POINTS` values per stored brick, x fastest.
    values: Vec<f32>,
    exterior: f32,
    interior: f32,
}

/// The two marks are numbers that no stored brick has.
const EXTERIOR: u32 = u32::MAX;
const INTERIOR: u32 = u32::MAX - 1;

impl BrickGrid {
    /// A sparse grid. `kinds` has one entry per brick, x fastest, whose stored ones have the numbers
    /// `0, 1, …`, each once, in any order; `values` holds [`BRICK_POINTS`] values per stored brick, in the order of
    /// these numbers.
    ///
    /// # Errors
    /// Kinds, numbers and values that do not fit together, and values that are not finite, those of bricks that are not
    /// stored among them, are named.
    pub fn new(
        lattice: Lattice,
        kinds: &[Brick],
        values: Vec<f32>,
        exterior: f32,
        interior: f32,
    ) -> Result<Self, GridError> {
        check_lattice(&lattice)?;
        for (bricks, value) in [("exterior", exterior), ("interior", interior)] {
            if !value.is_finite() {
                return Err(GridError::Fill { bricks, value });
            }
        }
        let bricks = lattice.counts.map(|n| n.div_ceil(BRICK));
        let brick_of = numbered(kinds, bricks, values.len())?;
        let grid = Self {
            lattice,
            bricks,
            brick_of,
            values,
            exterior,
            interior,
        };
        match first_not_finite(&grid.values) {
            None => Ok(grid),
            Some(i) => {
                let brick = grid
                    .brick_of
                    .iter()
                    .position(|&b| b as usize == i / BRICK_POINTS);
                let corner = grid.brick_coordinates(brick.expect("a stored brick has a place"));
                let p = i % BRICK_POINTS;
                let inside = [p % BRICK, p / BRICK % BRICK, p / (BRICK * BRICK)];
                let index = [0, 1, 2].map(|k| corner[k] * BRICK + inside[k]);
                Err(GridError::NotFinite {
                    index,
                    value: grid.values[i],
                })
            }
        }
    }

    /// Bricks per axis.
    pub fn bricks(&self) -> [usize; 3] {
        self.bricks
    }

    /// Brick coordinates of the brick at a place in memory.
    ///
    /// The order of `kinds` in [`BrickGrid::new`]. Panics if the lattice has no points.
    pub fn brick_coordinates(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.bricks;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// What a brick holds.
    ///
    /// Panics beyond the last brick in memory; beyond one axis only it is another brick.
    pub fn brick(&self, [a, b, c]: [usize; 3]) -> Brick {
        match self.brick_of[(c * self.bricks[1] + b) * self.bricks[0] + a] {
            EXTERIOR => Brick::Exterior,
            INTERIOR => Brick::Interior,
            stored => Brick::Stored(stored),
        }
    }

    /// The 512 values of a stored brick, x fastest.
    ///
    /// Panics if there is no brick of this number.
    pub fn stored(&self, brick: u32) -> &[f32] {
        &self.values[brick as usize * BRICK_POINTS..][..BRICK_POINTS]
    }

    /// The values of all stored bricks.
    ///
    /// Brick after brick, by their numbers.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Number of stored bricks.
    pub fn stored_bricks(&self) -> usize {
        self.values.len() / BRICK_POINTS
    }

    /// The value of every point of an exterior brick.
    pub fn exterior(&self) -> f32 {
        self.exterior
    }

    /// The value of every point of an interior brick.
    pub fn interior(&self) -> f32 {
        self.interior
    }

    /// All points as a dense grid; needs 4 B per lattice point.
    ///
    /// Rows are filled in parallel. Refuses nothing: ask [`Lattice::points`] first for a lattice that is large.
    pub fn to_dense(&self) -> ScalarGrid {
        let [nx, ny, _] = self.lattice.counts;
        let mut values = vec![0.0; self.lattice.len()];
        parallel::for_chunks(&mut values, nx.max(1), |row, out| {
            let (j, k) = (row % ny, row / ny);
            for (i, v) in out.iter_mut().enumerate() {
                *v = self.at([i, j, k]);
            }
        });
        ScalarGrid {
            lattice: self.lattice,
            values,
        }
    }
}

/// The number or the mark of every brick, once each stored one has its own.
fn numbered(kinds: &[Brick], bricks: [usize; 3], values: usize) -> Result<Vec<u32>, GridError> {
    let expected = bricks
        .iter()
        .fold(1u128, |all, &n| all.saturating_mul(n as u128));
    let stored = kinds
        .iter()
        .filter(|kind| matches!(kind, Brick::Stored(_)))
        .count();
    if kinds.len() as u128 != expected || values != stored * BRICK_POINTS {
        return Err(GridError::Bricks {
            kinds: kinds.len(),
            expected,
            values,
            stored,
        });
    }
    let mut taken = vec![false; stored];
    let number = |(brick, kind): (usize, &Brick)| match *kind {
        Brick::Exterior => Ok(EXTERIOR),
        Brick::Interior => Ok(INTERIOR),
        Brick::Stored(number) => match taken.get_mut(number as usize) {
            Some(free) if !*free => {
                *free = true;
                Ok(number)
            }
            _ => Err(GridError::BrickNumber {
                brick,
                number,
                stored,
            }),
        },
    };
    kinds.iter().enumerate().map(number).collect()
}

impl LatticeValues for BrickGrid {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }
    fn at(&self, [i, j, k]: [usize; 3]) -> f32 {
        match self.brick([i / BRICK, j / BRICK, k / BRICK]) {
            Brick::Exterior => self.exterior,
            Brick::Interior => self.interior,
            Brick::Stored(b) => {
                self.stored(b)[((k % BRICK) * BRICK + j % BRICK) * BRICK + i % BRICK]
            }
        }
    }
    fn read_row(&self, [mut i, j, k]: [usize; 3], mut row: &mut [f32]) {
        while !row.is_empty() {
            let n = (BRICK - i % BRICK).min(row.len());
            let (part, rest) = std::mem::take(&mut row).split_at_mut(n);
            match self.brick([i / BRICK, j / BRICK, k / BRICK]) {
                Brick::Exterior => part.fill(self.exterior),
                Brick::Interior => part.fill(self.interior),
                Brick::Stored(b) => {
                    let first = ((k % BRICK) * BRICK + j % BRICK) * BRICK + i % BRICK;
                    copy_row(part, &self.stored(b)[first..first + n]);
                }
            }
            row = rest;
            i += n;
        }
    }
    fn constant(&self, low: [usize; 3], high: [usize; 3]) -> Option<f32> {
        let (low, high) = (low.map(|c| c / BRICK), high.map(|c| c / BRICK));
        let first = self.brick(low);
        for c in low[2]..=high[2] {
            for b in low[1]..=high[1] {
                for a in low[0]..=high[0] {
                    if self.brick([a, b, c]) != first {
                        return None;
                    }
                }
            }
        }
        match first {
            Brick::Exterior => Some(self.exterior),
            Brick::Interior => Some(self.interior),
            Brick::Stored(_) => None,
        }
    }
}

impl ImplicitField for BrickGrid {
    fn value(&self, x: &Point3) -> f64 {
        trilinear(self, x).0
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        trilinear(self, x)
    }
}
