//! One connected part of a surface: one rung after another until one holds.

mod finer;
mod mapped;

use geom_core::mesh::Halfedges;
use geom_core::surface::ground::{Freedom, Ground, on_segments};
use geom_core::surface::remesh;
use geom_core::{Cancelled, Point3, QuadMesh, TriMesh};

use self::finer::Finer;
use self::mapped::{Mapping, as_many};
use super::improve::{improve, settled};
use super::parts::Part;
use super::quality::scaled_jacobians;
use super::smooth::Smooth;
use super::split::split_quads;
use crate::anisotropy::{Metric, Misalignment, Slope, adapted};
use crate::backend::On;
use crate::error::Error;
use crate::field::solve::field_of;
use crate::field::{CrossField, FieldReport, Frames, Guide};
use crate::guidance;
use crate::map::{Effort, MapOptions, MapReport};
use crate::options::{FieldOptions, Ladder, Options};

/// Which way led to the quads of a part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Rung {
    /// The map of the field, as asked for.
    #[default]
    Direct,
    /// A field of a less smooth copy, which has more singularities: smoothing draws narrow tunnels together to threads.
    Rougher,
    /// The field asked for, on triangles a quarter as large.
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
    /// Why the rungs before that one failed; once where several in a row did alike.
    pub failures: Vec<String>,
    /// The field; `None` on the last rung.
    pub field: Option<FieldReport>,
    /// The map; `None` on the last rung.
    pub map: Option<MapReport>,
    /// How often the lines were laid closer to each other where a handle or neck was too narrow for them, or quads were folded.
    pub closer: usize,
    /// How often triangles were cut into four where the map stayed folded in a few places.
    pub finer: u32,
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

