//! Keeping the enclosed volume.

use geom_core::{Point3, TriMesh, Vector3};

use super::guard::Guard;
use crate::Error;
use crate::forms::sorted_sides;

/// Most corrections per step, and the relative error at which they stop.
const STEPS: usize = 5;
const ERROR: f64 = 1e-6;

/// Moves a surface along its normals until it encloses `volume` again; how often a vertex was held back.
pub(super) fn restore<const N: usize>(
    positions: &mut [Point3],
    volume: f64,
    surface: impl Fn(&[Point3]) -> Result<TriMesh, Error>,
    guard: &mut Guard<'_, N>,
) -> Result<usize, Error> {
    let mut held = 0;
    // What of an offset's volume arrives: less than all where faces meet at sharp angles, as the last one has shown. Where vertices
    // were held back, too little does, and the others are not to make up for all of it.
    let (mut share, mut before) = (1.0, None);
    for step in 0..STEPS {
        let mesh = surface(positions)?;
        let missing = volume - mesh.volume();
        if missing.abs() <= ERROR * volume.abs() {
            break;
        }
        let may_narrow = step + 2 >= STEPS;
        if step + 2 == STEPS {
            // What corners held back says nothing of the rest.
            (share, before) = (1.0, None);
        }
        if let Some(before) = before.replace(missing) {
            share = f64::clamp(share * (1.0 - missing / before), 0.25, 2.0);
        }
        let along = missing / (share * mesh.area());
        let mut moves: Vec<Vector3> = mesh.vertex_normals().iter().map(|n| n * along).collect();
        // Corners that would become too narrow first stay behind; only where the others do not make up for it, they do not.
        held += match may_narrow {
            false => guard.hold_back(positions, &mut moves)?,
            true => guard.hold_back_offset(positions, &mut moves)?,
        };
        positions.iter_mut().zip(&moves).for_each(|(p, m)| *p += m);
    }
    Ok(held)
}

/// Only a closed surface encloses anything.
pub(super) fn refuse_open<const N: usize>(faces: &[[u32; N]]) -> Result<(), Error> {
    let sides = sorted_sides(faces);
    match sides
        .chunk_by(|a, b| a.0 == b.0)
        .find(|side| side.len() == 1)
    {
        Some(side) => Err(Error::Open {
            what: "keeping the volume",
            from: side[0].0[0],
            to: side[0].0[1],
        }),
        None => Ok(()),
    }
}
