//! Distances along a surface: shortest paths over edges or over triangles, and geodesic distance.
//!
//! [`shortest_paths`] is fast, exact on its graph, and gives ways; [`Searches`] ask for many of them. Along edges ways are too
//! long in directions that edges do not take, by up to 15 % on equilateral triangles, however short they are. [`Heat`] is near
//! the true distance along the surface and gives no ways.

mod heat;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::{Mutex, PoisonError};

use crate::TriMesh;
use crate::algebra;
use crate::compute::parallel;
use crate::options::OutOfRange;
use crate::surface::laplace;

pub use heat::{Heat, HeatOptions};

/// "No node": the parent of a source, and of what no source reaches.
pub const NONE: u32 = u32::MAX;

/// Why distances cannot be found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DistanceError {
    /// A source is not a node.
    #[error("source {source_index} names node {node}, but there are only {nodes} nodes")]
    NoSuchNode {
        /// Which of the sources.
        source_index: usize,
        /// The node it names.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// A source starts at a negative distance or at none.
    #[error(
        "source {source_index} starts at distance {distance}; it must be finite and not negative"
    )]
    StartDistance {
        /// Which of the sources.
        source_index: usize,
        /// Its distance.
        distance: f64,
    },
    /// A link has a negative length or none.
    #[error("the link {from}–{to} has length {length}; it must be finite and not negative")]
    Length {
        /// One end.
        from: u32,
        /// The other end.
        to: u32,
        /// Its length.
        length: f64,
    },
    /// A link ends at no node.
    #[error("link {link} names node {node}, but there are only {nodes} nodes")]
    LinkOutOfRange {
        /// Which of the links.
        link: usize,
        /// The node it names.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// A set of sources is empty.
    #[error("set {set} has no source, so nothing has a distance from it")]
    NoSource {
        /// Which of the sets.
        set: usize,
    },
    /// An option makes no sense.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// The surface has no Laplace operator.
    #[error(transparent)]
    Operator(#[from] laplace::Error),
    /// The equations cannot be solved.
    #[error(transparent)]
    Factor(#[from] algebra::Error),
}

/// An undirected graph with a length per link.
///
/// 16 bytes per end of a link. The nodes are those of whatever was linked: vertices for [`Graph::of_edges`], triangles
/// for [`Graph::of_dual`].
#[derive(Clone, Debug, PartialEq)]
pub struct Graph {
    starts: Vec<usize>,
    links: Vec<(u32, f64)>,
}

impl Graph {
    /// The graph of these links `(a, b, length)`; of several links between the same nodes all are
    /// kept, of which only the shortest matters. A link from a node to itself is of no use and does no harm.
    ///
    /// # Errors
    /// [`DistanceError::LinkOutOfRange`] and [`DistanceError::Length`], for the first link at fault.
    pub fn new(nodes: usize, links: &[(u32, u32, f64)]) -> Result<Self, DistanceError> {
        let mut counts = vec![0u32; nodes];
        for (link, &(a, b, length)) in links.iter().enumerate() {
            for node in [a, b] {
                if node as usize >= nodes {
                    return Err(DistanceError::LinkOutOfRange { link, node, nodes });
                }
                counts[node as usize] += 1;
            }
            if !(length.is_finite() && length >= 0.0) {
                return Err(DistanceError::Length {
                    from: a,
                    to: b,
                    length,
                });
            }
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut out = vec![(0, 0.0); 2 * links.len()];
        for &(a, b, length) in links {
            for (from, to) in [(a, b), (b, a)] {
                out[next[from as usize]] = (to, length);
                next[from as usize] += 1;
            }
        }
        Ok(Self { starts, links: out })
    }

    /// The edges of a mesh between its vertices, with their lengths in Å.
    ///
    /// # Errors
    /// An edge whose length is too large for a number (coordinates above about 10¹⁵⁴) is named.
    pub fn of_edges(mesh: &TriMesh) -> Result<Self, DistanceError> {
        let mut edges: Vec<[u32; 2]> = mesh
            .triangles()
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let p = mesh.positions();
        let links: Vec<_> = edges
            .iter()
            .map(|&[a, b]| (a, b, (p[a as usize] - p[b as usize]).norm()))
            .collect();
        Self::new(p.len(), &links)
    }

    /// The triangles of a mesh, linked across their common edges; a link is as long as the way from
    /// centroid over the edge's midpoint to centroid, in Å. At an edge of more than two triangles
    /// all pairs are linked.
    ///
    /// # Errors
    /// A way whose length is too large for a number (coordinates above about 10¹⁵⁴) is named.
    pub fn of_dual(mesh: &TriMesh) -> Result<Self, DistanceError> {
        let mut sides: Vec<([u32; 2], u32)> = mesh
            .triangles()
            .iter()
            .enumerate()
            .flat_map(|(t, &[a, b, c])| {
                [[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], t as u32))
            })
            .collect();
        sides.sort_unstable();
        let p = mesh.positions();
        let centroid = |t: u32| {
            let [a, b, c] = mesh.corners(t as usize);
            (a.coords + b.coords + c.coords) / 3.0
        };
        let mut links = Vec::with_capacity(sides.len() / 2);
        for around in sides.chunk_by(|x, y| x.0 == y.0) {
            let [a, b] = around[0].0.map(|v| p[v as usize].coords);
            let middle = (a + b) / 2.0;
            for (i, &(_, s)) in around.iter().enumerate() {
                for &(_, t) in &around[i + 1..] {
                    links.push((
                        s,
                        t,
                        (centroid(s) - middle).norm() + (middle - centroid(t)).norm(),
                    ));
                }
            }
        }
        Self::new(mesh.triangles().len(), &links)
    }

    /// The number of nodes.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Has the graph no node?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The neighbours of a node with the lengths of the links.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn links(&self, node: u32) -> &[(u32, f64)] {
        &self.links[self.starts[node as usize]..self.starts[node as usize + 1]]
    }
}

/// Shortest paths from the nearest of several sources to every node. Three numbers per node: the ways of all nodes
/// together are a forest, rooted in the sources.
#[derive(Clone, Debug, PartialEq)]
pub struct Paths {
    /// Distance per node; infinite where no source reaches.
    pub distance: Vec<f64>,
    /// The node before, on the way from the source; [`NONE`] at sources and where none reaches. Of
    /// equally short ways the first found: nodes are settled by distance, then by number.
    pub parent: Vec<u32>,
    /// Which of the sources is nearest; [`NONE`] where none reaches.
    pub source: Vec<u32>,
}

impl Paths {
    /// The nodes from the nearest source to `node`, both included; empty when no source reaches it. Also empty for a
    /// number that is no node.
    pub fn to(&self, node: u32) -> Vec<u32> {
        let mut path = Vec::new();
        if self.source.get(node as usize).is_none_or(|&s| s == NONE) {
            return path;
        }
        let mut at = node;
        while at != NONE {
            path.push(at);
            at = self.parent[at as usize];
        }
        path.reverse();
        path
    }
}

/// Dijkstra's shortest paths from `sources`, each a node with the distance it starts at, as far as
/// `reach` (infinite for all): nodes farther away count as not reached. Who asks many times for what is near has
/// some [`Searches`].
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::distance::{Graph, shortest_paths};
/// let sphere = shapes::icosphere(1.0, 4);
/// let paths = shortest_paths(&Graph::of_edges(&sphere)?, &[(0, 0.0)], f64::INFINITY)?;
/// let farthest = paths.distance.iter().fold(0.0, |a: f64, &b| a.max(b));
/// assert!(farthest > 3.1 && farthest < 3.5); // π, and a little more along edges
/// # Ok::<(), geom_core::surface::distance::DistanceError>(())
/// ```
///
/// `O((n + m) log n)` for n nodes and m links, less with a short `reach`. Of two sources in one node the one that
/// starts nearer counts, of equal ones the first.
///
/// # Errors
/// [`DistanceError::NoSuchNode`] and [`DistanceError::StartDistance`], for the first source at fault.
pub fn shortest_paths(
    graph: &Graph,
    sources: &[(u32, f64)],
    reach: f64,
) -> Result<Paths, DistanceError> {
    let mut search = Dijkstra::new(graph);
    search.paths_from(sources, reach)?;
    Ok(search.paths)
}

/// [`shortest_paths`] of one graph again and again: a search costs what it reaches, not a look at every node. What was
/// searched with before serves the next search, on any thread.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::distance::{Graph, Searches};
/// let sphere = shapes::icosphere(1.0, 4);
/// let graph = Graph::of_edges(&sphere)?;
/// let searches = Searches::of(&graph);
/// for v in 0..10 {
///     searches.with(|search| {
///         let (paths, reached) = search.paths_from(&[(v, 0.0)], 0.2)?;
///         assert_eq!(paths.distance[v as usize], 0.0);
///         assert!(reached.len() < 100);
///         Ok::<(), geom_core::surface::distance::DistanceError>(())
///     })?;
/// }
/// # Ok::<(), geom_core::surface::distance::DistanceError>(())
/// ```
#[derive(Debug)]
pub struct Searches<'a> {
    graph: &'a Graph,
    /// Those that nobody has in hand: no more than there ever were at once.
    idle: Mutex<Vec<Dijkstra<'a>>>,
}

