//! From guides to a cross field: diffusion, polish, descent, on a surface smoothed to the size of the
//! quads.

use geom_core::{Run, TriMesh};

use super::descend::{Descent, Price};
use super::diffuse::diffused;
use super::field::{CrossField, FieldReport, Guide, Toward};
use super::frames::{Frames, QUARTER};
use super::parallel::Parallel;
use super::singularity::{self, Lines};
use super::smooth::{Operators, flowed};
use crate::CrossfieldBackend;
use crate::Error;
use crate::backend::On;
use crate::options::FieldOptions;

/// How often a smoothing that cannot be carried back is halved.
/// Of its time, which is the square of a length: lengths become 1/√2.
const HALVINGS: usize = 4;
/// Rounds of matching and exact angles.
/// No round raises the energy: neither better jumps for the same angles do, nor better angles for the same jumps.
const POLISH: usize = 20;

/// The smoothest cross field that follows the guides (Eq. 4.9), with few singularities.
///
/// Bumps smaller than the quads would earn singularities closer to each other than a quad's side, which no
/// quad mesh can hold. So the field's topology is decided on a copy of the surface after mean curvature
/// flow for a time of `smoothing²`, and carried back: the periods jump by whole turns where a transport does, and
/// indices stay.
///
/// Runs on the CPU, whatever the backend: its factors are sparse and irregular.
///
/// `mesh` is an oriented manifold, perhaps with boundary and of several parts; to its boundary the field is parallel only where
/// guides say so ([`Toward::Side`](super::Toward::Side)).
///
/// If an index would change on the way back, which needs very bad triangles, half the time is tried, four times in all, and
/// then the field is solved on the surface as it is; [`FieldReport::smoothing`] says what it came to, 0 for the last.
///
/// A try that cannot be carried back costs a flow. The one that can be costs a few sparse factorizations, two of them for the
/// diffusion, a solve for each batch of changes of period jumps that are far from each other, and for each change that is judged
/// the part of one that a sparse right-hand side needs.
///
/// # Errors
/// [`Error::Option`] names a guide of a triangle or side that is not there, or a value out of range; others say why the mesh
/// has no frames (three triangles at an edge, flat triangles) or that a factorization has failed for lack of memory.
pub fn cross_field<B: CrossfieldBackend + ?Sized>(
    mesh: &TriMesh,
    guides: &[Guide],
    options: &FieldOptions,
    run: Run<'_, B>,
) -> Result<CrossField, Error> {
    cross_field_on(mesh, guides, options, run.with(run.backend.as_crossfield()))
}

fn cross_field_on(
    mesh: &TriMesh,
    guides: &[Guide],
    options: &FieldOptions,
    run: On<'_>,
) -> Result<CrossField, Error> {
    options.check()?;
    guides
        .iter()
        .try_for_each(|g| g.check(mesh.triangles().len()))?;
    let frames = Frames::of(mesh, options.weights)?;
    let (guides, conflicts) = without_conflicts(guides, &frames);
    let report = FieldReport {
        guided: guides.len(),
        conflicts,
        ..FieldReport::default()
    };
    let mut smoothing = options.smoothing;
    let operators = (smoothing > 0.0).then(|| Operators::of(mesh)).transpose()?;
    for operators in operators.iter().cycle().take(HALVINGS) {
        let times = vec![smoothing * smoothing; mesh.positions().len()];
        let smooth = flowed(operators, &times, |_| false)?;
        if let Some(field) = carried(run, &frames, &smooth, smoothing, &guides, options, &report)? {
            return Ok(field);
        }
        smoothing *= std::f64::consts::FRAC_1_SQRT_2;
    }
    on_one_surface(mesh, &frames, &guides, options, report, run)
}

/// The field of a surface with the frames of what smoothing has left of it: `mesh` is what it was before, on which distances of
/// singularities are measured.
pub(crate) fn field_of(
    mesh: &TriMesh,
    frames: &Frames,
    guides: &[Guide],
    options: &FieldOptions,
    run: On<'_>,
) -> Result<CrossField, Error> {
    let (guides, conflicts) = without_conflicts(guides, frames);
    let report = FieldReport {
        guided: guides.len(),
        conflicts,
        smoothing: options.smoothing,
        ..FieldReport::default()
    };
    on_one_surface(mesh, frames, &guides, options, report, run)
}

