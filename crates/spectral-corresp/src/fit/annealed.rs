//! The annealed two-way fit: as rigid as possible over wide neighbourhoods, then over narrow ones.
//!
//! Wide neighbourhoods at first forbid folds, narrow ones at the end allow hinges. Every node of each shape is drawn to the
//! nearest of the other: with one direction alone the cheapest map shrinks the shape to a part of the other.

use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, Vector3};

use super::{FITTED, Neighbourhoods, PARTNERS, SCORED, distortions, lifted, six};
use crate::Error;
use crate::backend::{Kernels, Nearest, On, RotationTask, SweepTask};
use crate::near;

/// A stage: pairs within `radius` (Å), so many rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stage {
    radius: f64,
    rounds: usize,
    pairs: usize,
}

const fn stage(radius: f64, rounds: usize, pairs: usize) -> Stage {
    Stage {
        radius,
        rounds,
        pairs,
    }
}

/// To tell candidates apart.
/// Half of the pairs per node, few rounds: only the order of the candidates matters.
pub(crate) const SHORT: &[Stage] = &[stage(18.0, 8, 30), stage(12.0, 8, 30)];
/// For the one that is kept.
pub(crate) const LONG: &[Stage] = &[stage(12.0, 10, 60), stage(8.0, 20, 60), stage(6.0, 20, 60)];

/// After the long schedule on some of the nodes, for all of them.
pub(crate) const LAST: &[Stage] = &[stage(6.0, 5, 60)];
/// To score a map as it is.
pub(crate) const JUDGE: &[Stage] = &[stage(6.0, 0, 60)];

/// λ: the pull of the data on a node over that of its neighbours.
/// Larger ones bend the shape to every bump of the other, smaller ones leave gaps.
const PULL: f64 = 0.15;
/// A node that many are drawn from pulls at most this many times as strongly.
const MOST_PULL: f64 = 3.0;
/// Steps of Jacobi's method per round.
/// Rotations follow in between; partners are found again only in the next round.
const SWEEPS: usize = 3;
/// Neighbourhoods reach at least this many times as far as the nearest node.
const LEAST_RADIUS: f64 = 3.0;
/// A stage ends when nodes move less than this in a round on average, Å.
const AT_REST: f64 = 0.02;
/// The pull of an anchor.
const ANCHOR_PULL: f64 = 1.0;

/// Boundary nodes of a shape, or some of them.
#[derive(Clone, Debug)]
pub(crate) struct Side {
    pub(crate) points: Vec<Point3>,
    pub(crate) normals: Vec<Vector3>,
}

/// A map from one side to the other.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    /// Where each node of the first goes.
    pub(crate) images: Vec<Point3>,
    /// The rotation of its neighbourhood.
    pub(crate) rotations: Vec<Matrix3<f64>>,
    /// The nearest node of the second to each image.
    pub(crate) forward: Vec<Nearest>,
    /// The node of the first with the nearest image to each node of the second.
    pub(crate) backward: Vec<Nearest>,
    /// J: root mean square distortion in the last stage, and the mean distances both ways, with normals; Å.
    pub(crate) score: f64,
}

/// Stages on one side, with who is near whom in each: the same for every map of it.
/// Rounds and neighbourhoods of each stage.
pub(crate) struct Schedule(Vec<(usize, Neighbourhoods)>);

impl Schedule {
    pub(crate) fn of(a: &Side, stages: &[Stage], seed: u64) -> Result<Self, Error> {
        // Where nodes lie far apart, so must neighbours.
        let least = LEAST_RADIUS * near::distance(&a.points)?;
        let stage = |s: &Stage| {
            let near = Neighbourhoods::within(&a.points, s.radius.max(least), s.pairs, seed)?;
            Ok((s.rounds, near))
        };
        Ok(Self(
            stages.iter().map(stage).collect::<Result<_, Error>>()?,
        ))
    }
}

