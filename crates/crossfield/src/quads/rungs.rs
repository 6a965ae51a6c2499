//! One connected part of a surface: one rung after another until one holds.

use geom_core::mesh::Halfedges;
use geom_core::surface::distance::{Graph, shortest_paths};
use geom_core::surface::ground::{Freedom, Ground, on_segments};
use geom_core::surface::remesh;
use geom_core::{Cancelled, Point3, QuadMesh, TriMesh};

use super::extract::{SurfacePoint, is_vain, lines, tangled};
use super::improve::{improve, settled};
use super::parts::Part;
use super::smooth::Smooth;
use super::split::split_quads;
use crate::anisotropy::{Metric, Misalignment, Slope, adapted};
use crate::backend::On;
use crate::error::Error;
use crate::field::solve::field_of;
use crate::field::{CrossField, FieldReport, Frames, Guide, Toward};
use crate::guidance;
use crate::map::{Effort, MapOptions, MapReport, Spread, parameterized};
use crate::options::{FieldOptions, Ladder, Options, Size};

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
    /// A smaller spacing, this many times by √2, with the first of these fields whose map folds only on integers.
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
    /// How often the lines were laid closer to each other where a handle or neck was too narrow for them.
    pub closer: usize,
    /// How often all ratios of the anisotropy were made their square roots because the map folded.
    pub milder: u32,
    /// Whether the anisotropy was given up because all rungs failed with it, and the quads are as if none had been asked for.
    pub squares: bool,
    /// How far the field is from the gradient of the anisotropy's function where that is steep; `None` without one, and on the
    /// last rung.
    pub misalignment: Option<Misalignment>,
    /// The round of the anisotropy's adaptation that the field is from: 0 if none was better than the field before.
    pub adapted: u32,
}

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

/// How often an anisotropy that folds the map is made milder.
const MILDER: u32 = 2;
/// How many times more quads than wanted are refused, unless they are few.
const MOST: f64 = 4.0;
const FEW: usize = 400;
/// How often lines are laid closer where quads are no mesh.
const CLOSER: usize = 6;

/// How much closer, where one quad goes around the surface, and where two do.
const RATIO: [f64; 2] = [0.4, 0.55];

/// Smoothing of the rungs, in that asked for.
const SMOOTHER: [f64; 5] = [1.5, 2.0, 3.0, 4.0, 6.0];

/// The quads of one connected part, narrower along the gradient of a slope.
pub(super) fn part_quads(
    mesh: &TriMesh,
    spacing: f64,
    options: &Options,
    slope: Option<&Slope<'_>>,
    run: On<'_>,
) -> Result<(QuadMesh, PartReport), Error> {
    let part = Part::of(mesh.clone(), options.crease)?;
    let mut report = PartReport {
        triangles: mesh.triangles().len(),
        ..PartReport::default()
    };
    let mut asked = Asked {
        options,
        spacing,
        slope,
        run,
    };
    let mut raw = climb(&part, &asked, &mut report)?;
    if raw.is_none() && slope.is_some() {
        report.squares = true;
        let quads = asked.stretched(&part)? / (spacing * spacing);
        asked.spacing = (part.mesh.area() / quads).sqrt();
        asked.slope = None;
        raw = climb(&part, &asked, &mut report)?;
    }
    let raw = match raw {
        Some(raw) => raw,
        None => {
            report.rung = Rung::Split;
            last_resort(&part, asked.spacing, options, run)?
        }
    };
    let narrowest = asked.narrowest();
    let made = finished(&part, raw, narrowest, options, run)?;
    report.quads = made.quads().len();
    Ok((made, report))
}

/// What is asked of a part.
#[derive(Clone, Copy)]
struct Asked<'a> {
    options: &'a Options,
    /// The side of a quad, the longer one, Å.
    spacing: f64,
    slope: Option<&'a Slope<'a>>,
    run: On<'a>,
}

impl Asked<'_> {
    /// The least proportion of a quad's sides.
    fn narrowest(&self) -> f64 {
        self.slope.map_or(1.0, |s| s.options().ratio)
    }

    /// The sides of squares as large as the smallest quads: what triangles are compared with.
    fn square(&self) -> f64 {
        self.spacing * self.narrowest().sqrt()
    }

    /// The area of a part, if its quads had two long sides.
    fn stretched(&self, part: &Part) -> Result<f64, Error> {
        match self.slope {
            Some(slope) => slope.stretched_area(),
            None => Ok(part.mesh.area()),
        }
    }
}

