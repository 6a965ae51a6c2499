//! Weighted graphs and their Laplacians: voxel sets with a stencil, any weights, and both joined.
//!
//! With weights `w ≥ 0` and degrees `d = Σ w`, the Laplacian is `K = D − W`; its rows sum to zero. The
//! normalized one, `1 − D^(−1/2) W D^(−1/2)` (Eq. 6.2, see "Reading the thesis"), has the eigenvalues of
//! the pencil `K x = λ D x`, and eigenvectors `V = D^(1/2) x`. So one matrix serves both, and only the
//! mass differs: [`Laplacian::mass`] or [`Laplacian::degree_mass`].
//!
//! ```
//! use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
//! // Three voxels in a row, and a lattice point beside them that belongs to none.
//! let row = VoxelGraph::new([4, 1, 1], &[true, true, true, false], Neighbours::Six, [1.0; 3])?;
//! let laplacian = Laplacian::of_voxels(row);
//! assert_eq!(laplacian.degrees(), [1.0, 2.0, 1.0]);
//! # Ok::<(), geom_core::algebra::graph::Error>(())
//! ```

use rayon::prelude::*;

use crate::algebra::Mass;
use crate::algebra::{self, SparseMatrix};

/// No node at a lattice point.
const NONE: u32 = u32::MAX;
/// Nodes per task. Not part of the result.
const NODES: usize = 2048;

/// Why a graph cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The flags do not fit the lattice.
    #[error("{found} flags for a lattice of {expected} points")]
    Flags {
        /// Flags given.
        found: usize,
        /// Points of the lattice.
        expected: u128,
    },
    /// The set fills too large a part of space for 32-bit places.
    #[error("a voxel set of {points} lattice points in its bounds; at most 2³² − 2 can be named")]
    TooLarge {
        /// Points in the bounds, with a margin of one.
        points: u128,
    },
    /// A weight is negative or not finite.
    #[error("the weight between {from} and {to} is {weight}; weights are finite and not negative")]
    Weight {
        /// First node; for a stencil 0.
        from: usize,
        /// Second node; for a stencil the number of the class (0 face, 1 edge, 2 corner).
        to: usize,
        /// The weight.
        weight: f64,
    },
    /// The links have another size than the graphs together.
    #[error("links of {found} nodes for graphs of {expected} nodes in all")]
    Links {
        /// Rows of the links.
        found: usize,
        /// Nodes of the graphs.
        expected: usize,
    },
    /// The weights are not a symmetric matrix.
    #[error(transparent)]
    Matrix(#[from] algebra::Error),
}

/// Which lattice points are neighbours.
///
/// More neighbours make distances along the graph, and its modes, depend less on the directions of the axes, and
/// products slower.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Neighbours {
    /// Those across a face.
    Six,
    /// Those across a face or an edge.
    Eighteen,
    /// Those across a face, an edge or a corner.
    #[default]
    TwentySix,
}

impl Neighbours {
    /// Distance classes in use: faces, edges, corners.
    fn classes(self) -> usize {
        match self {
            Self::Six => 1,
            Self::Eighteen => 2,
            Self::TwentySix => 3,
        }
    }
}

/// A set of voxels as a graph. Nodes are numbered as their points lie in the lattice (first axis
/// fastest). Neighbours are looked up through the lattice: four bytes per point of the set's bounds
/// and four per node, no stored weights.
///
/// The bounds have a margin of one point on all sides, which belongs to no node: every neighbour of a node is a place
/// in them, and no look-up has to ask whether it leaves the lattice. A slanted, thin set in a large box pays for the
/// box.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelGraph {
    /// Place of each node in the padded bounds, ascending.
    places: Vec<u32>,
    /// Node at each place of the padded bounds, or `NONE`.
    node_at: Vec<u32>,
    /// Padded bounds.
    size: [usize; 3],
    /// Lattice point of the first place.
    corner: [i64; 3],
    /// Offsets of the neighbours in the padded bounds and their class, by class.
    stencil: Vec<(isize, usize)>,
    /// Weight of each class in use.
    weights: Vec<f64>,
}