impl<'a> Searches<'a> {
    /// None yet; each takes 16 bytes per node.
    pub fn of(graph: &'a Graph) -> Self {
        Self {
            graph,
            idle: Mutex::default(),
        }
    }

    /// Lends a search.
    pub fn with<T>(&self, ask: impl FnOnce(&mut Dijkstra<'a>) -> T) -> T {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let used = idle().pop();
        let mut search = used.unwrap_or_else(|| Dijkstra::new(self.graph));
        let answer = ask(&mut search);
        idle().push(search);
        answer
    }
}

/// One of some [`Searches`].
#[derive(Clone, Debug)]
pub struct Dijkstra<'a> {
    graph: &'a Graph,
    paths: Paths,
    /// All that has an entry in `paths`.
    reached: Vec<u32>,
    /// Not negative, so the order of the bits is the order of the numbers.
    queue: BinaryHeap<Reverse<(u64, u32)>>,
}

impl<'a> Dijkstra<'a> {
    /// Nothing reached yet.
    fn new(graph: &'a Graph) -> Self {
        let nodes = graph.len();
        Self {
            graph,
            paths: Paths {
                distance: vec![f64::INFINITY; nodes],
                parent: vec![NONE; nodes],
                source: vec![NONE; nodes],
            },
            reached: Vec::new(),
            queue: BinaryHeap::new(),
        }
    }