/// What the field and the lines of a surface follow.
struct Wishes {
    guides: Vec<Guide>,
    metric: Option<Metric>,
}

/// Quads, and the triangles they were made of.
struct Raw {
    quads: QuadMesh,
    part: Part,
}

/// The rungs that have a map; `None` where all of them failed, and the report says why. An error where no rung follows.
fn climb(part: &Part, asked: &Asked<'_>, report: &mut PartReport) -> Result<Option<Raw>, Error> {
    let Asked { options, run, .. } = *asked;
    let lines = f64::from(1u16 << options.nested);
    let mut rungs = Rungs {
        options,
        spacing: asked.spacing * lines,
        slope: asked.slope,
        run,
        report,
        denser: None,
        smoothing: 0.0,
        effort: Effort::of(part.mesh.triangles().len()),
    };
    let start = proxy(part, asked)?.unwrap_or_else(|| part.clone());
    if let Some(wishes) = rungs.reported(wishes(&start, asked))?
        && let Some(quads) = rungs.with_field(&start, &wishes, 1.0, Rung::Direct)?
    {
        return Ok(Some(Raw { quads, part: start }));
    }
    // Where the triangles are as large as the quads, a map has too little freedom.
    let fine = match part.remeshed(FINE * asked.square() * lines, options.crease, run)? {
        Some(fine) => Ok(fine),
        None => part.refined(),
    };
    let Some(fine) = rungs.reported(fine)? else {
        return Ok(None);
    };
    let Some(wishes) = rungs.reported(wishes(&fine, asked))? else {
        return Ok(None);
    };
    rungs.denser = None;
    if let Some(quads) = rungs.with_field(&fine, &wishes, 1.0, Rung::Refined)? {
        return Ok(Some(Raw { quads, part: fine }));
    }
    for factor in SMOOTHER {
        if rungs.effort.is_spent() {
            break;
        }
        if let Some(quads) = rungs.with_field(&fine, &wishes, factor, Rung::Smoother)? {
            return Ok(Some(Raw { quads, part: fine }));
        }
    }
    if let Some((smooth, field)) = rungs.denser.take() {
        for step in 1..=DENSER {
            if rungs.effort.is_spent() {
                break;
            }
            let factor = 0.5f64.powf(0.5 * f64::from(step));
            let metric = wishes.metric.as_ref();
            let made = rungs.with_map(&fine, metric, &smooth, &field, factor, Rung::Denser(step));
            if let Some(quads) = rungs.reported(made)? {
                return Ok(Some(Raw { quads, part: fine }));
            }
        }
    }
    Ok(None)
}

/// Fewer triangles in place of far too many: the field needs no more than about fourteen per quad.
fn proxy(part: &Part, asked: &Asked<'_>) -> Result<Option<Part>, Cancelled> {
    let square = asked.square();
    let quads = part.mesh.area() / (square * square);
    if (part.mesh.triangles().len() as f64) < MANY * quads {
        return Ok(None);
    }
    part.remeshed(PROXY * square, asked.options.crease, asked.run)
}

/// What the rungs share.
struct Rungs<'a> {
    options: &'a Options,
    /// Of the lines that nested quads lie between, Å.
    spacing: f64,
    slope: Option<&'a Slope<'a>>,
    run: On<'a>,
    report: &'a mut PartReport,
    /// The first field whose map folds only on integers, and what it is a field of.
    denser: Option<(Smooth, CrossField)>,
    /// The smoothing of the last rung, Å: none that follows has less.
    smoothing: f64,
    effort: Effort,
}

