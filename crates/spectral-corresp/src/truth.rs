//! The true map of a protein in two poses, from its atoms: the same atoms in both say where each point of the surface
//! went.

use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::search::nearest::PointTree;
use geom_core::{Point3, Vector3};

use crate::Error;
use crate::fit::superpose;
use crate::shape::{Map, VoxelShape};

/// Atoms within this of an atom move with it as a rigid body, Å.
const RIGID: f64 = 8.0;

/// Where each point near the atoms of one pose is in the other.
///
/// A point belongs to the atom `a` with the smallest `|x − x_a|² − r_a²` and moves as the atoms within 8 Å of that one
/// do: `T(x) = x_a' + R (x − x_a)`.
///
/// ```
/// use spectral_corresp::Truth;
/// use spectral_corresp::geom_core::Point3;
/// let rest: Vec<Point3> = (0..20).map(|i| Point3::new(f64::from(i), f64::from(i * i % 7), 0.5)).collect();
/// // A quarter turn about z.
/// let turned: Vec<Point3> = rest.iter().map(|p| Point3::new(-p.y, p.x, p.z)).collect();
/// let truth = Truth::new(&rest, &[1.6; 20], &turned)?;
/// let image = truth.image(&Point3::new(3.0, 1.0, 4.0));
/// assert!((image - Point3::new(-1.0, 3.0, 4.0)).norm() < 1e-9);
/// # Ok::<(), spectral_corresp::Error>(())
/// ```
pub struct Truth {
    /// Atoms as points of four numbers, whose squared distance from `(x, 0)` is the power of `x` plus a constant.
    powers: [PointTree<4>; 2],
    atoms: [Vec<Point3>; 2],
    rotations: Vec<Matrix3<f64>>,
}

/// How far a map is from the true one.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct TruthReport {
    /// Mean distance of a node's partner from its true place, Å.
    pub mean: f64,
    /// The median of these distances, Å.
    pub median: f64,
    /// Their 95th percentile, Å.
    pub p95: f64,
    /// The share of nodes within 3 Å.
    pub within_3: f64,
    /// The share of nodes within 5 Å.
    pub within_5: f64,
    /// The mean distance of the true place from the nearest boundary node of the second shape, Å: no map does
    /// better.
    pub floor: f64,
}

impl Truth {
    /// From the same atoms, in the same order, in both poses, and their radii; Å.
    ///
    /// # Errors
    /// [`Error::Length`] without atoms, or where the lists differ in length; places and radii that are not finite.
    pub fn new(atoms_a: &[Point3], radii: &[f64], atoms_b: &[Point3]) -> Result<Self, Error> {
        let expected = atoms_a.len();
        require("atoms of the first pose", expected, expected.max(1))?;
        require("atoms of the second pose", atoms_b.len(), expected)?;
        require("radii", radii.len(), expected)?;
        let largest = radii.iter().fold(0.0f64, |m, r| m.max(*r));
        let lifted = |atoms: &[Point3]| {
            let rows = atoms.iter().zip(radii).map(|(p, r)| {
                // Radii that are no numbers stay so, and the tree refuses them.
                let height = largest * largest - r * r;
                [
                    p.x,
                    p.y,
                    p.z,
                    if height > 0.0 {
                        height.sqrt()
                    } else {
                        height * 0.0
                    },
                ]
            });
            PointTree::new(rows.collect())
        };
        let near = PointTree::of_positions(atoms_a)?;
        let motion = |p: &Point3| {
            let found = near.within(&[p.x, p.y, p.z], RIGID);
            let pair = |i: usize| (atoms_a[i], atoms_b[i]);
            let pairs: Vec<_> = found.iter().map(|n| pair(n.index as usize)).collect();
            superpose(&pairs).rotation
        };
        Ok(Self {
            powers: [lifted(atoms_a)?, lifted(atoms_b)?],
            rotations: parallel::map_each(atoms_a, motion),
            atoms: [atoms_a.to_vec(), atoms_b.to_vec()],
        })
    }

