//! Better places, and smaller elements where no places help.

use geom_core::TriMesh;
use geom_core::surface::ground::Ground;

use super::flow::Flow;
use super::jacobian::JacobianSummary;
use super::lift::GOAL;
use super::lines::{Lines, freedoms};
use super::{Improved, QualityReport};
use crate::backend::On;
use crate::mesh::refined;
use crate::options::{MAX_LEVEL, Method};
use crate::{Error, QualityOptions, TMesh, TMeshOptions, VertexKind};

/// How often elements that stay bad are cut.
const CUTS: usize = 2;

pub(crate) fn improve(
    mesh: TMesh,
    surface: &TriMesh,
    options: &QualityOptions,
    run: On<'_>,
) -> Result<Improved, Error> {
    let open = (0..mesh.positions().len()).any(|v| mesh.kind(v) == VertexKind::Boundary);
    let lines = Lines::of(surface, options.crease, open)?;
    let ground = Ground::new(surface, lines.all.clone())?;
    let mut made = moved(mesh, &lines, &ground, options, run)?;
    for _ in 0..CUTS {
        let is_bad = |e: &usize| made.jacobians[*e] < options.least;
        let bad: Vec<usize> = (0..made.jacobians.len()).filter(is_bad).collect();
        let Some(finer) = finer(&made.mesh, &bad)? else {
            break;
        };
        let next = moved(finer, &lines, &ground, options, run)?;
        if next.report.after.min <= made.report.after.min {
            break;
        }
        let report = QualityReport {
            steps: made.report.steps + next.report.steps,
            distortion: [made.report.distortion[0], next.report.distortion[1]],
            lifted: made.report.lifted + next.report.lifted,
            cut: made.report.cut + bad.len(),
            before: made.report.before,
            ..next.report
        };
        made = Improved { report, ..next };
    }
    Ok(made)
}

/// The same elements at better places.
fn moved(
    mut mesh: TMesh,
    lines: &Lines,
    ground: &Ground<'_>,
    options: &QualityOptions,
    run: On<'_>,
) -> Result<Improved, Error> {
    let freedom = freedoms(&mesh, lines);
    let mut flow = Flow::new(&mesh, &freedom, ground, options, run);
    let before = flow.jacobians();
    let least = before.iter().copied().fold(f64::INFINITY, f64::min);
    let mut kept = (flow.positions.clone(), flow.normals.clone());
    let (steps, distortion) = flow.run(least, &mut kept)?;
    let mut lifted = flow.lift_the_worst(GOAL)?;
    if options.method == Method::Corners {
        // The sum may fall while the worst corner does, beyond repair: back to where that was no worse than at the start.
        if flow.smallest_jacobian() < least {
            (flow.positions, flow.normals) = kept.clone();
            lifted = flow.lift_the_worst(GOAL)?;
        }
        lifted += flow.mend()?;
        // What lies on its back may have to become worse before it turns over, and be stuck there.
        if flow.smallest_jacobian() < least {
            (flow.positions, flow.normals) = kept;
        }
    }
    let jacobians = flow.jacobians();
    let positions = flow.positions;
    mesh.move_to(positions, |v, p| ground.pulled(p, freedom[v as usize]).0)?;
    let report = QualityReport {
        steps,
        distortion,
        lifted,
        cut: 0,
        before: JacobianSummary::of(&before),
        after: JacobianSummary::of(&jacobians),
        backend: run.backend.name(),
    };
    Ok(Improved {
        mesh,
        jacobians,
        report,
    })
}

/// The mesh with these elements and those around them cut into four, if it can be made: on finer quads if one of them is of
/// the finest level. Rules of T-meshes are those of [`TMeshOptions::default`].
fn finer(mesh: &TMesh, bad: &[usize]) -> Result<Option<TMesh>, Error> {
    if bad.is_empty() {
        return Ok(None);
    }
    let rules = TMeshOptions::default();
    let near = mesh.with_those_around(bad);
    let levels = mesh.levels();
    if near.iter().all(|&e| mesh.elements()[e].level > 0) {
        return mesh.cut(&near, &rules).map(Some);
    }
    let Ok(fine) = refined(mesh.fine(), 1) else {
        return Ok(None);
    };
    let mut allowed = levels;
    for level in &mut allowed {
        *level = (*level + 1).min(MAX_LEVEL);
    }
    for &q in near.iter().flat_map(|&e| mesh.fine_quads(e)) {
        allowed[q as usize] -= 1;
    }
    // The parts of a quad follow each other.
    let allowed: Vec<u8> = allowed.into_iter().flat_map(|l| [l; 4]).collect();
    TMesh::build(&fine, &allowed, &rules).map(Some)
}
