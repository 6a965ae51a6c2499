//! Smoothing by filtered normals, the rival of the flows: the normals of the faces first, then the vertices, which
//! follow them.

use geom_core::{Point3, QuadMesh, Run, TriMesh};

use super::guard::{Guard, Shape};
use super::sheet::Sheet;
use super::steps::{FlowReport, Smoothed};
use super::{bilateral, variation, volume};
use crate::Error;
use crate::backend::{On, OperatorBackend};
use crate::options::{FilterOptions, NormalFilter};

/// Filters the normals of a triangle mesh; the vertices then follow them (Sun, Rosin, Martin and Langbein, *Fast and
/// effective feature-preserving mesh denoising*, 2007) and spread along what they leave free, so that triangles keep
/// their shapes. On the CPU with any backend.
///
/// The normals are filtered once, from those of the input; [`FilterOptions::vertex_rounds`] then moves the vertices
/// towards them. Vertices keep their numbers, faces their corners.
///
/// # Errors
/// Options out of range, [`Error::NoExtent`] of a mesh without faces or of one place, [`Error::Open`] with
/// [`FilterOptions::keep_volume`].
pub fn filter_normals<B: OperatorBackend + ?Sized>(
    mesh: &TriMesh,
    options: &FilterOptions,
    run: Run<'_, B>,
) -> Result<Smoothed<TriMesh>, Error> {
    filter_normals_on(mesh, options, run.with(run.backend.as_operators()))
}

fn filter_normals_on(
    mesh: &TriMesh,
    options: &FilterOptions,
    run: On<'_>,
) -> Result<Smoothed<TriMesh>, Error> {
    let surface = |x: &[Point3]| Ok(TriMesh::new(x.to_vec(), mesh.triangles().to_vec())?);
    let (positions, mut report) =
        filter(mesh.positions(), mesh.triangles(), surface, options, run)?;
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
    filter_quad_normals_on(mesh, options, run.with(run.backend.as_operators()))
}

fn filter_quad_normals_on(
    mesh: &QuadMesh,
    options: &FilterOptions,
    run: On<'_>,
) -> Result<Smoothed<QuadMesh>, Error> {
    let surface = |x: &[Point3]| {
        let quads = QuadMesh::new(x.to_vec(), mesh.quads().to_vec())?;
        Ok(quads.into_triangles())
    };
    let (positions, mut report) = filter(mesh.positions(), mesh.quads(), surface, options, run)?;
    let smoothed = QuadMesh::new(positions, mesh.quads().to_vec())?;
    report.volume = [mesh.volume(), smoothed.volume()];
    Ok(Smoothed {
        mesh: smoothed,
        report,
    })
}

/// Both kinds of mesh: normals once, then rounds of the vertices, each held back by the guard.
fn filter<const N: usize>(
    start: &[Point3],
    faces: &[[u32; N]],
    surface: impl Fn(&[Point3]) -> Result<TriMesh, Error>,
    options: &FilterOptions,
    run: On<'_>,
) -> Result<(Vec<Point3>, FlowReport), Error> {
    options.check()?;
    let sheet = Sheet::of(start, faces)?;
    if options.keep_volume {
        volume::refuse_open(faces)?;
    }
    let normals = match options.filter {
        NormalFilter::Bilateral { rounds, range } => {
            bilateral::filtered(&sheet, faces, rounds, range, run)?
        }
        NormalFilter::TotalVariation { rounds, fidelity } => {
            variation::filtered(&sheet, rounds, fidelity, run)?
        }
    };
    let shape = Shape::wide(options.least_angle);
    let mut guard = Guard::of(start, faces, shape, options.keep_apart)?;
    let enclosed = surface(start)?.volume();
    let mut positions = start.to_vec();
    let mut report = FlowReport::default();
    for round in 0..options.vertex_rounds {
        run.progress("vertices", round as u64, options.vertex_rounds as u64)?;
        let mut moves = sheet.steps(&positions, faces, &normals, options.tangential);
        if options.keep_rims {
            sheet.hold_rims(&mut moves);
        }
        report.held_back += guard.hold_back(&positions, &mut moves)?;
        positions.iter_mut().zip(&moves).for_each(|(p, m)| *p += m);
        if options.keep_volume {
            report.held_back += volume::restore(&mut positions, enclosed, &surface, &mut guard)?;
        }
        report.steps += 1;
    }
    report.measure(start, &positions);
    Ok((positions, report))
}
