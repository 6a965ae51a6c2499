//! Where a map tears: pieces of a shape that go where what they hang on does not.
//!
//! A leg that was sent to the place of another one, below the knee, costs little distortion, since all that is wrong is
//! a ring of nodes; but there the map comes apart.

use geom_core::Point3;

use crate::Error;
use crate::fit::{Neighbourhoods, Side, superpose};

/// Nodes within this many spacings of each other hang together, if they do.
const REACH: f64 = 2.2;
/// A pair of them is torn where the map makes it longer than this many times.
/// Partners are lattice points, so that neighbours are stretched by rounding alone; three times is more than that.
const STRETCH: f64 = 3.0;
/// A piece goes along with the nodes within so many spacings of its tear.
const HOLD: f64 = 8.0;

/// The pieces of a boundary under a map.
pub(super) struct Pieces {
    near: Neighbourhoods,
    /// The piece of each node, by its first node.
    piece_of: Vec<u32>,
    /// Is a node in the largest piece of its part of the boundary?
    held: Vec<bool>,
}

impl Pieces {
    /// Of a map from `side` to `images`; lengths are those of `side`.
    pub(super) fn of(side: &Side, images: &[Point3], spacing: f64) -> Result<Self, Error> {
        // All pairs: no node has as many neighbours.
        let near = Neighbourhoods::within(&side.points, REACH * spacing, side.points.len(), 0)?;
        let whole = joined(&near, |_, _| true);
        let piece_of = joined(&near, |i, j| {
            let rest = (side.points[i] - side.points[j]).norm().max(spacing);
            (images[i] - images[j]).norm() < STRETCH * rest
        });
        let mut sizes = vec![0u32; near.len()];
        piece_of.iter().for_each(|&p| sizes[p as usize] += 1);
        // The largest piece of each part, the first of several.
        let mut largest: Vec<u32> = (0..near.len() as u32).collect();
        for (&part, &piece) in whole.iter().zip(&piece_of) {
            let best = &mut largest[part as usize];
            if sizes[piece as usize] > sizes[*best as usize] {
                *best = piece;
            }
        }
        let held = whole.iter().zip(&piece_of);
        let held = held.map(|(&part, &piece)| largest[part as usize] == piece);
        Ok(Self {
            held: held.collect(),
            near,
            piece_of,
        })
    }

    /// The share of the nodes in pieces that are torn off.
    pub(super) fn loose(&self) -> f64 {
        let loose = self.held.iter().filter(|h| !**h).count();
        loose as f64 / self.held.len().max(1) as f64
    }

    /// The images with the pieces that are torn off hung back on: each moves as the nodes at its tear do, in the order
    /// in which they are reached.
    pub(super) fn hung_back(&self, side: &Side, images: &[Point3], spacing: f64) -> Vec<Point3> {
        let (mut out, mut held) = (images.to_vec(), self.held.clone());
        loop {
            // The first piece that something held is near to, and what is held there.
            let tear = |&i: &usize| !held[i] && self.near.of(i).iter().any(|&j| held[j as usize]);
            let Some(first) = (0..held.len()).find(tear) else {
                return out;
            };
            let piece: Vec<usize> = (0..held.len())
                .filter(|&i| self.piece_of[i] == self.piece_of[first])
                .collect();
            let at_tear = piece.iter().flat_map(|&i| self.near.of(i));
            let hooks: Vec<Point3> = at_tear
                .filter(|j| held[**j as usize])
                .map(|&j| side.points[j as usize])
                .collect();
            let mean = hooks.iter().map(|p| p.coords).sum::<geom_core::Vector3>();
            let mean = Point3::from(mean / hooks.len() as f64);
            let reach =
                HOLD * spacing + hooks.iter().map(|p| (p - mean).norm()).fold(0.0, f64::max);
            let pairs: Vec<(Point3, Point3)> = (0..held.len())
                .filter(|&i| held[i] && (side.points[i] - mean).norm() < reach)
                .map(|i| (side.points[i], out[i]))
                .collect();
            let motion = superpose(&pairs);
            for i in piece {
                out[i] = motion.of(&side.points[i]);
                held[i] = true;
            }
        }
    }
}

/// The first node of what each node is joined to, by pairs that hold.
/// Depth first, from the lowest node on.
fn joined(near: &Neighbourhoods, holds: impl Fn(usize, usize) -> bool) -> Vec<u32> {
    let mut first_of = vec![u32::MAX; near.len()];
    let mut stack = Vec::new();
    for first in 0..near.len() {
        if first_of[first] != u32::MAX {
            continue;
        }
        first_of[first] = first as u32;
        stack.push(first);
        while let Some(i) = stack.pop() {
            for &j in near.of(i) {
                let j = j as usize;
                if first_of[j] == u32::MAX && holds(i, j) {
                    first_of[j] = first as u32;
                    stack.push(j);
                }
            }
        }
    }
    first_of
}
