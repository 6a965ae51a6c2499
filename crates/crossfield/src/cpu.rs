//! The kernel on the CPU: the specification, in parallel.

use geom_core::Cpu;
use rayon::prelude::*;

use crate::Error;
use crate::backend::{ChartDistortion, CrossfieldBackend};
use crate::map::Chart;
use crate::specification;

/// Elements per task.
/// An element is a few hundred operations at most: fewer of them are not worth a task.
const GRAIN: usize = 1024;

impl CrossfieldBackend for Cpu {
    /// In order, element by element: the same digits for any number of threads.
    fn chart_distortion(
        &self,
        charts: &[Chart],
        corners: &[[[f64; 2]; 3]],
        epsilon: f64,
        out: &mut Vec<ChartDistortion>,
    ) -> Result<(), Error> {
        charts
            .par_iter()
            .zip(corners)
            .with_min_len(GRAIN)
            .map(|(chart, uv)| specification::chart_distortion(chart, uv, epsilon))
            .collect_into_vec(out);
        Ok(())
    }
}
