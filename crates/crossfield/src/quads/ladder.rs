//! From a surface to quads, one rung after another until one holds.

use geom_core::mesh::Halfedges;
use geom_core::search::bvh::TriangleTree;
use geom_core::surface::remesh::{self, remesh};
use geom_core::surface::repair;
use geom_core::{Cpu, Point3, QuadMesh, Run, TriMesh};

use super::extract::{Extracted, SurfacePoint, extract};
use super::improve::{Freedom, Ground, improve, on_segment};
use super::parts::{self, Part};
use super::quality::{JacobianSummary, Valences, scaled_jacobian};
use super::split::split_quads;
use crate::backend::CrossfieldBackend;
use crate::error::Error;
use crate::field::{CrossField, FieldReport, Frames, Guide, Toward, cross_field};
use crate::guidance::{self, Guidance};
use crate::map::{GridMap, MapOptions, MapReport, Spacing, parameterize};
use crate::options::{FieldOptions, Ladder, Options, Size};

/// How often the spacing may be made smaller by √2.
const DENSER: u32 = 5;
/// From so many triangles per quad on, a coarser surface is mapped instead.
const MANY: f64 = 24.0;
/// Its edges, in sides of quads.
const PROXY: f64 = 0.4;
/// The edges of a surface whose own triangles were too large, in sides of quads.
const FINE: f64 = 0.5;
/// The edges that the last rung starts from, in sides of quads: each triangle becomes three quads or one and a half.
const LAST: f64 = 1.8;
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
    /// The triangle of the input surface nearest to the centre of each quad.
    pub origins: Vec<u32>,
    /// The scaled Jacobian of each quad, signed by the surface's normals: see [`scaled_jacobian`].
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
    let guidance = guidance_of_parts(&whole, &split, &options.guidance)?;
    let (mut positions, mut quads) = (Vec::new(), Vec::new());
    let mut report = Report {
        backend: run.backend.name(),
        repaired,
        ..Report::default()
    };
    for (number, mesh) in split.iter().enumerate() {
        run.progress("quads", number as u64, split.len() as u64)?;
        let options = Options {
            guidance: guidance[number].clone(),
            ..options.clone()
        };
        let (made, part) = part_quads(&mesh.0, spacing, &options, run)?;
        let first = positions.len() as u32;
        let (more, faces) = made.into_parts();
        positions.extend(more);
        quads.extend(faces.into_iter().map(|q| q.map(|v| v + first)));
        report.parts.push(part);
    }
    let mesh = QuadMesh::new(positions, quads)?;
    report.valences = Valences::of(&mesh)?;
    let (sources, origins) = origins(&mesh, surface)?;
    let jacobians = jacobians(&mesh, surface, &sources);
    report.scaled_jacobian = JacobianSummary::of(&jacobians);
    Ok(Quadrangulation {
        mesh,
        sources,
        origins,
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
                surface
                    .doubled_area_normal(at)
                    .try_normalize(0.0)
                    .unwrap_or_default()
            });
            scaled_jacobian(&mesh.corners(q), &normals.iter().sum())
        })
        .collect()
}