impl PartReport {
    /// Of the last rung: what was said of a map that was upright is not said of its quads.
    fn without_map(&mut self) {
        self.rung = Rung::Split;
        (self.field, self.map, self.misalignment) = (None, None, None);
        (self.closer, self.finer) = (0, 0);
    }
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

/// Scaled Jacobians below this are bad.
const FOLDED: f64 = 0.3;
/// A part of so few quads is a speck: bubbles of a density are.
const SPECK: usize = 64;

/// A closed part is not asked for fewer quads than a cube has.
const FEWEST: f64 = 6.0;

/// What a field costs, in evaluations of the energy of its map.
const FIELD: usize = 50;
/// A field of so many triangles takes twice as long as that, one of more in proportion: singular vertices move further there, one after
/// the other.
const LARGE: usize = 100_000;

/// How often triangles are cut where a map stays folded.
const FINER: u32 = 3;

/// How often an anisotropy that folds the map is made milder.
const MILDER: u32 = 2;
/// Smoothing of the rungs, in that asked for: nearly as much, so that singular vertices lie elsewhere.
const NEARLY: f64 = 0.9;
/// Less of it.
const ROUGHER: [f64; 2] = [0.7, 0.5];
/// And more.
const SMOOTHER: [f64; 5] = [1.5, 2.0, 3.0, 4.0, 6.0];
/// Triangles from which on finer ones take so long that rougher fields are tried before them in any case.
const COSTLY: usize = 20_000;

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
    if Halfedges::of(mesh)?.boundary_loops().is_empty() {
        // It may be a bubble smaller than a quad.
        let largest = (asked.stretched(&part)? / FEWEST).sqrt();
        asked.spacing = spacing.min(largest / asked.lines());
    }
    let mut spare = None;
    let mut made = climb(&part, &asked, &mut report, &mut spare)?;
    if made.is_none() && slope.is_some() {
        report.squares = true;
        let quads = asked.stretched(&part)? / (asked.spacing * asked.spacing);
        asked.spacing = (part.mesh.area() / quads).sqrt();
        asked.slope = None;
        made = climb(&part, &asked, &mut report, &mut spare)?;
    }
    let least = |quads: &QuadMesh| Ok::<f64, Error>(least(&scaled_jacobians(quads, &part.mesh)?));
    let split = || {
        let raw = last_resort(&part, asked.spacing, options, run)?;
        asked.finish(&part).finished(raw.quads, &raw.part)
    };
    let may_split = options.improve && options.ladder == Ladder::Full;
    let made = match made {
        // A handful of bad quads: those of the triangles may be better, and nobody misses the field of a speck.
        Some(made) if may_split && made.quads().len() <= SPECK && least(&made)? < FOLDED => {
            let split = split()?;
            if least(&split)? > least(&made)? {
                report.without_map();
                split
            } else {
                made
            }
        }
        Some(made) => made,
        None => {
            let split = split()?;
            match spare {
                Some(spare) if spare.least >= least(&split)? => {
                    let failures = std::mem::take(&mut report.failures);
                    report = PartReport {
                        failures,
                        ..spare.report
                    };
                    spare.quads
                }
                _ => {
                    report.without_map();
                    split
                }
            }
        }
    };
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

impl<'a> Asked<'a> {
    /// What finishes the quads of a part.
    fn finish(&self, whole: &'a Part) -> Finish<'a> {
        Finish {
            whole,
            narrowest: self.narrowest(),
            improve: self.options.improve,
            run: self.run,
        }
    }

    /// How many quads lie between two lines of the map.
    fn lines(&self) -> f64 {
        f64::from(1u16 << self.options.nested)
    }

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

/// The quads of the first rung whose map holds; `None` where all of them failed, and the report says why. An error where no
/// rung follows.
///
/// A field of another rung is made anew on the triangles of that rung. Only the smaller spacings share one: the first
/// field whose map was fine with real numbers, since with enough quads its integers will be.
fn climb<'a>(
    part: &'a Part,
    asked: &Asked<'a>,
    report: &mut PartReport,
    spare: &mut Option<Spare>,
) -> Result<Option<QuadMesh>, Error> {
    let Asked { options, run, .. } = *asked;
    let lines = asked.lines();
    let mut rungs = Rungs {
        finish: asked.finish(part),
        options,
        spacing: asked.spacing * lines,
        slope: asked.slope,
        run,
        report,
        spare,
        denser: None,
        unfit: false,
        smoothing: 0.0,
        effort: Effort::of(part.mesh.triangles().len()),
    };
    // The triangles of the surface first, which cost nothing and fit best.
    let start = proxy(part, asked)?.unwrap_or_else(|| part.clone());
    if let Some(quads) = rungs.on_given(&start, asked)? {
        return Ok(Some(quads));
    }
    // Where the triangles are as large as the quads, a map has too little freedom.
    let edge = FINE * asked.square() * lines;
    let equilateral = 3f64.sqrt() / 4.0 * edge * edge;
    if !rungs.may_have_field((part.mesh.area() / equilateral) as usize) {
        rungs.reported::<()>(Err(Error::Spent))?;
        return Ok(None);
    }
    let fine = match part.remeshed(edge, options.crease, run)? {
        Some(fine) => Ok(fine),
        None => part.refined(),
    };
    match rungs.reported(fine)? {
        Some(fine) => rungs.on_finer(&fine, asked),
        None => Ok(None),
    }
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

/// Quads that are not all upright, and how they were made.
struct Spare {
    /// The smallest scaled Jacobian.
    least: f64,
    quads: QuadMesh,
    report: PartReport,
}

fn least(jacobians: &[f64]) -> f64 {
    jacobians.iter().copied().fold(f64::INFINITY, f64::min)
}

/// What the rungs share.
struct Rungs<'a> {
    finish: Finish<'a>,
    options: &'a Options,
    /// Of the lines that nested quads lie between, Å.
    spacing: f64,
    slope: Option<&'a Slope<'a>>,
    run: On<'a>,
    report: &'a mut PartReport,
    /// The best quads of a map so far of which some face the wrong way.
    spare: &'a mut Option<Spare>,
    /// The first field whose map folds only on integers, and what it is a field of.
    denser: Option<(Smooth, CrossField)>,
    /// Did the last map fold before anything was an integer, so that only another field can help?
    unfit: bool,
    /// The most smoothing of the rungs, Å: no smoother one has less.
    smoothing: f64,
    /// What may still be done, over all rungs of this climb: when it is spent, no further map is tried. Fields that are tried for
    /// large parts in any case have a budget of their own.
    effort: Effort,
}

impl Rungs<'_> {
    /// The field asked for, then fields of less smooth copies, which cost less than finer triangles.
    fn on_given(&mut self, part: &Part, asked: &Asked<'_>) -> Result<Option<QuadMesh>, Error> {
        let Some(wishes) = self.reported(wishes(part, asked))? else {
            return Ok(None);
        };
        match self.with_field(part, &wishes, 1.0, Rung::Direct)? {
            None => self.rougher(part, &wishes),
            made => Ok(made),
        }
    }

    /// The field asked for on finer triangles, then simpler fields, which fold less, then more quads, which give integers
    /// more room.
    fn on_finer(&mut self, fine: &Part, asked: &Asked<'_>) -> Result<Option<QuadMesh>, Error> {
        let Some(wishes) = self.reported(wishes(fine, asked))? else {
            return Ok(None);
        };
        // A field of other triangles is none of these.
        self.denser = None;
        if let Some(quads) = self.with_field(fine, &wishes, 1.0, Rung::Refined)? {
            return Ok(Some(quads));
        }
        for factor in SMOOTHER {
            if self.effort.is_spent() {
                break;
            }
            if let Some(quads) = self.with_field(fine, &wishes, factor, Rung::Smoother)? {
                return Ok(Some(quads));
            }
        }
        self.denser(fine, wishes.metric.as_ref())
    }

