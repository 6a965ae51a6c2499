//! The kernels on the CPU, in parallel.
//!
//! Results are in the order of their elements and do not depend on the number of threads: each is summed by one thread,
//! in a fixed order.

use geom_core::Cpu;
use rayon::prelude::*;

use crate::Error;
use crate::backend::{PointsTask, SamplesTask, SplineBackend};
use crate::surface::bezier::{self, bernstein};
use crate::surface::{PatchPoints, Sample};

impl SplineBackend for Cpu {
    /// Weights of polynomial bases are set to 1, from which the sums of coefficients differ by rounding.
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

    /// Of each patch first the curves at each t, then the samples on them, so that of two parameters each costs its own
    /// sums only.
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