impl Rungs<'_> {
    /// A field smoothed `factor` times as much as asked for, and the quads of its map; `None` where it failed.
    fn with_field(
        &mut self,
        part: &Part,
        wishes: &Wishes,
        factor: f64,
        rung: Rung,
    ) -> Result<Option<QuadMesh>, Error> {
        (self.report.milder, self.report.adapted) = (0, 0);
        let field = self.field(part, wishes, factor);
        let Some((smooth, field)) = self.reported(field)? else {
            return Ok(None);
        };
        let mut metric = wishes.metric.clone();
        let mut made = self.with_map(part, metric.as_ref(), &smooth, &field, 1.0, rung);
        if self.options.ladder == Ladder::Full {
            for milder in 1..=MILDER {
                let (Err(Error::Folded { .. }), Some(steep)) = (&made, &metric) else {
                    break;
                };
                self.reported(made)?;
                metric = Some(steep.milder());
                made = self.with_map(part, metric.as_ref(), &smooth, &field, 1.0, rung);
                self.report.milder = milder;
            }
        }
        let relaxed = matches!(made, Err(Error::Folded { relaxed: true, .. }));
        if made.is_err() && !relaxed && self.denser.is_none() {
            self.denser = Some((smooth, field));
        }
        self.reported(made)
    }

    fn field(
        &mut self,
        part: &Part,
        wishes: &Wishes,
        factor: f64,
    ) -> Result<(Smooth, CrossField), Error> {
        const EVALUATIONS: usize = 50;
        if !self.effort.spend(EVALUATIONS * part.mesh.triangles().len()) {
            return Err(Error::Spent);
        }
        let options = self.options;
        let length = factor * options.smoothing * self.spacing;
        let smooth = Smooth::of(part, length, self.smoothing, options.weights)?;
        self.smoothing = smooth.length;
        let field_options = FieldOptions {
            smoothing: smooth.length,
            singularity_penalty: factor * options.singularity_penalty,
            weights: options.weights,
        };
        let guides = &wishes.guides;
        let field = field_of(&part.mesh, &smooth.frames, guides, &field_options, self.run)?;
        let field = self.adapted(part, wishes, &smooth, field)?;
        Ok((smooth, field))
    }

    /// The field as the anisotropy's map would rather have it, if it is to be adapted.
    fn adapted(
        &mut self,
        part: &Part,
        wishes: &Wishes,
        smooth: &Smooth,
        field: CrossField,
    ) -> Result<CrossField, Error> {
        let wanted = self.slope.and_then(|s| s.options().adaptation);
        let (Some(wanted), Some(metric)) = (wanted, &wishes.metric) else {
            return Ok(field);
        };
        let Smooth { mesh, frames, .. } = smooth;
        let (spacing, same) = (self.spacing, vec![1.0; part.mesh.triangles().len()]);
        let map = |field: &CrossField| MapOptions {
            spacing: smooth.spacing(spacing, &same, Some(metric), field),
            lines: part.lines.iter().map(|&h| h as u32).collect(),
        };
        let free = metric.transition(&wishes.guides);
        let (field, round) = adapted(mesh, frames, field, &free, map, &wanted, self.run)?;
        self.report.adapted = round;
        Ok(field)
    }

    /// The quads of a field's map.
    fn with_map(
        &mut self,
        part: &Part,
        metric: Option<&Metric>,
        smooth: &Smooth,
        field: &CrossField,
        factor: f64,
        rung: Rung,
    ) -> Result<QuadMesh, Error> {
        let ground = Mapping {
            part,
            smooth,
            field,
            metric,
        };
        let (quads, closer, map) = as_many(&ground, factor * self.spacing, self)?;
        self.report.misalignment = metric.map(|m| m.misalignment(&smooth.frames, field));
        self.report.rung = rung;
        self.report.field = Some(field.report.clone());
        self.report.map = Some(map);
        self.report.closer = closer;
        Ok(quads)
    }

    /// `None` for what has failed, and the report says why; an error where no rung follows.
    fn reported<T>(&mut self, made: Result<T, Error>) -> Result<Option<T>, Error> {
        match made {
            Ok(made) => Ok(Some(made)),
            Err(error @ Error::Cancelled(_)) => Err(error),
            Err(error) if self.options.ladder == Ladder::Off => Err(error),
            Err(error) => {
                self.report.failures.push(error.to_string());
                Ok(None)
            }
        }
    }
}

/// The guidance asked for, the gradient, and the lines that must be kept.
fn wishes(part: &Part, asked: &Asked<'_>) -> Result<Wishes, Error> {
    let frames = Frames::of(&part.mesh, asked.options.weights)?;
    let mut guides = guidance::guides(&part.mesh, &frames, &asked.options.guidance)?;
    let metric = match asked.slope {
        Some(slope) => Some(slope.metric(&part.mesh, &frames)?),
        None => None,
    };
    if let Some(metric) = &metric {
        let named: std::collections::BTreeSet<u32> = guides.iter().map(|g| g.face).collect();
        guides.extend(metric.guides().filter(|g| !named.contains(&g.face)));
    }
    guides.extend(part.lines.iter().map(|&h| Guide {
        face: (h / 3) as u32,
        toward: Toward::Side((h % 3) as u8),
        weight: f64::INFINITY,
    }));
    Ok(Wishes { guides, metric })
}