    /// Smaller spacings with the first field whose map folds only on integers, if there is one.
    fn denser(&mut self, fine: &Part, metric: Option<&Metric>) -> Result<Option<QuadMesh>, Error> {
        let Some((smooth, field)) = self.denser.take() else {
            return Ok(None);
        };
        // Of the maps of other fields.
        (self.report.milder, self.report.finer) = (0, 0);
        for step in 1..=DENSER {
            if self.effort.is_spent() {
                break;
            }
            let factor = 0.5f64.powf(0.5 * f64::from(step));
            let ground = Mapping::of(fine, &smooth, &field, metric);
            let made = self.with_map(&ground, factor, Rung::Denser(step));
            if let Some(quads) = self.reported(made)? {
                return Ok(Some(quads));
            }
        }
        Ok(None)
    }

    /// Fields of less smooth copies, where that asked for has no map even without integers. A large part is worth two of them in
    /// any case: a handful of its places fold, those of another field are others, and finer triangles take several times as long.
    fn rougher(&mut self, part: &Part, wishes: &Wishes) -> Result<Option<QuadMesh>, Error> {
        let (near, rest): (&[f64], &[f64]) = match part.mesh.triangles().len() < COSTLY {
            true => (&[], &ROUGHER),
            false => (&[NEARLY, ROUGHER[0]], &ROUGHER[1..]),
        };
        for &factor in near {
            // A budget of their own, also where the field asked for has too many integers: another may have fewer.
            let all = self.all();
            let left = std::mem::replace(&mut self.effort, all);
            let made = self.with_field(part, wishes, factor, Rung::Rougher)?;
            self.effort = left;
            if made.is_some() {
                return Ok(made);
            }
        }
        for &factor in rest {
            if !self.unfit || self.effort.is_spent() {
                break;
            }
            if let Some(quads) = self.with_field(part, wishes, factor, Rung::Rougher)? {
                return Ok(Some(quads));
            }
        }
        Ok(None)
    }

    /// A field smoothed `factor` times as much as asked for, and the quads of its map; `None` where it failed.
    ///
    /// Where the map folds with an anisotropy, the same field is tried with its ratios made milder before another field
    /// is.
    fn with_field(
        &mut self,
        part: &Part,
        wishes: &Wishes,
        factor: f64,
        rung: Rung,
    ) -> Result<Option<QuadMesh>, Error> {
        (self.report.milder, self.report.adapted, self.report.finer) = (0, 0, 0);
        let field = self.field(part, wishes, factor);
        let Some((smooth, field)) = self.reported(field)? else {
            return Ok(None);
        };
        let mut metric = wishes.metric.clone();
        let ground = Mapping::of(part, &smooth, &field, metric.as_ref());
        let mut made = self.with_finer(&ground, rung, usize::MAX);
        if self.options.ladder == Ladder::Full {
            for milder in 1..=MILDER {
                let (Err(Error::Folded { .. }), Some(steep)) = (&made, &metric) else {
                    break;
                };
                self.reported(made)?;
                metric = Some(steep.milder());
                let ground = Mapping::of(part, &smooth, &field, metric.as_ref());
                made = self.with_finer(&ground, rung, usize::MAX);
                self.report.milder = milder;
            }
        }
        if matches!(made, Err(Error::Integers { .. })) {
            // Fields of the next rungs have about as many: no map of theirs is begun.
            self.effort.end();
        }
        let relaxed = matches!(made, Err(Error::Folded { relaxed: true, .. }));
        self.unfit = relaxed;
        if made.is_err() && !relaxed && self.denser.is_none() {
            self.denser = Some((smooth, field));
        }
        self.reported(made)
    }

    /// The work that the part is worth.
    fn all(&self) -> Effort {
        Effort::of(self.finish.whole.mesh.triangles().len())
    }

    /// Is at least half of that left?
    fn has_half(&self) -> bool {
        2 * self.effort.left() >= self.all().left()
    }

    /// Is enough left for all that the field of so many triangles takes? If not, nothing would be left for its map.
    fn may_have_field(&self, triangles: usize) -> bool {
        let cost = FIELD.saturating_mul(triangles);
        let large = (cost / LARGE).saturating_mul(triangles);
        self.effort.left() >= cost.saturating_add(large) as u64
    }

