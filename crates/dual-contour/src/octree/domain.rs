//! The lattice of the finest cells, and which material a point of it belongs to.

use geom_core::mesh::{EXTERIOR, INTERIOR, OUTSIDE, Region};
use geom_core::{Point3, Vector3};

use super::tree::{BLOCK, block_coordinates, block_count};
use crate::{Material, Shape};

/// The lattice of the finest cells. Places in Å follow from the lattice of the values alone, wherever the domain
/// begins: sums of whole numbers and of [`exact`] fractions of a cell have no rounding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Domain {
    /// The first point of the lattice of the values, Å.
    origin: Point3,
    /// Edge of a finest cell, Å.
    pub(crate) spacing: f64,
    /// Finest cells per axis; what lies in whole blocks beyond is void.
    pub(crate) cells: [i32; 3],
    /// Blocks per axis, the last of which may stick out.
    pub(crate) blocks: [i32; 3],
    /// The same point among those of the finest cells: beyond the domain if that is a part of a larger one.
    pub(crate) anchor: [i32; 3],
}

impl Domain {
    /// The point `anchor` of the finest cells stands at `origin`.
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
        self.origin + self.in_values(local).coords * self.spacing
    }
    /// The same of a place `offset` away from a point whose coordinates are whole numbers of cells or halves: the
    /// offset may be any number, and what is rounded off does not depend on where the domain begins.
    pub(crate) fn world_from(&self, exact: &Point3, offset: &Vector3) -> Point3 {
        self.origin + (self.in_values(exact).coords + offset) * self.spacing
    }
    /// From where the domain begins to where the values do, in finest cells.
    pub(crate) fn in_values(&self, p: &Point3) -> Point3 {
        Point3::from(p.coords - local(self.anchor).coords)
    }
    /// A lattice point in Å.
    pub(crate) fn point(&self, p: [i32; 3]) -> Point3 {
        self.world(&local(p))
    }
    pub(crate) fn block_len(&self) -> usize {
        block_count(self.blocks)
    }
    pub(crate) fn block(&self, b: usize) -> [i32; 3] {
        block_coordinates(self.blocks, b)
    }
}

/// A lattice point in units of the finest cells.
pub(crate) fn local(p: [i32; 3]) -> Point3 {
    Point3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))
}

/// The nearest fraction of a cell that no whole number of cells makes inexact: of all 53 bits of a number, 20 are
/// left for the lattice.
/// It moves a point by at most 2⁻³³ of a cell. With it tiles that begin elsewhere have the same vertices.
pub(crate) fn exact(offset: f64) -> f64 {
    const PARTS: f64 = (1u64 << 32) as f64;
    (offset * PARTS).round() / PARTS
}

/// The point at a share of the way between two points, itself [`exact`] if the first is.
pub(crate) fn along(from: Point3, to: Point3, share: f64) -> Point3 {
    from + ((to - from) * share).map(exact)
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

    /// The label of a point (Å) with a value. A value at the level is inside, a point on the boundary of a material in
    /// it.
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

    /// How deep a point lies in the region of a label, Å, the molecule aside: negative outside of it. As exact as the
    /// depths of the shapes are.
    pub(crate) fn depth(&self, label: Region, x: &Point3) -> f64 {
        let within = self.outer.map_or(f64::INFINITY, |s| s.depth(x));
        if label == OUTSIDE {
            return -within;
        }
        // What is left by the shapes before, of other regions; what those of this region hold of it.
        let (mut left, mut held) = (within, f64::NEG_INFINITY);
        for material in &self.materials {
            let depth = material.shape.depth(x);
            if material.region == label {
                held = held.max(depth.min(left));
            } else {
                left = left.min(-depth);
            }
        }
        if label == EXTERIOR { left } else { held }
    }

    /// The label of all points within `reach` of `x` that are not in the molecule, if they have one.
    /// Since a shape's depth changes by no more than the distance, a boundary deeper or farther than `reach` does not
    /// come nearer.
    pub(super) fn around(&self, x: &Point3, reach: f64) -> Option<Region> {
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

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;

    /// Of overlapping shapes, two of one region, in an outer sphere: at any point exactly the label's own depth is not
    /// negative, and no depth changes by more than the distance.
    pub fn a_point_is_deep_in_its_region_alone() {
        let ball = |center: [f64; 3], radius| Shape::Sphere {
            center: center.into(),
            radius,
        };
        let slab = |normal, low, high| Shape::Slab { normal, low, high };
        let of = |region, shape| Material { region, shape };
        let labels = Labels {
            level: 1.0,
            materials: vec![
                of(3, ball([1.0, 0.0, 0.0], 2.0)),
                of(2, slab(Vector3::new(1.0, 1.0, 0.0), -1.0, 2.0)),
                of(3, ball([-1.0, 1.0, 0.5], 1.5)),
                of(4, slab(Vector3::z(), 0.0, 1.0)),
            ],
            outer: Some(ball([0.0; 3], 4.0)),
        };
        let mut met = [0; 5];
        let mut before: Option<(Point3, [f64; 5])> = None;
        for i in 0..4000 {
            let x =
                Point3::from([0.31, 0.47, 0.73].map(|s| 9.0 * ((f64::from(i) * s) % 1.0) - 4.5));
            let regions = [EXTERIOR, 2, 3, 4, OUTSIDE];
            let depths = regions.map(|r| labels.depth(r, &x));
            let here = labels.at(f64::NEG_INFINITY, &x);
            for (k, (region, depth)) in regions.into_iter().zip(depths).enumerate() {
                assert_eq!(depth >= 0.0, region == here, "{x}: {depth} in {region}");
                met[k] += usize::from(region == here);
            }
            if let Some((y, others)) = before.replace((x, depths)) {
                let pairs = depths.iter().zip(others);
                assert!(
                    pairs
                        .into_iter()
                        .all(|(a, b)| (a - b).abs() <= (x - y).norm() + 1e-12)
                );
            }
        }
        assert!(met.iter().all(|&n| n > 50), "{met:?}");
    }
}
