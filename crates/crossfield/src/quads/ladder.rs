//! From a surface to quads, part by part.

use geom_core::search::bvh::TriangleTree;
use geom_core::surface::repair;
use geom_core::{Point3, QuadMesh, Run, TriMesh};

use super::extract::SurfacePoint;
use super::parts;
use super::quality::{
    AspectSummary, JacobianSummary, Valences, aspect_ratio, scaled_jacobians, sources,
};
use super::rungs::{PartReport, Rung, part_quads};
use crate::anisotropy::{Slope, slopes};
use crate::backend::{CrossfieldBackend, On};
use crate::error::Error;
use crate::guidance::Guidance;
use crate::options::Options;

/// What was done.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Report {
    /// Backend of the kernels.
    pub backend: String,
    /// Per connected part.
    pub parts: Vec<PartReport>,
    /// What the input had to be repaired of; `None` for an oriented manifold without flat triangles.
    pub repaired: Option<repair::Report>,
    /// Scaled Jacobians of the quads.
    pub scaled_jacobian: JacobianSummary,
    /// How much longer than wide the quads are.
    pub aspect_ratio: AspectSummary,
    /// Vertices by their quads.
    pub valences: Valences,
}

impl Report {
    /// The last rung that any part needed.
    pub fn rung(&self) -> Rung {
        self.parts.iter().map(|p| p.rung).max().unwrap_or_default()
    }
}

/// A quad mesh of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Quadrangulation {
    /// The quads: a manifold, oriented like the surface, with its Euler characteristic and boundary loops.
    pub mesh: QuadMesh,
    /// Where each vertex lies on the input surface.
    pub sources: Vec<SurfacePoint>,
    /// The triangle of the input surface nearest to the centre of each quad.
    pub origins: Vec<u32>,
    /// The scaled Jacobian of each quad, signed by the surface's normals: see [`scaled_jacobian`](geom_core::mesh::quality::scaled_jacobian).
    pub jacobians: Vec<f64>,
    /// What was done.
    pub report: Report,
}

impl Quadrangulation {
    /// Values per vertex of the input surface, on the vertices of the quads. Panics unless there is one per vertex.
    pub fn vertex_values(&self, surface: &TriMesh, values: &[f64]) -> Vec<f64> {
        assert_eq!(
            values.len(),
            surface.positions().len(),
            "one value per vertex"
        );
        let at = |source: &SurfacePoint| {
            let corners = surface.triangles()[source.triangle as usize];
            (0..3)
                .map(|k| source.barycentric[k] * values[corners[k] as usize])
                .sum()
        };
        self.sources.iter().map(at).collect()
    }

    /// Labels per triangle of the input surface, on the quads: residues, chains, regions. Panics unless there is one per
    /// triangle.
    pub fn face_labels<T: Clone>(&self, labels: &[T]) -> Vec<T> {
        self.origins
            .iter()
            .map(|&t| labels[t as usize].clone())
            .collect()
    }
}

