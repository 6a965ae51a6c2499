//! 12 — Which point of one shape became which of another.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::shapes::{Body, MatchArgs, Pair, ShapeArgs};
use biogeom_examples::picture::{Image, Layer, Paint, Rgb, Scale, Scene, View, sheet_of_modes};
use biogeom_examples::products::Coloring;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use geom_core::io::{self, view::View as Fields};
use geom_core::{Aabb, Point3, Vector3};
use serde::Serialize;
use serde_json::json;
use spectral_corresp::fit::superpose;
use spectral_corresp::{CompareOptions, Correspondence, compare};

/// The correspondence of two shapes: which boundary point of the second belongs to which of the first
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    shapes: ShapeArgs,
    #[command(flatten)]
    matching: MatchArgs,
    /// Both structures have the same atoms in the same order: say how far the match is from where they went
    #[arg(long)]
    truth_atoms: bool,
    /// Links in the picture
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u16).range(0..=2000))]
    links: u16,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  12_correspond open.pdb closed.pdb --out adk
  12_correspond open.pdb closed.pdb --truth-atoms --out adk
  12_correspond cat.off lion.off --out cats

Positions, orientations and numbers of nodes do not matter; a mirror image is not matched. The verdict is good, doubtful
or failed: look at the candidates in report.json where it is not good. Outputs: matches.csv (a row per boundary point of
the first shape: ax,ay,az,bx,by,bz,distortion, in Å and in the inputs' own coordinates; b lies on the second shape within a
spacing of a boundary point, not on the lattice), first.glb and second.glb (partners
have one colour), correspond.png (with links), modes.png (joint modes on both), report.json.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        self.shapes.inputs()
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("12_correspond", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let pair = args.shapes.read(session)?;
    // Before what takes long.
    let truth = args.truth_atoms.then(|| pair.truth()).transpose()?;
    let found = args.matching.find(&pair, session)?;
    if let Some(truth) = truth {
        let (a, b) = (&pair.first.shape, &pair.second.shape);
        session.note("truth", truth.judge(a, b, &found.forward)?)?;
        let places = truth.judge_places(a, b, &found.places(b))?;
        session.note("truth_of_places", places)?;
        session.note("residue_accuracy", pair.residue_accuracy(&found)?)?;
    }
    session.files(5, || {
        write_matches(args, session, &pair, &found)?;
        let colors = partners(&pair, &found)?;
        for (name, body, colors) in [
            ("first", &pair.first, &colors[0]),
            ("second", &pair.second, &colors[1]),
        ] {
            let view = Fields::from(&body.surface).colored(products::rgba(colors))?;
            io::mesh::save(session.output(format!("{name}.glb"))?, &view)?;
            let coloring = Coloring {
                colors: colors.clone(),
                scale: None,
                legend: Vec::new(),
            };
            session.show(name, &body.surface, vec![("partners".to_owned(), coloring)]);
        }
        session.picture("correspond", || {
            picture(session, &pair, &found, &colors, args.links.into())
        })?;
        session.picture("modes", || modes(session, &pair, &found))
    })
}

fn write_matches(
    args: &Args,
    session: &Session,
    pair: &Pair,
    found: &Correspondence,
) -> Result<(), Failure> {
    let (a, b) = (&pair.first.shape, &pair.second.shape);
    let defaults = CompareOptions::default();
    let options = CompareOptions {
        radius: defaults.radius * args.matching.unit(pair),
        seed: args.matching.seed,
        ..defaults
    };
    let on = session.on(session.device.corresp());
    let compared = compare(a, b, &found.forward, &options, on)?;
    session.note("comparison", compared.report)?;
    session.note("counts", json!({ "matches": found.forward.len() }))?;
    let rows = a.boundary_points().iter().zip(found.places(b));
    let rows = rows.zip(&compared.distortions);
    io::save(session.output("matches.csv")?, |w| {
        writeln!(w, "ax,ay,az,bx,by,bz,distortion")?;
        for ((p, q), e) in rows {
            writeln!(w, "{},{},{},{},{},{},{e:.4}", p.x, p.y, p.z, q.x, q.y, q.z)?;
        }
        Ok(())
    })?;
    Ok(())
}

/// Colours by the place in the first shape, along its principal axes; partners have the same.
fn partners(pair: &Pair, found: &Correspondence) -> Result<[Vec<Rgb>; 2], Failure> {
    let points = pair.first.shape.boundary_points();
    let view = View::principal(points);
    let places: Vec<[f64; 3]> = [view.right, view.up, view.toward]
        .map(|axis| {
            let along: Vec<f64> = points.iter().map(|p| p.coords.dot(&axis)).collect();
            let low = along.iter().copied().fold(f64::INFINITY, f64::min);
            let high = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let width = (high - low).max(f64::MIN_POSITIVE);
            along
                .into_iter()
                .map(|x| (x - low) / width)
                .collect::<Vec<_>>()
        })
        .into_iter()
        .fold(vec![[0.0; 3]; points.len()], |mut all, channel| {
            for (place, x) in all.iter_mut().zip(channel) {
                place.rotate_left(1);
                place[2] = x;
            }
            all
        });
    let colors = |body: &Body, of: &dyn Fn(usize) -> usize| -> Result<Vec<Rgb>, Failure> {
        let nodes = body.shape.boundary().len();
        let channel = |c: usize| -> Result<Vec<f64>, Failure> {
            let values: Vec<f64> = (0..nodes).map(|i| places[of(i)][c]).collect();
            body.on_surface(&values, &body.surface)
        };
        let channels = [channel(0)?, channel(1)?, channel(2)?];
        let byte = |x: f64| (40.0 + 205.0 * x.clamp(0.0, 1.0)) as u8;
        let vertices = 0..body.surface.positions().len();
        Ok(vertices
            .map(|v| [0, 1, 2].map(|c| byte(channels[c][v])))
            .collect())
    };
    Ok([
        colors(&pair.first, &|i| i)?,
        colors(&pair.second, &|j| found.backward[j] as usize)?,
    ])
}

