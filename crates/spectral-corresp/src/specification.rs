//! The kernels as their equations read. Slow; for tests.
//!
//! Every pair of nodes and every row is looked at: no cells, no trees, no blocks. What the fast kernels owe to it
//! stands beside their trait in [`backend`](crate::backend).

use geom_core::nalgebra::Matrix3;
use geom_core::{Point3, Vector3};

use crate::backend::{HistogramTask, Nearest, RotationTask, Rows, SweepTask};

/// [`CorrespBackend::histograms`](crate::CorrespBackend::histograms) of one node: every node is looked at.
pub fn histogram(task: &HistogramTask<'_>, node: usize) -> Vec<u32> {
    let mut row = vec![0; task.bars];
    for (q, &place) in task.points.iter().zip(task.places) {
        let steps = task.points[node]
            .iter()
            .zip(q)
            .map(|(a, b)| i64::from(a - b));
        if steps.map(|d| d * d).sum::<i64>() <= i64::from(task.reach) {
            // Not above the last bar's middle, where all counts for it.
            let low = (place / task.one).min(task.bars as u32 - 2);
            let high = place - low * task.one;
            row[low as usize] += task.one - high;
            row[low as usize + 1] += high;
        }
    }
    row
}

/// [`CorrespBackend::squared_distances`](crate::CorrespBackend::squared_distances) by looking at every point outside, and at the first ring of points beyond the lattice.
/// One ring beyond is enough: what lies farther out is never nearer.
pub fn squared_distances(counts: [usize; 3], inside: &[bool]) -> Vec<u32> {
    let [nx, ny, nz] = counts.map(|n| n as i64);
    let is_outside = |[i, j, k]: [i64; 3]| {
        let within = (0..nx).contains(&i) && (0..ny).contains(&j) && (0..nz).contains(&k);
        !within || !inside[((k * ny + j) * nx + i) as usize]
    };
    let around = |[nx, ny, nz]: [i64; 3], first: i64| {
        let row = move |k| (first..ny).flat_map(move |j| (first..nx).map(move |i| [i, j, k]));
        (first..nz).flat_map(row)
    };
    let outside: Vec<[i64; 3]> = around([nx + 1, ny + 1, nz + 1], -1)
        .filter(|&p| is_outside(p))
        .collect();
    let square = |p: [i64; 3], q: &[i64; 3]| (0..3).map(|a| (q[a] - p[a]).pow(2)).sum::<i64>();
    let nearest = |p| outside.iter().map(|q| square(p, q)).min();
    around([nx, ny, nz], 0)
        .map(|p| nearest(p).unwrap_or(0) as u32)
        .collect()
}

/// [`CorrespBackend::nearest`](crate::CorrespBackend::nearest): every row is looked at.
/// `None` without rows.
pub fn nearest(query: &[f64], targets: Rows<'_>) -> Option<Nearest> {
    let distance = |i: usize| {
        let row = targets.row(i).iter().zip(query);
        row.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let all = (0..targets.len()).map(|i| (distance(i), i));
    let (distance, index) = all.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Nearest {
        index: index as u32,
        distance,
    })
}

/// [`CorrespBackend::rotations`](crate::CorrespBackend::rotations): `S = U Σ Vᵀ`, `R = U diag(1, 1, det(U Vᵀ)) Vᵀ`, the
/// third being the smallest singular value. Nothing without a second one: the rotation is not defined.
pub fn rotation(task: &RotationTask<'_>, i: usize) -> Option<Matrix3<f64>> {
    let pair = |&j: &u32| {
        let j = j as usize;
        (task.now[i] - task.now[j]) * (task.rest[i] - task.rest[j]).transpose()
    };
    let s: Matrix3<f64> = task.near.of(i).iter().map(pair).sum();
    let svd = s.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sorted = svd.singular_values;
    if sorted[1] <= 1e-3 * sorted[0] {
        return None;
    }
    let sign = (u * v_t).determinant().signum();
    Some(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t)
}

/// [`CorrespBackend::sweep`](crate::CorrespBackend::sweep).
/// The minimum over the place of one node of the energy with a pull, its neighbours and all rotations as they are.
pub fn sweep(task: &SweepTask<'_>, i: usize) -> Point3 {
    let shape = &task.shape;
    let near = shape.near.of(i);
    let wanted = |&j: &u32| {
        let j = j as usize;
        let turn = (task.rotations[i] + task.rotations[j]) * 0.5;
        shape.now[j].coords + turn * (shape.rest[i] - shape.rest[j])
    };
    let pull = task.pull[i];
    match (near.len(), pull > 0.0) {
        (0, true) => task.targets[i],
        (0, false) => shape.now[i],
        (n, _) => {
            let mean = near.iter().map(wanted).sum::<Vector3>() / n as f64;
            Point3::from((mean + task.targets[i].coords * pull) / (1.0 + pull))
        }
    }
}
