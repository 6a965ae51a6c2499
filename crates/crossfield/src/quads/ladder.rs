//! From a surface to quads, one rung after another until one holds.

use geom_core::bvh::TriangleTree;
use geom_core::mesh::Halfedges;
use geom_core::{Point3, QuadMesh, Run, TriMesh, repair};

use super::extract::{Extracted, SurfacePoint, extract};
use super::improve::{Freedom, Ground, Sides, improve};
use super::parts::{self, Part};
use super::quality::{JacobianSummary, Valences, scaled_jacobian};
use super::split::split_quads;
use crate::backend::CrossfieldBackend;
use crate::error::Error;
use crate::field::{CrossField, FieldReport, Frames, Guide, Toward, cross_field};
use crate::guidance;
use crate::map::spacing::Spacing;
use crate::map::{GridMap, MapReport, Request, parameterize};
use crate::options::{FieldOptions, Ladder, Options, Size};

/// How often the spacing may be made smaller by √2.
const DENSER: u32 = 5;
/// How far the number of quads may be from the one asked for before the spacing is corrected.
const OFF_TARGET: f64 = 0.1;

/// Which way led to the quads of a part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Rung {
    /// The map of the field, as asked for.
    #[default]
    Direct,
    /// A field with fewer singularities.
    Smoother,
    /// A smaller spacing, this many times by √2.
    Denser(u32),
    /// No map: triangles paired and cut into quads.
    Split,
}

/// What was made of one connected part of the surface.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PartReport {
    /// Triangles of the part.
    pub triangles: usize,
    /// Its quads.
    pub quads: usize,
    /// The way that led to them.
    pub rung: Rung,
    /// Why the rungs before that one failed.
    pub failures: Vec<String>,
    /// The field; `None` on the last rung.
    pub field: Option<FieldReport>,
    /// The map; `None` on the last rung.
    pub map: Option<MapReport>,
}

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
    /// What was done.
    pub report: Report,
}

