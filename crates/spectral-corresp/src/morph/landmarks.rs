//! Landmarks: nodes that the morph leads, all others follow (Eqs. 6.13–6.14).

use geom_core::Point3;
use geom_core::algebra::graph::VoxelGraph;
use geom_core::compute::parallel;
use geom_core::search::nearest::PointTree;

use super::solve::Solver;
use crate::Error;
use crate::shape::{Parts, VoxelShape};

/// The extrema of the harmonic function `W h = ρ − mean(ρ)`, `ρ_i = |(W x)_i|` with `W` the weights less their sums on
/// the diagonal: its minima lie at the tips, its maxima deep inside. A node counts if no other within `radius` is as
/// extreme; of equal ones the first.
/// Ascending. ρ is what is missing around a node, nearly nothing inside and much at tips and edges; it is made free of
/// its mean over each part, since the matrix has constants in its kernel.
pub(super) fn harmonic(
    graph: &VoxelGraph,
    rest: &[Point3],
    parts: &Parts,
    radius: f64,
    solver: &Solver,
) -> Result<Vec<u32>, Error> {
    let reach = |i: usize| {
        let edge = |(j, w): (usize, f64)| (rest[j] - rest[i]) * w;
        graph.around(i).map(edge).sum::<geom_core::Vector3>().norm()
    };
    let mut rho: Vec<f64> = parallel::map(rest.len(), reach);
    parts.subtract_means(&mut rho);
    // The solver is for three columns and for the sums less the weights.
    let mut h = vec![Point3::origin(); rest.len()];
    solver.solve(
        graph,
        |i| geom_core::Vector3::new(-rho[i], 0.0, 0.0),
        &mut h,
    )?;
    let mut h: Vec<f64> = h.iter().map(|p| p.x).collect();
    parts.subtract_means(&mut h);
    let tree = PointTree::of_positions(rest)?;
    let is_extreme = |&i: &u32| {
        let here = h[i as usize];
        let p = rest[i as usize];
        let near = tree.within(&[p.x, p.y, p.z], radius);
        let others = || near.iter().map(|n| n.index).filter(|&j| j != i);
        let wins = |sign: f64| {
            others().all(|j| {
                let (a, b) = (sign * here, sign * h[j as usize]);
                a > b || (a == b && i < j)
            })
        };
        wins(1.0) || wins(-1.0)
    };
    Ok(parallel::flat_map(rest.len(), |i| {
        Some(i as u32).filter(is_extreme)
    }))
}

/// Given landmarks as those of the second shape: of its nodes the nearest to each image, which goes to where the landmark
/// came from.
/// So that both ways of a morph are led by the same places.
pub(super) fn turned(
    given: &[(u32, Point3)],
    a: &VoxelShape,
    b: &VoxelShape,
) -> Result<Vec<(u32, Point3)>, Error> {
    let nodes: Vec<Point3> = (0..b.nodes()).map(|i| b.position(i)).collect();
    let tree = PointTree::of_positions(&nodes)?;
    let turn = |(node, image): &(u32, Point3)| {
        let near = tree.nearest(&[image.x, image.y, image.z], 1);
        let to = near.first().map_or(0, |n| n.index);
        let offset = nodes[to as usize] - image;
        (to, a.position(*node as usize) + offset)
    };
    Ok(given.iter().map(turn).collect())
}