/// Map and quads of a field, checked against the surface, and how often lines were laid closer to each other.
type Mapped = (QuadMesh, usize, MapReport);

/// What a map is made of.
struct Mapping<'a> {
    part: &'a Part,
    smooth: &'a Smooth,
    field: &'a CrossField,
    metric: Option<&'a Metric>,
}

impl Mapping<'_> {
    /// Area over that of a quad with two long sides of 1: as the field has them, and if it followed the gradient everywhere.
    fn stretched(&self) -> [f64; 2] {
        let mesh = &self.part.mesh;
        let Some(metric) = self.metric else {
            return [mesh.area(); 2];
        };
        let area = |f: usize| mesh.doubled_area_normal(f).norm() / 2.0;
        let sum = |density: &dyn Fn(usize) -> f64| {
            let faces = 0..mesh.triangles().len();
            faces.map(|f| area(f) * density(f)).sum()
        };
        let theta = &self.field.theta;
        [
            sum(&|f| metric.density(f, theta[f])),
            sum(&|f| metric.aligned_density(f)),
        ]
    }
}

/// Once more where rounding made the quads larger or smaller than wanted, with that allowed for.
fn as_many(ground: &Mapping<'_>, spacing: f64, rungs: &Rungs<'_>) -> Result<Mapped, Error> {
    let [made, asked] = ground.stretched();
    let counted = !matches!(rungs.options.size, Size::Spacing(_));
    // A field that does not follow the gradient asks for more quads than were counted on.
    let stretch = if counted { made / asked } else { 1.0 };
    let nested = f64::from(1u32 << (2 * rungs.options.nested));
    let area = if counted { asked } else { made };
    let wanted = area / (spacing * spacing) * nested;
    let spacing = spacing * stretch.sqrt();
    let most = area / rungs.spacing.powi(2) * nested;
    let first = mapped(ground, spacing, most, rungs)?;
    let share = |made: &Mapped| made.0.quads().len() as f64 / wanted;
    let off = |made: &Mapped| (share(made) - 1.0).abs();
    if matches!(rungs.options.size, Size::Quads(_)) && off(&first) > OFF_TARGET {
        match mapped(ground, spacing * share(&first).sqrt(), most, rungs) {
            Ok(second) if off(&second) < off(&first) => return Ok(second),
            Err(error @ Error::Cancelled(_)) => return Err(error),
            _ => {}
        }
    }
    Ok(first)
}

/// Map and quads of a field. Where the quads are no mesh because a handle or neck is too narrow for them, the lines are laid
/// closer to each other. `wanted` quads are asked for; far more are refused.
fn mapped(
    ground: &Mapping<'_>,
    spacing: f64,
    wanted: f64,
    rungs: &Rungs<'_>,
) -> Result<Mapped, Error> {
    let Mapping {
        part,
        smooth,
        field,
        metric,
    } = *ground;
    let mut closer = vec![1.0; part.mesh.triangles().len()];
    let mut tried = 0;
    loop {
        let map_options = MapOptions {
            spacing: smooth.spacing(spacing, &closer, metric, field),
            lines: part.lines.iter().map(|&h| h as u32).collect(),
        };
        let effort = rungs.effort.share(2);
        let Smooth { mesh, frames, .. } = smooth;
        let nested = rungs.options.nested;
        let vain = |spread: &Spread| tried < CLOSER && is_vain(spread, nested);
        let map = parameterized(mesh, frames, field, &map_options, &effort, vain, rungs.run);
        rungs.effort.give_back(&effort);
        // The map of the smoothed triangles is one of those that they were, too.
        let (sources, quads, report) = lines(map?, frames, nested)?;
        if quads.len() > FEW.max((MOST * wanted) as usize) {
            return Err(Error::TooMany {
                quads: quads.len(),
                wanted: wanted as usize,
            });
        }
        let tangled = tangled(&quads);
        if tangled.is_empty() || tried == CLOSER {
            let positions = sources.iter().map(|p| p.position(&part.mesh)).collect();
            let quads = QuadMesh::new(positions, quads)?;
            check(&quads, &part.mesh)?;
            return Ok((quads, tried, report));
        }
        tried += 1;
        for (around, ratio) in (1..).zip(RATIO) {
            let near = tangled.iter().filter(|t| t.1 == around);
            let near: Vec<SurfacePoint> = near.map(|t| sources[t.0 as usize]).collect();
            lay_closer(part, &near, spacing, ratio, &mut closer)?;
        }
    }
}

