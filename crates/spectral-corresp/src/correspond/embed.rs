//! Nodes that follow others: embedded deformation (Sumner, Schmid and Pauly, *Embedded deformation for shape
//! manipulation*, 2007).
//!
//! Fits and morphs solve for some nodes only; here the others learn where they go. Each control node carries a rigid
//! motion, its own rotation about its own place, and a point takes the weighted mean of where eight of them would put
//! it: smooth from point to point, and exact for a rigid motion of all.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::search::nearest::PointTree;

use crate::Error;
use crate::fit::{Motion, superpose};

/// Control nodes that a point follows; the next one says how far they reach.
/// The next one has no weight, so that a point that passes from one set of eight to another does not jump.
const FOLLOWED: usize = 8;

/// Control nodes with their images and rotations.
pub struct Embedding<'a> {
    tree: PointTree<3>,
    rest: &'a [Point3],
    images: &'a [Point3],
    rotations: Vec<Matrix3<f64>>,
}

impl<'a> Embedding<'a> {
    /// Of control nodes at `rest` with their `images`. Without `rotations` each takes that of its own neighbours.
    ///
    /// # Errors
    /// [`Error::Length`] where lists differ in length; places that are not finite.
    pub fn new(
        rest: &'a [Point3],
        images: &'a [Point3],
        rotations: &[Matrix3<f64>],
    ) -> Result<Self, Error> {
        let expected = rest.len();
        let fits = |what, found| match found == expected {
            true => Ok(()),
            false => Err(Error::Length {
                what,
                found,
                expected,
            }),
        };
        fits("images of control nodes", images.len())?;
        if !rotations.is_empty() {
            fits("rotations of control nodes", rotations.len())?;
        }
        let tree = PointTree::of_positions(rest)?;
        let own = |p: &Point3| -> Motion {
            let near = tree.nearest(&[p.x, p.y, p.z], 2 * FOLLOWED);
            let pairs = near
                .iter()
                .map(|n| (rest[n.index as usize], images[n.index as usize]));
            superpose(&pairs.collect::<Vec<_>>())
        };
        let rotations = if rotations.is_empty() {
            parallel::map_each(rest, |p| own(p).rotation)
        } else {
            rotations.to_vec()
        };
        Ok(Self {
            tree,
            rest,
            images,
            rotations,
        })
    }

    /// Where points go: the mean of where the eight nearest control nodes take them, `Σ ω (R (x − p) + X)`, with
    /// `ω ∝ (1 − d / d₉)²`.
    /// A control node itself stays near its image but need not hit it. Without control nodes points stay where they
    /// are.
    pub fn of(&self, points: &[Point3]) -> Vec<Point3> {
        parallel::map_each(points, |p| self.one(p))
    }

    fn one(&self, p: &Point3) -> Point3 {
        let near = self.tree.nearest(&[p.x, p.y, p.z], FOLLOWED + 1);
        let reach = near.last().map_or(0.0, |n| n.distance);
        let (mut sum, mut total) = (geom_core::Vector3::zeros(), 0.0);
        for n in near.iter().take(FOLLOWED) {
            let k = n.index as usize;
            let share = if reach > 0.0 {
                1.0 - n.distance / reach
            } else {
                1.0
            };
            let weight = (share * share).max(1e-9);
            let there = self.rotations[k] * (p - self.rest[k]) + self.images[k].coords;
            sum += there * weight;
            total += weight;
        }
        if total > 0.0 {
            Point3::from(sum / total)
        } else {
            *p
        }
    }
}
