//! 13 — Shapes between two shapes.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::shapes::{Field, MatchArgs, Pair, ShapeArgs};
use biogeom_examples::input::source::contour;
use biogeom_examples::picture::{Layer, Paint, Scene, View, sheet};
use biogeom_examples::products::Coloring;
use biogeom_examples::{Failure, Session, products};
use clap::{Parser, ValueEnum};
use geom_core::io::structure::{self, pqr};
use geom_core::io::{self, view::View as Fields};
use geom_core::{Point3, Structure, TriMesh, Vector3};
use serde::Serialize;
use serde_json::Value;
use spectral_corresp::morph::Overlap;
use spectral_corresp::options::{Landmarks, Paths};
use spectral_corresp::{Frame, Morph, MorphOptions};

/// The first shape on its way to the second
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    shapes: ShapeArgs,
    /// Times of the frames: 0 is the first shape, 1 the second; the motion goes on before and after
    #[arg(long, value_name = "T,T,…", value_delimiter = ',', default_values_t = [0.0, 0.33, 0.67, 1.0])]
    times: Vec<f64>,
    /// How nodes go
    #[arg(long, value_enum, default_value_t)]
    paths: PathName,
    /// Which nodes are led
    #[arg(long, value_enum, default_value_t)]
    landmarks: LandmarkName,
    /// Harmonic landmarks of a kind are no closer than this, Å
    #[arg(long, value_name = "R", default_value_t = 6.0)]
    landmark_radius: f64,
    /// Only the first shape moves; else the second one moves backwards, too, and is the last frame
    #[arg(long)]
    one_way: bool,
    /// Low-pass of the frames, in spacings
    #[arg(long, value_name = "SIGMA", default_value_t = MorphOptions::default().sigma)]
    sigma: f64,
    /// The real shape at each of the times, made as the first shape is: how far are the frames from them?
    #[arg(long, value_name = "FILE,FILE,…", value_delimiter = ',')]
    #[serde(serialize_with = "names")]
    truth_frames: Vec<PathBuf>,
    #[command(flatten)]
    matching: MatchArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  13_deform open.pdb closed.pdb --out morph
  13_deform open.pdb closed.pdb --times=-0.33,0,0.5,1,1.33 --paths linear --out morph

Outputs: frame_00.glb … (surfaces), frame_00.pqr … and morph.cif
(the first structure's atoms, taken along; viewers play the latter's models), frames.png (all of them),
frames.vtu (the first surface with its displacements), report.json with volume, stretch and self-overlap of each frame,
and its difference from the real one.";

#[derive(Clone, Copy, Default, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum PathName {
    /// Each node turns by a share of its rotation
    #[default]
    Rotating,
    /// Straight lines, as in the thesis
    Linear,
}

#[derive(Clone, Copy, Default, PartialEq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum LandmarkName {
    /// All boundary nodes
    #[default]
    Boundary,
    /// Extrema of a harmonic function, as in the thesis
    Harmonic,
}

fn names<S: serde::Serializer>(paths: &[PathBuf], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(paths.iter().map(|p| p.to_string_lossy()))
}

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        let mut inputs = self.shapes.inputs();
        inputs.extend(self.truth_frames.iter().cloned());
        inputs
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("13_deform", program)
}

impl Args {
    fn options(&self, pair: &Pair, session: &Session) -> MorphOptions {
        MorphOptions {
            landmarks: match self.landmarks {
                LandmarkName::Boundary => Landmarks::Boundary,
                LandmarkName::Harmonic => Landmarks::Harmonic {
                    radius: self.landmark_radius * self.matching.unit(pair),
                },
            },
            paths: match self.paths {
                PathName::Rotating => Paths::Rotating,
                PathName::Linear => Paths::Linear,
            },
            two_way: !self.one_way,
            sigma: self.sigma,
            max_memory: session.memory(),
            ..MorphOptions::default()
        }
    }
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    if args.landmarks == LandmarkName::Boundary {
        session.refuse(&["landmark_radius"], "is of --landmarks harmonic")?;
    }
    let (times, truths) = (args.times.len(), args.truth_frames.len());
    if truths != 0 && truths != times {
        return Err(format!("{truths} --truth-frames for {times} --times").into());
    }
    let pair = args.shapes.read(session)?;
    let found = args.matching.find(&pair, session)?;
    let (a, b) = (&pair.first.shape, &pair.second.shape);
    let on = session.on(session.device.corresp());
    let morph = session.stage("images", || {
        Morph::new(a, b, &found, &args.options(&pair, session), on)
    })?;
    session.note("morph", morph.report())?;
    let mut frames: Vec<(Frame, TriMesh)> = Vec::new();
    let mut measures = Vec::new();
    for (i, &t) in args.times.iter().enumerate() {
        let frame = session.stage("frame", || morph.frame(t, on))?;
        let mut noted = serde_json::to_value(frame.report)?;
        // How far nodes go from frame to frame: even steps look even.
        if let (Some((before, _)), Value::Object(noted)) = (frames.last(), &mut noted) {
            let step = root_mean_square(&before.positions, &frame.positions);
            noted.insert("step".to_owned(), step.into());
        }
        if let (Some(path), Value::Object(noted)) = (args.truth_frames.get(i), &mut noted) {
            let field = args.shapes.field(session, path)?;
            let truth = difference(&field, &frame)?;
            noted.insert("volume_error".to_owned(), truth["epsilon"].clone());
            noted.insert("truth".to_owned(), truth);
            if let Some(rmsd) = rmsd(args, &pair, &field, &frame)? {
                noted.insert("atoms_rmsd".to_owned(), rmsd.into());
            }
            let unchanged = morph.frame(0.0, on)?;
            noted.insert("first_shape".to_owned(), difference(&field, &unchanged)?);
        }
        let surface = session.stage("surface", || {
            contour(session, &frame.grid, frame.level, None)
        })?;
        if let Value::Object(noted) = &mut noted {
            noted.insert("surface_volume".to_owned(), surface.volume().into());
        }
        measures.push(noted);
        frames.push((frame, surface));
    }
    session.note("frames", measures)?;
    session.files(2 * frames.len() as u64 + 2, || {
        write(session, &pair, &frames)
    })
}

