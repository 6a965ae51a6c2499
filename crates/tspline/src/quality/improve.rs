//! Better places, and smaller elements where no places help.

use geom_core::TriMesh;
use geom_core::mesh::quality::JacobianSummary;
use geom_core::surface::flow::{Descent, Flow, Search, State, Straightening, Vertices, least};

use super::cells::Cells;
use super::components::Surface;
use super::lines::{Lines, freedoms};
use super::{Improved, QualityReport};
use crate::backend::On;
use crate::mesh::refined;
use crate::options::{MAX_LEVEL, Method};
use crate::{Error, QualityOptions, TMesh, TMeshOptions, VertexKind};

/// How often elements that stay bad are cut.
const CUTS: usize = 2;
/// How often those that are bad before are made straight.
const AGAIN: usize = 4;
/// Powers of the distortions whose sum is lowered, one after the other: the first is Eq. 5.6, the second heeds the worse
/// corners more.
const POWERS: [i32; 2] = [1, 4];
/// No element becomes worse than this in a flow unless it was: the second would make good ones worse for the sake of others.
const GOOD: f64 = 0.9;
/// Elements below this are worked on one by one after it: just below the sine of 60°, the most that all corners at a vertex of
/// three or six quads can have.
const GOAL: f64 = 0.86;
/// Those below this are no rectangles, and are worked on last, for so many rounds.
const RECTANGLE: f64 = 0.95;
const RISE: usize = 6;

pub(crate) fn improve(
    mesh: TMesh,
    surface: &TriMesh,
    options: &QualityOptions,
    run: On<'_>,
) -> Result<Improved, Error> {
    let open = (0..mesh.positions().len()).any(|v| mesh.kind(v) == VertexKind::Boundary);
    let components = surface.components();
    let lines = Lines::of(surface, options.crease, open)?;
    let surface = Surface::of(&components, options.crease, open)?;
    let mut made = moved(mesh, &surface, &lines, options, run)?;
    for _ in 0..CUTS {
        let is_bad = |e: &usize| made.jacobians[*e] < options.least;
        let bad: Vec<usize> = (0..made.jacobians.len()).filter(is_bad).collect();
        let Some(finer) = finer(&made.mesh, &bad)? else {
            break;
        };
        let next = moved(finer, &surface, &lines, options, run)?;
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
    surface: &Surface<'_>,
    lines: &Lines,
    options: &QualityOptions,
    run: On<'_>,
) -> Result<Improved, Error> {
    let fine = freedoms(&mesh, lines);
    let part = surface.parts(mesh.fine())?;
    let coarse = || (0..mesh.positions().len()).map(|v| mesh.fine_of_vertex(v) as usize);
    let vertices = Vertices::on_parts(
        mesh.positions().to_vec(),
        coarse().map(|v| fine[v]).collect(),
        &surface.grounds,
        coarse().map(|v| part[v]).collect(),
    );
    let cells = Cells::new(&mesh, &vertices.positions, options.method);
    let mut flow = Flow::new(cells, vertices, run.with(run.backend.as_corners()));
    let before = flow.values(Cells::jacobian);
    let smallest = least(before.iter().copied());
    let start = flow.vertices.state();
    let first = flow.mean_distortion()?;
    let mut steps = 0;
    for power in POWERS {
        steps += flow.descend_in_rounds(&descent(power, options), Cells::jacobian, GOOD)?;
    }
    let kept = match flow.worst(Cells::jacobian) >= smallest {
        true => flow.vertices.state(),
        false => start,
    };
    let distortion = [first, flow.mean_distortion()?];
    let lifted = lifted(&mut flow, smallest, kept, options)?;
    let jacobians = flow.values(Cells::jacobian);
    let positions = flow.vertices.positions;
    mesh.move_to(positions, |v, p| {
        let ground = &surface.grounds[part[v as usize] as usize];
        ground.pulled(p, fine[v as usize]).0
    })?;
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

fn descent(power: i32, options: &QualityOptions) -> Descent {
    Descent {
        power,
        steps: options.steps,
        first: 0.2,
        tolerance: options.tolerance,
        renew: false,
    }
}

/// Moves the vertices of the worst elements; how many. Where they would end below the `smallest` of the start, those that were
/// `kept` are taken.
fn lifted(
    flow: &mut Flow<'_, Cells>,
    smallest: f64,
    kept: State,
    options: &QualityOptions,
) -> Result<usize, Error> {
    let search = Search {
        by: Cells::jacobian,
        goal: GOAL,
        rounds: options.rounds,
        first: 0.5,
    };
    let straightening = Straightening {
        by: Cells::upright_jacobian,
        descent: descent(1, options),
        best: Cells::upright_jacobian,
        start_counts: false,
        // Without a search there is nothing but the flow for all.
        again: AGAIN.min(options.rounds),
    };
    let mut lifted = flow.lift_the_worst(&search)?;
    if options.method == Method::Corners {
        // The sum may fall while the worst corner does, beyond repair: back to where that was no worse than at the start.
        if flow.worst(Cells::jacobian) < smallest {
            flow.vertices.put(kept.clone());
            lifted = flow.lift_the_worst(&search)?;
        }
        lifted += flow.straighten(&straightening, &search)?;
        // What lies on its back may have to become worse before it turns over, and be stuck there.
        if flow.worst(Cells::jacobian) < smallest {
            flow.vertices.put(kept);
        }
        // The worst have had their places; what is left is for the mean.
        let rise = Search {
            goal: RECTANGLE,
            rounds: options.rounds.min(RISE),
            first: 0.1,
            ..search
        };
        let before = flow.vertices.state();
        lifted += flow.lift_the_mean(&rise, GOAL)?;
        // What does not fall is the merit, which short sides may hold where the corners are better than that.
        if flow.worst(Cells::jacobian) < smallest {
            flow.vertices.put(before);
        }
    }
    Ok(lifted)
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
