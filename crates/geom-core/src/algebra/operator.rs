//! What the solver multiplies with: a sparse matrix, or a graph Laplacian with the memory of a stencil.
//!
//! A graph of millions of voxels has up to 26 entries per row, all of them one of three weights. Stored as a matrix
//! they would take twelve bytes each; here they are looked up through the lattice, and only what no stencil has (the
//! diagonal, links between graphs) is a matrix.

use std::borrow::Cow;

use crate::algebra::graph::{Laplacian, VoxelGraph};
use crate::algebra::{self, SparseMatrix};

/// A symmetric operator on vectors of `rows` numbers: a [`SparseMatrix`] or a [`Laplacian`].
///
/// It is small and copied freely, and verbs take `impl Into<Operator>`: hand over `&matrix` or `&laplacian`. Symmetry
/// is not checked here.
#[derive(Clone, Copy, Debug)]
pub struct Operator<'a> {
    matrix: &'a SparseMatrix,
    /// The weights of these graphs, one graph after the other along the diagonal, are subtracted.
    graphs: &'a [VoxelGraph],
    is_graph: bool,
}

impl<'a> From<&'a SparseMatrix> for Operator<'a> {
    fn from(matrix: &'a SparseMatrix) -> Self {
        Self {
            matrix,
            graphs: &[],
            is_graph: false,
        }
    }
}

impl<'a> From<&'a Laplacian> for Operator<'a> {
    fn from(laplacian: &'a Laplacian) -> Self {
        Self {
            matrix: laplacian.matrix(),
            graphs: laplacian.graphs(),
            is_graph: true,
        }
    }
}

impl<'a> Operator<'a> {
    /// Number of rows.
    pub fn rows(self) -> usize {
        self.matrix.rows()
    }

    /// `A X` for a block of `columns` vectors. Parallel by rows: the bits do not depend on the number of threads.
    ///
    /// # Panics
    /// If the block does not have `rows · columns` values.
    pub fn multiply(self, block: &[f64], columns: usize) -> Vec<f64> {
        let mut out = self.matrix.multiply(block, columns);
        let mut first = 0;
        for graph in self.graphs {
            let range = first * columns..(first + graph.nodes()) * columns;
            graph.subtract_product(&block[range.clone()], columns, &mut out[range]);
            first += graph.nodes();
        }
        out
    }

    /// The diagonal.
    pub fn diagonal(self) -> Vec<f64> {
        self.matrix.diagonal()
    }

    /// The rows and columns of some nodes, which must ascend and have no neighbours but each other. A connected part
    /// has no others: nothing is cut.
    pub(super) fn part(self, nodes: &[u32]) -> Laplacian {
        let mut first = 0;
        let mut at = 0;
        let mut graphs = Vec::new();
        for graph in self.graphs {
            let end = first + graph.nodes() as u32;
            let count = nodes[at..].partition_point(|&i| i < end);
            let own: Vec<u32> = nodes[at..at + count].iter().map(|&i| i - first).collect();
            graphs.push(graph.part(&own));
            (first, at) = (end, at + count);
        }
        Laplacian::of_parts(self.matrix.principal(nodes), graphs)
    }

    /// Does it come from a [`Laplacian`]?
    pub fn is_graph(self) -> bool {
        self.is_graph
    }

    /// Its matrix; of a [`Laplacian`] what the graphs leave.
    pub fn matrix(self) -> &'a SparseMatrix {
        self.matrix
    }

    /// The graphs whose weights are subtracted, one after the other along the diagonal.
    pub fn graphs(self) -> &'a [VoxelGraph] {
        self.graphs
    }

    /// Columns and values of a row, in no particular order.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(self, row: usize) -> impl Iterator<Item = (usize, f64)> + 'a {
        let mut first = 0;
        let mut own = None;
        for graph in self.graphs {
            if row < first + graph.nodes() {
                own = Some((graph, first));
                break;
            }
            first += graph.nodes();
        }
        let voxels = own.into_iter().flat_map(move |(graph, first)| {
            graph.around(row - first).map(move |(j, w)| (first + j, -w))
        });
        self.matrix.row(row).chain(voxels)
    }

    /// The same as one sparse matrix. For what needs entries at hand: factors and small dense inverses. A graph then
    /// takes the memory that it was spared.
    pub(crate) fn assembled(self) -> Result<Cow<'a, SparseMatrix>, algebra::Error> {
        if self.graphs.is_empty() {
            return Ok(Cow::Borrowed(self.matrix));
        }
        SparseMatrix::written(self.rows(), self.rows(), |i, out| {
            out.extend(self.row(i).map(|(j, a)| (j as u32, a)));
        })
        .map(Cow::Owned)
    }
}
