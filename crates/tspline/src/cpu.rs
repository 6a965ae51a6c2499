//! The kernels on the CPU: the specification, in parallel.

use geom_core::Cpu;
use rayon::prelude::*;

use crate::backend::{Corner, CornerDistortion, PointsTask, SamplesTask, SplineBackend};
use crate::surface::bezier::{self, bernstein};
use crate::surface::{PatchPoints, Sample};
use crate::{Error, specification};

/// Corners per task.
const GRAIN: usize = 1024;

impl SplineBackend for Cpu {
    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
    ) -> Result<(), Error> {
        corners
            .par_iter()
            .with_min_len(GRAIN)
            .map(|corner| specification::corner_distortion(corner, epsilon))
            .collect_into_vec(out);
        Ok(())
    }

    fn bezier_points(
        &self,
        task: &PointsTask<'_>,
        out: &mut Vec<PatchPoints>,
    ) -> Result<(), Error> {
        let extraction = task.extraction;
        (0..extraction.patches().len())
            .into_par_iter()
            .with_min_len(256)
            .map(|patch| {
                let rows = extraction
                    .on(patch)
                    .iter()
                    .zip(extraction.coefficients(patch));
                let mut points = [[0.0; 4]; 16];
                for (&f, row) in rows {
                    let p = &task.controls[f as usize];
                    for (out, c) in points.iter_mut().zip(row) {
                        out[0] += c * p.x;
                        out[1] += c * p.y;
                        out[2] += c * p.z;
                        out[3] += c;
                    }
                }
                if !extraction.is_rational() {
                    points.iter_mut().for_each(|p| p[3] = 1.0);
                }
                points
            })
            .collect_into_vec(out);
        Ok(())
    }

    fn bezier_samples(&self, task: &SamplesTask<'_>, out: &mut Vec<Sample>) -> Result<(), Error> {
        let tables = task.parameters.iter().map(|&t| {
            let [value, slope, _] = bernstein(t);
            [value, slope]
        });
        let table: Vec<[[f64; 4]; 2]> = tables.collect();
        let per = table.len() * table.len();
        out.clear();
        out.resize(per * task.patches.len(), Sample::default());
        if per > 0 {
            out.par_chunks_mut(per)
                .zip(task.patches)
                .with_min_len(64)
                .for_each(|(out, points)| bezier::samples(points, &table, out));
        }
        Ok(())
    }
}
