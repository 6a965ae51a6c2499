//! Where the search may start: maps from features of nodes, and rigid motions.
//!
//! A fit finds the nearest good map and no other, so that much depends on where it starts. Every kind of start gives
//! candidates; those of one kind are told apart by a score, and the best few that differ are fitted shortly, all alike.

mod features;
mod histograms;
mod motions;

use geom_core::nalgebra::Matrix3;
use geom_core::search::nearest::PointTree;
use geom_core::{Point3, Vector3};

use crate::Error;
use crate::backend::{On, RotationTask};
use crate::fit::{self, Motion, Neighbourhoods, Side, superpose};
use crate::near;
use crate::options::MatchOptions;
use crate::shape::VoxelShape;

pub(crate) use features::{of_histograms, of_modes};
#[cfg(feature = "wgpu")]
pub(crate) use histograms::Cells;
pub(crate) use histograms::histograms;
pub(crate) use motions::of_motions;

/// Nodes on which candidates are told apart.
const SCORED: usize = 800;
/// Pairs per node of them, within a radius of 18 Å.
const SCORED_PAIRS: usize = 60;
const SCORED_RADIUS: f64 = 18.0;
/// Candidates of each kind that go on.
const KEPT: usize = 4;
/// Candidates whose images differ by less than this on average are the same, Å.
const APART: f64 = 5.0;

/// What is known of one shape's boundary before the search; lengths in Å.
#[derive(Clone, Debug)]
pub(crate) struct Boundary<'a> {
    pub(crate) shape: &'a VoxelShape,
    pub(crate) side: Side,
    /// Rows of the thesis's start without the mode: histograms of diameters.
    pub(crate) histograms: Vec<f64>,
    /// Modes at the boundary nodes.
    pub(crate) modes: Vec<Vec<f64>>,
    /// Their eigenvalues.
    pub(crate) values: Vec<f64>,
    /// Some of the nodes, well spread, the first of them best.
    pub(crate) spread: Vec<u32>,
}

/// A map that may be right.
#[derive(Clone, Debug)]
pub(crate) struct Candidate {
    /// What it came from.
    pub(crate) name: String,
    /// Images of [`Boundary::spread`] of the first shape.
    pub(crate) images: Vec<Point3>,
    /// Distortion, or for motions the distance; Å. Comparable within a kind only.
    pub(crate) score: f64,
}

impl Boundary<'_> {
    /// The spread nodes alone.
    pub(crate) fn thinned(&self) -> Side {
        self.side.some(&self.spread)
    }
}

impl Side {
    /// Some of its nodes.
    pub(crate) fn some(&self, nodes: &[u32]) -> Self {
        Self {
            points: nodes.iter().map(|&n| self.points[n as usize]).collect(),
            normals: nodes.iter().map(|&n| self.normals[n as usize]).collect(),
        }
    }
}

/// `count` of the points, each as far as possible from those before it (Gonzalez, *Clustering to minimize the maximum
/// intercluster distance*, 1985); the first is the farthest from the mean.
/// Time grows with the product of both numbers. Any first part of the list is well spread, too.
pub(crate) fn spread(points: &[Point3], count: usize) -> Vec<u32> {
    let mean = points.iter().map(|p| p.coords).sum::<Vector3>() / points.len().max(1) as f64;
    let farthest = |squares: &[f64]| {
        let mut best = 0;
        for (i, s) in squares.iter().enumerate() {
            if *s > squares[best] {
                best = i;
            }
        }
        best
    };
    let from_mean: Vec<f64> = points
        .iter()
        .map(|p| (p.coords - mean).norm_squared())
        .collect();
    let mut last = farthest(&from_mean);
    let mut squares = vec![f64::INFINITY; points.len()];
    let mut out = Vec::with_capacity(count.min(points.len()));
    while out.len() < count.min(points.len()) {
        out.push(last as u32);
        for (s, p) in squares.iter_mut().zip(points) {
            *s = s.min((p - points[last]).norm_squared());
        }
        squares[last] = -1.0;
        last = farthest(&squares);
    }
    out
}

