//! Colours such that neighbours differ: sweeps over one colour at a time read nothing that they
//! write, so that their result does not depend on threads.

/// A colour per node; no two neighbours have the same. Every node has one, also those without neighbours, which are of
/// colour 0.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Coloring {
    /// Colour per node, from 0.
    pub color: Vec<u32>,
    /// The nodes of each colour, in order.
    pub groups: Vec<Vec<u32>>,
}

impl Coloring {
    /// Each node, in order, gets the lowest colour that no neighbour has yet; at most one colour
    /// more than the largest number of neighbours. `neighbors` must name nodes below `nodes`; links
    /// count in both directions if both are given.
    ///
    /// ```
    /// use geom_core::compute::coloring::Coloring;
    /// // A ring of five needs three.
    /// let ring = Coloring::greedy(5, |v| [(v + 4) % 5, (v + 1) % 5]);
    /// assert_eq!(ring.color, [0, 1, 0, 1, 2]);
    /// assert_eq!(ring.groups, [vec![0, 2], vec![1, 3], vec![4]]);
    /// ```
    ///
    /// Time is that of asking every node once for its neighbours. The order of the nodes decides the number of colours,
    /// which is not the least there is.
    pub fn greedy<I: IntoIterator<Item = u32>>(nodes: usize, neighbors: impl Fn(u32) -> I) -> Self {
        const NONE: u32 = u32::MAX;
        let mut color = vec![NONE; nodes];
        let mut groups: Vec<Vec<u32>> = Vec::new();
        // Which node last met each colour among its neighbours.
        let mut met: Vec<u32> = Vec::new();
        for v in 0..nodes as u32 {
            for w in neighbors(v) {
                let c = color[w as usize];
                if c != NONE && w != v {
                    met[c as usize] = v;
                }
            }
            let free = met.iter().position(|&last| last != v).unwrap_or(met.len());
            if free == met.len() {
                met.push(NONE);
                groups.push(Vec::new());
            }
            color[v as usize] = free as u32;
            groups[free].push(v);
        }
        Self { color, groups }
    }
}
