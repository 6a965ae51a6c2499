//! 07 — A cross field on a surface: four directions per triangle that follow its eigenfunctions.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::crosses::{self, Mode};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::input::surface;
use biogeom_examples::picture::{Layer, Paint, Rgb, Scene, View};
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use crossfield::field::{Frames, Guide};
use crossfield::{CrossField, FieldOptions, cross_field, guidance};
use geom_core::TriMesh;
use geom_core::io::{self, view::View as Fields};
use geom_core::surface::laplace::EdgeWeights;
use serde::Serialize;
use serde_json::json;

/// A smooth cross field: of a mesh, or of a structure's or grid's surface (its largest part)
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// What the field follows: none, curvature, modes:1,2, modes:auto, characteristic:1,2
    #[arg(long, value_name = "GUIDE", default_value = "none", value_parser = crosses::guide)]
    guide: crosses::Guide,
    /// How strictly
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// Bumps smaller than this get no singularities of their own, Å [default: 1.14 edges]
    #[arg(long, value_name = "LENGTH")]
    smoothing: Option<f64>,
    /// What removing a pair of singularities may cost, rad²
    #[arg(long, value_name = "MU", default_value_t = FieldOptions::default().singularity_penalty)]
    singularity_penalty: f64,
    #[command(flatten)]
    common: Common,
}

/// Triangles that guide the field.
const GUIDED: Rgb = [96, 168, 120];

const EXAMPLES: &str = "\
Examples:
  07_field spot.ply --out out
  07_field 1ajj.pdb --spacing 1 --guide modes:1,2 --mode hard --out guided

Crosses lie along the rims of open surfaces, as sides of quads do. Outputs: field.png and field.glb (crosses; blue balls
where three quads will meet, red ones where five will; what guides the field in green), field.vtu (one arm of the cross per
triangle, four times the index per vertex), report.json with `field`.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("07_field", field)
}

fn field(args: &Args, session: &Session) -> Result<(), Failure> {
    crosses::refuse_mode_alone(&args.guide, session)?;
    let mut components = surface::read(&args.source, session)?.components();
    if components.is_empty() {
        return Err("the surface has no triangle".into());
    }
    let mesh = components.swap_remove(0);
    products::note_surface(session, &mesh)?;
    let options = FieldOptions {
        smoothing: args.smoothing.unwrap_or_else(|| default_smoothing(&mesh)),
        singularity_penalty: args.singularity_penalty,
        ..FieldOptions::default()
    };
    let frames = Frames::of(&mesh, EdgeWeights::One)?;
    let mut guides = session.stage("guidance", || {
        guidance::guides(&mesh, &frames, &args.guide.guidance(args.mode))
    })?;
    guides.extend(guidance::rims(&frames));
    let field = session.stage("field", || {
        cross_field(
            &mesh,
            &guides,
            &options,
            session.on(session.device.crossfield()),
        )
    })?;
    session.note("field", &field.report)?;
    session.note(
        "counts",
        json!({ "singularities": field.report.singularities }),
    )?;

    session.files(3, || {
        let arms: Vec<[f32; 3]> = (0..frames.faces())
            .map(|f| field.arms(&frames, f)[0].cast::<f32>().into())
            .collect();
        let index: Vec<f32> = field.index.iter().map(|&i| i as f32).collect();
        let fields = Fields::from(&mesh)
            .cell_field("arm", &arms)?
            .point_field("four_times_index", &index)?;
        io::mesh::save(session.output("field.vtu")?, &fields)?;

        let scene = scene(&mesh, &frames, &guides, &field);
        products::save_scene(session, "field", &scene)?;
        session.picture("field", || {
            session.show_scene("field", &scene);
            scene.draw(session.rasterizer()?, products::SIZE)
        })
    })
}

/// The surface with its crosses, balls at singular vertices, and the triangles that guide the field in another colour: those
/// along the isocontours, or where curvature says how.
fn scene(mesh: &TriMesh, frames: &Frames, guides: &[Guide], field: &CrossField) -> Scene {
    let mut is_guided = vec![false; frames.faces()];
    for guide in guides {
        is_guided[guide.face as usize] = true;
    }
    let part = |guided: bool, color: Rgb| {
        let mut layer = Layer::surface(mesh, Paint::Plain(color));
        layer.edges = false;
        let faces = mesh.triangles().iter().zip(&is_guided);
        layer.faces = faces.filter(|f| *f.1 == guided).map(|f| *f.0).collect();
        layer
    };
    let mut layers = vec![part(false, products::GOLD)];
    if !guides.is_empty() {
        layers.push(part(true, GUIDED));
    }
    layers.push(crosses::crosses(mesh, frames, field));
    let singular = field
        .singular_vertices(frames)
        .map(|v| (mesh.positions()[v], field.index[v] > 0));
    layers.extend(crosses::balls(singular, 0.008 * mesh.bounds().diagonal()));
    let view = View::principal(mesh.positions()).turned(0.25, 0.2);
    let mut scene = Scene::new(layers, view);
    if !guides.is_empty() {
        scene.legend = vec![(GUIDED, "guides".to_owned())];
    }
    scene.caption = Some(format!(
        "{} singularities, energy {:.2} rad²",
        field.report.singularities, field.report.energy
    ));
    scene
}

/// The side of quads a third as many as the triangles.
fn default_smoothing(mesh: &TriMesh) -> f64 {
    (3.0 * mesh.area() / mesh.triangles().len() as f64).sqrt()
}