/// Where vertices and centres of quads lie on the surface.
fn origins(mesh: &QuadMesh, surface: &TriMesh) -> Result<(Vec<SurfacePoint>, Vec<u32>), Error> {
    let tree = TriangleTree::new(surface).map_err(|_| Error::Empty)?;
    let closest = |points: &[Point3]| tree.closest_to_all(points).map_err(|_| Error::Empty);
    let centres: Vec<Point3> = (0..mesh.quads().len())
        .map(|q| {
            let corners = mesh.corners(q).map(|p| p.coords);
            Point3::from((corners[0] + corners[1] + corners[2] + corners[3]) / 4.0)
        })
        .collect();
    let sources = closest(mesh.positions())?
        .into_iter()
        .map(|c| SurfacePoint {
            triangle: c.triangle,
            barycentric: c.barycentric,
        });
    let origins = closest(&centres)?.iter().map(|c| c.triangle).collect();
    Ok((sources.collect(), origins))
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
        let tree = TriangleTree::new(whole).map_err(|_| Error::Empty)?;
        let nearest = tree.closest_to_all(&points).map_err(|_| Error::Empty)?;
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

/// The quads of one connected part.
fn part_quads<B: CrossfieldBackend + ?Sized>(
    mesh: &TriMesh,
    spacing: f64,
    options: &Options,
    run: Run<'_, B>,
) -> Result<(QuadMesh, PartReport), Error> {
    let part = Part::of(mesh.clone(), options.crease)?;
    let mut report = PartReport {
        triangles: mesh.triangles().len(),
        ..PartReport::default()
    };
    let raw = match climb(&part, spacing, options, run, &mut report) {
        Ok(raw) => raw,
        Err(error @ Error::Cancelled(_)) => return Err(error),
        Err(error) if options.ladder == Ladder::Off => return Err(error),
        Err(error) => {
            if report.failures.is_empty() {
                report.failures.push(error.to_string());
            }
            report.rung = Rung::Split;
            (report.field, report.map) = (None, None);
            last_resort(&part, spacing, options)?
        }
    };
    let made = finished(&part, raw, options, run)?;
    report.quads = made.quads().len();
    Ok((made, report))
}

/// Quads, and the triangles they were made of.
struct Raw {
    quads: QuadMesh,
    part: Part,
}

/// The rungs that have a map.
fn climb<B: CrossfieldBackend + ?Sized>(
    part: &Part,
    spacing: f64,
    options: &Options,
    run: Run<'_, B>,
    report: &mut PartReport,
) -> Result<Raw, Error> {
    let mut rungs = Rungs {
        options,
        run,
        report,
        error: None,
    };
    let start = match proxy(part, spacing, options) {
        Some(proxy) => proxy,
        None => part.clone(),
    };
    if let Some(quads) = rungs.with_field(&start, spacing, 1.0, Rung::Direct)?.0 {
        return Ok(Raw { quads, part: start });
    }
    // Where the triangles are as large as the quads, a map has too little freedom.
    let fine = match remeshed(part, FINE * spacing, options) {
        Ok(fine) => fine,
        Err(_) => part.refined()?,
    };
    let mut field = None;
    for (factor, rung) in [
        (1.0, Rung::Refined),
        (2.0, Rung::Smoother),
        (4.0, Rung::Smoother),
    ] {
        let (quads, solved) = rungs.with_field(&fine, spacing, factor, rung)?;
        if let Some(quads) = quads {
            return Ok(Raw { quads, part: fine });
        }
        field = Some(solved);
    }
    let field = field.expect("three were solved");
    for step in 1..=DENSER {
        let denser = spacing * 0.5f64.powf(0.5 * f64::from(step));
        if let Some(quads) = rungs.with_map(&fine, &field, denser, Rung::Denser(step))? {
            return Ok(Raw { quads, part: fine });
        }
    }
    Err(rungs.error.expect("every rung failed"))
}

/// Fewer triangles in place of far too many: the field needs no more than about fourteen per quad.
fn proxy(part: &Part, spacing: f64, options: &Options) -> Option<Part> {
    let quads = part.mesh.area() / (spacing * spacing);
    if (part.mesh.triangles().len() as f64) < MANY * quads {
        return None;
    }
    remeshed(part, PROXY * spacing, options).ok()
}

/// The part with nearly equilateral triangles of this edge length (Botsch and Kobbelt, 2004), if its topology stays.
fn remeshed(part: &Part, edge: f64, options: &Options) -> Result<Part, Error> {
    let wanted = remesh::Options {
        sizing: remesh::Sizing::Uniform {
            edge_length: Some(edge),
        },
        features: match options.crease {
            Some(degrees) => remesh::Features::Angle(degrees),
            None => remesh::Features::None,
        },
        ..remesh::Options::default()
    };
    let made = remesh(part.mesh.clone(), None, &wanted, Run::on(&Cpu))?.mesh;
    let loops = |mesh: &TriMesh| Halfedges::of(mesh).map(|e| e.boundary_loops().len());
    let same = made.euler_characteristic() == part.mesh.euler_characteristic()
        && loops(&made)? == loops(&part.mesh)?;
    if !same {
        return Err(Error::Empty);
    }
    Part::of(made, options.crease)
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
        match mapped(
            part,
            field,
            &Spacing::Uniform(spacing),
            self.options,
            self.run,
        ) {
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
        let map_options = MapOptions {
            spacing: spacing.clone(),
            lines: part.lines.iter().map(|&h| h as u32).collect(),
        };
        let map = parameterize(&part.mesh, &frames, field, &map_options, run)?;
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
    let euler = quads.euler_characteristic();
    let loops = Halfedges::of_quads(quads)?.boundary_loops().len();
    let wanted_euler = surface.euler_characteristic();
    let wanted_loops = Halfedges::of(surface)?.boundary_loops().len();
    if euler == wanted_euler && loops == wanted_loops {
        return Ok(());
    }
    Err(Error::Topology {
        euler,
        loops,
        wanted_euler,
        wanted_loops,
    })
}

/// Quads of the triangles themselves, of about the wanted size if the surface can be remeshed.
fn last_resort(part: &Part, spacing: f64, options: &Options) -> Result<Raw, Error> {
    let part = match remeshed(part, LAST * spacing, options) {
        Ok(coarse) => coarse,
        Err(_) => part.clone(),
    };
    let mut keep = vec![false; 3 * part.mesh.triangles().len()];
    for &h in &part.lines {
        keep[h] = true;
    }
    let quads = split_quads(&part.mesh, &keep)?;
    Ok(Raw { quads, part })
}

/// Vertices on the surface, better quads.
fn finished<B: CrossfieldBackend + ?Sized>(
    part: &Part,
    raw: Raw,
    options: &Options,
    run: Run<'_, B>,
) -> Result<QuadMesh, Error> {
    if !options.improve {
        return Ok(raw.quads);
    }
    let freedom = freedoms(&raw)?;
    let tree = TriangleTree::new(&part.mesh).map_err(|_| Error::Empty)?;
    let normals = part.mesh.vertex_normals();
    let ground = Ground {
        surface: &part.mesh,
        tree: &tree,
        normals: &normals,
        lines: part.segments()?,
    };
    improve(raw.quads, &ground, &freedom, run.backend)
}

/// Vertices on lines slide along them, their corners stay.
fn freedoms(raw: &Raw) -> Result<Vec<Freedom>, Error> {
    let (positions, lines) = (raw.part.mesh.positions(), raw.part.segments()?);
    let corners = raw.part.corners()?;
    let fixed: Vec<&Point3> = (0..corners.len())
        .filter(|&v| corners[v] == Some(true))
        .map(|v| &positions[v])
        .collect();
    let near = 1e-9 * raw.part.mesh.bounds().diagonal();
    let of = |p: &Point3| {
        if !lines
            .iter()
            .any(|line| (on_segment(line, p) - p).norm() <= near)
        {
            Freedom::Surface
        } else if fixed.iter().any(|c| (*c - p).norm() <= near) {
            Freedom::Fixed
        } else {
            Freedom::Line
        }
    };
    Ok(raw.quads.positions().iter().map(of).collect())
}