/// A [`VoxelGraph`] as kernels see it: the neighbours of node `i` are the nodes at `places[i] + offset` for each
/// entry of the stencil.
#[derive(Clone, Debug, PartialEq)]
pub struct StencilTables<'a> {
    /// Place of each node in the bounds, which have a margin of one, ascending.
    pub places: &'a [u32],
    /// The node at each place of the bounds, or `u32::MAX`.
    pub node_at: &'a [u32],
    /// Offset of each neighbour and the weight of the edge to it.
    pub stencil: Vec<(i32, f32)>,
}

impl VoxelGraph {
    /// The graph of the points with `inside[i + nx (j + ny k)]`, for a lattice of `counts = [nx, ny,
    /// nz]` points. `weights` are those across a face, an edge and a corner, of which
    /// `neighbours` uses the first one, two or three; `exp(−1), exp(−2), exp(−3)` is the Gaussian of
    /// the distance in units of the spacing (Eq. 6.1).
    ///
    /// # Errors
    /// [`Error::Flags`], [`Error::Weight`] for a weight in use, [`Error::TooLarge`] for the bounds.
    pub fn new(
        counts: [usize; 3],
        inside: &[bool],
        neighbours: Neighbours,
        weights: [f64; 3],
    ) -> Result<Self, Error> {
        let expected = counts
            .iter()
            .fold(1u128, |n, &c| n.saturating_mul(c as u128));
        if inside.len() as u128 != expected {
            let found = inside.len();
            return Err(Error::Flags { found, expected });
        }
        if let Some(to) =
            (0..neighbours.classes()).find(|&c| !(weights[c] >= 0.0 && weights[c].is_finite()))
        {
            let weight = weights[to];
            return Err(Error::Weight {
                from: 0,
                to,
                weight,
            });
        }
        let [nx, ny, _] = counts;
        let point = |at: usize| [at % nx, at / nx % ny, at / nx / ny];
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for (at, _) in inside.iter().enumerate().filter(|&(_, &i)| i) {
            let p = point(at);
            for axis in 0..3 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        if low[0] == usize::MAX {
            low = [0; 3];
            high = [0; 3];
        }
        let size = [0, 1, 2].map(|a| high[a] - low[a] + 3);
        let points: u128 = size.iter().map(|&s| s as u128).product();
        if points > crate::id::MAX_ELEMENTS as u128 {
            return Err(Error::TooLarge { points });
        }
        let mut node_at = vec![NONE; points as usize];
        let mut places = Vec::new();
        for (at, _) in inside.iter().enumerate().filter(|&(_, &i)| i) {
            let p = point(at);
            let [x, y, z] = [0, 1, 2].map(|a| p[a] - low[a] + 1);
            let place = x + size[0] * (y + size[1] * z);
            node_at[place] = places.len() as u32;
            places.push(place as u32);
        }
        Ok(Self {
            places,
            node_at,
            size,
            corner: low.map(|l| l as i64 - 1),
            stencil: stencil(size, neighbours),
            weights: weights[..neighbours.classes()].to_vec(),
        })
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.places.len()
    }

    /// The lattice point `[i, j, k]` of a node.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn point(&self, node: usize) -> [usize; 3] {
        let place = self.places[node] as usize;
        let [sx, sy, _] = self.size;
        let local = [place % sx, place / sx % sy, place / sx / sy];
        [0, 1, 2].map(|a| (local[a] as i64 + self.corner[a]) as usize)
    }

    /// The node at a lattice point, if the point belongs to the set. `None`, too, for points outside of the lattice.
    pub fn node(&self, point: [usize; 3]) -> Option<usize> {
        let mut place = 0;
        for axis in [2, 1, 0] {
            let local = usize::try_from(point[axis] as i64 - self.corner[axis]).ok()?;
            if local >= self.size[axis] {
                return None;
            }
            place = place * self.size[axis] + local;
        }
        let node = self.node_at[place];
        (node != NONE).then_some(node as usize)
    }

