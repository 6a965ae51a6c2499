//! 08 — Quads of a surface, by its cross field.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::crosses::{self, Guide, Mode};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::input::surface;
use biogeom_examples::picture::{ColorMap, Image, Layer, Paint, Scale, Scene, View};
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use crossfield::quads::quality::distances;
use crossfield::{Ladder, Options, Quadrangulation, Size, quadrangulate};
use geom_core::io::{self, view::View as Fields};
use geom_core::mesh::Halfedges;
use geom_core::{TriMesh, VertexId};
use serde::Serialize;
use serde_json::json;

/// A mesh of quads: of a mesh's surface, or of a structure's or grid's
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// How many quads [default: a third of the triangles]
    #[arg(long, value_name = "N", conflicts_with = "side", value_parser = clap::value_parser!(u32).range(1..))]
    quads: Option<u32>,
    /// Side of a quad, Å, instead
    #[arg(long, value_name = "H")]
    side: Option<f64>,
    /// What the field follows: none, curvature, modes:1,2, modes:auto, characteristic:1,2
    #[arg(long, value_name = "GUIDE", default_value = "none", value_parser = crosses::guide)]
    guide: Guide,
    /// How strictly
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// Keep edges whose triangles' normals differ by more than this, degrees
    #[arg(long, value_name = "DEGREES")]
    crease: Option<f64>,
    /// Bumps smaller than this many sides of a quad get no irregular vertices of their own
    #[arg(long, value_name = "SIDES", default_value_t = Options::default().smoothing)]
    smoothing: f64,
    /// What removing a pair of irregular vertices may cost, rad²
    #[arg(long, value_name = "MU", default_value_t = Options::default().singularity_penalty)]
    singularity_penalty: f64,
    /// Stop at the first failure instead of trying other fields and sizes
    #[arg(long)]
    no_fallback: bool,
    /// Leave the vertices where the map puts them
    #[arg(long)]
    raw: bool,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  08_quads spot.ply --quads 2000 --out out
  08_quads 1ajj.pdb --spacing 1 --guide modes:1,2 --out protein

Outputs: quads.obj, quads.vtu (scaled Jacobian per quad), quads.glb, quads.png (sides, irregular vertices, scaled
Jacobian), report.json with `counts.quads`, `counts.irregular`, `scaled_jacobian`, `hausdorff` (from the quads to
the surface and back, Å) and `rung`, which says how the mesh was made.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("08_quads", quads)
}

fn quads(args: &Args, session: &Session) -> Result<(), Failure> {
    crosses::refuse_mode_alone(&args.guide, session)?;
    let mesh = surface::read(&args.source, session)?;
    products::note_surface(session, &mesh)?;
    let options = Options {
        size: match (args.quads, args.side) {
            (Some(n), _) => Size::Quads(n as usize),
            (None, Some(h)) => Size::Spacing(h),
            (None, None) => Size::Triangles,
        },
        guidance: args.guide.guidance(args.mode),
        crease: args.crease,
        smoothing: args.smoothing,
        singularity_penalty: args.singularity_penalty,
        ladder: if args.no_fallback {
            Ladder::Off
        } else {
            Ladder::Full
        },
        improve: !args.raw,
        ..Options::default()
    };
    options.check()?;
    affordable(&options, &mesh, session)?;
    let on = session.on(session.device.crossfield());
    let made = session.stage("quads", || quadrangulate(&mesh, &options, on))?;
    note(session, &mesh, &made)?;
    session.files(4, || save(session, &made))
}

/// Refuses more quads than there is memory for, before anything is made of them.
fn affordable(options: &Options, mesh: &TriMesh, session: &Session) -> Result<(), Failure> {
    let needed = options.bytes(mesh.area(), mesh.triangles().len());
    let allowed = session.memory();
    if needed > allowed as f64 {
        let gigabytes = |bytes: f64| bytes / 1e9;
        return Err(format!(
            "the quads need about {:.1} GB, more than the {:.1} GB of --max-memory",
            gigabytes(needed),
            gigabytes(allowed as f64)
        )
        .into());
    }
    Ok(())
}

fn note(session: &Session, mesh: &TriMesh, made: &Quadrangulation) -> Result<(), Failure> {
    let report = &made.report;
    let counts = json!({
        "quads": made.mesh.quads().len(),
        "vertices": made.mesh.positions().len(),
        "irregular": report.valences.irregular(),
    });
    session.note("counts", counts)?;
    let fields = report.parts.iter().filter_map(|p| p.field.as_ref());
    session.note(
        "singularities",
        fields.clone().map(|f| f.singularities).sum::<usize>(),
    )?;
    session.note("energy", fields.map(|f| f.energy).sum::<f64>())?;
    session.note("scaled_jacobian", report.scaled_jacobian)?;
    session.note("hausdorff", distances(&made.mesh, mesh)?)?;
    session.note("rung", report.rung())?;
    session.note("valences", &report.valences)?;
    session.note("repaired", report.repaired)?;
    session.note("parts", &report.parts)
}

fn save(session: &Session, made: &Quadrangulation) -> Result<(), Failure> {
    let jacobian: Vec<f32> = made.jacobians.iter().map(|&j| j as f32).collect();
    let fields = Fields::from(&made.mesh).cell_field("scaled_jacobian", &jacobian)?;
    io::mesh::save(session.output("quads.vtu")?, &fields)?;
    io::mesh::save(session.output("quads.obj")?, &Fields::from(&made.mesh))?;
    io::mesh::save(session.output("quads.glb")?, &Fields::from(&made.mesh))?;

    session.picture("quads", || picture(session, made))
}

/// The quads with their sides and irregular vertices, coloured by the scaled Jacobian.
fn picture(session: &Session, made: &Quadrangulation) -> Result<Image, Failure> {
    let scale = Scale::new(ColorMap::Viridis, [0.0, 1.0], "scaled Jacobian");
    let halves = made.mesh.clone().into_triangles();
    let colors = made
        .jacobians
        .iter()
        .flat_map(|&j| [scale.color(j); 2])
        .collect();
    let mut body = Layer::surface(&halves, Paint::Faces(colors));
    body.edges = false;
    let edges = Halfedges::of_quads(&made.mesh)?;
    let irregular = (0..made.mesh.positions().len()).filter_map(|v| {
        let id = VertexId(v as u32);
        let count = edges.around(id).count();
        let inside = !edges.on_boundary(id);
        (inside && count != 4).then(|| (made.mesh.positions()[v], count < 4))
    });
    let radius = 0.006 * made.mesh.bounds().diagonal();
    let mut layers = vec![body, crosses::sides(&made.mesh)];
    layers.extend(crosses::balls(irregular, radius));
    let view = View::principal(made.mesh.positions()).turned(0.25, 0.2);
    let mut scene = Scene::new(layers, view);
    scene.scale = Some(scale);
    scene.caption = Some(format!(
        "{} quads, {} irregular vertices",
        products::grouped(made.mesh.quads().len()),
        made.report.valences.irregular()
    ));
    session.show_scene("quads", &scene);
    Ok(scene.draw(session.rasterizer()?, products::SIZE)?)
}
