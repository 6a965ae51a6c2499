//! Better quads: vertices move on the surface until corners are right angles, and where no places are good, other quads take
//! their place.

mod change;
mod elements;
mod mend;

#[cfg(feature = "testing")]
pub(crate) use {elements::lengths, mend::changes};

use geom_core::QuadMesh;
use geom_core::surface::flow::{self, Descent, Elements, Search, Straightening, Vertices};
use geom_core::surface::ground::{Freedom, Ground};

use self::elements::Quads;
use crate::Error;
use crate::backend::On;

/// Down the sum of all distortions.
const DESCENT: Descent = Descent {
    power: 1,
    steps: 100,
    first: 0.1,
    tolerance: 1e-5,
    renew: false,
};
/// Quads below the goal are worked on one by one.
const SEARCH: Search<Quads> = Search {
    by: Quads::merit,
    goal: 0.6,
    rounds: 24,
    first: 0.25,
};
/// And together.
const STRAIGHTENING: Straightening<Quads> = Straightening {
    by: Quads::merit,
    descent: Descent {
        steps: 60,
        ..DESCENT
    },
    best: Quads::jacobian,
    start_counts: true,
    again: 3,
};

/// At last, those below the most that all corners at a vertex of three or six quads can have, nearly;
const POLISH: Search<Quads> = Search {
    by: Quads::jacobian,
    goal: 0.86,
    rounds: 6,
    ..SEARCH
};
/// then those that are not nearly rectangles, for the sake of the mean while none falls below that again. Longer steps would
/// make more of the sides uneven.
const RISE: Search<Quads> = Search {
    goal: 0.95,
    first: 0.1,
    ..POLISH
};

type Flow<'a> = flow::Flow<'a, Quads>;

/// Moves vertices down the gradient of the corners' distortion (Eqs. 5.5–5.7, signed), back onto the surface after each
/// step, and then those of the worst quads to where these are best. Quads keep the proportions of their sides where
/// these are above `narrowest`, which is 1 for squares. Where a quad would end with a scaled Jacobian below
/// 0.6 and below what it was, its vertices stay. Quads that stay bad give way to others. Then all go down once more, and
/// all vertices search whose quads are worse than corners at an irregular vertex have to be, where none of those below 0.6
/// ends worse; at last those whose quads are no rectangles, for places where these are better in the mean.
pub(crate) fn improve(
    mesh: QuadMesh,
    narrowest: f64,
    ground: &Ground<'_>,
    freedom: &[Freedom],
    run: On<'_>,
) -> Result<QuadMesh, Error> {
    let (positions, quads) = mesh.into_parts();
    let quads = Quads::new(quads, &positions, narrowest);
    let vertices = Vertices::new(positions, freedom.to_vec(), ground);
    let mut flow = Flow::new(quads, vertices, run.with(run.backend.as_corners()));
    flow.descend_in_rounds(&DESCENT, Quads::jacobian, SEARCH.goal)?;
    flow.lift_the_worst(&SEARCH)?;
    flow.straighten(&STRAIGHTENING, &SEARCH)?;
    mend::mended(&mut flow)?;
    // What was lifted and mended has other proportions, and holds up its surroundings no longer.
    flow.elements.renew(&flow.vertices.positions);
    flow.descend_in_rounds(&DESCENT, Quads::jacobian, SEARCH.goal)?;
    flow.lift_many(&POLISH)?;
    flow.lift_the_mean(&RISE, POLISH.goal)?;
    mend::taken(&flow)
}

/// Vertices on the surface, as near as possible to where they were.
pub(crate) fn settled(
    mesh: QuadMesh,
    ground: &Ground<'_>,
    freedom: &[Freedom],
) -> Result<QuadMesh, Error> {
    let (positions, quads) = mesh.into_parts();
    let vertices = Vertices::new(positions, freedom.to_vec(), ground);
    Ok(QuadMesh::new(vertices.positions, quads)?)
}