    /// The neighbours of a node and the weights of the edges to them, by class and place. Those across faces come
    /// first.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn around(&self, node: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let place = self.places[node] as isize;
        self.stencil
            .iter()
            .map(move |&(offset, class)| (self.node_at[(place + offset) as usize], class))
            .filter(|&(j, _)| j != NONE)
            .map(|(j, class)| (j as usize, self.weights[class]))
    }

    /// The sum of the weights at each node.
    pub fn degrees(&self) -> Vec<f64> {
        let mut degrees = vec![0.0; self.nodes()];
        self.subtract_product(&vec![-1.0; self.nodes()], 1, &mut degrees);
        degrees
    }

    /// `out ← out − W X`. Widths that the compiler knows are done in one go, others by eights through a copy, whose
    /// sums are rounded once more: the last bits of a column may depend on how many stand beside it.
    pub(crate) fn subtract_product<T: Real>(&self, block: &[T], columns: usize, out: &mut [T]) {
        match columns {
            0 => {}
            1 => self.subtract::<T, 1>(block, out),
            4 => self.subtract::<T, 4>(block, out),
            8 => self.subtract::<T, 8>(block, out),
            16 => self.subtract::<T, 16>(block, out),
            _ => {
                // In slices of a width that the compiler knows.
                let mut slice = vec![T::default(); self.nodes() * 8];
                let mut part = slice.clone();
                for first in (0..columns).step_by(8) {
                    let width = (columns - first).min(8);
                    for (to, from) in slice.chunks_mut(8).zip(block.chunks(columns)) {
                        to[..width].copy_from_slice(&from[first..first + width]);
                    }
                    part.fill(T::default());
                    self.subtract::<T, 8>(&slice, &mut part);
                    for (to, from) in out.chunks_mut(columns).zip(part.chunks(8)) {
                        for (to, &from) in to[first..first + width].iter_mut().zip(from) {
                            *to = *to + from;
                        }
                    }
                }
            }
        }
    }

    /// Class by class: neighbours of one class are added first and multiplied by their weight once. A neighbour that is
    /// not there reads a row of zeros, since `NONE` lies beyond all rows: no branch.
    fn subtract<T: Real, const C: usize>(&self, block: &[T], out: &mut [T]) {
        let (rows, _) = block.as_chunks::<C>();
        let (out, _) = out.as_chunks_mut::<C>();
        let classes: Vec<(T, Vec<isize>)> = (0..self.weights.len())
            .map(|class| {
                let offsets = self.stencil.iter().filter(|s| s.1 == class).map(|s| s.0);
                (T::from_f64(self.weights[class]), offsets.collect())
            })
            .collect();
        let zero = [T::default(); C];
        out.par_chunks_mut(NODES)
            .zip(self.places.par_chunks(NODES))
            .for_each(|(out, places)| {
                for (y, &place) in out.iter_mut().zip(places) {
                    for (weight, offsets) in &classes {
                        let mut sum = zero;
                        for &offset in offsets {
                            let j = self.node_at[(place as isize + offset) as usize];
                            let x = rows.get(j as usize).unwrap_or(&zero);
                            for c in 0..C {
                                sum[c] = sum[c] + x[c];
                            }
                        }
                        for c in 0..C {
                            y[c] = y[c] - *weight * sum[c];
                        }
                    }
                }
            });
    }

    /// The graph of some of the nodes, which must ascend.
    pub(super) fn part(&self, nodes: &[u32]) -> Self {
        let mut out = Self {
            places: nodes.iter().map(|&i| self.places[i as usize]).collect(),
            node_at: vec![NONE; self.node_at.len()],
            stencil: self.stencil.clone(),
            weights: self.weights.clone(),
            ..*self
        };
        for (i, &place) in (0u32..).zip(&out.places) {
            out.node_at[place as usize] = i;
        }
        out
    }

    /// The graph as a stencil on its bounds, for kernels. Weights are rounded to f32; an offset may be negative.
    pub fn tables(&self) -> StencilTables<'_> {
        let stencil = self
            .stencil
            .iter()
            .map(|&(offset, class)| (offset as i32, self.weights[class] as f32));
        StencilTables {
            places: &self.places,
            node_at: &self.node_at,
            stencil: stencil.collect(),
        }
    }
}

/// Offsets of the neighbours in bounds of this size, and their class, by class and place.
fn stencil(size: [usize; 3], neighbours: Neighbours) -> Vec<(isize, usize)> {
    let [sx, sy, _] = size.map(|s| s as isize);
    let mut out = Vec::with_capacity(26);
    for class in 0..neighbours.classes() {
        for z in -1isize..=1 {
            for y in -1isize..=1 {
                for x in -1isize..=1 {
                    if (x * x + y * y + z * z) as usize == class + 1 {
                        out.push((x + sx * (y + sy * z), class));
                    }
                }
            }
        }
    }
    out
}