/// Of the distances of points from others, one by one.
fn root_mean_square(a: &[Point3], b: &[Point3]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(p, q)| (p - q).norm_squared()).sum();
    (squares / a.len().max(1) as f64).sqrt()
}

/// How far the points of a frame are from those of the real shape. What of it lies beyond the frame's lattice is counted
/// on that continued.
fn difference(field: &Field, frame: &Frame) -> Result<Value, Failure> {
    let overlap: Overlap = frame.overlap(&field.bounds(), |points| field.inside(points))?;
    Ok(serde_json::to_value(overlap)?)
}

/// The atoms of the first structure, taken along.
fn carried(pair: &Pair, frame: &Frame) -> Result<Option<Structure>, Failure> {
    let Some(structure) = &pair.first.structure else {
        return Ok(None);
    };
    let atoms: Vec<Point3> = structure.atoms().iter().map(|a| a.position).collect();
    let moved = pair.first.follow(&atoms, &frame.positions)?;
    let mut structure = structure.clone();
    for (atom, place) in structure.atoms_mut().iter_mut().zip(moved) {
        atom.position = place;
    }
    Ok(Some(structure))
}

/// How far they are from the real ones, root mean square, Å; if there are as many.
fn rmsd(args: &Args, pair: &Pair, real: &Field, frame: &Frame) -> Result<Option<f64>, Failure> {
    let (Some(atoms), Field::Structure(model)) = (carried(pair, frame)?, real) else {
        return Ok(None);
    };
    let atoms = args.shapes.seen(&atoms);
    let places: Vec<Point3> = atoms.atoms().iter().map(|a| a.position).collect();
    let real = model.centers();
    Ok((places.len() == real.len()).then(|| root_mean_square(&places, real)))
}

/// Shapes need not be molecules.
fn measured(volume: f64) -> String {
    match volume {
        v if v >= 100.0 => products::grouped(v.round() as usize),
        v => products::brief(v),
    }
}

fn write(session: &Session, pair: &Pair, frames: &[(Frame, TriMesh)]) -> Result<(), Failure> {
    for (i, (_, surface)) in frames.iter().enumerate() {
        let name = format!("frame_{i:02}");
        io::mesh::save(
            session.output(format!("{name}.glb"))?,
            &Fields::from(surface),
        )?;
        let plain = ("plain".to_owned(), Coloring::plain(surface));
        session.show(&name, surface, vec![plain]);
    }
    // The atoms as the models of one file, which viewers play.
    let atoms = frames.iter().map(|(frame, _)| carried(pair, frame));
    let atoms: Vec<Structure> = atoms
        .filter_map(Result::transpose)
        .collect::<Result<_, Failure>>()?;
    if !atoms.is_empty() {
        structure::save_models(session.output("morph.cif")?, &atoms)?;
        for (i, atoms) in atoms.iter().enumerate() {
            pqr::save(session.output(format!("frame_{i:02}.pqr"))?, atoms)?;
        }
    }
    let rest = &pair.first.surface;
    let mut nodes = Fields::from(rest);
    for (i, (frame, _)) in frames.iter().enumerate() {
        let moved = pair.first.follow(rest.positions(), &frame.positions)?;
        let shifts: Vec<Vector3> = rest
            .positions()
            .iter()
            .zip(&moved)
            .map(|(p, x)| x - p)
            .collect();
        nodes = nodes.point_field(&format!("shift_{i:02}"), &shifts)?;
    }
    io::mesh::save(session.output("frames.vtu")?, &nodes)?;
    session.picture("frames", || {
        let view = View::principal(pair.first.surface.positions()).turned(0.25, 0.2);
        // All frames in one measure: each picture holds the points of all, unseen.
        let all = frames.iter().flat_map(|f| f.1.positions().iter().copied());
        let positions: Vec<Point3> = all.collect();
        let corner = |i: u32| [i; 3];
        let unseen = Layer {
            faces: (0..positions.len() as u32).map(corner).collect(),
            positions,
            paint: Paint::Plain(products::GOLD),
            normals: None,
            edges: false,
        };
        let draw = |(frame, surface): &(Frame, TriMesh)| {
            let mut layer = Layer::surface(surface, Paint::Plain(products::GOLD));
            layer.edges = false;
            let mut scene = Scene::new(vec![layer, unseen.clone()], view);
            scene.caption = Some(format!(
                "{} Å³ · stretch {:.2}",
                measured(surface.volume()),
                frame.report.largest_stretch
            ));
            let image = scene.draw(session.rasterizer()?, [520, 420])?;
            Ok::<_, Failure>((format!("t = {}", frame.report.time), image))
        };
        let images: Vec<_> = frames.iter().map(draw).collect::<Result<_, _>>()?;
        let rows = images.len().div_ceil(5).max(1);
        Ok(sheet(&images, images.len().div_ceil(rows)))
    })
}