/// The second shape turned as the first one lies and put beside it.
fn beside(pair: &Pair, found: &Correspondence) -> (View, impl Fn(&Point3) -> Point3) {
    let (a, b) = (
        pair.first.shape.boundary_points(),
        pair.second.shape.boundary_points(),
    );
    let back: Vec<(Point3, Point3)> = found
        .forward
        .iter()
        .zip(a)
        .map(|(&j, p)| (b[j as usize], *p))
        .collect();
    let motion = superpose(&back);
    let view = View::principal(a);
    let extent = |points: &mut dyn Iterator<Item = Point3>| {
        points.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
            let x = p.coords.dot(&view.right);
            (low.min(x), high.max(x))
        })
    };
    let first = extent(&mut a.iter().copied());
    let second = extent(&mut b.iter().map(|p| motion.of(p)));
    let gap = 0.12 * (first.1 - first.0);
    let shift = view.right * (first.1 - second.0 + gap);
    (view, move |p: &Point3| motion.of(p) + shift)
}

fn moved(body: &Body, place: &impl Fn(&Point3) -> Point3, paint: Paint) -> Layer {
    let mut layer = Layer::surface(&body.surface, paint);
    let turned = |p: &Point3, n: &Vector3| (place(&(p + n)) - place(p)).normalize();
    if let Some(normals) = &mut layer.normals {
        for (n, p) in normals.iter_mut().zip(&layer.positions) {
            *n = turned(p, n);
        }
    }
    for p in &mut layer.positions {
        *p = place(p);
    }
    layer.edges = false;
    layer
}

fn picture(
    session: &Session,
    pair: &Pair,
    found: &Correspondence,
    colors: &[Vec<Rgb>; 2],
    links: usize,
) -> Result<Image, Failure> {
    let (view, place) = beside(pair, found);
    let mut first = Layer::surface(&pair.first.surface, Paint::Vertices(colors[0].clone()));
    first.edges = false;
    let second = moved(&pair.second, &place, Paint::Vertices(colors[1].clone()));
    let (a, b) = (
        pair.first.shape.boundary_points(),
        pair.second.shape.boundary_points(),
    );
    let radius = 0.0012 * Aabb::of_points(a).diagonal();
    let step = (a.len() / links.max(1)).max(1);
    let ends = (0..a.len()).step_by(step).take(links);
    let ends = ends.map(|i| (a[i], place(&b[found.forward[i] as usize])));
    let mut scene = Scene::new(vec![first, second, rods(ends, radius)], view);
    scene.caption = Some(format!(
        "{:?} · J = {:.2} Å · {} matches",
        found.verdict,
        found.score,
        products::grouped(found.forward.len())
    ));
    scene.draw(session.rasterizer()?, products::SIZE)
}

/// Thin three-sided rods.
fn rods(ends: impl Iterator<Item = (Point3, Point3)>, radius: f64) -> Layer {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for (p, q) in ends {
        let along = (q - p).try_normalize(0.0).unwrap_or_else(Vector3::x);
        let side = along.cross(&Vector3::ith(along.iamin(), 1.0)).normalize();
        let up = along.cross(&side);
        let first = positions.len() as u32;
        for end in [p, q] {
            for k in 0..3 {
                let angle = f64::from(k) * std::f64::consts::TAU / 3.0;
                positions.push(end + (side * angle.cos() + up * angle.sin()) * radius);
            }
        }
        for k in 0..3 {
            let l = (k + 1) % 3;
            faces.push([first + k, first + l, first + 3 + k]);
            faces.push([first + l, first + 3 + l, first + 3 + k]);
        }
    }
    Layer {
        positions,
        faces,
        paint: Paint::Plain([70, 70, 78]),
        normals: None,
        edges: false,
    }
}

/// Joint modes on both shapes, side by side.
fn modes(session: &Session, pair: &Pair, found: &Correspondence) -> Result<Image, Failure> {
    let (view, place) = beside(pair, found);
    let on = |body: &Body, mode: &[f64]| -> Result<Vec<f64>, Failure> {
        let boundary = body.shape.boundary().iter();
        let values: Vec<f64> = boundary.map(|&n| mode[n as usize]).collect();
        body.on_surface(&values, &body.surface)
    };
    let mut images = Vec::new();
    let joint = &found.modes;
    for (k, value) in joint.values.iter().enumerate() {
        let values = [
            on(&pair.first, &joint.first[k])?,
            on(&pair.second, &joint.second[k])?,
        ];
        let scale = Scale::symmetric(&values.concat(), "");
        let mut first = Layer::surface(
            &pair.first.surface,
            Paint::Vertices(scale.colors(&values[0])),
        );
        first.edges = false;
        let second = Paint::Vertices(scale.colors(&values[1]));
        let second = moved(&pair.second, &place, second);
        let scene = Scene::new(vec![first, second], view);
        let image = scene.draw(session.rasterizer()?, [560, 300])?;
        images.push((format!("{}: λ = {}", k + 1, products::brief(*value)), image));
    }
    Ok(sheet_of_modes(&images, 2))
}
