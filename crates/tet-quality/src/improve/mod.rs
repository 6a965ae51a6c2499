//! The verb: from a mesh and goals to a better mesh and an account.

use geom_core::options::{OutOfRange, require};
use geom_core::{ImplicitField, Run, TetMesh};

use crate::backend::{On, QualityBackend};
use crate::boundary::field::Isosurface;
use crate::boundary::input::{free_again, prepare};
use crate::boundary::own::OwnSurface;
use crate::error::Error;
use crate::improve::passes::Passes;
use crate::measure::unmet::{surface_fit, unmet};
use crate::options::{Options, SurfaceMotion};
use crate::outcome::{Crossings, Improved, Report};

pub(crate) mod crossed;
mod part;
mod passes;
mod seat;
mod settings;

/// Improves a tetrahedral mesh: smoothing, swaps, flips and contractions, until the
/// [`Goals`](crate::Goals) are met, nothing changes, or the passes are used up. No operation inverts
/// a tetrahedron or makes the worst of those it touches worse; regions and their interfaces keep
/// their topology; box faces stay plane and box edges straight; a cavity that is not meshed keeps at
/// least a quarter of its volume, so that its wall does not turn inside out. Walls of gaps that are
/// not meshed and have come through each other are parted at the end; [`Report::crossings`] says what remains.
///
/// `field` is the density whose level [`Options::level`] the surface vertices lie on. Where a plane wall between two other
/// regions meets that surface, as that of a membrane does, vertices go to the curve in which both meet. A mesh of which
/// nothing else is known can move along its own surfaces: [`SurfaceMotion::AlongInput`].
///
/// On any backend, moves of surface vertices, operations, the guard of cavities and gaps, and what falls
/// short are judged on the CPU; the backend measures the mesh before and after and proposes the moves of
/// the other vertices.
///
/// ```
/// # #[cfg(feature = "testing")] {
/// use tet_quality::geom_core::{Cpu, ImplicitField, Run};
/// use tet_quality::{Options, improve};
/// # use tet_quality::testing::ball_in_box;
///
/// // A ball in a box; the ball is also the implicit field that its surface vertices stay on.
/// let (mesh, ball) = ball_in_box(6, 1.0, 2.1);
/// let field: &dyn ImplicitField = &ball;
/// let improved = improve(mesh, Some(field), &Options::default(), Run::on(&Cpu))?;
///
/// let report = &improved.report;
/// assert!(report.after.all.min_dihedral.min > report.before.all.min_dihedral.min);
/// assert!(report.converged && report.unmet.counts.is_empty());
/// assert_eq!(report.surface.far, 0);
/// # }
/// # Ok::<(), tet_quality::Error>(())
/// ```
///
/// An empty mesh gives an empty one. Memory and the time of a sweep grow with the number of tetrahedra; later passes
/// look only at those that still miss the goals.
///
/// # Errors
///
/// - [`Error::Option`]: an option is out of its range, or [`SurfaceMotion::AlongInput`] was asked for with a field.
/// - [`Error::NonManifoldFace`], [`Error::NotOrientable`]: the tetrahedra overlap.
/// - [`Error::StillInverted`]: some stay inverted or flat, or [`Options::untangle`] is off.
/// - [`Error::FieldNotFinite`]: the field is not a number at a surface vertex.
/// - [`Error::Cancelled`]: the watcher asked to stop, between two passes or rounds.
/// - [`Error::Backend`]: the backend failed, or gave another number of answers than were asked for.
pub fn improve<B: QualityBackend + ?Sized>(
    mesh: TetMesh,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Improved, Error> {
    improve_part(mesh, &[], field, options, run)
}

/// [`improve`] for a part of a larger mesh: vertices that are `held` (one flag per vertex; none is, of an empty list) stay
/// where they are and keep the edges and faces between them, so that parts which share them still fit together. Their
/// kinds come out as they went in. What they forbid counts as the boundary in the account.
///
/// # Errors
///
/// Those of [`improve`], and motions of the surface that know no held vertices: only [`SurfaceMotion::Tangential`] and
/// [`SurfaceMotion::Fixed`] do.
pub fn improve_part<B: QualityBackend + ?Sized>(
    mesh: TetMesh,
    held: &[bool],
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Improved, Error> {
    improve_part_on(
        mesh,
        held,
        field,
        options,
        run.with(run.backend.as_quality()),
    )
}

/// Both verbs, compiled once: input, flow, passes, parting of walls, account. The flow comes before the passes, since
/// it leaves the isosurface; walls are parted after them, when few are left.
fn improve_part_on(
    mesh: TetMesh,
    held: &[bool],
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: On<'_>,
) -> Result<Improved, Error> {
    options.check()?;
    if !held.is_empty() {
        let (flags, of) = (held.len(), mesh.positions().len());
        let told = format!("{flags} flags for {of} vertices");
        require(
            flags == of,
            "held",
            told,
            "have one flag per vertex, or none",
        )?;
        let local = matches!(
            options.surface,
            SurfaceMotion::Tangential | SurfaceMotion::Fixed
        );
        let told = format!("{:?}", options.surface);
        let must = "be Tangential or Fixed where vertices are held";
        require(local, "surface", told, must)?;
    }
    let along_input = options.surface == SurfaceMotion::AlongInput;
    if along_input && field.is_some() {
        let must = "be Tangential where there is a field";
        return Err(OutOfRange::new("surface", "AlongInput", must).into());
    }
    // What the surface vertices lie on: the level set, or the input's own surfaces.
    let mut surface = field.map(|field| Isosurface {
        field,
        level: options.level,
        own: false,
        plane: None,
    });
    let mut input = prepare(mesh, held, surface.as_ref())?;
    let own = along_input.then(|| OwnSurface::of(&input.mesh)).flatten();
    if let Some(own) = &own {
        surface = Some(Isosurface {
            field: own,
            level: 0.0,
            own: true,
            plane: None,
        });
        free_again(&mut input.mesh, surface.as_ref())?;
    }
    // The work.
    let mut work = Passes::new(input.mesh, surface, options);
    let before = work.quality(run)?;
    let crossed = work.crossing().len();
    let untangled = work.untangle(run)?;
    let flowed = work.flow(&input.junctions)?;
    let mut passes = work.run(run)?;
    let crossing = work.crossing();
    let after_passes = crossing.len();
    let left = match options.passes {
        0 => after_passes,
        _ => work.part(crossing, &mut passes, run)?,
    };
    // The account.
    let after = work.quality(run)?;
    let mesh = &work.guarded.mesh;
    let unmet = unmet(mesh, &options.goals, &input.junctions);
    let report = Report {
        backend: run.backend.name(),
        before,
        after,
        // Decided in f64, whatever the backend measures in.
        converged: unmet.counts.is_empty(),
        passes,
        reoriented: input.reoriented,
        untangled,
        flowed,
        unmet,
        surface: surface_fit(mesh, work.surface.as_ref(), work.deviation()),
        crossings: Crossings {
            before: crossed,
            after_passes,
            after: left,
        },
        junctions: input.junctions,
    };
    Ok(Improved {
        mesh: work.guarded.mesh.finish(),
        report,
    })
}
