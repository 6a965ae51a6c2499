//! The thesis's second step of refinement (Eqs. 6.8–6.12): the distortion alone, with images kept on the nodes of the
//! other shape.
//!
//! The step is taken freely, then each image is put back on a node, by which small steps come to nothing: so the start
//! decides much. There is no pull towards the other shape but this. It is here to be compared with.

use geom_core::Point3;

use super::{Neighbourhoods, Side, distortions};
use crate::Error;
use crate::backend::{Kernels, On, RotationTask, Rows, SweepTask};

/// Pairs per node: more change the result by less than 2 %.
const PAIRS: usize = 60;

/// Jacobi steps with the images put back on the nearest node of `b`, until the energy falls by less than `tolerance`
/// of itself, at most `most`.
/// Gives the images with the least energy: those before a step that raises it.
#[expect(
    clippy::too_many_arguments,
    reason = "one call, and each of them is a parameter of the method"
)]
pub(crate) fn descend(
    a: &Side,
    b: &Side,
    mut images: Vec<Point3>,
    radius: f64,
    tolerance: f64,
    most: usize,
    seed: u64,
    run: On<'_>,
) -> Result<Vec<Point3>, Error> {
    let near = Neighbourhoods::within(&a.points, radius, PAIRS, seed)?;
    let flat = |points: &[Point3]| {
        points
            .iter()
            .flat_map(|p| [p.x, p.y, p.z])
            .collect::<Vec<f64>>()
    };
    let targets = flat(&b.points);
    let free = vec![0.0; images.len()];
    let (mut rotations, mut next, mut found) = (Vec::new(), Vec::new(), Vec::new());
    let (mut energy, mut before) = (f64::INFINITY, images.clone());
    for _ in 0..most {
        let shape = RotationTask {
            rest: &a.points,
            now: &images,
            near: &near,
        };
        run.rotations(&shape, &mut rotations)?;
        let now: f64 = distortions(&shape, &rotations).iter().sum();
        if now > energy {
            return Ok(before);
        }
        if energy - now < tolerance * energy && energy.is_finite() {
            break;
        }
        energy = now;
        before.clone_from(&images);
        let task = SweepTask {
            shape,
            rotations: &rotations,
            targets: &images,
            pull: &free,
        };
        run.sweep(&task, &mut next)?;
        let moved = flat(&next);
        let rows = |values| Rows { values, width: 3 };
        run.nearest(rows(&moved), rows(&targets), &mut found)?;
        images = found.iter().map(|n| b.points[n.index as usize]).collect();
    }
    Ok(images)
}
