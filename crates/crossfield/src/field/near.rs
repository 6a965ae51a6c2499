//! Singular vertices too near to each other.
//!
//! Distances along edges between vertices do not change while singularities move about. So those that are known are
//! kept from one question to the next, and only from vertices that were not singular before is the graph searched, as
//! far as `apart`. And changes of period jumps that are so far from each other that they can be made together.

use geom_core::compute::parallel;
use geom_core::surface::distance::Searches;

use super::frames::{Frames, previous};
use crate::Error;

/// Pairs of singular vertices near to each other.
#[derive(Default)]
pub(super) struct Near {
    /// What they were of, ascending.
    of: Vec<u32>,
    /// With their distances.
    pairs: Vec<(f64, u32, u32)>,
}

impl Near {
    /// Those nearer to each other than `apart`, the nearest first; two that are stuck are none.
    pub(super) fn pairs(
        &mut self,
        searches: &Searches<'_>,
        singular: &[u32],
        apart: f64,
        stuck: &[bool],
    ) -> Result<Vec<(u32, u32)>, Error> {
        let is_singular = |v: u32| singular.binary_search(&v).is_ok();
        self.pairs.retain(|p| is_singular(p.1) && is_singular(p.2));
        let new: Vec<u32> = singular
            .iter()
            .copied()
            .filter(|v| self.of.binary_search(v).is_err())
            .collect();
        let found: Vec<Result<_, Error>> = parallel::map_each(&new, |&v| {
            searches.with(|search| {
                let (paths, reached) = search.paths_from(&[(v, 0.0)], apart)?;
                let near = reached.iter().filter(|&&u| is_singular(u) && u != v);
                // Of two new ones each pair once.
                let others = near.filter(|&u| *u > v || new.binary_search(u).is_err());
                let pairs = others.map(|&u| (paths.distance[u as usize], u.min(v), u.max(v)));
                Ok(pairs.filter(|pair| pair.0 < apart).collect::<Vec<_>>())
            })
        });
        for pairs in found {
            self.pairs.extend(pairs?);
        }
        self.of = singular.to_vec();
        self.pairs
            .sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let open = |p: &&(f64, u32, u32)| !(stuck[p.1 as usize] && stuck[p.2 as usize]);
        let open = self.pairs.iter().filter(open);
        Ok(open.map(|p| (p.1, p.2)).collect())
    }
}

/// Places of a surface that are taken, and what is near to them.
pub(super) struct Taken<'a> {
    frames: &'a Frames,
    rings: usize,
    /// Per vertex.
    near: Vec<bool>,
}

impl<'a> Taken<'a> {
    /// None yet; `rings` edges from one are near.
    pub(super) fn new(frames: &'a Frames, rings: usize) -> Self {
        Self {
            frames,
            rings,
            near: vec![false; frames.edges().vertices()],
        }
    }

    /// Takes some vertices, unless one of them is near to those taken before.
    pub(super) fn take(&mut self, vertices: &[usize]) -> bool {
        if vertices.iter().any(|&v| self.near[v]) {
            return false;
        }
        let mut front = vertices.to_vec();
        front.iter().for_each(|&v| self.near[v] = true);
        for _ in 0..self.rings {
            let mut next = Vec::new();
            for v in front {
                let frames = self.frames;
                for h in frames.around(v) {
                    // Of a fan at a boundary, the last half-edge leads back to the vertex.
                    for u in [frames.to(h), frames.from(previous(h))] {
                        if !std::mem::replace(&mut self.near[u], true) {
                            next.push(u);
                        }
                    }
                }
            }
            front = next;
        }
        true
    }
}