/// Quads of any surface: its field, the map that follows it, the quads of the map; see [`Rung`] for what happens where that
/// is not possible. The field, its eigenfunctions and the integers of the map are computed on the CPU, whatever the
/// backend; the kernels of untangling and improvement run on it.
///
/// ```
/// use crossfield::geom_core::{Cpu, Run, mesh::shapes};
/// use crossfield::{Options, Size, quadrangulate, quads::Rung};
///
/// // A prism with sharp rims, which stay sides of quads.
/// let prism = shapes::cylinder(2.0, 6.0, 48, 12);
/// let options = Options { size: Size::Spacing(0.5), crease: Some(60.0), ..Options::default() };
/// let made = quadrangulate(&prism, &options, Run::on(&Cpu))?;
/// assert_eq!(made.mesh.euler_characteristic(), 2);
/// // Which rung of the ladder gave the quads, and how far from the wanted corners they are.
/// let part = &made.report.parts[0];
/// assert!(part.rung != Rung::Split && part.quads == made.mesh.quads().len());
/// assert!(made.report.scaled_jacobian.min > 0.0);
/// # Ok::<(), crossfield::Error>(())
/// ```
///
/// The surface may have boundaries, several connected parts and triangles that have to be repaired: what is no oriented
/// manifold is made one first ([`Report::repaired`]). What it may need of memory, [`Options::bytes`] estimates.
///
/// # Errors
/// [`Error::Option`] for values out of range, [`Error::Empty`] without triangles, [`Error::Area`] without an area,
/// [`Error::Repair`] for input beyond repair, [`Error::TooLarge`] for more quads than there is memory for. With [`Ladder::Off`](crate::Ladder::Off) also the first failure of a field or map ([`Error::Folded`],
/// [`Error::Integers`], [`Error::TooMany`], [`Error::Topology`]); with [`Ladder::Full`](crate::Ladder::Full) these are in
/// [`PartReport::failures`] instead.
pub fn quadrangulate<B: CrossfieldBackend + ?Sized>(
    surface: &TriMesh,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Quadrangulation, Error> {
    quadrangulate_on(surface, options, run.with(run.backend.as_crossfield()))
}

fn quadrangulate_on(
    surface: &TriMesh,
    options: &Options,
    run: On<'_>,
) -> Result<Quadrangulation, Error> {
    options.check()?;
    if surface.triangles().is_empty() {
        return Err(Error::Empty);
    }
    let (whole, repaired) = repair::manifold(surface)?;
    let split = parts::split(&whole);
    let slopes = match &options.anisotropy {
        Some(anisotropy) => slopes(anisotropy, surface, &whole, &split)?,
        None => Vec::new(),
    };
    let area = filled_area(&whole, &slopes)?;
    let (bytes, limit) = (
        options.bytes(whole.area(), whole.triangles().len()),
        options.max_memory,
    );
    if !(area > 0.0 && area.is_finite()) {
        return Err(Error::Area { area });
    }
    if bytes > limit as f64 {
        return Err(Error::TooLarge { bytes, limit });
    }
    let spacing = options.size.spacing(area, whole.triangles().len());
    let guidance = guidance_of_parts(&whole, &split, &options.guidance)?;
    let mut positions = Vec::new();
    let mut quads = Vec::new();
    let mut found = Found::default();
    let mut report = Report {
        backend: run.backend.name(),
        repaired,
        ..Report::default()
    };
    for (number, (mesh, faces)) in split.iter().enumerate() {
        run.progress("quads", number as u64, split.len() as u64)?;
        let options = Options {
            guidance: guidance[number].clone(),
            anisotropy: None,
            ..*options
        };
        let (made, part) = part_quads(mesh, spacing, &options, slopes.get(number), run)?;
        // Each part by itself: another may touch it, or lie around it.
        found.add(&made, mesh, faces)?;
        let first = positions.len() as u32;
        let (more, corners) = made.into_parts();
        positions.extend(more);
        quads.extend(corners.into_iter().map(|q| q.map(|v| v + first)));
        report.parts.push(part);
    }
    let mesh = QuadMesh::new(positions, quads)?;
    if report.repaired.is_some() {
        // The triangles are others than the input's.
        found.places = Places::of(&mesh, surface)?;
    }
    report.valences = Valences::of(&mesh)?;
    report.scaled_jacobian = JacobianSummary::of(&found.jacobians);
    let aspects = (0..mesh.quads().len()).map(|q| aspect_ratio(&mesh.corners(q)));
    report.aspect_ratio = AspectSummary::of(aspects.collect());
    let Places { sources, origins } = found.places;
    Ok(Quadrangulation {
        mesh,
        sources,
        origins,
        jacobians: found.jacobians,
        report,
    })
}

/// What the parts' quads are like, and where they lie.
#[derive(Default)]
struct Found {
    jacobians: Vec<f64>,
    places: Places,
}

impl Found {
    /// Adds a part's quads; `faces` are the part's triangles in the whole surface.
    fn add(&mut self, quads: &QuadMesh, part: &TriMesh, faces: &[u32]) -> Result<(), Error> {
        self.jacobians.extend(scaled_jacobians(quads, part)?);
        let Places { sources, origins } = Places::of(quads, part)?;
        let of = |triangle: u32| faces[triangle as usize];
        self.places.origins.extend(origins.into_iter().map(of));
        let of = |source: SurfacePoint| SurfacePoint {
            triangle: of(source.triangle),
            ..source
        };
        self.places.sources.extend(sources.into_iter().map(of));
        Ok(())
    }
}

/// Where vertices and centres of quads lie on a surface.
#[derive(Default)]
struct Places {
    sources: Vec<SurfacePoint>,
    origins: Vec<u32>,
}

impl Places {
    fn of(mesh: &QuadMesh, surface: &TriMesh) -> Result<Self, Error> {
        let tree = TriangleTree::new(surface)?;
        let centres: Vec<Point3> = (0..mesh.quads().len())
            .map(|q| {
                let corners = mesh.corners(q).map(|p| p.coords);
                Point3::from((corners[0] + corners[1] + corners[2] + corners[3]) / 4.0)
            })
            .collect();
        let origins = tree.closest_to_all(&centres)?;
        Ok(Self {
            sources: sources(mesh, &tree)?,
            origins: origins.iter().map(|c| c.triangle).collect(),
        })
    }
}

/// The area that squares of one size fill: that of the surface, or with anisotropy what its narrow quads become when they
/// are stretched to squares.
fn filled_area(whole: &TriMesh, slopes: &[Slope]) -> Result<f64, Error> {
    if slopes.is_empty() {
        return Ok(whole.area());
    }
    slopes.iter().map(|slope| slope.stretched_area()).sum()
}

/// Each stroke guides the part that it lies on, everything else all parts.
fn guidance_of_parts(
    whole: &TriMesh,
    split: &[(TriMesh, Vec<u32>)],
    guidance: &[Guidance],
) -> Result<Vec<Vec<Guidance>>, Error> {
    let mut part_of = vec![0; whole.triangles().len()];
    for (number, (_, faces)) in split.iter().enumerate() {
        for &face in faces {
            part_of[face as usize] = number;
        }
    }
    let mut of_parts = vec![Vec::new(); split.len()];
    for one in guidance {
        let Guidance::Strokes { strokes, weight } = one else {
            for part in &mut of_parts {
                part.push(one.clone());
            }
            continue;
        };
        let points: Vec<Point3> = strokes.iter().map(|s| s.0).collect();
        let tree = TriangleTree::new(whole)?;
        let nearest = tree.closest_to_all(&points)?;
        for (number, part) in of_parts.iter_mut().enumerate() {
            let own = strokes.iter().zip(&nearest);
            let own = own.filter(|(_, at)| part_of[at.triangle as usize] == number);
            part.push(Guidance::Strokes {
                strokes: own.map(|(stroke, _)| *stroke).collect(),
                weight: *weight,
            });
        }
    }
    Ok(of_parts)
}
