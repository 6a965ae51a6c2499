//! The kernels on the GPU.
//!
//! What is counted is counted in whole numbers, as on the CPU: distances on the lattice and histograms are the same to
//! the last bit. The rest is in f32, relative to a mean that is taken off in f64. A GPU says which row is nearest; how
//! far it is the CPU finds from the numbers as they were given. Rotations come back as quaternions, which stay
//! rotations however they are rounded.

use bytemuck::{Pod, Zeroable};
use geom_core::compute::gpu::GpuBuffer;
use geom_core::compute::parallel;
use geom_core::nalgebra::{Matrix3, Quaternion, UnitQuaternion};
use geom_core::shaders::{
    SPECTRAL_CORRESP_DISTANCES, SPECTRAL_CORRESP_HISTOGRAMS, SPECTRAL_CORRESP_NEAREST,
    SPECTRAL_CORRESP_ROTATIONS, SPECTRAL_CORRESP_SWEEP,
};
use geom_core::{GpuContext, GpuError, Point3, Vector3, Wgpu};

use crate::Error;
use crate::backend::{CorrespBackend, HistogramTask, Nearest, RotationTask, Rows, SweepTask};
use crate::fit::Neighbourhoods;
use crate::start::Cells;

/// Differences of numbers per dispatch: what a driver lets run without a word.
/// A dispatch of queries is as long as the number of targets allows, and never shorter than 64 queries.
const DIFFERENCES: usize = 1 << 31;

/// More than any square of a distance on a lattice that fits a buffer, and its sum with one of them has 32 bits.
const FAR: u32 = 1 << 30;

/// A pass of the distances along one axis: points in all, points along the axis, and how far apart two of these are in
/// memory.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct DistancesHead {
    points: u32,
    count: u32,
    stride: u32,
    unused: u32,
}

/// Nodes, bars and radius, and the cubes by which nodes near by are found: see `Cells`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct HistogramsHead {
    nodes: u32,
    bars: u32,
    reach: u32,
    one: u32,
    low: [i32; 3],
    side: i32,
    cubes: [i32; 3],
    unused: u32,
}

/// How many rows there are on both sides, of how many numbers.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct NearestHead {
    queries: u32,
    targets: u32,
    width: u32,
    unused: u32,
}

/// The task of rotations and sweeps: how many nodes there are.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Head {
    nodes: u32,
    unused: [u32; 3],
}

impl Head {
    fn of(nodes: usize) -> Self {
        Self {
            nodes: nodes as u32,
            unused: [0; 3],
        }
    }
}

/// Workgroups of 64 for so many threads, within the limit of each dimension.
fn groups(threads: usize) -> [u32; 3] {
    let groups = threads.div_ceil(64);
    let x = groups.min(32_768);
    [x as u32, groups.div_ceil(x.max(1)) as u32, 1]
}

/// A vector and a number beside it, as shaders read them.
fn narrow(v: Vector3, last: f64) -> [f32; 4] {
    [v.x as f32, v.y as f32, v.z as f32, last as f32]
}

/// Relative to their mean: only differences are used, and they keep more digits.
fn centered(points: &[Point3]) -> Vec<[f32; 4]> {
    let mean =
        |axis: usize| parallel::sum(points.len(), |i| points[i][axis]) / points.len().max(1) as f64;
    let mean = Vector3::new(mean(0), mean(1), mean(2));
    points
        .iter()
        .map(|p| narrow(p.coords - mean, 0.0))
        .collect()
}

/// The buffers that describe a task.
/// In the order in which both kernels bind them: head, places at rest, places now, starts, neighbours.
fn uploaded(gpu: &GpuContext, task: &RotationTask<'_>) -> Result<[GpuBuffer; 5], GpuError> {
    let near: &Neighbourhoods = task.near;
    let starts: Vec<u32> = near.starts().iter().map(|&s| s as u32).collect();
    Ok([
        gpu.uniform("task", &Head::of(task.rest.len()))?,
        gpu.upload("rest", &centered(task.rest))?,
        gpu.upload("now", &centered(task.now))?,
        gpu.upload("starts", &starts)?,
        gpu.upload("others", near.others())?,
    ])
}

impl CorrespBackend for Wgpu {
    fn squared_distances(
        &self,
        counts: [usize; 3],
        inside: &[bool],
        out: &mut Vec<u32>,
    ) -> Result<(), Error> {
        out.clear();
        if inside.is_empty() {
            return Ok(());
        }
        let gpu = self.gpu();
        let far = |&inside: &bool| if inside { FAR } else { 0 };
        let first: Vec<u32> = parallel::map_each(inside, far);
        let mut buffers = [
            gpu.upload("squares", &first)?,
            gpu.output::<u32>("squares", inside.len())?,
        ];
        // Nothing goes to and fro between the passes.
        for (count, stride) in [
            (counts[0], 1),
            (counts[1], counts[0]),
            (counts[2], counts[0] * counts[1]),
        ] {
            let head = DistancesHead {
                points: inside.len() as u32,
                count: count as u32,
                stride: stride as u32,
                unused: 0,
            };
            let head = gpu.uniform("task", &head)?;
            let [before, after] = &buffers;
            gpu.dispatch(
                &SPECTRAL_CORRESP_DISTANCES,
                &[&head, before, after],
                groups(inside.len()),
            )?;
            buffers.swap(0, 1);
        }
        *out = gpu.download(&buffers[0])?;
        Ok(())
    }

