//! Modes of two shapes as one graph (Eqs. 6.5–6.6).
//!
//! With matched nodes of both shapes joined by springs, two graphs become one, and its modes are functions on both at once: what the first
//! mode is on the one it is on the other, without signs to guess. Where the springs are too weak
//! the shapes move against each other in some modes; these are left out, and the springs made stronger if too few remain.

use std::collections::BTreeSet;

use geom_core::algebra::SparseMatrix;
use geom_core::algebra::graph::Laplacian;

use crate::Error;
use crate::backend::On;
use crate::options::MatchOptions;
use crate::shape::{self, Map, VoxelShape};

/// Modes less correlated over the links than this move the shapes against each other.
const IN_PHASE: f64 = 0.5;
/// Fewer joint modes than this, and the links are made stronger.
const LEAST: usize = 4;
/// By this factor, at most so many times.
const STRONGER: (f64, usize) = (3.0, 3);

/// Modes of both shapes, joined by links between partners.
#[derive(Clone, Debug, PartialEq)]
pub struct JointModes {
    /// Eigenvalues of the normalized Laplacian of the joint graph, ascending.
    pub values: Vec<f64>,
    /// A number per node of the first shape; the largest in magnitude over both is 1.
    pub first: Vec<Vec<f64>>,
    /// A number per node of the second shape.
    pub second: Vec<Vec<f64>>,
    /// The correlation of each mode over the links.
    /// At least 0.5.
    pub correlations: Vec<f64>,
    /// How many modes were left out because the shapes move against each other in them.
    pub dropped: usize,
    /// The weight of a link over that of an edge across a face, after it was made stronger.
    pub link: f64,
}

/// The links of an anchored node over others: what the caller knows counts more than what was found.
const ANCHORED: f64 = 10.0;

/// The first modes of both shapes that move in phase. `forward` and `backward` are partners as in
/// [`Correspondence`](crate::Correspondence): a pair has one link, whichever names it. That of an `anchored` boundary
/// node of the first shape to its partner is ten times as strong as the others.
///
/// # Errors
/// [`Error::Direction`] for maps between other shapes, [`Error::Length`] for an anchored node that there is not,
/// [`Error::TooManyModes`], and [`Error::Unlinked`] if fewer than four modes (or than are asked for) move in phase with
/// links 27 times as strong.
pub fn joint_modes(
    a: &VoxelShape,
    b: &VoxelShape,
    forward: &Map,
    backward: &Map,
    anchored: &[u32],
    options: &MatchOptions,
    run: On<'_>,
) -> Result<JointModes, Error> {
    options.check()?;
    forward.check(a, b)?;
    backward.check(b, a)?;
    if let Some(&node) = anchored.iter().find(|&&n| n as usize >= forward.len()) {
        return Err(Error::Length {
            what: "partners, for an anchored node of this number",
            found: forward.len(),
            expected: node as usize + 1,
        });
    }
    let links = links(a, b, forward, backward);
    let anchored = anchored.iter().map(|&i| pair(a, b, i, forward[i as usize]));
    let anchored: BTreeSet<(u32, u32)> = anchored.collect();
    let mut link = options.link;
    for attempt in 0..=STRONGER.1 {
        let found = modes(a, b, &links, &anchored, link, options, run)?;
        let enough = found.values.len() >= LEAST.min(options.modes);
        if enough {
            return Ok(found);
        }
        if attempt == STRONGER.1 {
            return Err(Error::Unlinked {
                kept: found.values.len(),
            });
        }
        link *= STRONGER.0;
    }
    unreachable!("the last attempt returns")
}

/// Two boundary nodes as nodes of the graphs.
fn pair(a: &VoxelShape, b: &VoxelShape, i: u32, j: u32) -> (u32, u32) {
    (a.boundary()[i as usize], b.boundary()[j as usize])
}

/// Pairs of nodes, each once.
#[cfg_attr(
    not(feature = "testing"),
    expect(unreachable_pub, reason = "tests ask for it")
)]
pub fn links(a: &VoxelShape, b: &VoxelShape, forward: &[u32], backward: &[u32]) -> Vec<(u32, u32)> {
    let there = (0u32..).zip(forward).map(|(i, &j)| pair(a, b, i, j));
    let back = (0u32..).zip(backward).map(|(j, &i)| pair(a, b, i, j));
    let mut links: Vec<(u32, u32)> = there.chain(back).collect();
    links.sort_unstable();
    links.dedup();
    links
}

/// Modes of the joint graph, those out of phase left out and counted.
fn modes(
    a: &VoxelShape,
    b: &VoxelShape,
    links: &[(u32, u32)],
    anchored: &BTreeSet<(u32, u32)>,
    link: f64,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<JointModes, Error> {
    let (first, all) = (a.nodes(), a.nodes() + b.nodes());
    // In units of the edge across a face.
    let unit = a
        .graph()
        .tables()
        .stencil
        .first()
        .map_or(1.0, |s| f64::from(s.1));
    let both = |&(i, j): &(u32, u32)| {
        let stronger = if anchored.contains(&(i, j)) {
            ANCHORED
        } else {
            1.0
        };
        let (j, weight) = (j + first as u32, link * unit * stronger);
        [(i, j, weight), (j, i, weight)]
    };
    let entries: Vec<_> = links.iter().flat_map(both).collect();
    let matrix = SparseMatrix::from_triplets(all, all, &entries)?;
    let graphs = vec![a.graph().clone(), b.graph().clone()];
    let laplacian = Laplacian::joint(graphs, &matrix)?;
    let found = shape::modes(&laplacian, options.modes, run)?;
    let mut out = JointModes {
        values: Vec::new(),
        first: Vec::new(),
        second: Vec::new(),
        correlations: Vec::new(),
        dropped: 0,
        link,
    };
    for (value, mode) in found.values.into_iter().zip(found.vectors) {
        let (on_a, on_b) = mode.split_at(first);
        let correlation = correlation(links, on_a, on_b);
        if correlation < IN_PHASE {
            out.dropped += 1;
            continue;
        }
        let (mut on_a, mut on_b) = (on_a.to_vec(), on_b.to_vec());
        shape::normalize(&mut [&mut on_a, &mut on_b]);
        out.values.push(value);
        out.first.push(on_a);
        out.second.push(on_b);
        out.correlations.push(correlation);
    }
    Ok(out)
}

/// Of the values at both ends of the links.
/// Pearson's; 0 where one side does not vary.
fn correlation(links: &[(u32, u32)], a: &[f64], b: &[f64]) -> f64 {
    let count = links.len().max(1) as f64;
    let pairs = || links.iter().map(|&(i, j)| (a[i as usize], b[j as usize]));
    let (sum_a, sum_b) = pairs().fold((0.0, 0.0), |s, (x, y)| (s.0 + x, s.1 + y));
    let (mean_a, mean_b) = (sum_a / count, sum_b / count);
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in pairs() {
        let (x, y) = (x - mean_a, y - mean_b);
        aa += x * x;
        bb += y * y;
        ab += x * y;
    }
    if aa * bb > 0.0 {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}
