//! Isotropic remeshing of triangle surfaces: edges of a wanted length, triangles near equilateral.
//!
//! [`remesh`] repeats four steps (Botsch and Kobbelt, *A remeshing approach to multiresolution
//! modeling*, 2004): split edges longer than 4/3 of the wanted length, contract edges shorter than
//! 4/5 of it, flip edges towards even valences and larger angles, and move each vertex within its
//! tangent plane and back to the surface. It follows the level set of a field where one is given,
//! else the input mesh. The wanted length is the same everywhere or adapts to the curvature
//! (Dunyach et al., *Adaptive remeshing for real-time mesh deformation*, 2013).
//!
//! Where the surface is too narrow or too curved for the wanted edges, they become shorter, with gradation, until two
//! goals are met: all angles at least 30° ([`Options::min_angle_deg`]), and a distance between result and surface,
//! both ways, of at most 0.3 edge lengths ([`Options::max_deviation`]). So they do where triangles cross each other and none
//! of the input did. [`Report`] has the distances as measured, the
//! lengths of the edges in units of those asked for, and each triangle below the goal with its cause. Borders and
//! creases ([`Features::Angle`]) are resampled; their corners are those that turn by 45° within a wanted edge, so that
//! a ragged border makes no needles. All of it runs on the CPU, whatever the backend.
//!
//! Every step is tested before it is done: the surface stays a manifold of the same topology (link
//! condition), no triangle turns away from the surface's normal, and features, boundaries and
//! their corners stay. Topology changes run in a fixed order and moves colour by colour, so the
//! result has the same bits for any number of threads.
//!
//! Files: `options.rs` and [`Report`] are the two ends; `mesh.rs` is the mesh that changes, `reference.rs` the surface
//! that it follows; `kept.rs` says which edges stay, `sizes.rs` how long edges shall be; `steps.rs` does a round,
//! `refine.rs` looks where goals are missed.

#[cfg(feature = "testing")]
#[doc(hidden)]
pub mod inside;
mod kept;
mod mesh;
mod options;
mod reference;
mod refine;
mod report;
mod sizes;
mod steps;

use crate::mesh::TriangleReport;
use crate::mesh::quality::edge_lengths;
use crate::{Backend, ImplicitField, Run, TriMesh};

pub use options::{Error, Features, Options, Sizing};
pub use report::{Cause, Deviation, Exception, RelativeLengths, Remeshed, Report};

use mesh::Mesh;
use reference::Reference;

/// How often the work begins anew where parts of the surface were lost. Parts are lost where edges were too long for
/// them at first; the second start has the lengths that the first one found.
const RESTARTS: usize = 1;

