//! Single steps, for tests.

use geom_core::algebra::graph::VoxelGraph;
use geom_core::nalgebra::Matrix3;
use geom_core::{Cpu, Point3, Run, Vector3};

use crate::backend::CorrespBackend;
use crate::error::Error;
use crate::fit::{self, Schedule, Side};
use crate::shape::VoxelShape;
use crate::{correspond, morph};

/// Pairs of nodes that two maps of boundary nodes link, each once.
pub fn links(a: &VoxelShape, b: &VoxelShape, forward: &[u32], backward: &[u32]) -> Vec<(u32, u32)> {
    correspond::links(a, b, forward, backward)
}

/// Where the nodes of a side go on another, all normals along z, from where they are, and the score: in one stage of a
/// radius (Å), so many rounds and so many pairs per node. Nodes with an anchor have a place of their own.
pub fn anneal(
    sides: [&[Point3]; 2],
    anchors: &[(u32, Point3)],
    (radius, rounds, pairs): (f64, usize, usize),
) -> Result<(Vec<Point3>, f64), Error> {
    let [a, b] = sides.map(|points| Side {
        points: points.to_vec(),
        normals: vec![Vector3::z(); points.len()],
    });
    let schedule = Schedule::of(&a, &[fit::stage(radius, rounds, pairs)], 1)?;
    let backend: &dyn CorrespBackend = &Cpu;
    let images = a.points.clone();
    let fit = fit::anneal(&a, &b, images, anchors, &schedule, Run::on(backend))?;
    Ok((fit.images, fit.score))
}

/// The rotations of all neighbourhoods from `rest` to `now`.
pub fn rotations(graph: &VoxelGraph, rest: &[Point3], now: &[Point3]) -> Vec<Matrix3<f64>> {
    morph::rotations(graph, rest, now)
}

/// How far from rigid neighbourhoods are with these rotations.
pub fn distortion(
    graph: &VoxelGraph,
    rest: &[Point3],
    now: &[Point3],
    rotations: &[Matrix3<f64>],
) -> f64 {
    morph::distortion(graph, rest, now, rotations)
}