/// f32 or f64.
pub(crate) trait Real:
    Copy
    + Default
    + Send
    + Sync
    + From<f32>
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
{
    fn from_f64(value: f64) -> Self;
}
impl Real for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }
}
impl Real for f32 {
    fn from_f64(value: f64) -> Self {
        value as f32
    }
}

/// The Laplacian `D − W` of a graph.
///
/// Positive semi-definite; its null space has one constant per connected part. The weights of stencils are never
/// stored: see [`Operator`](crate::algebra::Operator).
#[derive(Clone, Debug, PartialEq)]
pub struct Laplacian {
    /// `D` minus the weights that no stencil has.
    matrix: SparseMatrix,
    /// Voxel graphs whose nodes stand one graph after the other.
    graphs: Vec<VoxelGraph>,
    degrees: Vec<f64>,
}

impl Laplacian {
    /// Of a voxel set.
    pub fn of_voxels(graph: VoxelGraph) -> Self {
        let degrees = graph.degrees();
        Self {
            matrix: SparseMatrix::diagonal_of(&degrees),
            graphs: vec![graph],
            degrees,
        }
    }

    /// Of symmetric weights, finite and not negative. The diagonal does not count.
    ///
    /// # Errors
    /// Those of [`Laplacian::joint`].
    pub fn of_weights(weights: &SparseMatrix) -> Result<Self, Error> {
        Self::joint(Vec::new(), weights)
    }

    /// Of several voxel sets, one after the other, with weighted links between any two nodes: the
    /// joint graph of two shapes (Eqs. 6.5–6.6). `links` is symmetric over all nodes. Links add to what a stencil has
    /// between the same two nodes. With no graphs the links are all there is.
    ///
    /// # Errors
    /// [`Error::Matrix`] if links are not square, finite and symmetric, [`Error::Links`] and [`Error::Weight`].
    pub fn joint(graphs: Vec<VoxelGraph>, links: &SparseMatrix) -> Result<Self, Error> {
        links.check_hermitian()?;
        let (rows, nodes) = (links.rows(), graphs.iter().map(VoxelGraph::nodes).sum());
        if !graphs.is_empty() && rows != nodes {
            let (found, expected) = (rows, nodes);
            return Err(Error::Links { found, expected });
        }
        for from in 0..rows {
            if let Some((to, weight)) = links.row(from).find(|&(to, w)| to != from && w < 0.0) {
                return Err(Error::Weight { from, to, weight });
            }
        }
        let mut degrees: Vec<f64> = graphs.iter().flat_map(VoxelGraph::degrees).collect();
        degrees.resize(rows, 0.0);
        for (i, degree) in degrees.iter_mut().enumerate() {
            *degree += links
                .row(i)
                .filter(|&(j, _)| j != i)
                .map(|(_, w)| w)
                .sum::<f64>();
        }
        let matrix = SparseMatrix::written(rows, rows, |i, out| {
            out.push((i as u32, degrees[i]));
            let others = links.row(i).filter(|&(j, w)| j != i && w != 0.0);
            out.extend(others.map(|(j, w)| (j as u32, -w)));
        })?;
        Ok(Self {
            matrix,
            graphs,
            degrees,
        })
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.degrees.len()
    }

    /// The degree of each node.
    pub fn degrees(&self) -> &[f64] {
        &self.degrees
    }

    /// One per node: the eigenvectors of `D − W` itself.
    pub fn mass(&self) -> Mass {
        Mass::Lumped(vec![1.0; self.nodes()])
    }

    /// The degrees: the pencil of the normalized Laplacian. Nodes of degree zero are left out of it.
    pub fn degree_mass(&self) -> Mass {
        Mass::Lumped(self.degrees.clone())
    }

    /// A Laplacian of its parts: a matrix, whose diagonal holds the degrees, less the weights of the graphs.
    pub(super) fn of_parts(matrix: SparseMatrix, graphs: Vec<VoxelGraph>) -> Self {
        let degrees = matrix.diagonal();
        Self {
            matrix,
            graphs,
            degrees,
        }
    }

    pub(crate) fn matrix(&self) -> &SparseMatrix {
        &self.matrix
    }

    pub(crate) fn graphs(&self) -> &[VoxelGraph] {
        &self.graphs
    }
}