/// The field of a surface as it is.
fn on_one_surface(
    mesh: &TriMesh,
    frames: &Frames,
    guides: &[Guide],
    options: &FieldOptions,
    mut report: FieldReport,
    run: On<'_>,
) -> Result<CrossField, Error> {
    // Much of either runs on one thread.
    let (theta, parallel) = rayon::join(
        || diffused(frames, guides, run),
        || Parallel::new(frames, guides),
    );
    let (mut theta, parallel) = (theta?, parallel?);
    let mut jump = vec![0; frames.edges().len()];
    for round in 0..POLISH {
        let before = jump.clone();
        match_branches(frames, &theta, &mut jump);
        // The angles are the best ones for these jumps after the first round, not before it.
        if round > 0 && jump == before {
            break;
        }
        parallel.angles(&jump, &mut theta)?;
    }
    let along = guides.iter().filter(|g| g.is_hard());
    let along = along.filter_map(|guide| match guide.toward {
        Toward::Side(side) => Some(3 * guide.face as usize + usize::from(side)),
        Toward::Angle(_) => None,
    });
    let lines = Lines::of(frames, along);
    let mut descent = Descent::new(mesh, &parallel, lines, (theta, jump), options.smoothing);
    let price = Price {
        far: options.singularity_penalty,
        near: options.smoothing,
    };
    descent.run(price, &mut report, run)?;
    let (mut theta, jump) = (descent.theta, descent.jump);
    parallel.angles(&jump, &mut theta)?;
    Ok(CrossField::measured(frames, theta, jump, report))
}

/// Solves on the smoothed surface and carries the period jumps back; `None` where an index would change.
///
/// κ and the angle defects depend continuously on the positions but for whole turns of κ: so
/// `p + 4 round((κ' − κ) / 2π)`, κ' being that of the smooth copy, is the same field in the same topology. That the
/// indices agree is checked all the same.
fn carried(
    run: On<'_>,
    frames: &Frames,
    smooth: &TriMesh,
    smoothing: f64,
    guides: &[Guide],
    options: &FieldOptions,
    report: &FieldReport,
) -> Result<Option<CrossField>, Error> {
    let Ok(smooth_frames) = Frames::of(smooth, options.weights) else {
        // The flow has made a triangle flat.
        return Ok(None);
    };
    let mut turns = vec![0; frames.edges().len()];
    for (h, t) in frames.interior() {
        let by = (smooth_frames.transport(h) - frames.transport(h)) / std::f64::consts::TAU;
        turns[h] = 4 * by.round() as i32;
        turns[t] = -turns[h];
    }
    // An index is a number of the frames less the jumps around: what those of any field come to is known before it is.
    let none = vec![0; turns.len()];
    let kept = |v: usize| {
        let id = geom_core::VertexId(v as u32);
        frames.edges().out(id).is_none()
            || frames.on_boundary(v)
            || singularity::interior_index(frames, &turns, v)
                == singularity::interior_index(&smooth_frames, &none, v)
    };
    if !(0..frames.edges().vertices()).all(kept) {
        return Ok(None);
    }
    let solved = on_one_surface(smooth, &smooth_frames, guides, options, report.clone(), run)?;
    let jump: Vec<i32> = solved.jump.iter().zip(&turns).map(|(p, t)| p + t).collect();
    let parallel = Parallel::new(frames, guides)?;
    let mut theta = solved.theta;
    parallel.angles(&jump, &mut theta)?;
    // Boundary guides hold the angle up to quarter turns: the jumps next to it follow the branch taken.
    let report = FieldReport {
        smoothing,
        ..solved.report
    };
    Ok(Some(CrossField::measured(frames, theta, jump, report)))
}

/// The principal matching: each cross with its neighbour's nearest arm.
/// The residual of each edge is at most an eighth of a turn then, and no other jump of that edge alone has a smaller
/// one.
fn match_branches(frames: &Frames, theta: &[f64], jump: &mut [i32]) {
    for (h, t) in frames.interior() {
        let turn = theta[t / 3] - theta[h / 3] - frames.transport(h);
        jump[h] = (turn / QUARTER).round() as i32;
        jump[t] = -jump[h];
    }
}

/// One guide per triangle: hard before soft, then the heavier, then the first. One of weight 0 holds nothing.
fn without_conflicts(guides: &[Guide], frames: &Frames) -> (Vec<Guide>, usize) {
    let mut kept: Vec<Guide> = guides.iter().filter(|g| g.weight > 0.0).copied().collect();
    kept.sort_by(|a, b| a.face.cmp(&b.face).then(b.weight.total_cmp(&a.weight)));
    let before = kept.len();
    let mut conflicts = 0;
    kept.dedup_by(|later, kept| {
        let same = later.face == kept.face;
        if same {
            let angle = later.angle(frames) - kept.angle(frames);
            conflicts += usize::from(super::frames::modulo_quarter(angle).abs() > 1e-6);
        }
        same
    });
    debug_assert!(kept.len() + conflicts <= before);
    (kept, conflicts)
}
