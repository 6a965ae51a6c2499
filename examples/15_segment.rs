//! 15 — Segments of a surface from the eigenfunctions of an operator.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::picture::{
    Image, Layer, Paint, Rgb, Scale, Scene, View, segment_color, sheet_of_modes,
};
use biogeom_examples::products::Coloring;
use biogeom_examples::{Failure, Session, products};
use clap::{Parser, ValueEnum};
use geom_core::io::{self, mesh::AnyMesh, view::View as Fields};
use geom_core::{Point3, TriMesh};
use secondfund_ops::{
    Element, Faces, Groups, Normals, Operator, SegmentOptions, Segments, Spectrum, SpectrumOptions,
    Surface, Weight, segment, spectrum,
};
use serde::Serialize;
use serde_json::json;

/// Segments of a surface: patches on which the modes of an operator change little
#[derive(Parser, Serialize)]
#[command(version, after_help = EXAMPLES)]
struct Args {
    /// Mesh of triangles or quads (PLY, OFF, OBJ, STL, GLB, VTU, MSH)
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// How many groups [default: sought]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=200))]
    groups: Option<u16>,
    /// The operator whose modes are used
    #[arg(long, value_enum, default_value_t)]
    operator: OperatorName,
    /// The weight of the secondary Laplace operator
    #[arg(long, value_enum, default_value_t)]
    weight: WeightName,
    /// Curvatures below this count as flat, in units of the largest extent
    #[arg(long, value_name = "EPSILON", default_value_t = SpectrumOptions::default().regularization)]
    regularization: f64,
    /// Rounds of smoothing of a triangle mesh's normals
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=100))]
    normal_rounds: u32,
    /// Modes on the contact sheet, besides those that the segments need
    #[arg(long, value_name = "K", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=60))]
    modes: u16,
    /// Leave the borders of the segments as they come
    #[arg(long)]
    raw_borders: bool,
    /// Seed of the sample
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  15_segment spot.ply --out parts
  15_segment bust.off --groups 7 --out bust
  15_segment gear.ply --weight one --out faces

Quads are taken as the control mesh of a Catmull–Clark limit surface. Outputs: segments.seg (one number per face of
the input), segments.glb and segments.png (coloured), modes.png, report.json with the eigenvalues and the
segments' areas.";

#[derive(Clone, Copy, Default, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum OperatorName {
    /// Secondary Laplace operator: sees curvature
    #[default]
    Slo,
    /// Laplace–Beltrami: sees distances along the surface
    Lbo,
}

#[derive(Clone, Copy, Default, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum WeightName {
    /// 1: faces
    One,
    /// e^K: parts
    #[default]
    ExpK,
    /// e^−H: concave regions of convex bodies
    ExpMinusH,
    /// e^H: parts that meet in straight concave creases
    ExpH,
}

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("15_segment", program)
}

impl Args {
    fn spectrum_options(&self, needed: usize) -> SpectrumOptions {
        let weight = match self.weight {
            WeightName::One => Weight::One,
            WeightName::ExpK => Weight::ExpK,
            WeightName::ExpMinusH => Weight::ExpMinusH,
            WeightName::ExpH => Weight::ExpH,
        };
        SpectrumOptions {
            operator: match self.operator {
                OperatorName::Slo => Operator::Slo(weight),
                OperatorName::Lbo => Operator::Lbo,
            },
            modes: needed.max(self.modes.into()),
            regularization: self.regularization,
            ..SpectrumOptions::default()
        }
    }

    fn segment_options(&self) -> SegmentOptions {
        let mut options = SegmentOptions {
            smooth: !self.raw_borders,
            seed: self.seed,
            ..SegmentOptions::default()
        };
        if let Some(count) = self.groups {
            options.groups = Groups::Count(count.into());
        }
        options
    }
}

