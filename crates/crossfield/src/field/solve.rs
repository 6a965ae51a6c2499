//! From guides to a cross field: diffusion, polish, descent, on a surface smoothed to the size of the
//! quads.

use geom_core::algebra::Cholesky;
use geom_core::surface::laplace::{self, Mass};
use geom_core::{Point3, TriMesh};

use super::descend::Descent;
use super::diffuse::diffused;
use super::field::{CrossField, FieldReport, Guide};
use super::frames::{Frames, QUARTER};
use super::parallel::Parallel;
use super::singularity;
use crate::Error;
use crate::options::FieldOptions;

/// Steps of mean curvature flow.
const FLOW_STEPS: usize = 3;
/// How often a smoothing that cannot be carried back is halved.
const HALVINGS: usize = 4;
/// Rounds of matching and exact angles.
const POLISH: usize = 20;

/// The smoothest cross field that follows the guides (Eq. 4.9), with few singularities.
///
/// Bumps smaller than the quads would earn singularities closer to each other than a quad's side, which no
/// quad mesh can hold. So the field's topology is decided on a copy of the surface after mean curvature
/// flow for a time of `smoothing²`, and carried back: the periods jump by whole turns where a transport does, and
/// indices stay.
///
/// Runs on the CPU, whatever the backend: its factors are sparse and irregular.
pub fn cross_field(
    mesh: &TriMesh,
    guides: &[Guide],
    options: &FieldOptions,
) -> Result<CrossField, Error> {
    options.check()?;
    let frames = Frames::of(mesh, options.weights)?;
    let (guides, conflicts) = without_conflicts(guides, &frames);
    let report = FieldReport {
        guided: guides.len(),
        conflicts,
        ..FieldReport::default()
    };
    let mut smoothing = options.smoothing;
    for _ in 0..HALVINGS {
        if smoothing <= 0.0 {
            break;
        }
        let smooth = flowed(mesh, smoothing * smoothing)?;
        if let Some(field) = carried(&frames, &smooth, smoothing, &guides, options, &report)? {
            return Ok(field);
        }
        smoothing *= std::f64::consts::FRAC_1_SQRT_2;
    }
    on_one_surface(mesh, &frames, &guides, options, report)
}

/// The field of a surface as it is.
fn on_one_surface(
    mesh: &TriMesh,
    frames: &Frames,
    guides: &[Guide],
    options: &FieldOptions,
    mut report: FieldReport,
) -> Result<CrossField, Error> {
    let mut theta = diffused(frames, guides)?;
    let parallel = Parallel::new(frames, guides)?;
    let mut jump = vec![0; frames.edges().len()];
    for _ in 0..POLISH {
        let before = jump.clone();
        match_branches(frames, &theta, &mut jump);
        if jump == before {
            break;
        }
        parallel.angles(&jump, &mut theta)?;
    }
    let mut descent = Descent::new(mesh, &parallel, theta, jump);
    descent.run(options.singularity_penalty, &mut report)?;
    let (mut theta, jump) = (descent.theta, descent.jump);
    parallel.angles(&jump, &mut theta)?;
    Ok(CrossField::measured(frames, theta, jump, report))
}

/// Solves on the smoothed surface and carries the period jumps back; `None` where an index would change.
fn carried(
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
    let solved = on_one_surface(smooth, &smooth_frames, guides, options, report.clone())?;
    let mut jump = solved.jump.clone();
    for (h, t) in frames.interior() {
        let turns = (smooth_frames.transport(h) - frames.transport(h)) / std::f64::consts::TAU;
        jump[h] += 4 * turns.round() as i32;
        jump[t] = -jump[h];
    }
    let inside = |v: &usize| {
        frames.edges().out(geom_core::VertexId(*v as u32)).is_some() && !frames.on_boundary(*v)
    };
    let kept = (0..frames.edges().vertices())
        .filter(inside)
        .all(|v| singularity::interior_index(frames, &jump, v) == solved.index[v]);
    if !kept {
        return Ok(None);
    }
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
fn match_branches(frames: &Frames, theta: &[f64], jump: &mut [i32]) {
    for (h, t) in frames.interior() {
        let turn = theta[t / 3] - theta[h / 3] - frames.transport(h);
        jump[h] = (turn / QUARTER).round() as i32;
        jump[t] = -jump[h];
    }
}

/// One guide per triangle: hard before soft, then the heavier, then the first.
fn without_conflicts(guides: &[Guide], frames: &Frames) -> (Vec<Guide>, usize) {
    let mut kept: Vec<Guide> = guides.to_vec();
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

/// Mean curvature flow for a time t, in implicit steps with the operator of the start (Desbrun et al., 1999).
/// Boundary vertices stay.
fn flowed(mesh: &TriMesh, time: f64) -> Result<TriMesh, Error> {
    let stiffness = laplace::stiffness(mesh)?;
    let Mass::Lumped(mass) = laplace::lumped_mass(mesh) else {
        unreachable!("the lumped mass is lumped")
    };
    let edges = geom_core::mesh::Halfedges::of(mesh)?;
    let vertices = mesh.positions().len();
    let stays: Vec<bool> = (0..vertices)
        .map(|v| {
            let v = geom_core::VertexId(v as u32);
            edges.out(v).is_none() || edges.on_boundary(v)
        })
        .collect();
    let step = time / FLOW_STEPS as f64;
    // Rows of vertices that stay become x = x; their columns go to the right-hand side.
    let matrix = stiffness.map(|i, j, k| match (i == j, stays[i] || stays[j]) {
        (true, true) => 1.0,
        (false, true) => 0.0,
        (true, false) => mass[i] + step * k,
        (false, false) => step * k,
    });
    let factor = Cholesky::of(&matrix)?;
    let mut block: Vec<f64> = mesh
        .positions()
        .iter()
        .flat_map(|p| p.coords.iter().copied())
        .collect();
    for _ in 0..FLOW_STEPS {
        let mut right = vec![0.0; block.len()];
        for i in 0..vertices {
            for c in 0..3 {
                right[3 * i + c] = if stays[i] {
                    block[3 * i + c]
                } else {
                    let pulled: f64 = stiffness
                        .row(i)
                        .filter(|&(j, _)| stays[j])
                        .map(|(j, k)| step * k * block[3 * j + c])
                        .sum();
                    mass[i] * block[3 * i + c] - pulled
                };
            }
        }
        factor.solve_in_place(&mut right, 3)?;
        block = right;
    }
    let positions = block
        .chunks_exact(3)
        .map(|p| Point3::new(p[0], p[1], p[2]))
        .collect();
    Ok(TriMesh::new(positions, mesh.triangles().to_vec())?)
}
