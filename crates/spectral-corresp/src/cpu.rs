//! The kernels on the CPU: f64, the caller's rayon pool.
//!
//! The nearest of rows is found in one of two ways: by a tree where rows are narrow or very many, else in blocks that
//! are looked through in the lanes of vectors.

use geom_core::compute::parallel;
use geom_core::nalgebra::Matrix3;
use geom_core::search::nearest::PointTree;
use geom_core::{Cpu, Point3};

use crate::Error;
use crate::backend::{CorrespBackend, HistogramTask, Nearest, RotationTask, Rows, SweepTask};
use crate::fit::{Flat, rotation, swept};
use crate::shape::distance;

/// Rows wider than this gain nothing from a tree.
const TREE_WIDTH: usize = 12;
/// Up to so many rows of more than three numbers are all looked at.
const LOOKED_AT: usize = 16_384;
/// Queries per task.
const QUERIES: usize = 64;

/// Nodes, rows and queries are each by themselves: results have the same bits for any number of threads.
impl CorrespBackend for Cpu {
    fn squared_distances(
        &self,
        counts: [usize; 3],
        inside: &[bool],
        out: &mut Vec<u32>,
    ) -> Result<(), Error> {
        distance::squared_distances(counts, inside, out);
        Ok(())
    }

    fn histograms(&self, task: &HistogramTask<'_>, out: &mut Vec<u32>) -> Result<(), Error> {
        task.counted(out);
        Ok(())
    }

    fn nearest(
        &self,
        queries: Rows<'_>,
        targets: Rows<'_>,
        out: &mut Vec<Nearest>,
    ) -> Result<(), Error> {
        out.clear();
        if targets.is_empty() {
            return Ok(());
        }
        if targets.width <= 3 || (targets.len() > LOOKED_AT && targets.width <= TREE_WIDTH) {
            return match targets.width {
                0..=3 => by_tree::<3>(queries, targets, out),
                4..=6 => by_tree::<6>(queries, targets, out),
                _ => by_tree::<TREE_WIDTH>(queries, targets, out),
            };
        }
        let flat = Flat::of(targets);
        out.resize(queries.len(), Nearest::default());
        let width = queries.width;
        parallel::for_chunks(out, QUERIES, |chunk, out| {
            let values = &queries.values[chunk * QUERIES * width..][..out.len() * width];
            flat.nearest(Rows { values, width }, out);
        });
        Ok(())
    }

    fn rotations(&self, task: &RotationTask<'_>, out: &mut Vec<Matrix3<f64>>) -> Result<(), Error> {
        out.resize(task.rest.len(), Matrix3::zeros());
        parallel::for_each(out, |i, out| *out = rotation(task, i));
        Ok(())
    }

    fn sweep(&self, task: &SweepTask<'_>, out: &mut Vec<Point3>) -> Result<(), Error> {
        out.resize(task.shape.rest.len(), Point3::origin());
        parallel::for_each(out, |i, out| *out = swept(task, i));
        Ok(())
    }
}

/// Rows filled up with zeros, which change no distance.
fn by_tree<const K: usize>(
    queries: Rows<'_>,
    targets: Rows<'_>,
    out: &mut Vec<Nearest>,
) -> Result<(), Error> {
    let fill = |row: &[f64]| std::array::from_fn(|c| row.get(c).copied().unwrap_or(0.0));
    let targets = (0..targets.len()).map(|i| fill(targets.row(i)));
    let tree = PointTree::<K>::new(targets.collect())?;
    *out = parallel::map(queries.len(), |q| {
        let near = tree.nearest(&fill(queries.row(q)), 1);
        near.first().map_or(Nearest::default(), |n| Nearest {
            index: n.index,
            distance: n.distance,
        })
    });
    Ok(())
}