    /// The penalty of singularities grows with the smoothing, so that fields of later rungs have fewer of them.
    fn field(
        &mut self,
        part: &Part,
        wishes: &Wishes,
        factor: f64,
    ) -> Result<(Smooth, CrossField), Error> {
        if !self.effort.spend(FIELD * part.mesh.triangles().len()) {
            return Err(Error::Spent);
        }
        let options = self.options;
        let length = factor * options.smoothing * self.spacing;
        let least = if factor < 1.0 { 0.0 } else { self.smoothing };
        let smooth = Smooth::of(part, length, least, options.weights)?;
        self.smoothing = self.smoothing.max(smooth.length);
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

    /// The quads of a field's map. Where that stays folded in few places, the triangles there are cut, as long as fewer vertices
    /// than these are not right then.
    fn with_finer(
        &mut self,
        ground: &Mapping<'_>,
        rung: Rung,
        most: usize,
    ) -> Result<QuadMesh, Error> {
        let made = self.with_map(ground, 1.0, rung);
        let folded = ground.ends.folded.take();
        let may_cut = self.options.ladder == Ladder::Full && !self.effort.is_spent();
        let (Err(Error::Folded { .. }), Some(folded), true) = (&made, folded, may_cut) else {
            return made;
        };
        let left = folded.vertices.len();
        if left >= most || self.report.finer == FINER {
            return made;
        }
        match Finer::around(ground, &folded, self.options.weights)? {
            Some(finer) => {
                self.report.finer += 1;
                self.with_finer(&finer.mapping(), rung, left)
            }
            None => made,
        }
    }

    /// The quads of a field's map.
    fn with_map(
        &mut self,
        ground: &Mapping<'_>,
        factor: f64,
        rung: Rung,
    ) -> Result<QuadMesh, Error> {
        let Mapping {
            smooth,
            field,
            metric,
            ..
        } = ground;
        let (quads, closer, map) = as_many(ground, factor * self.spacing, self)?;
        self.report.misalignment = metric.map(|m| m.misalignment(&smooth.frames, field));
        self.report.rung = rung;
        self.report.field = Some(field.report.clone());
        self.report.map = Some(map);
        self.report.closer = closer;
        if self.options.improve && self.options.ladder == Ladder::Full {
            return self.upright(quads);
        }
        Ok(quads)
    }

    /// An error for quads of which some face the wrong way; or nearly, where triangles had to be cut for their map, since the field
    /// of another rung may do without. The best of these are kept, should the last rung have none better.
    fn upright(&mut self, quads: QuadMesh) -> Result<QuadMesh, Error> {
        let jacobians = scaled_jacobians(&quads, &self.finish.whole.mesh)?;
        let most = if self.report.finer > 0 { FOLDED } else { 0.0 };
        let inverted = jacobians.iter().filter(|&&j| j <= most).count();
        if inverted == 0 {
            return Ok(quads);
        }
        let least = least(&jacobians);
        if self.spare.as_ref().is_none_or(|spare| spare.least < least) {
            *self.spare = Some(Spare {
                least,
                quads,
                report: self.report.clone(),
            });
        }
        Err(Error::Inverted { quads: inverted })
    }

    /// `None` for what has failed, and the report says why; an error where no rung follows.
    fn reported<T>(&mut self, made: Result<T, Error>) -> Result<Option<T>, Error> {
        match made {
            Ok(made) => Ok(Some(made)),
            Err(error @ Error::Cancelled(_)) => Err(error),
            Err(error) if self.options.ladder == Ladder::Off => Err(error),
            Err(error) => {
                // Once for rungs that fail alike.
                let why = error.to_string();
                if self.report.failures.last() != Some(&why) {
                    self.report.failures.push(why);
                }
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
    guides.extend(part.lines.iter().map(|&h| guidance::along(h)));
    Ok(Wishes { guides, metric })
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

/// How quads are finished: their vertices on the surface, their corners as right as they get.
#[derive(Clone, Copy)]
struct Finish<'a> {
    /// The surface.
    whole: &'a Part,
    /// The least proportion of a quad's sides.
    narrowest: f64,
    improve: bool,
    run: On<'a>,
}

impl Finish<'_> {
    /// Quads made of the triangles of `part`.
    fn finished(&self, quads: QuadMesh, part: &Part) -> Result<QuadMesh, Error> {
        let freedom = freedoms(part, quads.positions())?;
        let ground = Ground::new(&self.whole.mesh, self.whole.segments()?)?;
        if self.improve {
            improve(quads, self.narrowest, &ground, &freedom, self.run)
        } else {
            settled(quads, &ground, &freedom)
        }
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