/// How candidates of one pair of shapes are told apart: by the distortion on some nodes of the first.
pub(crate) struct Judge {
    rest: Vec<Point3>,
    near: Neighbourhoods,
}

impl Judge {
    pub(crate) fn of(a: &Boundary<'_>, seed: u64) -> Result<Self, Error> {
        let rest: Vec<Point3> = a
            .spread
            .iter()
            .map(|&n| a.side.points[n as usize])
            .collect();
        let rest = rest[..SCORED.min(rest.len())].to_vec();
        let radius = SCORED_RADIUS.max(3.0 * near::distance(&rest)?);
        let near = Neighbourhoods::within(&rest, radius, SCORED_PAIRS, seed)?;
        Ok(Self { rest, near })
    }

    /// How many of the spread nodes are looked at.
    pub(crate) fn nodes(&self) -> usize {
        self.rest.len()
    }

    /// The root mean square distortion of images of the first spread nodes, Å. Unlike the distance of features or
    /// of pairs it tells a mirror image.
    pub(crate) fn score(&self, images: &[Point3], run: On<'_>) -> Result<f64, Error> {
        let task = RotationTask {
            rest: &self.rest,
            now: &images[..self.rest.len()],
            near: &self.near,
        };
        fit::score(&task, run)
    }
}

/// The best few candidates that differ.
/// At most four, each at least 5 Å from all better ones on average.
pub(crate) fn best_apart(mut candidates: Vec<Candidate>) -> Vec<Candidate> {
    candidates.sort_by(|a, b| a.score.total_cmp(&b.score));
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        let differs = |k: &Candidate| distance(&k.images, &candidate.images) > APART;
        if kept.len() < KEPT && kept.iter().all(differs) {
            kept.push(candidate);
        }
    }
    kept
}

/// The mean distance of points from others, one by one.
pub(crate) fn distance(a: &[Point3], b: &[Point3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm()).sum();
    sum / a.len().max(1) as f64
}

/// Anchors on the boundary: the node nearest to each, and where it goes; and the rigid motion of all of them.
pub(crate) fn anchored(
    a: &Side,
    anchors: &[(Point3, Point3)],
    options: &MatchOptions,
) -> Result<(Motion, Vec<(u32, Point3)>), Error> {
    let scaled = |p: &Point3| Point3::from(p.coords / options.unit);
    let anchors: Vec<_> = anchors
        .iter()
        .map(|(p, q)| (scaled(p), scaled(q)))
        .collect();
    let count = anchors.len();
    let spans = |points: &mut dyn Iterator<Item = Point3>| {
        let points: Vec<Point3> = points.collect();
        let mean = points.iter().map(|p| p.coords).sum::<Vector3>() / count.max(1) as f64;
        let spread: Matrix3<f64> = points
            .iter()
            .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
            .sum();
        let extents = spread
            .iter()
            .all(|x| x.is_finite())
            .then(|| spread.symmetric_eigenvalues());
        extents.is_some_and(|e| {
            let mut e = [e[0], e[1], e[2]];
            e.sort_by(f64::total_cmp);
            e[1] > 1e-6 * e[2]
        })
    };
    let both = spans(&mut anchors.iter().map(|a| a.0)) && spans(&mut anchors.iter().map(|a| a.1));
    if count < 3 || !both {
        return Err(Error::Anchors { count });
    }
    let motion = superpose(&anchors);
    let tree = PointTree::of_positions(&a.points)?;
    let on_boundary = anchors.iter().filter_map(|(p, q)| {
        let node = tree.nearest(&[p.x, p.y, p.z], 1).first()?.index;
        let offset = a.points[node as usize] - p;
        Some((node, q + motion.rotation * offset))
    });
    Ok((motion, on_boundary.collect()))
}
