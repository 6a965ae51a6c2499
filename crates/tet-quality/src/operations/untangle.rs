//! Inverted tetrahedra: every vertex around them moves to the middle of the space that its faces
//! leave to it (Freitag & Plassmann 2000), until all are positive or nothing moves.

use geom_core::{Point3, Vector3};

use crate::backend::On;
use crate::boundary::guard::GuardedMesh;
use crate::error::Error;
use crate::mesh::editable::Freedom;
use crate::smoothing::smooth::{axes_of, corners_of, load, relax, sweep};
use crate::smoothing::star::{Depth, Star};

/// Most rounds.
const ROUNDS: u32 = 40;
/// Steps toward the middle per vertex and round.
const STEPS: u32 = 60;
/// From this round on the neighbours move, too, to make room.
const WIDEN: u32 = 2;

/// Moves vertices until no tetrahedron is inverted or flat, as far as that is possible. Vertices of
/// the isosurface may leave it: the passes bring them back.
pub(crate) fn untangle(guarded: &mut GuardedMesh, run: On<'_>) -> Result<(), Error> {
    for round in 0..ROUNDS {
        let bad = guarded.mesh.below(f64::MIN_POSITIVE);
        if bad.is_empty() {
            break;
        }
        run.progress("untangle", round.into(), ROUNDS.into())?;
        let mut vertices = corners_of(&guarded.mesh, &bad);
        let mut moved = centre(guarded, &vertices);
        if round >= WIDEN {
            let mut around: Vec<u32> = vertices
                .iter()
                .flat_map(|&v| guarded.mesh.incidence.of(v).iter().copied())
                .collect();
            around.sort_unstable();
            around.dedup();
            vertices = corners_of(&guarded.mesh, &around);
            moved += relax(guarded, &vertices, 3, None, run)?;
            moved += centre(guarded, &vertices);
        }
        if moved == 0 {
            break;
        }
    }
    Ok(())
}

/// Moves each vertex to the middle of the space that its faces leave to it. Gives how many moved.
fn centre(guarded: &mut GuardedMesh, vertices: &[u32]) -> usize {
    let axes = |freedom: Freedom| match freedom {
        Freedom::Field => axes_of(Freedom::Free, None),
        other => axes_of(other, None),
    };
    sweep(
        guarded,
        vertices,
        |freedom| axes(freedom).is_some(),
        |guarded, v, star| {
            let mesh = &guarded.mesh;
            load(mesh, v, star);
            deepest(mesh.x[v as usize], &axes(mesh.freedom[v as usize])?, star)
        },
        GuardedMesh::move_vertex,
    )
}

/// The point that lies deepest inside all faces of the star. The depth is concave, so ascent along
/// the face that is nearest, in shrinking steps, comes near its maximum.
fn deepest(start: Point3, axes: &[Vector3; 3], star: &Star) -> Option<Point3> {
    let edge = star.mean_edge(&start.coords);
    let before = star.depth(&start.coords).depth;
    let (mut x, mut best) = (start.coords, (before, start.coords));
    for k in 0..STEPS {
        let Depth { depth, inward } = star.depth(&x);
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
