//! Rigid motions of the whole: iterated closest points from many rotations, trimmed (Rusinkiewicz and Levoy, *Efficient
//! variants of the ICP algorithm*, 2001), on places and normals. On the CPU, whatever the backend.
//!
//! The pose of a body has six numbers. The shift follows from the means of both shapes, so that only rotations have to
//! be sought: with 600 random ones there is nearly always one within 30° of the right one, from where ICP finds its
//! way.

use std::f64::consts::TAU;

use geom_core::compute::parallel;
use geom_core::compute::random::SplitMix64;
use geom_core::nalgebra::{Matrix3, Quaternion, UnitQuaternion};
use geom_core::{Point3, Vector3};

use super::{Boundary, Candidate};
use crate::backend::Nearest;
use crate::fit::{Flat, Motion, SCORED, Side, lifted, six, superpose};

/// Rotations from which it starts.
const ROTATIONS: usize = 600;
/// Rounds and points for all of them, and for the best of those.
const FIRST: (usize, usize) = (4, 150);
const SECOND: (usize, usize) = (12, 350);
/// How many go on to the second.
const GO_ON: usize = 48;
/// The share of the pairs that is kept in a round.
const TRIM: f64 = 0.9;

/// A shape's nodes, ready to be met in places and normals.
/// Rows of its places and normals are searched by blocks: all starts share them.
struct Cloud {
    side: Side,
    rows: Flat,
    mean: Vector3,
}

impl Cloud {
    fn of(side: Side) -> Self {
        let rows = lifted(&side.points, side.normals.iter().copied(), SCORED);
        let mean = side.points.iter().map(|p| p.coords).sum::<Vector3>();
        Self {
            rows: Flat::of(six(&rows)),
            mean: mean / side.points.len().max(1) as f64,
            side,
        }
    }

    /// The distance of each of the first `count` nodes, moved, to the nearest of another cloud, and which it is.
    /// As distance, own node, node of the other.
    fn meet(&self, motion: &Motion, count: usize, other: &Self) -> Vec<(f64, u32, u32)> {
        let count = count.min(self.side.points.len());
        let points: Vec<Point3> = self.side.points[..count]
            .iter()
            .map(|p| motion.of(p))
            .collect();
        let normals = self.side.normals[..count]
            .iter()
            .map(|n| motion.rotation * n);
        let rows = lifted(&points, normals, SCORED);
        let mut near = vec![Nearest::default(); count];
        other.rows.nearest(six(&rows), &mut near);
        let met = near.iter().zip(0u32..);
        met.map(|(n, i)| (n.distance, i, n.index)).collect()
    }
}

/// The best motions of the spread nodes of `a` onto those of `b`, with the two-way mean distance as their score.
/// Sorted by the first, short search only; the scores are of the second.
pub(crate) fn of_motions(a: &Boundary<'_>, b: &Boundary<'_>, seed: u64) -> Vec<Candidate> {
    let (from, to) = (Cloud::of(a.thinned()), Cloud::of(b.thinned()));
    let starts = SplitMix64::new(seed);
    let mut motions: Vec<(f64, Motion)> = parallel::map(ROTATIONS, |i| {
        let rotation = uniform(&starts, 3 * i as u64);
        let motion = Motion {
            rotation,
            shift: to.mean - rotation * from.mean,
        };
        iterate(&from, &to, motion, FIRST)
    });
    motions.sort_by(|a, b| a.0.total_cmp(&b.0));
    motions.truncate(GO_ON);
    let motions: Vec<(f64, Motion)> = parallel::map_each(&motions, |(_, motion)| {
        let (there, motion) = iterate(&from, &to, *motion, SECOND);
        let back = motion.rotation.transpose();
        let inverse = Motion {
            rotation: back,
            shift: -(back * motion.shift),
        };
        let back = to.meet(&inverse, SECOND.1, &from);
        let mean = back.iter().map(|m| m.0).sum::<f64>() / back.len().max(1) as f64;
        (there + mean, motion)
    });
    let candidate = |(score, motion): (f64, Motion)| Candidate {
        name: "rigid".to_owned(),
        images: from.side.points.iter().map(|p| motion.of(p)).collect(),
        score,
    };
    motions.into_iter().map(candidate).collect()
}

/// A rotation drawn uniformly (Shoemake, *Uniform random rotations*, 1992).
fn uniform(random: &SplitMix64, first: u64) -> Matrix3<f64> {
    let unit = |n| (random.nth(first + n) >> 11) as f64 / (1u64 << 53) as f64;
    let (u, v, w) = (unit(0), TAU * unit(1), TAU * unit(2));
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    let q = Quaternion::new(b * w.cos(), a * v.sin(), a * v.cos(), b * w.sin());
    UnitQuaternion::from_quaternion(q)
        .to_rotation_matrix()
        .into_inner()
}

/// So many rounds on so many points; the mean distance of the pairs that are kept.
/// Pairs are by places and normals, motions by places alone.
fn iterate(
    from: &Cloud,
    to: &Cloud,
    mut motion: Motion,
    (rounds, points): (usize, usize),
) -> (f64, Motion) {
    let kept = |motion: &Motion| {
        let mut met = from.meet(motion, points, to);
        met.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        met.truncate((TRIM * met.len() as f64).ceil() as usize);
        met
    };
    for _ in 0..rounds {
        let pairs: Vec<(Point3, Point3)> = kept(&motion)
            .into_iter()
            .map(|(_, i, j)| (from.side.points[i as usize], to.side.points[j as usize]))
            .collect();
        motion = superpose(&pairs);
    }
    let met = kept(&motion);
    (
        met.iter().map(|m| m.0).sum::<f64>() / met.len().max(1) as f64,
        motion,
    )
}