/// A surface with its segments, and the triangles to draw: those of a quad are two in a row.
struct Segmented {
    spectrum: Spectrum,
    segments: Segments,
    /// Per face of the input.
    labels: Vec<u32>,
    shown: TriMesh,
    sides: usize,
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    if matches!(args.operator, OperatorName::Lbo) {
        let because = "is of --operator slo";
        session.refuse(&["weight", "regularization"], because)?;
    }
    let read = session.stage("reading", || {
        io::mesh::read_up_to(&args.input, session.memory())
    })?;
    let done = match read.mesh {
        AnyMesh::Quad(mesh) => {
            session.refuse(
                &["normal_rounds"],
                "is for triangles, and the input has quads",
            )?;
            let surface = session.stage("limit surface", || Surface::new(mesh))?;
            session.note(
                "surface",
                json!({ "element": "catmull-clark", "refined": surface.refined() }),
            )?;
            of_quads(args, session, &surface)?
        }
        mesh => {
            session.note("surface", json!({ "element": "triangles" }))?;
            of_triangles(args, session, mesh.into_triangles())?
        }
    };
    note(session, &done)?;
    session.files(4, || write(session, &done, args.modes.into()))
}

fn of_triangles(args: &Args, session: &Session, mesh: TriMesh) -> Result<Segmented, Failure> {
    let normals = Normals::OfMesh {
        rounds: args.normal_rounds,
    };
    let (spectrum, segments) = solve(
        args,
        session,
        Element::Triangles(&mesh, &normals),
        &Faces::from(&mesh),
    )?;
    Ok(Segmented {
        labels: segments.labels.clone(),
        spectrum,
        segments,
        shown: mesh,
        sides: 3,
    })
}

fn of_quads(args: &Args, session: &Session, surface: &Surface) -> Result<Segmented, Failure> {
    let limit = surface.limit_mesh();
    let (spectrum, segments) = solve(
        args,
        session,
        Element::CatmullClark(surface),
        &Faces::from(&limit),
    )?;
    // Where it was refined, a quad of the input has the label that most of its children have.
    let step = if surface.refined() { 4 } else { 1 };
    let labels = segments.labels.chunks(step).map(most).collect();
    Ok(Segmented {
        spectrum,
        segments,
        labels,
        shown: limit.into_triangles(),
        sides: 4,
    })
}

/// The label that occurs most; of several the lowest.
fn most(labels: &[u32]) -> u32 {
    let count = |l: u32| labels.iter().filter(|&&other| other == l).count();
    let ranked = labels.iter().map(|&l| (count(l), std::cmp::Reverse(l)));
    ranked.max().map_or(0, |(_, label)| label.0)
}

fn solve(
    args: &Args,
    session: &Session,
    element: Element<'_>,
    faces: &Faces,
) -> Result<(Spectrum, Segments), Failure> {
    let options = args.segment_options();
    let asked = args.spectrum_options(options.modes_needed());
    let backend = session.device.operators();
    let spectrum = session.stage("modes", || spectrum(&element, &asked, session.on(backend)))?;
    let segments = session.stage("segments", || {
        segment(&spectrum, faces, &options, session.on(backend))
    })?;
    Ok((spectrum, segments))
}

fn note(session: &Session, done: &Segmented) -> Result<(), Failure> {
    let counts = json!({ "faces": done.labels.len(), "segments": done.segments.areas.len() });
    session.note("counts", counts)?;
    session.note("eigenvalues", &done.spectrum.values)?;
    session.note("spectral", &done.spectrum.report)?;
    session.note("unit", done.spectrum.scale)?;
    session.note("skipped", done.spectrum.skipped)?;
    let segments = &done.segments;
    session.note(
        "segments",
        json!({
            "count": segments.areas.len(),
            "areas": segments.areas,
            "groups": segments.groups,
            "modes": segments.modes,
            "choices": segments.choices,
        }),
    )
}

