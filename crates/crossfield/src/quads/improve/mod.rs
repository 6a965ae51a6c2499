//! Better quads: vertices move on the surface until corners are right angles, and where no places are good, other quads take
//! their place.

mod change;
mod flow;
mod lift;
mod mend;

#[cfg(feature = "testing")]
pub(crate) use {flow::lengths, mend::changes};

use geom_core::QuadMesh;
use geom_core::surface::ground::{Freedom, Ground};

use self::flow::Flow;
use crate::Error;
use crate::backend::On;

/// Steps of the flow.
const STEPS: usize = 100;
/// Quads below this are worked on one by one after the flow.
const GOAL: f64 = 0.6;

/// Moves vertices down the gradient of the corners' distortion (Eqs. 5.5–5.7, signed), back onto the surface after each
/// step, and then those of the worst quads to where these are best. Quads keep the proportions of their sides where
/// these are above `narrowest`, which is 1 for squares. Where the flow ends with a smallest scaled Jacobian below 0.6
/// and below the largest that it met, it goes back to that before the worst are moved. Quads that stay bad give way to others.
pub(crate) fn improve(
    mesh: QuadMesh,
    narrowest: f64,
    ground: &Ground<'_>,
    freedom: &[Freedom],
    run: On<'_>,
) -> Result<QuadMesh, Error> {
    let mut flow = Flow::new(mesh, narrowest, ground, freedom.to_vec(), run);
    let best = flow.descend(1, STEPS, false)?;
    // The sum may fall while the worst corner does: keep the best of both unless the worst is fine.
    if flow.smallest_jacobian() < best.0.min(GOAL) {
        (flow.positions, flow.normals) = best.1;
    }
    flow.lift_the_worst();
    flow.straighten()?;
    mend::mended(flow)
}

/// Vertices on the surface, as near as possible to where they were.
pub(crate) fn settled(
    mesh: QuadMesh,
    ground: &Ground<'_>,
    freedom: &[Freedom],
    run: On<'_>,
) -> Result<QuadMesh, Error> {
    let flow = Flow::new(mesh, 1.0, ground, freedom.to_vec(), run);
    Ok(QuadMesh::new(flow.positions, flow.quads)?)
}
