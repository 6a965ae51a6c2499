//! Balls around what needs another look, so that no border runs through it.
//!
//! Where an element at a border has to be improved, its neighbours lie in another tile and may not move. A second round
//! deals the elements anew, by patches: what surrounds such a place is then whole in one tile.

use std::collections::HashMap;

use crate::Point3;
use crate::compute::sets::DisjointSets;

/// Balls around places. Those that overlap are one patch, which belongs to the tile of its first place as a whole.
///
/// Two balls that hold one point overlap, and balls that overlap are one patch: a point is thus in one patch at most.
#[derive(Clone, Debug)]
pub struct Patches {
    radius: f64,
    places: Vec<Point3>,
    /// The tile of each place's patch.
    tiles: Vec<u32>,
    /// The places by cubes as wide as a ball.
    cubes: HashMap<[i64; 3], Vec<u32>>,
}

impl Patches {
    /// Balls of a radius around places, each told with the tile that it is in. The order of the places decides.
    ///
    /// ```
    /// use geom_core::{Point3, tiles::Patches};
    /// let at = |x: f64| Point3::new(x, 0.0, 0.0);
    /// // The first two overlap; the third is alone.
    /// let patches = Patches::new(&[(at(1.0), 4), (at(2.5), 0), (at(9.0), 7)], 1.0);
    /// assert_eq!(patches.tile_of(&at(3.0)), Some(4));
    /// assert_eq!(patches.tile_of(&at(8.5)), Some(7));
    /// assert_eq!(patches.tile_of(&at(5.0)), None);
    /// ```
    ///
    /// Overlap is transitive: a chain of balls is one patch, however long. `radius` is above 0; all ranks must be given
    /// the same places in the same order. O(places), as long as few lie within one ball.
    pub fn new(places: &[(Point3, u32)], radius: f64) -> Self {
        let mut cubes: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (i, (x, _)) in (0..).zip(places) {
            cubes.entry(cube(x, radius)).or_default().push(i);
        }
        let mut patches = Self {
            radius,
            places: places.iter().map(|p| p.0).collect(),
            tiles: Vec::new(),
            cubes,
        };
        let mut sets = DisjointSets::new(places.len());
        for (i, (x, _)) in (0..).zip(places) {
            for j in patches.near(x, 2.0 * radius) {
                sets.join(i, j);
            }
        }
        // The first member names a set.
        let roots = sets.into_roots();
        patches.tiles = roots.iter().map(|&root| places[root as usize].1).collect();
        patches
    }

    /// The tile of the patch that holds a point, if one does.
    ///
    /// The balls are closed. 27 cubes are looked at.
    pub fn tile_of(&self, x: &Point3) -> Option<usize> {
        let place = self.near(x, self.radius).next()?;
        Some(self.tiles[place as usize] as usize)
    }

    /// Does a tile have patches?
    ///
    /// O(places).
    pub fn has(&self, tile: usize) -> bool {
        self.tiles.iter().any(|&t| t as usize == tile)
    }

    /// The places within a distance of at most a ball's width.
    ///
    /// Cubes have the width of a ball, 2 `radius`, so that whatever is within that distance is in one of the 27 around.
    fn near(&self, x: &Point3, distance: f64) -> impl Iterator<Item = u32> {
        let middle = cube(x, self.radius);
        let cubes = (0..27).filter_map(move |i| {
            let at = [i % 3, i / 3 % 3, i / 9];
            self.cubes.get(&[0, 1, 2].map(|k| middle[k] + at[k] - 1))
        });
        let x = *x;
        let is_near =
            move |i: &u32| (self.places[*i as usize] - x).norm_squared() <= distance * distance;
        cubes.flatten().copied().filter(is_near)
    }
}

/// The cube of a point.
///
/// Numbered from the origin, of either sign.
fn cube(x: &Point3, radius: f64) -> [i64; 3] {
    [x.x, x.y, x.z].map(|c| (c / (2.0 * radius)).floor() as i64)
}
