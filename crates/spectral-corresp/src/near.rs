//! Who is near whom.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::compute::random::SplitMix64;
use geom_core::search::nearest::PointTree;

use crate::Error;

/// Who is near whom: a symmetric sample of the pairs of nodes within a radius.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Neighbourhoods {
    starts: Vec<usize>,
    others: Vec<u32>,
}

impl Neighbourhoods {
    /// About `per_node` of the pairs within `radius` of each point, the same for the same `seed`; all where there are
    /// fewer. A pair belongs to both of its points or to none.
    /// Whether a pair is in is decided by a hash of its two numbers, the lower one first, so that both of its points
    /// agree without asking each other. Time grows with the number of pairs within the radius, memory with those that
    /// are kept.
    ///
    /// # Errors
    /// Points that are not finite.
    pub fn within(
        points: &[Point3],
        radius: f64,
        per_node: usize,
        seed: u64,
    ) -> Result<Self, Error> {
        let tree = PointTree::of_positions(points)?;
        let around = |p: &Point3| tree.within(&[p.x, p.y, p.z], radius);
        // Counted first and found again: not all pairs are ever held at once.
        let counts: Vec<u32> = parallel::map_each(points, |p| around(p).len() as u32);
        let random = SplitMix64::new(seed);
        let is_in = |i: u32, j: u32| {
            let least = counts[i as usize].min(counts[j as usize]) - 1;
            let (low, high) = (u64::from(i.min(j)), u64::from(i.max(j)));
            let draw = random.nth(low.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ high) >> 11;
            (draw as f64) * (1.0 / (1u64 << 53) as f64) * f64::from(least) < per_node as f64
        };
        let rows: Vec<Vec<u32>> = parallel::map(points.len(), |i| {
            let others = around(&points[i]).into_iter().map(|n| n.index);
            let i = i as u32;
            let mut row: Vec<u32> = others.filter(|&j| j != i && is_in(i, j)).collect();
            row.sort_unstable();
            row
        });
        Ok(Self::of_rows(rows))
    }

    /// The others of each node.
    pub fn of_rows(rows: Vec<Vec<u32>>) -> Self {
        let counts: Vec<u32> = rows.iter().map(|r| r.len() as u32).collect();
        Self {
            starts: parallel::starts_of(&counts),
            others: rows.concat(),
        }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Is there no node?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The nodes near a node, ascending.
    pub fn of(&self, node: usize) -> &[u32] {
        &self.others[self.starts[node]..self.starts[node + 1]]
    }

    /// Where the neighbours of each node start in [`others`](Self::others), and the total at the end.
    pub fn starts(&self) -> &[usize] {
        &self.starts
    }

    /// The neighbours of all nodes, node after node.
    pub fn others(&self) -> &[u32] {
        &self.others
    }
}

/// The mean distance of points from the nearest other one.
/// 0 for fewer than two.
pub(crate) fn distance(points: &[Point3]) -> Result<f64, Error> {
    let tree = PointTree::of_positions(points)?;
    let nearest = |i: usize| {
        let p = points[i];
        let near = tree.nearest(&[p.x, p.y, p.z], 2);
        near.last().map_or(0.0, |n| n.distance)
    };
    Ok(parallel::sum(points.len(), nearest) / points.len().max(1) as f64)
}
