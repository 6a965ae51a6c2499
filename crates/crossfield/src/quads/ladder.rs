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
    /// The same on triangles a quarter as large.
    Refined,
    /// A field with fewer singularities, on these.
    Smoother,
    /// A smaller spacing, this many times by √2, with the last of these fields.
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
    /// The scaled Jacobian of each quad, signed by the surface's normals: see [`scaled_jacobian`].
    pub jacobians: Vec<f64>,
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
    let sources = sources(&mesh, surface)?;
    let jacobians = jacobians(&mesh, surface, &sources);
    report.scaled_jacobian = JacobianSummary::of(&jacobians);
    Ok(Quadrangulation {
        mesh,
        sources,
        jacobians,
        report,
    })
}

/// The scaled Jacobian of each quad, signed by the surface's normals where its corners lie.
fn jacobians(mesh: &QuadMesh, surface: &TriMesh, sources: &[SurfacePoint]) -> Vec<f64> {
    mesh.quads()
        .iter()
        .enumerate()
        .map(|(q, corners)| {
            let normals = corners.map(|v| {
                let at = sources[v as usize].triangle as usize;
                surface.doubled_area_normal(at).try_normalize(0.0).unwrap_or_default()
            });
            scaled_jacobian(&mesh.corners(q), &normals.iter().sum())
        })
        .collect()
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
        Ok(quads) => quads,
        Err(error @ Error::Cancelled(_)) => return Err(error),
        Err(error) if options.ladder == Ladder::Off => return Err(error),
        Err(error) => {
            if report.failures.is_empty() {
                report.failures.push(error.to_string());
            }
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
) -> Result<QuadMesh, Error> {
    let mut rungs = Rungs {
        options,
        run,
        report,
        error: None,
    };
    if let Some(quads) = rungs.with_field(part, spacing, 1.0, Rung::Direct)?.0 {
        return Ok(quads);
    }
    let fine = part.refined()?;
    let mut field = None;
    for (factor, rung) in [(1.0, Rung::Refined), (2.0, Rung::Smoother), (4.0, Rung::Smoother)] {
        let (quads, solved) = rungs.with_field(&fine, spacing, factor, rung)?;
        if let Some(quads) = quads {
            return Ok(quads);
        }
        field = Some(solved);
    }
    let field = field.expect("three were solved");
    for step in 1..=DENSER {
        let denser = spacing * 0.5f64.powf(0.5 * f64::from(step));
        if let Some(quads) = rungs.with_map(&fine, &field, denser, Rung::Denser(step))? {
            return Ok(quads);
        }
    }
    Err(rungs.error.expect("every rung failed"))
}

/// What the rungs share; the last failure.
struct Rungs<'a, B: ?Sized> {
    options: &'a Options,
    run: Run<'a, B>,
    report: &'a mut PartReport,
    error: Option<Error>,
}

impl<B: CrossfieldBackend + ?Sized> Rungs<'_, B> {
    /// A field smoothed `factor` times as much as asked for, and the quads of its map unless it folds.
    fn with_field(
        &mut self,
        part: &Part,
        spacing: f64,
        factor: f64,
        rung: Rung,
    ) -> Result<(Option<QuadMesh>, CrossField), Error> {
        let field_options = FieldOptions {
            smoothing: factor * self.options.smoothing * spacing,
            singularity_penalty: factor * self.options.singularity_penalty,
            weights: self.options.weights,
        };
        let field = cross_field(&part.mesh, &guides(part, self.options)?, &field_options)?;
        Ok((self.with_map(part, &field, spacing, rung)?, field))
    }

    /// The quads of a field's map unless it folds; an error where no rung follows.
    fn with_map(
        &mut self,
        part: &Part,
        field: &CrossField,
        spacing: f64,
        rung: Rung,
    ) -> Result<Option<QuadMesh>, Error> {
        match mapped(part, field, &Spacing::Uniform(spacing), self.options, self.run) {
            Ok((extracted, map)) => {
                self.report.rung = rung;
                self.report.field = Some(field.report.clone());
                self.report.map = Some(map.report);
                Ok(Some(extracted.mesh))
            }
            Err(error @ Error::Cancelled(_)) => Err(error),
            Err(error) if self.options.ladder == Ladder::Off => Err(error),
            Err(error) => {
                self.report.failures.push(error.to_string());
                self.error = Some(error);
                Ok(None)
            }
        }
    }
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
