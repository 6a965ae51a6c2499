//! Inverted tetrahedra: every vertex around them moves to the middle of the space that its faces
//! leave to it (Freitag & Plassmann 2000), until all are positive or nothing moves.

use geom_core::{Point3, Run, Vector3};

use crate::Error;
use crate::backend::QualityBackend;
use crate::mesh::editable::{Freedom, Work};
use crate::smoothing::smooth::{axes_of, corners_of, load, relax, sweep};
use crate::smoothing::star::Ring;

/// Most rounds.
const ROUNDS: u32 = 40;
/// Steps toward the middle per vertex and round.
const STEPS: u32 = 60;
/// From this round on the neighbours move, too, to make room.
const WIDEN: u32 = 2;

/// Moves vertices until no tetrahedron is inverted or flat, as far as that is possible. Vertices of
/// the isosurface may leave it: the passes bring them back.
pub(crate) fn untangle<B: QualityBackend + ?Sized>(
    work: &mut Work,
    run: Run<'_, B>,
) -> Result<(), Error> {
    for round in 0..ROUNDS {
        let bad = work.below(f64::MIN_POSITIVE);
        if bad.is_empty() {
            break;
        }
        run.progress("untangle", round.into(), ROUNDS.into())?;
        let mut vertices = corners_of(work, &bad);
        let mut moved = centre(work, &vertices);
        if round >= WIDEN {
            let mut around: Vec<u32> = vertices
                .iter()
                .flat_map(|&v| work.rings.of(v).iter().copied())
                .collect();
            around.sort_unstable();
            around.dedup();
            vertices = corners_of(work, &around);
            moved += relax(work, &vertices, 3, None, run)?;
            moved += centre(work, &vertices);
        }
        if moved == 0 {
            break;
        }
    }
    Ok(())
}

fn centre(work: &mut Work, vertices: &[u32]) -> usize {
    let axes = |freedom: Freedom| match freedom {
        Freedom::Field => axes_of(Freedom::Free, None),
        other => axes_of(other, None),
    };
    sweep(
        work,
        vertices,
        |freedom| axes(freedom).is_some(),
        |work, v, ring| {
            load(work, v, ring);
            deepest(work.x[v as usize], &axes(work.freedom[v as usize])?, ring)
        },
        Work::place,
    )
}

/// The point that lies deepest inside all faces of the ring. The depth is concave, so ascent along
/// the face that is nearest, in shrinking steps, comes near its maximum.
fn deepest(start: Point3, axes: &[Vector3; 3], ring: &Ring) -> Option<Point3> {
    let edge = ring.mean_edge(&start.coords);
    let before = ring.depth(&start.coords).0;
    let (mut x, mut best) = (start.coords, (before, start.coords));
    for k in 0..STEPS {
        let (depth, inward) = ring.depth(&x);
        if depth > best.0 {
            best = (depth, x);
        }
        let direction = axes
            .iter()
            .fold(Vector3::zeros(), |s, a| s + a * a.dot(&inward));
        let Some(direction) = direction.try_normalize(1e-12) else {
            break;
        };
        x += direction * (0.4 * edge / (1.0 + 0.35 * f64::from(k)));
    }
    (best.0 > before + 1e-6 * edge).then(|| best.1.into())
}