    /// The atom that a point belongs to in a pose.
    fn atom(&self, pose: usize, x: &Point3) -> usize {
        let found = self.powers[pose].nearest(&[x.x, x.y, x.z, 0.0], 1);
        found.first().map_or(0, |n| n.index as usize)
    }

    /// Where a point of the first pose is in the second.
    /// Meant for points near the surface; farther out images of neighbouring points may lie apart.
    pub fn image(&self, x: &Point3) -> Point3 {
        let atom = self.atom(0, x);
        let offset: Vector3 = x - self.atoms[0][atom];
        self.atoms[1][atom] + self.rotations[atom] * offset
    }

    /// How far a map of boundary nodes is from the true one; `forward` as in
    /// [`Correspondence`](crate::Correspondence).
    ///
    /// # Errors
    /// [`Error::Direction`] for a map between other shapes.
    pub fn judge(
        &self,
        a: &VoxelShape,
        b: &VoxelShape,
        forward: &Map,
    ) -> Result<TruthReport, Error> {
        forward.check(a, b)?;
        let partners = forward.iter().map(|&j| b.boundary_points()[j as usize]);
        self.judge_places(a, b, &partners.collect::<Vec<_>>())
    }

    /// The same of places that are not on the lattice, as
    /// [`Correspondence::places`](crate::Correspondence::places) gives them.
    pub fn judge_places(
        &self,
        a: &VoxelShape,
        b: &VoxelShape,
        places: &[Point3],
    ) -> Result<TruthReport, Error> {
        require("places", places.len(), a.boundary().len())?;
        let there = PointTree::of_positions(b.boundary_points())?;
        let points = a.boundary_points();
        let judged: Vec<(f64, f64)> = parallel::map(points.len(), |i| {
            let truth = self.image(&points[i]);
            let error = (places[i] - truth).norm();
            let floor = there.nearest(&[truth.x, truth.y, truth.z], 1);
            (error, floor.first().map_or(0.0, |n| n.distance))
        });
        let mut errors: Vec<f64> = judged.iter().map(|e| e.0).collect();
        errors.sort_unstable_by(f64::total_cmp);
        let count = errors.len() as f64;
        let share = |limit: f64| errors.partition_point(|e| *e < limit) as f64 / count;
        Ok(TruthReport {
            mean: errors.iter().sum::<f64>() / count,
            median: percentile(&errors, 0.5),
            p95: percentile(&errors, 0.95),
            within_3: share(3.0),
            within_5: share(5.0),
            floor: judged.iter().map(|e| e.1).sum::<f64>() / count,
        })
    }

    /// The share of nodes whose partner belongs to an atom of the same residue; `residues` names that of each atom.
    pub fn residue_accuracy(
        &self,
        residues: &[u32],
        a: &VoxelShape,
        b: &VoxelShape,
        forward: &Map,
    ) -> Result<f64, Error> {
        forward.check(a, b)?;
        require("residues", residues.len(), self.rotations.len())?;
        let partners = forward.partners();
        let same = parallel::map(partners.len(), |i| {
            let (x, y) = (
                &a.boundary_points()[i],
                &b.boundary_points()[partners[i] as usize],
            );
            residues[self.atom(0, x)] == residues[self.atom(1, y)]
        });
        let same = same.iter().filter(|&&same| same).count();
        Ok(same as f64 / forward.len() as f64)
    }
}

fn require(what: &'static str, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected {
        return Ok(());
    }
    Err(Error::Length {
        what,
        found,
        expected,
    })
}

/// Of ascending values, between the two around it; 0 without any.
pub(crate) fn percentile(ascending: &[f64], share: f64) -> f64 {
    let Some(last) = ascending.len().checked_sub(1) else {
        return 0.0;
    };
    let place = share * last as f64;
    let below = place as usize;
    let above = (below + 1).min(last);
    ascending[below] + (place - below as f64) * (ascending[above] - ascending[below])
}