fn write(session: &Session, done: &Segmented, modes: usize) -> Result<(), Failure> {
    io::save(session.output("segments.seg")?, |w| {
        for label in &done.labels {
            writeln!(w, "{label}")?;
        }
        Ok(())
    })?;
    let per_face = if done.sides == 4 { 2 } else { 1 };
    let of_triangles: Vec<Rgb> = done
        .segments
        .labels
        .iter()
        .flat_map(|&l| std::iter::repeat_n(segment_color(l), per_face))
        .collect();
    session.show(
        "segments",
        &done.shown,
        colorings(done, &of_triangles, modes),
    );
    let (split, colors) = split_faces(&done.shown, &of_triangles);
    io::mesh::save(
        session.output("segments.glb")?,
        &Fields::from(&split).colored(products::rgba(&colors))?,
    )?;
    let view = View::principal(done.shown.positions()).turned(0.25, 0.2);
    session.picture("segments", || {
        let mut layer = Layer::surface(&done.shown, Paint::Faces(of_triangles));
        layer.edges = false;
        let mut scene = Scene::new(vec![layer], view);
        let (count, groups) = (done.segments.areas.len(), done.segments.groups);
        scene.caption = Some(format!("{count} segments from {groups} groups"));
        Ok(scene.draw(session.rasterizer()?, products::SIZE)?)
    })?;
    session.picture("modes", || picture_of_modes(session, done, view, modes))
}

/// What the page shows: the segments and the modes. A vertex between segments has the colour of one of them.
fn colorings(done: &Segmented, of_triangles: &[Rgb], modes: usize) -> Vec<(String, Coloring)> {
    let mut colors = vec![[255; 3]; done.shown.positions().len()];
    for (corners, &color) in done.shown.triangles().iter().zip(of_triangles) {
        corners.iter().for_each(|&v| colors[v as usize] = color);
    }
    let labels = 0..done.segments.areas.len() as u32;
    let named = |l: u32| (segment_color(l), format!("segment {l}"));
    let segments = Coloring {
        colors,
        scale: None,
        legend: labels.map(named).collect(),
    };
    let mode = |(i, mode): (usize, &Vec<f64>)| {
        let scale = Scale::symmetric(mode, "");
        (format!("mode {}", i + 1), Coloring::of_values(mode, scale))
    };
    let mut ways = vec![("segments".to_owned(), segments)];
    ways.extend(done.spectrum.modes.iter().enumerate().map(mode).take(modes));
    ways
}

fn picture_of_modes(
    session: &Session,
    done: &Segmented,
    view: View,
    modes: usize,
) -> Result<Image, Failure> {
    let shown = modes.min(done.spectrum.modes.len());
    let paint = |mode: &Vec<f64>| Paint::Vertices(Scale::symmetric(mode, "").colors(mode));
    let paints: Vec<Paint> = done.spectrum.modes[..shown].iter().map(paint).collect();
    let mut layer = Layer::surface(&done.shown, Paint::Plain(products::GOLD));
    layer.edges = false;
    let scene = Scene::new(vec![layer], view);
    let images = scene.draw_each(session.rasterizer()?, [420, 330], &paints)?;
    let title = |(i, value): (usize, &f64)| format!("{}: λ = {}", i + 1, products::brief(*value));
    let titles = done.spectrum.values.iter().enumerate().map(title);
    Ok(sheet_of_modes(&titles.zip(images).collect::<Vec<_>>(), 4))
}

/// Triangles that share no vertices, so that each has its own colour at its corners.
fn split_faces(mesh: &TriMesh, of_triangles: &[Rgb]) -> (TriMesh, Vec<Rgb>) {
    let corners: Vec<Point3> = (0..mesh.triangles().len())
        .flat_map(|t| mesh.corners(t))
        .collect();
    let triangles = (0..mesh.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    let colors = of_triangles.iter().flat_map(|&c| [c; 3]).collect();
    let split = TriMesh::new(corners, triangles.collect()).expect("the triangles of a valid mesh");
    (split, colors)
}