    fn histograms(&self, task: &HistogramTask<'_>, out: &mut Vec<u32>) -> Result<(), Error> {
        let (gpu, nodes, bars) = (self.gpu(), task.points.len(), task.bars);
        out.clear();
        if nodes == 0 {
            return Ok(());
        }
        let cells = Cells::of(task.points, task.reach);
        let head = HistogramsHead {
            nodes: nodes as u32,
            bars: bars as u32,
            reach: task.reach,
            one: task.one,
            low: cells.low,
            side: cells.side,
            cubes: cells.counts.map(|n| n as i32),
            unused: 0,
        };
        let row = |&n: &u32| {
            let [x, y, z] = task.points[n as usize];
            [x, y, z, task.places[n as usize] as i32]
        };
        let points: Vec<[i32; 4]> = cells.order.iter().map(row).collect();
        let head = gpu.uniform("task", &head)?;
        let points = gpu.upload("points", &points)?;
        let starts = gpu.upload("starts", &cells.starts)?;
        let rows = gpu.output::<u32>("rows", nodes * bars)?;
        let buffers = [&head, &points, &starts, &rows];
        // A group per node.
        gpu.dispatch(&SPECTRAL_CORRESP_HISTOGRAMS, &buffers, groups(64 * nodes))?;
        out.resize(nodes * bars, 0);
        let rows = gpu.download::<u32>(&rows)?;
        for (row, &node) in rows.chunks(bars).zip(&cells.order) {
            out[node as usize * bars..][..bars].copy_from_slice(row);
        }
        Ok(())
    }

    fn nearest(
        &self,
        queries: Rows<'_>,
        targets: Rows<'_>,
        out: &mut Vec<Nearest>,
    ) -> Result<(), Error> {
        out.clear();
        if targets.is_empty() || queries.is_empty() {
            return Ok(());
        }
        let gpu = self.gpu();
        let (width, count) = (targets.width, targets.len());
        let mean = |c: usize| parallel::sum(count, |t| targets.row(t)[c]) / count as f64;
        let means: Vec<f64> = (0..width).map(mean).collect();
        let column = |rows: Rows<'_>, i: usize, c: usize| (rows.row(i)[c] - means[c]) as f32;
        let rows = (0..count).flat_map(|t| (0..width).map(move |c| (t, c)));
        let rows: Vec<f32> = rows.map(|(t, c)| column(targets, t, c)).collect();
        let there = gpu.upload("targets", &rows)?;
        let most = (DIFFERENCES / (count * width)).max(64);
        for first in (0..queries.len()).step_by(most) {
            let part = first..(first + most).min(queries.len());
            let columns = (0..width).flat_map(|c| part.clone().map(move |q| (q, c)));
            let columns: Vec<f32> = columns.map(|(q, c)| column(queries, q, c)).collect();
            let head = NearestHead {
                queries: part.len() as u32,
                targets: count as u32,
                width: width as u32,
                unused: 0,
            };
            let head = gpu.uniform("task", &head)?;
            let here = gpu.upload("queries", &columns)?;
            let found = gpu.output::<u32>("nearest", part.len())?;
            gpu.dispatch(
                &SPECTRAL_CORRESP_NEAREST,
                &[&head, &here, &there, &found],
                groups(part.len()),
            )?;
            // How far it is, from the numbers as they were given.
            let distance = |q: usize, t: usize| {
                let pairs = queries.row(q).iter().zip(targets.row(t));
                pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
            };
            let found = gpu.download::<u32>(&found)?;
            out.extend(part.zip(found).map(|(q, index)| Nearest {
                index,
                distance: distance(q, index as usize),
            }));
        }
        Ok(())
    }

    fn rotations(&self, task: &RotationTask<'_>, out: &mut Vec<Matrix3<f64>>) -> Result<(), Error> {
        let (gpu, nodes) = (self.gpu(), task.rest.len());
        let [head, rest, now, starts, others] = uploaded(gpu, task)?;
        let found = gpu.output::<[f32; 4]>("rotations", nodes)?;
        gpu.dispatch(
            &SPECTRAL_CORRESP_ROTATIONS,
            &[&head, &rest, &now, &starts, &others, &found],
            groups(nodes),
        )?;
        let found = gpu.download::<[f32; 4]>(&found)?;
        out.clear();
        out.extend(found.into_iter().map(|q| {
            let [w, x, y, z] = q.map(f64::from);
            let unit = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            unit.to_rotation_matrix().into_inner()
        }));
        Ok(())
    }

    fn sweep(&self, task: &SweepTask<'_>, out: &mut Vec<Point3>) -> Result<(), Error> {
        let (gpu, shape) = (self.gpu(), &task.shape);
        let nodes = shape.rest.len();
        let [head, rest, now, starts, others] = uploaded(gpu, shape)?;
        let rows = task.rotations.iter().flat_map(|r| {
            [0, 1, 2].map(|row| narrow(Vector3::new(r[(row, 0)], r[(row, 1)], r[(row, 2)]), 0.0))
        });
        let rotations = gpu.upload("rotations", &rows.collect::<Vec<_>>())?;
        let towards = task.targets.iter().zip(shape.now).zip(task.pull);
        let towards: Vec<[f32; 4]> = towards
            .map(|((to, now), &pull)| narrow(to - now, pull))
            .collect();
        let targets = gpu.upload("targets", &towards)?;
        let moves = gpu.output::<[f32; 4]>("moves", nodes)?;
        let buffers = [
            &head, &rest, &now, &starts, &others, &rotations, &targets, &moves,
        ];
        gpu.dispatch(&SPECTRAL_CORRESP_SWEEP, &buffers, groups(nodes))?;
        let moves = gpu.download::<[f32; 4]>(&moves)?;
        out.clear();
        out.extend(shape.now.iter().zip(moves).map(|(now, [x, y, z, _])| {
            now + Vector3::new(f64::from(x), f64::from(y), f64::from(z))
        }));
        Ok(())
    }
}
