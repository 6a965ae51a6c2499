//! The kernels on the processor: f64 in its vectors, on the caller's rayon pool. What they owe to is
//! the `specification`.
//!
//! Which thread does what changes no bit: tetrahedra are measured one by one, and the vertices of a colour all read the
//! mesh as the colours before left it.

use geom_core::compute::parallel;
use geom_core::{Cpu, Point3, Vector3};

use crate::backend::{QualityBackend, Relaxation};
use crate::error::Error;
use crate::measure::block;
use crate::measure::metrics::Measures;
use crate::smoothing::search::{Compass, Start, search, search_within};
use crate::smoothing::star::Star;

/// Tetrahedra per task.
const CHUNK: usize = 4096;

/// On the pool that the caller is in. Neither kernel has a way to fail.
impl QualityBackend for Cpu {
    fn measure(
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
        parallel::for_chunks(out, CHUNK, |chunk, out| {
            let tets = &tets[chunk * CHUNK..][..out.len()];
            block::measure(positions, tets, out);
        });
        Ok(())
    }

    fn relax(&self, task: &Relaxation<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
        let mut positions = task.positions.to_vec();
        for colour in &task.colours {
            // Within a colour every vertex reads fixed neighbours.
            let moved: Vec<Point3> =
                parallel::map_init(colour.len(), Star::default, |star, of_colour| {
                    let i = colour.start + of_colour;
                    let faces = task.starts[i] as usize..task.starts[i + 1] as usize;
                    star.load(&positions, &task.faces[faces]);
                    let x = positions[task.vertices[i] as usize].coords;
                    let compass = Compass::along(&task.axes[i]);
                    Point3::from(match &task.slide {
                        None => search(star, x, &compass, task.rounds),
                        Some(slide) => {
                            let mean = slide.means[i].map(|d| x + d);
                            let reach = slide.reach * star.mean_edge(&x);
                            let value = star.value(&x);
                            let start = Start { at: x, value };
                            let within = |y: &Vector3| (y - x).norm_squared() <= reach * reach;
                            search_within(star, start, mean, &compass, task.rounds, within)
                        }
                    })
                });
            for (&v, x) in task.vertices[colour.clone()].iter().zip(moved) {
                positions[v as usize] = x;
            }
        }
        let displacement = |&v: &u32| positions[v as usize] - task.positions[v as usize];
        out.clear();
        out.extend(task.vertices.iter().map(displacement));
        Ok(())
    }
}
