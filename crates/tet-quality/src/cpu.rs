//! The specification of the kernels: f64, the caller's rayon pool.

use geom_core::{Cpu, Point3, Vector3};
use rayon::prelude::*;

use crate::backend::{QualityBackend, Relaxation};
use crate::measure::block;
use crate::smoothing::search::{Compass, search};
use crate::smoothing::star::Ring;
use crate::{Error, Measures};

/// Tetrahedra per task.
const CHUNK: usize = 4096;

impl QualityBackend for Cpu {
    fn measure_into(
        &self,
        positions: &[Point3],
        tets: &[[u32; 4]],
        out: &mut Vec<Measures>,
    ) -> Result<(), Error> {
        if out.capacity() < tets.len() {
            // Zeros that nobody has written yet: the threads share the first touch of the memory.
            *out = bytemuck::zeroed_vec(tets.len());
        }
        out.resize(tets.len(), Measures::default());
        out.par_chunks_mut(CHUNK)
            .zip(tets.par_chunks(CHUNK))
            .for_each(|(out, tets)| block::measure(positions, tets, out));
        Ok(())
    }

    fn relax(&self, task: &Relaxation<'_>) -> Result<Vec<Vector3>, Error> {
        let mut positions = task.positions.to_vec();
        for colour in &task.colours {
            // Within a colour every vertex reads fixed neighbours.
            let moved: Vec<Point3> = colour
                .clone()
                .into_par_iter()
                .with_min_len(32)
                .map_init(Ring::default, |ring, i| {
                    let faces = task.starts[i] as usize..task.starts[i + 1] as usize;
                    ring.load(&positions, &task.faces[faces]);
                    let x = positions[task.vertices[i] as usize].coords;
                    let compass = Compass::along(&task.axes[i]);
                    Point3::from(search(ring, x, &compass, task.rounds))
                })
                .collect();
            for (&v, x) in task.vertices[colour.clone()].iter().zip(moved) {
                positions[v as usize] = x;
            }
        }
        Ok(task
            .vertices
            .iter()
            .map(|&v| positions[v as usize] - task.positions[v as usize])
            .collect())
    }
}
