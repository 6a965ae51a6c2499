//! Smoothing by filtered normals, the rival of the flows: the normals of the faces first, then the vertices, which
//! follow them.

use geom_core::compute::parallel;
use geom_core::{Point3, QuadMesh, Run, TriMesh, Vector3};
use rayon::prelude::*;

use super::guard::hold_back;
use super::steps::{FlowReport, Smoothed};
use super::{bilateral, variation};
use crate::Error;
use crate::backend::{On, OperatorBackend};
use crate::forms::{area_normal, centroid, sorted_sides};
use crate::options::{FilterOptions, NormalFilter};

/// Filters the normals of a triangle mesh; the vertices then follow them (Sun, Rosin, Martin and Langbein, *Fast and
/// effective feature-preserving mesh denoising*, 2007). On the CPU with any backend.
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
    let mut positions = start.to_vec();
    let mut report = FlowReport::default();
    for round in 0..options.vertex_rounds {
        run.progress("vertices", round as u64, options.vertex_rounds as u64)?;
        let mut moves = sheet.steps(&positions, faces, &normals);
        if options.keep_rims {
            sheet.hold_rims(&mut moves);
        }
        report.held_back += hold_back(&positions, faces, &mut moves);
        positions.iter_mut().zip(&moves).for_each(|(p, m)| *p += m);
        report.steps += 1;
    }
    report.measure(start, &positions);
    Ok((positions, report))
}

/// An edge of two faces.
pub(super) struct Hinge {
    pub(super) faces: [u32; 2],
    /// In mean edges.
    pub(super) length: f64,
}

/// The faces of a mesh as a filter sees them.
pub(super) struct Sheet {
    pub(super) centers: Vec<Point3>,
    /// Unit normals, zero for a face without area.
    pub(super) normals: Vec<Vector3>,
    /// In squared mean edges.
    pub(super) areas: Vec<f64>,
    pub(super) hinges: Vec<Hinge>,
    /// Which vertices lie on boundaries.
    rims: Vec<bool>,
    starts: Vec<usize>,
    faces: Vec<u32>,
}

impl Sheet {
    fn of<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> Result<Self, Error> {
        let sides = sorted_sides(faces);
        let length = |[a, b]: [u32; 2]| (positions[b as usize] - positions[a as usize]).norm();
        let all: f64 = sides.iter().map(|side| length(side.0)).sum();
        let edge = all / sides.len() as f64;
        // Not a number for a mesh without faces.
        if edge.is_nan() || edge <= 0.0 {
            return Err(Error::NoExtent);
        }
        let mut rims = vec![false; positions.len()];
        let mut hinges = Vec::with_capacity(sides.len() / 2);
        for around in sides.chunk_by(|a, b| a.0 == b.0) {
            match around {
                [(ends, _)] => ends.iter().for_each(|&v| rims[v as usize] = true),
                [(ends, f), (_, g)] => hinges.push(Hinge {
                    faces: [*f, *g],
                    length: length(*ends) / edge,
                }),
                // More than two sheets have no common normal.
                _ => {}
            }
        }
        let scaled: Vec<Vector3> = faces.iter().map(|f| area_normal(positions, f)).collect();
        let unit = |n: &Vector3| n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let mut counts = vec![0u32; positions.len()];
        for &v in faces.as_flattened() {
            counts[v as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut members = vec![0; faces.as_flattened().len()];
        for (corner, &v) in faces.as_flattened().iter().enumerate() {
            members[next[v as usize]] = (corner / N) as u32;
            next[v as usize] += 1;
        }
        Ok(Self {
            centers: faces.iter().map(|f| centroid(positions, f)).collect(),
            normals: scaled.iter().map(unit).collect(),
            areas: scaled.iter().map(|n| n.norm() / (edge * edge)).collect(),
            hinges,
            rims,
            starts,
            faces: members,
        })
    }

    /// The faces of a vertex.
    pub(super) fn around(&self, v: usize) -> &[u32] {
        &self.faces[self.starts[v]..self.starts[v + 1]]
    }

    /// Each vertex goes the mean of its ways to the planes through the middles of its faces.
    fn steps<const N: usize>(
        &self,
        positions: &[Point3],
        corners: &[[u32; N]],
        normals: &[Vector3],
    ) -> Vec<Vector3> {
        (0..positions.len())
            .into_par_iter()
            .map(|v| {
                let faces = self.around(v);
                let to_planes = faces.iter().map(|&f| {
                    let center = centroid(positions, &corners[f as usize]);
                    let n = normals[f as usize];
                    n * n.dot(&(center - positions[v]))
                });
                to_planes.sum::<Vector3>() / faces.len().max(1) as f64
            })
            .collect()
    }

    fn hold_rims(&self, moves: &mut [Vector3]) {
        for (m, _) in moves.iter_mut().zip(&self.rims).filter(|(_, rim)| **rim) {
            *m = Vector3::zeros();
        }
    }
}
