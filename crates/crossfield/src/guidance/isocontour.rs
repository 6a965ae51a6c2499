//! Guidance by isocontours of eigenfunctions (Eqs. 4.6–4.7).

use geom_core::TriMesh;
use geom_core::surface::laplace;

use super::modes::Mode;
use crate::Error;
use crate::field::frames::{Frames, modulo_quarter};
use crate::field::{Guide, Toward};

/// Two modes that want directions more than this apart, in one triangle or in neighbours, contradict each other.
const CONFLICT: f64 = 20.0;

/// The triangles through which the isocontours at `low + r (high − low)` and `high − r (high − low)` run, along the gradient
/// there. Triangles where modes contradict each other are left out: kept, they earn hundreds of singularities.
///
/// The sign of an eigenfunction is arbitrary; that both ends of the range are treated alike makes the guides
/// independent of it. Of a triangle that several contours cross without contradiction, the first mode has the
/// direction.
pub(super) fn guides(
    mesh: &TriMesh,
    frames: &Frames,
    modes: &[Mode],
    inset: f64,
    weight: f64,
) -> Result<Vec<Guide>, Error> {
    let mut claims: Vec<Vec<(usize, f64)>> = vec![Vec::new(); frames.faces()];
    for (number, mode) in modes.iter().enumerate() {
        let f = &mode.function;
        let gradient = laplace::gradient(mesh, f)?;
        let (low, high) = f
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &x| {
                (l.min(x), h.max(x))
            });
        for level in [low + inset * (high - low), high - inset * (high - low)] {
            for (face, corners) in mesh.triangles().iter().enumerate() {
                let above = corners.iter().filter(|&&v| f[v as usize] > level).count();
                if above == 1 || above == 2 {
                    claims[face].push((number, frames.angle(face, &gradient[face])));
                }
            }
        }
    }
    let dropped = contradictions(frames, &claims);
    Ok((0..frames.faces())
        .filter(|&face| !dropped[face])
        .filter_map(|face| {
            let &(_, angle) = claims[face].first()?;
            Some(Guide {
                face: face as u32,
                toward: Toward::Angle(angle),
                weight,
            })
        })
        .collect())
}

/// Per triangle, whether two modes disagree in it, or one in it with another in a neighbour: then both triangles are
/// dropped. Directions are compared up to quarter turns, as the field can have two modes at right angles.
fn contradictions(frames: &Frames, claims: &[Vec<(usize, f64)>]) -> Vec<bool> {
    let far = |angle: f64| modulo_quarter(angle).abs().to_degrees() > CONFLICT;
    let mut dropped: Vec<bool> = claims
        .iter()
        .map(|claims| claims.iter().any(|c| far(c.1 - claims[0].1)))
        .collect();
    for (h, t) in frames.interior() {
        let (i, j) = (h / 3, t / 3);
        let apart = claims[i].iter().any(|a| {
            let there = a.1 + frames.transport(h);
            claims[j].iter().any(|b| a.0 != b.0 && far(b.1 - there))
        });
        if apart {
            dropped[i] = true;
            dropped[j] = true;
        }
    }
    dropped
}
