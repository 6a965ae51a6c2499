//! 07 — A cross field on a surface: four directions per triangle that follow its eigenfunctions.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::crosses::{self, Guide, Mode};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::input::surface;
use biogeom_examples::picture::{Layer, Paint, Scene, View};
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use crossfield::field::Frames;
use crossfield::{FieldOptions, cross_field, guidance};
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
    guide: Guide,
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

const EXAMPLES: &str = "\
Examples:
  07_field spot.ply --out out
  07_field 1ajj.pdb --spacing 1 --guide modes:1,2 --mode hard --out guided

Outputs: field.png (crosses; blue balls where three quads will meet, red ones where five will), field.vtu (one arm
of the cross per triangle, four times the index per vertex), report.json with `field`.";

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
    let guides = session.stage("guidance", || {
        guidance::guides(&mesh, &frames, &args.guide.guidance(args.mode))
    })?;
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

    session.files(2, || {
        let arms: Vec<[f32; 3]> = (0..frames.faces())
            .map(|f| field.arms(&frames, f)[0].cast::<f32>().into())
            .collect();
        let index: Vec<f32> = field.index.iter().map(|&i| i as f32).collect();
        let fields = Fields::from(&mesh)
            .cell_field("arm", &arms)?
            .point_field("four_times_index", &index)?;
        io::mesh::save(session.output("field.vtu")?, &fields)?;

        session.picture("field", || {
            let mut body = Layer::surface(&mesh, Paint::Plain(products::GOLD));
            body.edges = false;
            let mut layers = vec![body, crosses::crosses(&mesh, &frames, &field)];
            let singular = field
                .singular_vertices(&frames)
                .map(|v| (mesh.positions()[v], field.index[v] > 0));
            layers.extend(crosses::balls(singular, 0.008 * mesh.bounds().diagonal()));
            let view = View::principal(mesh.positions()).turned(0.25, 0.2);
            let mut scene = Scene::new(layers, view);
            scene.caption = Some(format!(
                "{} singularities, energy {:.2} rad²",
                field.report.singularities, field.report.energy
            ));
            session.show_scene("field", &scene);
            Ok(scene.draw(session.rasterizer()?, products::SIZE)?)
        })
    })
}

/// The side of quads a third as many as the triangles.
fn default_smoothing(mesh: &TriMesh) -> f64 {
    (3.0 * mesh.area() / mesh.triangles().len() as f64).sqrt()
}