    /// What [`shortest_paths`] answers, to the bit, and the nodes that are reached, in the order in which they were first
    /// seen.
    ///
    /// # Errors
    /// Those of [`shortest_paths`].
    pub fn paths_from(
        &mut self,
        sources: &[(u32, f64)],
        reach: f64,
    ) -> Result<(&Paths, &[u32]), DistanceError> {
        for node in self.reached.drain(..).map(|v| v as usize) {
            self.paths.distance[node] = f64::INFINITY;
            (self.paths.parent[node], self.paths.source[node]) = (NONE, NONE);
        }
        self.check(sources)?;
        for (i, &(node, distance)) in sources.iter().enumerate() {
            // −0.0 has another pattern of bits.
            self.reach(node, distance + 0.0, reach, NONE, i as u32);
        }
        while let Some(Reverse((bits, node))) = self.queue.pop() {
            let distance = f64::from_bits(bits);
            if distance > self.paths.distance[node as usize] {
                continue;
            }
            let source = self.paths.source[node as usize];
            for &(to, length) in self.graph.links(node) {
                self.reach(to, distance + length, reach, node, source);
            }
        }
        Ok((&self.paths, &self.reached))
    }

    fn check(&self, sources: &[(u32, f64)]) -> Result<(), DistanceError> {
        let nodes = self.graph.len();
        for (source_index, &(node, distance)) in sources.iter().enumerate() {
            if node as usize >= nodes {
                return Err(DistanceError::NoSuchNode {
                    source_index,
                    node,
                    nodes,
                });
            }
            if !(distance.is_finite() && distance >= 0.0) {
                return Err(DistanceError::StartDistance {
                    source_index,
                    distance,
                });
            }
        }
        Ok(())
    }

    /// Takes a way to a node, if it is the shortest so far and not too long.
    fn reach(&mut self, node: u32, distance: f64, reach: f64, parent: u32, source: u32) {
        let known = &mut self.paths.distance[node as usize];
        if distance < *known && distance <= reach {
            if known.is_infinite() {
                self.reached.push(node);
            }
            *known = distance;
            self.paths.parent[node as usize] = parent;
            self.paths.source[node as usize] = source;
            self.queue.push(Reverse((distance.to_bits(), node)));
        }
    }
}
