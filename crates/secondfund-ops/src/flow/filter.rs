//! Smoothing by filtered normals, the rival of the flows: the normals of the faces first, then the vertices, which
//! follow them.

use geom_core::{Point3, QuadMesh, Run, TriMesh};

use super::guard::hold_back;
use super::sheet::Sheet;
use super::steps::{FlowReport, Smoothed};
use super::{bilateral, variation};
use crate::Error;
use crate::backend::{On, OperatorBackend};
use crate::options::{FilterOptions, NormalFilter};

/// Filters the normals of a triangle mesh; the vertices then follow them (Sun, Rosin, Martin and Langbein, *Fast and
/// effective feature-preserving mesh denoising*, 2007) and spread along what they leave free, so that triangles keep
/// their shapes. On the CPU with any backend.
///
/// # Errors
/// Options out of range, [`Error::NoExtent`] of a mesh without faces or of one place.
pub fn filter_normals<B: OperatorBackend + ?Sized>(
    mesh: &TriMesh,
    options: &FilterOptions,
    run: Run<'_, B>,
) -> Result<Smoothed<TriMesh>, Error> {
    let run = run.with(run.backend.as_operators());
    let (positions, mut report) = filter(mesh.positions(), mesh.triangles(), options, run)?;
    let smoothed = TriMesh::new(positions, mesh.triangles().to_vec())?;
    report.volume = [mesh.volume(), smoothed.volume()];
    Ok(Smoothed {
        mesh: smoothed,
        report,
    })
}

/// The same of a quad mesh as it stands, not of its limit surface: a quad's normal is that of its mean plane.
///
/// # Errors
/// As [`filter_normals`].
pub fn filter_quad_normals<B: OperatorBackend + ?Sized>(
    mesh: &QuadMesh,
    options: &FilterOptions,
    run: Run<'_, B>,
) -> Result<Smoothed<QuadMesh>, Error> {
    let run = run.with(run.backend.as_operators());
    let (positions, mut report) = filter(mesh.positions(), mesh.quads(), options, run)?;
    let smoothed = QuadMesh::new(positions, mesh.quads().to_vec())?;
    report.volume = [mesh.volume(), smoothed.volume()];
    Ok(Smoothed {
        mesh: smoothed,
        report,
    })
}

fn filter<const N: usize>(
    start: &[Point3],
    faces: &[[u32; N]],
    options: &FilterOptions,
    run: On<'_>,
) -> Result<(Vec<Point3>, FlowReport), Error> {
    options.check()?;
    let sheet = Sheet::of(start, faces)?;
    let normals = match options.filter {
        NormalFilter::Bilateral { rounds, range } => {
            bilateral::filtered(&sheet, faces, rounds, range, run)?
        }
        NormalFilter::TotalVariation { rounds, fidelity } => {
            variation::filtered(&sheet, rounds, fidelity, run)?
        }
    };
    let least_sine = options.least_angle.to_radians().sin();
    let mut positions = start.to_vec();
    let mut report = FlowReport::default();
    for round in 0..options.vertex_rounds {
        run.progress("vertices", round as u64, options.vertex_rounds as u64)?;
        let mut moves = sheet.steps(&positions, faces, &normals, options.tangential);
        if options.keep_rims {
            sheet.hold_rims(&mut moves);
        }
        report.held_back += hold_back(&positions, faces, &mut moves, least_sine);
        positions.iter_mut().zip(&moves).for_each(|(p, m)| *p += m);
        report.steps += 1;
    }
    report.measure(start, &positions);
    Ok((positions, report))
}