/// Makes the spacing of lines near some points smaller, from a quad's side away on less and less.
fn lay_closer(
    part: &Part,
    points: &[SurfacePoint],
    spacing: f64,
    ratio: f64,
    closer: &mut [f64],
) -> Result<(), Error> {
    const FAR: f64 = 3.0;
    if points.is_empty() {
        return Ok(());
    }
    let triangles = part.mesh.triangles();
    let mut sources: Vec<(u32, f64)> = points
        .iter()
        .flat_map(|p| triangles[p.triangle as usize])
        .map(|v| (v, 0.0))
        .collect();
    sources.sort_by_key(|s| s.0);
    sources.dedup_by_key(|s| s.0);
    let graph = Graph::of_edges(&part.mesh)?;
    let distance = shortest_paths(&graph, &sources, 2.0 * FAR * spacing)?.distance;
    for (closer, corners) in closer.iter_mut().zip(triangles) {
        let nearest = corners.iter().map(|&v| distance[v as usize]);
        let nearest = nearest.fold(f64::INFINITY, f64::min) / spacing;
        *closer *= ratio + (1.0 - ratio) * ((nearest - 1.0) / (FAR - 1.0)).clamp(0.0, 1.0);
    }
    Ok(())
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
fn last_resort(part: &Part, spacing: f64, options: &Options, run: On<'_>) -> Result<Raw, Error> {
    // The vertices go back onto the surface: here a far one does no harm.
    let loose = remesh::Options {
        max_deviation: Some(f64::INFINITY),
        refinements: 0,
        ..remesh::Options::default()
    };
    let make = |edge: f64| -> Result<Raw, Error> {
        let part = part
            .remeshed_with(edge, options.crease, loose.clone(), run)?
            .unwrap_or_else(|| part.clone());
        let mut keep = vec![false; 3 * part.mesh.triangles().len()];
        for &h in &part.lines {
            keep[h] = true;
        }
        let quads = split_quads(&part.mesh, &keep)?;
        Ok(Raw { quads, part })
    };
    let first = make(LAST * spacing)?;
    let wanted = part.mesh.area() / (spacing * spacing);
    let share = |raw: &Raw| raw.quads.quads().len() as f64 / wanted;
    let off = |raw: &Raw| share(raw).ln().abs();
    if (share(&first) - 1.0).abs() <= OFF_TARGET {
        return Ok(first);
    }
    let second = make(LAST * spacing * share(&first).sqrt())?;
    Ok(if off(&second) < off(&first) {
        second
    } else {
        first
    })
}

/// Vertices on the surface, better quads.
fn finished(
    part: &Part,
    raw: Raw,
    narrowest: f64,
    options: &Options,
    run: On<'_>,
) -> Result<QuadMesh, Error> {
    let freedom = freedoms(&raw.part, raw.quads.positions())?;
    let ground = Ground::new(&part.mesh, part.segments()?)?;
    if options.improve {
        improve(raw.quads, narrowest, &ground, &freedom, run)
    } else {
        settled(raw.quads, &ground, &freedom, run)
    }
}

/// Vertices on lines slide along them, their corners stay.
fn freedoms(part: &Part, points: &[Point3]) -> Result<Vec<Freedom>, Error> {
    let (positions, lines) = (part.mesh.positions(), part.segments()?);
    let corners = part.corners()?;
    let fixed: Vec<&Point3> = (0..corners.len())
        .filter(|&v| corners[v] == Some(true))
        .map(|v| &positions[v])
        .collect();
    let near = 1e-9 * part.mesh.bounds().diagonal();
    let of = |p: &Point3| {
        if lines.is_empty() || (on_segments(&lines, p) - p).norm() > near {
            Freedom::Surface
        } else if fixed.iter().any(|c| (*c - p).norm() <= near) {
            Freedom::Fixed
        } else {
            Freedom::Line
        }
    };
    Ok(points.iter().map(of).collect())
}
