//! The specification of the kernels: f64, the caller's rayon pool.

use geom_core::{Cpu, Point3, Vector3};
use rayon::prelude::*;

use crate::backend::{QualityBackend, Relaxation};
use crate::ring::Ring;
use crate::search::{Compass, search};
use crate::{Error, Measures, measures};

impl QualityBackend for Cpu {
    fn measure(&self, positions: &[Point3], tets: &[[u32; 4]]) -> Result<Vec<Measures>, Error> {
        Ok(tets
            .par_iter()
            .with_min_len(1024)
            .map(|t| measures(t.map(|v| positions[v as usize])))
            .collect())
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
                    ring.clear();
                    for f in &task.faces[task.starts[i] as usize..task.starts[i + 1] as usize] {
                        ring.push(f.map(|v| positions[v as usize]));
                    }
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
