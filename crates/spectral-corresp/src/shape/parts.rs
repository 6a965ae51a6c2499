//! Connected parts of a shape, and paths through them.

use geom_core::algebra::graph::VoxelGraph;
use geom_core::{Point3, Vector3};

/// A node without another before it.
pub(crate) const ROOT: u32 = u32::MAX;

/// The nodes in an order in which each comes after one that it is joined to.
pub(crate) struct Parts {
    /// All nodes, part after part, each part breadth first from its first node.
    pub(crate) order: Vec<u32>,
    /// For each node the one from which it was reached.
    pub(crate) parent: Vec<u32>,
    /// Where each part starts in `order`.
    starts: Vec<usize>,
}

impl Parts {
    /// Breadth first: paths to the first node are as short as can be.
    pub(crate) fn of(graph: &VoxelGraph) -> Self {
        let nodes = graph.nodes();
        let (mut order, mut parent) = (Vec::with_capacity(nodes), vec![ROOT; nodes]);
        let (mut seen, mut starts) = (vec![false; nodes], Vec::new());
        for first in 0..nodes {
            if seen[first] {
                continue;
            }
            starts.push(order.len());
            seen[first] = true;
            let mut next = order.len();
            order.push(first as u32);
            while let Some(&node) = order.get(next) {
                next += 1;
                for (other, _) in graph.around(node as usize) {
                    if !seen[other] {
                        seen[other] = true;
                        parent[other] = node;
                        order.push(other as u32);
                    }
                }
            }
        }
        starts.push(order.len());
        Self {
            order,
            parent,
            starts,
        }
    }

    /// The nodes of each part.
    pub(crate) fn each(&self) -> impl Iterator<Item = &[u32]> {
        self.starts.windows(2).map(|s| &self.order[s[0]..s[1]])
    }

    /// The first node of each part.
    pub(crate) fn roots(&self) -> impl Iterator<Item = u32> {
        self.each().map(|part| part[0])
    }

    /// Makes the mean over each part zero.
    pub(crate) fn subtract_means(&self, values: &mut [f64]) {
        for part in self.each() {
            let sum: f64 = part.iter().map(|&i| values[i as usize]).sum();
            let mean = sum / part.len() as f64;
            part.iter().for_each(|&i| values[i as usize] -= mean);
        }
    }

    /// Shifts each part so that its mean is that of `(1 − t) a + t b`.
    pub(crate) fn center(&self, positions: &mut [Point3], a: &[Point3], b: &[Point3], t: f64) {
        for part in self.each() {
            let missing = part.iter().map(|&i| {
                let i = i as usize;
                a[i].coords * (1.0 - t) + b[i].coords * t - positions[i].coords
            });
            let shift = missing.sum::<Vector3>() / part.len() as f64;
            part.iter().for_each(|&i| positions[i as usize] += shift);
        }
    }
}
