//! 14 — Where two shapes differ.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::shapes::{MatchArgs, ShapeArgs};
use biogeom_examples::picture::{ColorMap, Layer, Paint, Scale, Scene, View, sheet};
use biogeom_examples::products::{self, Coloring};
use biogeom_examples::{Failure, Session};
use clap::Parser;
use geom_core::io::{self, view::View as Fields};
use serde::Serialize;
use spectral_corresp::{CompareOptions, compare};

/// Where the first shape differs from the second: in thickness, and by bending
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    shapes: ShapeArgs,
    /// Neighbourhoods in which bending is measured, Å (see --unit)
    #[arg(long, value_name = "R", default_value_t = CompareOptions::default().radius)]
    radius: f64,
    /// Both structures have the same atoms in the same order: say how far the match is from where they went
    #[arg(long)]
    truth_atoms: bool,
    #[command(flatten)]
    matching: MatchArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  14_compare open.pdb closed.pdb --out compared
  14_compare before.mrc after.mrc --isovalue 0.02 --out maps

Outputs: diameters.glb and distortions.glb (coloured), compare.vtu (the same as point fields, and the distance of each
partner), compare.png, report.json with mean, 95th percentile and maximum of both, coverage and one distance.
Diameters are distances to a skeleton of lattice points, which depends on how a body lies on the lattice: a protein and its
turned copy differ by 2 Å in the mean and 10 at most. Differences below that are noise.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        self.shapes.inputs()
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("14_compare", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let pair = args.shapes.read(session)?;
    // Before what takes long.
    let truth = args.truth_atoms.then(|| pair.truth()).transpose()?;
    let found = args.matching.find(&pair, session)?;
    let (a, b) = (&pair.first.shape, &pair.second.shape);
    let unit = args.matching.unit(&pair);
    let options = CompareOptions {
        radius: args.radius * unit,
        seed: args.matching.seed,
        ..CompareOptions::default()
    };
    let on = session.on(session.device.corresp());
    let compared = session.stage("comparison", || compare(a, b, &found.forward, &options, on))?;
    session.note("comparison", compared.report)?;
    session.note("distance", compared.report.distance())?;
    if let Some(truth) = truth {
        session.note("truth", truth.judge(a, b, &found.forward)?)?;
    }
    let surface = &pair.first.surface;
    let on_surface = |values: &[f64]| pair.first.on_surface(values, surface);
    let fields = [
        (
            "diameters",
            on_surface(&compared.diameters)?,
            "difference of diameters / Å",
        ),
        (
            "distortions",
            on_surface(&compared.distortions)?,
            "local distortion / Å",
        ),
    ];
    let distances = on_surface(&found.distances)?;
    session.files(4, || {
        let mut all = Fields::from(surface).point_field("partner_distance", distances)?;
        let view = View::principal(surface.positions()).turned(0.25, 0.2);
        let (mut pictures, mut colorings) = (Vec::new(), Vec::new());
        for (name, values, label) in &fields {
            all = all.point_field(name, values)?;
            // The few largest do not decide what is seen.
            let mut sorted = values.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            let high = sorted
                .get(sorted.len() * 98 / 100)
                .map_or(1.0, |h| h.max(1e-6));
            let scale = Scale::new(ColorMap::Heat, [0.0, high], *label);
            let coloring = Coloring::of_values(values, scale.clone());
            let colors = coloring.colors.clone();
            colorings.push(((*name).to_owned(), coloring));
            let colored = Fields::from(surface).colored(products::rgba(&colors))?;
            io::mesh::save(session.output(format!("{name}.glb"))?, &colored)?;
            pictures.push((name, scale, colors));
        }
        session.show("first", surface, colorings);
        io::mesh::save(session.output("compare.vtu")?, &all)?;
        session.picture("compare", || {
            let mut images = Vec::new();
            for (name, scale, colors) in pictures {
                let mut layer = Layer::surface(surface, Paint::Vertices(colors));
                layer.edges = false;
                let mut scene = Scene::new(vec![layer], view);
                scene.scale = Some(scale);
                images.push((
                    (*name).to_owned(),
                    scene.draw(session.rasterizer()?, [900, 700])?,
                ));
            }
            Ok(sheet(&images, 2))
        })
    })
}
