//! As-rigid-as-possible positions of a graph's nodes (Sorkine and Alexa, *As-rigid-as-possible surface modeling*,
//! 2007), with the weights of the graph.
//!
//! The method goes back and forth between two easy steps. With positions fixed, the best rotation of each neighbourhood
//! is known in closed form; with rotations fixed, the best positions solve a linear system, whose matrix is the same in
//! all rounds. Each step lowers the energy, so that it comes to rest.

use geom_core::algebra::graph::VoxelGraph;
use geom_core::algebra::iterate::{self, conjugate_gradients};
use geom_core::algebra::{Cholesky, SparseMatrix};
use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, Vector3};

use crate::Error;
use crate::fit::nearest_rotation;

/// What conjugate gradients owe, relative to the right-hand side.
const TOLERANCE: iterate::Options = iterate::Options {
    tolerance: 1e-6,
    max_iterations: 2000,
};
/// A residual larger than this is no solution.
const POOR: f64 = 1e-3;
/// The number of a node that is held.
const HELD: u32 = u32::MAX;

/// `(D − W) X = B` for the nodes that are not held. Every part of the graph must hold one.
/// Without a held node the matrix of a part would have constants in its kernel.
pub(super) struct Solver {
    /// Number of each node among the free ones.
    place: Vec<u32>,
    free: Vec<u32>,
    matrix: SparseMatrix,
    /// Of the matrix, or of its diagonal.
    factor: Cholesky,
    pub(super) direct: bool,
}

impl Solver {
    /// Factors once, or beyond `direct_nodes` not at all.
    ///
    /// # Errors
    /// What refuses the matrix or its factor.
    pub(super) fn new(
        graph: &VoxelGraph,
        held: &[bool],
        direct_nodes: usize,
    ) -> Result<Self, Error> {
        let mut place = vec![HELD; graph.nodes()];
        let free: Vec<u32> = (0..graph.nodes() as u32)
            .filter(|&i| !held[i as usize])
            .collect();
        for (k, &i) in (0u32..).zip(&free) {
            place[i as usize] = k;
        }
        let mut entries = Vec::new();
        for (k, &i) in (0u32..).zip(&free) {
            let mut degree = 0.0;
            for (j, w) in graph.around(i as usize) {
                degree += w;
                if place[j] != HELD {
                    entries.push((k, place[j], -w));
                }
            }
            entries.push((k, k, degree));
        }
        let matrix = SparseMatrix::from_triplets(free.len(), free.len(), &entries)?;
        let direct = free.len() <= direct_nodes;
        let factor = if direct {
            Cholesky::of(&matrix)?
        } else {
            Cholesky::of(&SparseMatrix::diagonal_of(&matrix.diagonal()))?
        };
        Ok(Self {
            place,
            free,
            matrix,
            factor,
            direct,
        })
    }

    /// Moves the free nodes so that `Σ_j w (X_i − X_j) = rhs(i)` at each of them; the others stay. Where nothing is
    /// factored, the search starts where the nodes are.
    ///
    /// # Errors
    /// [`Error::NotSolved`] if conjugate gradients end far from the solution.
    pub(super) fn solve(
        &self,
        graph: &VoxelGraph,
        rhs: impl Fn(usize) -> Vector3 + Sync,
        positions: &mut [Point3],
    ) -> Result<(), Error> {
        if self.free.is_empty() {
            return Ok(());
        }
        let now = &*positions;
        let row = |&i: &u32| -> [f64; 3] {
            let mut b = rhs(i as usize);
            for (j, w) in graph.around(i as usize) {
                if self.place[j] == HELD {
                    b += now[j].coords * w;
                }
            }
            b.into()
        };
        let rows: Vec<[f64; 3]> = parallel::map_each(&self.free, row);
        let mut block = rows.into_flattened();
        if self.direct {
            self.factor.solve_in_place(&mut block, 3)?;
        } else {
            let start: Vec<f64> = self
                .free
                .iter()
                .flat_map(|&i| <[f64; 3]>::from(now[i as usize].coords))
                .collect();
            let image = self.matrix.multiply(&start, 3);
            let missing: Vec<f64> = block.iter().zip(&image).map(|(b, a)| b - a).collect();
            let found = conjugate_gradients(&self.matrix, &self.factor, &missing, 3, &TOLERANCE)?;
            let residual = found.residuals.iter().copied().fold(0.0, f64::max);
            if !(found.converged || residual < POOR) {
                return Err(Error::NotSolved { residual });
            }
            block = start
                .iter()
                .zip(&found.values)
                .map(|(x, d)| x + d)
                .collect();
        }
        for (&i, x) in self.free.iter().zip(block.as_chunks::<3>().0) {
            positions[i as usize] = Point3::from(*x);
        }
        Ok(())
    }

    /// Rotations of neighbourhoods and positions of free nodes in turn, until the energy `Σ w |X_i − X_j − R_i (P_i −
    /// P_j)|²` falls by less than `tolerance` of itself. Gives the number of rounds.
    pub(super) fn relax(
        &self,
        graph: &VoxelGraph,
        rest: &[Point3],
        positions: &mut [Point3],
        most: usize,
        tolerance: f64,
    ) -> Result<usize, Error> {
        let mut energy = f64::INFINITY;
        for round in 0..most {
            let rotations = rotations(graph, rest, positions);
            let now = distortion(graph, rest, positions, &rotations);
            if energy - now <= tolerance * energy && energy.is_finite() {
                return Ok(round);
            }
            energy = now;
            let rhs = |i: usize| {
                let edge = |(j, w): (usize, f64)| {
                    (rotations[i] + rotations[j]) * (rest[i] - rest[j]) * (0.5 * w)
                };
                graph.around(i).map(edge).sum()
            };
            self.solve(graph, rhs, positions)?;
        }
        Ok(most)
    }
}

/// `Σ_j w (X_i − X_j)(P_i − P_j)ᵀ`.
pub(super) fn covariance(
    graph: &VoxelGraph,
    rest: &[Point3],
    now: &[Point3],
    i: usize,
) -> Matrix3<f64> {
    let edge = |(j, w): (usize, f64)| (now[i] - now[j]) * (rest[i] - rest[j]).transpose() * w;
    graph.around(i).map(edge).sum()
}

/// The rotations of all neighbourhoods from `rest` to `now`.
#[cfg_attr(
    not(feature = "testing"),
    expect(unreachable_pub, reason = "tests ask for it")
)]
pub fn rotations(graph: &VoxelGraph, rest: &[Point3], now: &[Point3]) -> Vec<Matrix3<f64>> {
    let of = |i: usize| nearest_rotation(&covariance(graph, rest, now, i));
    parallel::map(rest.len(), of)
}

/// How far from rigid neighbourhoods are with these rotations.
#[cfg_attr(
    not(feature = "testing"),
    expect(unreachable_pub, reason = "tests ask for it")
)]
pub fn distortion(
    graph: &VoxelGraph,
    rest: &[Point3],
    now: &[Point3],
    rotations: &[Matrix3<f64>],
) -> f64 {
    parallel::sum(rest.len(), |i| {
        let left = |(j, w): (usize, f64)| {
            ((now[i] - now[j]) - rotations[i] * (rest[i] - rest[j])).norm_squared() * w
        };
        graph.around(i).map(left).sum()
    })
}
