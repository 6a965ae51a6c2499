//! The kernels on the CPU: f64, the caller's rayon pool.
//!
//! Every result is written by one thread from what it alone reads, so that none depends on how many there are. The
//! loops over patches stand in `operators/patch.rs`; that of one triangle in `forms/triangles.rs`.

use geom_core::compute::parallel;
use geom_core::{Cpu, Vector3};
use rayon::prelude::*;

use crate::Error;
use crate::backend::{OperatorBackend, PatchMatrices, PatchTask, TriangleTask};
use crate::forms::{TriangleMatrix, element};
use crate::operators::patch;

/// None of the kernels has a way to fail.
impl OperatorBackend for Cpu {
    fn triangle_matrices(
        &self,
        task: &TriangleTask<'_>,
        out: &mut Vec<TriangleMatrix>,
    ) -> Result<(), Error> {
        task.triangles
            .par_iter()
            .with_min_len(1024)
            .map(|&corners| {
                let factor = match task.factors {
                    [] => 1.0,
                    f => corners.map(|v| f[v as usize]).iter().sum::<f64>() / 3.0,
                };
                element(
                    corners.map(|v| task.positions[v as usize]),
                    corners.map(|v| task.normals[v as usize]),
                    factor,
                    &task.conductor,
                )
            })
            .collect_into_vec(out);
        Ok(())
    }

    fn patch_matrices(&self, task: &PatchTask<'_>, out: &mut PatchMatrices) -> Result<(), Error> {
        patch::matrices(task, out);
        Ok(())
    }

    fn patch_forces(&self, task: &PatchTask<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
        patch::forces(task, out);
        Ok(())
    }

    fn distances(&self, rows: &[f32], width: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        let n = rows.len().checked_div(width).unwrap_or(0);
        out.clear();
        out.resize(n * n, 0.0);
        if n == 0 {
            return Ok(());
        }
        parallel::for_chunks(out, n, |i, out| {
            let a = &rows[i * width..(i + 1) * width];
            for (out, b) in out.iter_mut().zip(rows.chunks_exact(width)) {
                let squared: f32 = a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum();
                *out = squared.sqrt();
            }
        });
        Ok(())
    }
}