/// Fits the images of `a` to `b` from `images`, stage after stage. `anchors` are nodes of `a` with a place of their own.
///
/// The score is taken in the neighbourhoods of the last stage, with normals shorter than in the fit; partners are found
/// last, with shorter ones still.
pub(crate) fn anneal(
    a: &Side,
    b: &Side,
    images: Vec<Point3>,
    anchors: &[(u32, Point3)],
    schedule: &Schedule,
    run: On<'_>,
) -> Result<Fit, Error> {
    let targets = |length| lifted(&b.points, b.normals.iter().copied(), length);
    let fitted = targets(FITTED);
    let mut fit = Fit {
        images,
        rotations: Vec::new(),
        forward: Vec::new(),
        backward: Vec::new(),
        score: 0.0,
    };
    let none = Neighbourhoods::default();
    let mut last = &none;
    for (rounds, near) in &schedule.0 {
        last = near;
        for _ in 0..*rounds {
            let before = fit.images.clone();
            round(a, b, &fitted, anchors, near, &mut fit, run)?;
            let moved = fit.images.iter().zip(&before).map(|(x, y)| (x - y).norm());
            if moved.sum::<f64>() < AT_REST * before.len() as f64 {
                break;
            }
        }
    }
    let task = RotationTask {
        rest: &a.points,
        now: &fit.images,
        near: last,
    };
    run.rotations(&task, &mut fit.rotations)?;
    let squares = distortions(&task, &fit.rotations);
    let distortion = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    meet(a, &targets(SCORED), SCORED, &mut fit, run)?;
    let mean =
        |near: &[Nearest]| near.iter().map(|n| n.distance).sum::<f64>() / near.len().max(1) as f64;
    fit.score = distortion + mean(&fit.forward) + mean(&fit.backward);
    meet(a, &targets(PARTNERS), PARTNERS, &mut fit, run)?;
    Ok(fit)
}

/// Who is nearest to whom, both ways, with normals of this length.
fn meet(a: &Side, targets: &[f64], length: f64, fit: &mut Fit, run: On<'_>) -> Result<(), Error> {
    let turned = fit.rotations.iter().zip(&a.normals).map(|(r, n)| r * n);
    let images = lifted(&fit.images, turned, length);
    let (images, targets) = (six(&images), six(targets));
    run.nearest(images, targets, &mut fit.forward)?;
    run.nearest(targets, images, &mut fit.backward)
}

/// Rotations, partners both ways, then sweeps towards the mean of what each node met and what met it. An anchor takes
/// the place of these data.
fn round(
    a: &Side,
    b: &Side,
    targets: &[f64],
    anchors: &[(u32, Point3)],
    near: &Neighbourhoods,
    fit: &mut Fit,
    run: On<'_>,
) -> Result<(), Error> {
    let rotate = |fit: &mut Fit| {
        let mut rotations = std::mem::take(&mut fit.rotations);
        let task = RotationTask {
            rest: &a.points,
            now: &fit.images,
            near,
        };
        run.rotations(&task, &mut rotations)?;
        fit.rotations = rotations;
        Ok::<(), Error>(())
    };
    rotate(fit)?;
    meet(a, targets, FITTED, fit, run)?;
    // The data of a node: the node that it meets, and all that meet it.
    let mut sums: Vec<(Vector3, f64)> = fit
        .forward
        .iter()
        .map(|n| (b.points[n.index as usize].coords, 1.0))
        .collect();
    for (n, y) in fit.backward.iter().zip(&b.points) {
        let (sum, count) = &mut sums[n.index as usize];
        *sum += y.coords;
        *count += 1.0;
    }
    let mut places: Vec<Point3> = sums.iter().map(|(s, n)| Point3::from(s / *n)).collect();
    let mut pull: Vec<f64> = sums.iter().map(|(_, n)| PULL * n.min(MOST_PULL)).collect();
    for &(node, place) in anchors {
        places[node as usize] = place;
        pull[node as usize] = ANCHOR_PULL;
    }
    let mut next = Vec::new();
    for sweep in 0..SWEEPS {
        if sweep > 0 {
            rotate(fit)?;
        }
        let task = SweepTask {
            shape: RotationTask {
                rest: &a.points,
                now: &fit.images,
                near,
            },
            rotations: &fit.rotations,
            targets: &places,
            pull: &pull,
        };
        run.sweep(&task, &mut next)?;
        std::mem::swap(&mut fit.images, &mut next);
    }
    Ok(())
}

/// Where the nodes of a side go on another, all normals along z, from where they are, and the score: in one stage of a
/// radius (Å), so many rounds and so many pairs per node. Nodes with an anchor have a place of their own. For tests.
#[cfg(feature = "testing")]
pub fn annealed_in_one_stage(
    sides: [&[Point3]; 2],
    anchors: &[(u32, Point3)],
    (radius, rounds, pairs): (f64, usize, usize),
) -> Result<(Vec<Point3>, f64), Error> {
    let [a, b] = sides.map(|points| Side {
        points: points.to_vec(),
        normals: vec![Vector3::z(); points.len()],
    });
    let schedule = Schedule::of(&a, &[stage(radius, rounds, pairs)], 1)?;
    let backend: &dyn crate::CorrespBackend = &geom_core::Cpu;
    let images = a.points.clone();
    let fit = anneal(&a, &b, images, anchors, &schedule, On::on(backend))?;
    Ok((fit.images, fit.score))
}