/// A surface of good triangles in place of `mesh`, with edges as `options` want them. Vertices lie
/// on the level set of `field` where one is given, else on `mesh`; also there where the level set is
/// farther than an edge or faces another way, since the topology is that of `mesh`.
///
/// ```
/// use geom_core::{Cpu, Run, mesh::shapes};
/// use geom_core::surface::remesh::{Options, Sizing, remesh};
/// let torus = shapes::torus(3.0, 1.0, 40, 12);
/// let options = Options {
///     sizing: Sizing::Uniform { edge_length: Some(0.3) },
///     ..Options::default()
/// };
/// let result = remesh(torus, None, &options, Run::on(&Cpu))?;
/// assert_eq!(result.mesh.euler_characteristic(), 0);
/// assert!(result.report.after.min_angle_deg > 25.0);
/// # Ok::<(), geom_core::surface::remesh::Error>(())
/// ```
///
/// # Errors
/// [`Error`] names the option or the element that is at fault.
///
/// Progress is told in the stages `remesh` (rounds) and `refine`. Not to meet the goals is no error: look at
/// [`Report::converged`] and [`Report::exceptions`].
pub fn remesh(
    mesh: TriMesh,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, impl Backend + ?Sized>,
) -> Result<Remeshed, Error> {
    // Of the run, only the watcher: all that follows is compiled once, whatever the backend.
    let run = run.with(&());
    options.check()?;
    if mesh.triangles().is_empty() {
        return Err(Error::Empty);
    }
    for triangle in 0..mesh.triangles().len() {
        let doubled_area = mesh.doubled_area_normal(triangle).norm_squared();
        if doubled_area == 0.0 {
            return Err(Error::Degenerate { triangle });
        }
        let longest = edge_lengths(mesh.corners(triangle))
            .into_iter()
            .fold(0.0, f64::max);
        if !(doubled_area.is_finite() && longest.is_finite()) {
            return Err(Error::TooLarge { triangle });
        }
    }
    let before = TriangleReport::of(&mesh);
    let triangles = mesh.triangles().len();
    let labels = match options.labels.len() {
        0 => vec![0; triangles],
        n if n == triangles => options.labels.clone(),
        labels => return Err(Error::Labels { labels, triangles }),
    };
    let mut work = Mesh::new(&mesh, labels)?;
    let mut reference = Reference::new(mesh, field, options, &mut work)?;
    let goal = options.min_angle_deg.to_radians();
    let points = reference.points();
    let (mut counts, mut settled, mut iterations, mut refinements) = <_>::default();
    let start = work.clone();
    for attempt in 0..=RESTARTS {
        (settled, iterations) = rounds(&mut work, &reference, options, run, &mut counts)?;
        counts += steps::lift(&mut work, &reference, goal);
        for stage in 0..options.refinements {
            run.progress("refine", stage as u64, options.refinements as u64)?;
            if refine::shorten(&mut work, &mut reference, &points, goal) == 0 {
                break;
            }
            refinements += 1;
            counts += steps::round(&mut work, &reference);
            counts += steps::round(&mut work, &reference);
            counts += steps::round(&mut work, &reference);
            steps::settle(&mut work, &reference);
            counts += steps::lift(&mut work, &reference, goal);
        }
        // What has been cut off does not grow again, but now it is known where edges must be short.
        let lost = || {
            let farthest = refine::farthest_from(&work.surface(), &reference, &points);
            farthest > reference.allowed || refine::crosses(&work, &reference)
        };
        if attempt == RESTARTS || refinements == 0 || !lost() {
            break;
        }
        work = start.clone();
        reference.spots.renew();
        refine::apply(&mut work, &reference);
        counts = steps::Counts::default();
    }
    let feature_edges = work.edges().filter(|&h| work.is_feature(h)).count();
    let lengths = relative_lengths(&work);
    let alive = (0..work.vertices.len() as u32).filter(|&v| work.is_alive(v));
    let shorter = alive.clone().filter(|&v| {
        let vertex = &work.vertices[v as usize];
        vertex.size < vertex.wanted
    });
    let shortened = shorter.count() as f64 / alive.count() as f64;
    let exceptions = refine::exceptions(&work, &reference, goal);
    let mesh = work.surface();
    let labels = if options.labels.is_empty() {
        Vec::new()
    } else {
        work.living_labels()
    };
    let (vertex_deviation, inner_deviation) = reference.deviations(&mesh);
    let reverse_deviation = refine::farthest_from(&mesh, &reference, &points);
    let allowed_deviation = reference.allowed;
    let off_level = reference.off_level(&mesh);
    let after = TriangleReport::of(&mesh);
    let largest = inner_deviation.max.max(reverse_deviation);
    let converged =
        settled && after.min_angle_deg >= options.min_angle_deg && largest <= allowed_deviation;
    let report = Report {
        before,
        after,
        iterations,
        splits: counts.splits,
        contractions: counts.contractions,
        flips: counts.flips,
        refinements,
        shortened,
        lengths,
        feature_edges,
        vertex_deviation,
        inner_deviation,
        reverse_deviation,
        allowed_deviation,
        off_level,
        exceptions,
        converged,
    };
    Ok(Remeshed {
        mesh,
        labels,
        report,
    })
}

/// Of each edge in units of the shorter of the lengths asked for at its ends; refined places thus count as short.
fn relative_lengths(work: &Mesh) -> RelativeLengths {
    let wanted = |v: u32| work.vertices[v as usize].wanted;
    let mut lengths: Vec<f64> = work
        .edges()
        .map(|h| work.length(h) / wanted(work.from(h)).min(wanted(work.to(h))))
        .collect();
    lengths.sort_by(f64::total_cmp);
    let last = lengths.len() - 1;
    let inside = lengths
        .iter()
        .filter(|&&l| (steps::SHORT..=steps::LONG).contains(&l));
    RelativeLengths {
        min: lengths[0],
        percent_1: lengths[last / 100],
        median: lengths[last / 2],
        percent_99: lengths[last - last / 100],
        max: lengths[last],
        within: inside.count() as f64 / lengths.len() as f64,
    }
}

/// The rounds at the lengths wanted now; did they settle, and how many were they? They have when a round changes less
/// than one edge in a hundred.
fn rounds(
    work: &mut Mesh,
    reference: &Reference<'_>,
    options: &Options,
    run: Run<'_, ()>,
    counts: &mut steps::Counts,
) -> Result<(bool, usize), Error> {
    let (mut settled, mut done) = (false, 0);
    while done < options.iterations && !settled {
        run.progress("remesh", done as u64, options.iterations as u64)?;
        let changes = steps::round(work, reference);
        settled = 100 * changes.total() < work.edges().count();
        *counts += changes;
        done += 1;
    }
    steps::settle(work, reference);
    Ok((settled, done))
}