/// Quads of any surface: its field, the map that follows it, the quads of the map; see [`Rung`] for what happens where that
/// is not possible. The field, its eigenfunctions and the integers of the map are computed on the CPU, whatever the
/// backend; the kernels of untangling and improvement run on it.
pub fn quadrangulate<B: CrossfieldBackend + ?Sized>(
    surface: &TriMesh,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Quadrangulation, Error> {
    options.check()?;
    if surface.triangles().is_empty() {
        return Err(Error::Empty);
    }
    let (whole, repaired) = parts::manifold(surface)?;
    let spacing = options.size.spacing(whole.area(), whole.triangles().len());
    let split = parts::split(&whole);
    let (mut positions, mut quads) = (Vec::new(), Vec::new());
    let mut report = Report {
        backend: run.backend.name(),
        repaired,
        ..Report::default()
    };
    for (number, (mesh, _)) in split.iter().enumerate() {
        run.progress("quads", number as u64, split.len() as u64)?;
        let (made, part) = part_quads(mesh, spacing, options, run)?;
        let first = positions.len() as u32;
        let (more, faces) = made.into_parts();
        positions.extend(more);
        quads.extend(faces.into_iter().map(|q| q.map(|v| v + first)));
        report.parts.push(part);
    }
    let mesh = QuadMesh::new(positions, quads)?;
    report.valences = Valences::of(&mesh)?;
    report.scaled_jacobian = JacobianSummary::of(&jacobians(&mesh, surface)?);
    let sources = sources(&mesh, surface)?;
    Ok(Quadrangulation { mesh, sources, report })
}

/// The scaled Jacobian of each quad, signed by the surface's normal below its centre.
pub fn jacobians(mesh: &QuadMesh, surface: &TriMesh) -> Result<Vec<f64>, Error> {
    let tree = TriangleTree::new(surface).map_err(|_| Error::Empty)?;
    let centres: Vec<Point3> = (0..mesh.quads().len())
        .map(|q| {
            let sum = mesh.corners(q).iter().fold(geom_core::Vector3::zeros(), |s, p| s + p.coords);
            Point3::from(sum / 4.0)
        })
        .collect();
    let closest = tree.closest_to_all(&centres).map_err(|_| Error::Empty)?;
    Ok(closest
        .iter()
        .enumerate()
        .map(|(q, at)| {
            let normal = surface.doubled_area_normal(at.triangle as usize);
            scaled_jacobian(&mesh.corners(q), &normal)
        })
        .collect())
}

fn sources(mesh: &QuadMesh, surface: &TriMesh) -> Result<Vec<SurfacePoint>, Error> {
    let tree = TriangleTree::new(surface).map_err(|_| Error::Empty)?;
    let closest = tree.closest_to_all(mesh.positions()).map_err(|_| Error::Empty)?;
    Ok(closest
        .iter()
        .map(|c| SurfacePoint {
            triangle: c.triangle,
            barycentric: c.barycentric,
        })
        .collect())
}

/// The quads of one connected part.
fn part_quads<B: CrossfieldBackend + ?Sized>(
    mesh: &TriMesh,
    spacing: f64,
    options: &Options,
    run: Run<'_, B>,
) -> Result<(QuadMesh, PartReport), Error> {
    let (part, _) = Part::of(mesh.clone(), options.crease)?;
    let mut report = PartReport {
        triangles: mesh.triangles().len(),
        ..PartReport::default()
    };
    let raw = match climb(&part, spacing, options, run, &mut report) {
        Ok(extracted) => extracted.mesh,
        Err(error @ Error::Cancelled(_)) => return Err(error),
        Err(error) if options.ladder == Ladder::Off => return Err(error),
        Err(error) => {
            report.failures.push(error.to_string());
            report.rung = Rung::Split;
            (report.field, report.map) = (None, None);
            last_resort(&part)?
        }
    };
    let made = finished(&part, raw, options, run)?;
    report.quads = made.quads().len();
    Ok((made, report))
}

/// The rungs that have a map.
fn climb<B: CrossfieldBackend + ?Sized>(
    part: &Part,
    spacing: f64,
    options: &Options,
    run: Run<'_, B>,
    report: &mut PartReport,
) -> Result<Extracted, Error> {
    let mut failure = None;
    for (attempt, factor) in [1.0, 2.0, 4.0].into_iter().enumerate() {
        let field_options = FieldOptions {
            smoothing: factor * options.smoothing * spacing,
            singularity_penalty: factor * options.singularity_penalty,
            weights: options.weights,
        };
        let guides = guides(part, options)?;
        let field = cross_field(&part.mesh, &guides, &field_options)?;
        let made = mapped(part, &field, &Spacing::Uniform(spacing), options, run);
        let rung = if attempt == 0 { Rung::Direct } else { Rung::Smoother };
        match made {
            Ok((extracted, map)) => {
                report.rung = rung;
                report.field = Some(field.report);
                report.map = Some(map.report);
                return Ok(extracted);
            }
            Err(error @ Error::Cancelled(_)) => return Err(error),
            Err(error) if options.ladder == Ladder::Off => return Err(error),
            Err(error) => {
                report.failures.push(error.to_string());
                failure = Some((error, field));
            }
        }
    }
    let (mut error, field) = failure.expect("an attempt was made");
    for step in 1..=DENSER {
        let denser = spacing * 0.5f64.powf(0.5 * f64::from(step));
        match mapped(part, &field, &Spacing::Uniform(denser), options, run) {
            Ok((extracted, map)) => {
                report.rung = Rung::Denser(step);
                report.field = Some(field.report);
                report.map = Some(map.report);
                return Ok(extracted);
            }
            Err(cancelled @ Error::Cancelled(_)) => return Err(cancelled),
            Err(other) => {
                report.failures.push(other.to_string());
                error = other;
            }
        }
    }
    Err(error)
}

/// The guidance asked for, and the lines that must be kept.
fn guides(part: &Part, options: &Options) -> Result<Vec<Guide>, Error> {
    let frames = Frames::of(&part.mesh, options.weights)?;
    let mut guides = guidance::guides(&part.mesh, &frames, &options.guidance)?;
    guides.extend(part.lines.iter().map(|&h| Guide {
        face: (h / 3) as u32,
        toward: Toward::Side((h % 3) as u8),
        weight: f64::INFINITY,
    }));
    Ok(guides)
}

/// Map and quads of a field, checked against the surface.
fn mapped<B: CrossfieldBackend + ?Sized>(
    part: &Part,
    field: &CrossField,
    spacing: &Spacing,
    options: &Options,
    run: Run<'_, B>,
) -> Result<(Extracted, GridMap), Error> {
    let frames = Frames::of(&part.mesh, options.weights)?;
    let make = |spacing: &Spacing| -> Result<(Extracted, GridMap), Error> {
        let map = {
            let request = Request {
                mesh: &part.mesh,
                frames: &frames,
                field,
                lines: &part.lines,
                spacing,
            };
            parameterize(&request, run)?
        };
        let extracted = extract(&part.mesh, &frames, &map)?;
        check(&extracted.mesh, &part.mesh)?;
        Ok((extracted, map))
    };
    let first = make(spacing)?;
    let wanted = spacing.quads(frames.areas());
    let share = first.0.mesh.quads().len() as f64 / wanted;
    if matches!(options.size, Size::Quads(_)) && (share - 1.0).abs() > OFF_TARGET {
        // Rounding made the quads larger or smaller: once more with that allowed for.
        if let Ok(second) = make(&spacing.scaled(share.sqrt()))
            && (second.0.mesh.quads().len() as f64 / wanted - 1.0).abs() < (share - 1.0).abs()
        {
            return Ok(second);
        }
    }
    Ok(first)
}

/// A manifold with the surface's Euler characteristic and boundary loops, or an error.
fn check(quads: &QuadMesh, surface: &TriMesh) -> Result<(), Error> {
    let made = Halfedges::of_quads(quads)?;
    let given = Halfedges::of(surface)?;
    let same = quads.euler_characteristic() == surface.euler_characteristic()
        && made.boundary_loops().len() == given.boundary_loops().len();
    if same {
        return Ok(());
    }
    let why = "the quads have another topology than the surface";
    Err(Error::Torn { face: 0, why })
}

fn last_resort(part: &Part) -> Result<QuadMesh, Error> {
    let mut keep = vec![false; 3 * part.mesh.triangles().len()];
    for &h in &part.lines {
        keep[h] = true;
    }
    split_quads(&part.mesh, &keep)
}

/// Vertices on the surface, better quads.
fn finished<B: CrossfieldBackend + ?Sized>(
    part: &Part,
    raw: QuadMesh,
    options: &Options,
    run: Run<'_, B>,
) -> Result<QuadMesh, Error> {
    if !options.improve {
        return Ok(raw);
    }
    let tree = TriangleTree::new(&part.mesh).map_err(|_| Error::Empty)?;
    let normals = part.mesh.vertex_normals();
    let ground = Ground {
        surface: &part.mesh,
        tree: &tree,
        normals: &normals,
        lines: part.segments()?,
    };
    let freedom = freedoms(part, &raw, &ground)?;
    improve(raw, &ground, &freedom, Sides::Equal, run.backend)
}

/// Vertices on lines slide along them, those next to their corners stay.
fn freedoms(part: &Part, quads: &QuadMesh, ground: &Ground<'_>) -> Result<Vec<Freedom>, Error> {
    let corners = part.corners()?;
    let fixed: Vec<Point3> = (0..corners.len())
        .filter(|&v| corners[v] == Some(true))
        .map(|v| part.mesh.positions()[v])
        .collect();
    let near = 1e-9 * part.mesh.bounds().diagonal();
    Ok(quads
        .positions()
        .iter()
        .map(|p| {
            if ground.lines.is_empty() || !ground.is_on_line(p, near) {
                Freedom::Surface
            } else if fixed.iter().any(|c| (c - p).norm() <= near) {
                Freedom::Fixed
            } else {
                Freedom::Line
            }
        })
        .collect())
}
