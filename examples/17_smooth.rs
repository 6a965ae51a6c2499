//! 17 — Smoothing that keeps creases.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::picture::{Layer, Paint, Scene, View, sheet};
use biogeom_examples::{Failure, Session, products};
use clap::{Parser, ValueEnum};
use geom_core::io::{self, mesh::AnyMesh, view::View as Fields};
use geom_core::{QuadMesh, TriMesh};
use secondfund_ops::flow::{BilateralOptions, FlowReport, filter_normals};
use secondfund_ops::options::FlowOperator;
use secondfund_ops::{FlowOptions, smooth, smooth_quads};
use serde::Serialize;

/// A smoother surface: by the flow of an operator, or by filtered normals
#[derive(Parser, Serialize)]
#[command(version, after_help = EXAMPLES)]
struct Args {
    /// Mesh of triangles or quads (PLY, OFF, OBJ, STL, GLB, VTU, MSH)
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// How to smooth
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// Steps of a flow
    #[arg(long, value_name = "N", default_value_t = FlowOptions::default().iterations as u32, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    steps: u32,
    /// How far 95 % of the vertices move in a step at most, in mean edges
    #[arg(long, value_name = "SHARE", default_value_t = FlowOptions::default().step)]
    step: f64,
    /// The share of the sharpening part: 0 is the smoothest, 1 the equation as it stands
    #[arg(long, value_name = "BETA", default_value_t = FlowOptions::default().sharpen)]
    sharpen: f64,
    /// Keep the enclosed volume
    #[arg(long)]
    keep_volume: bool,
    /// Let the rims of holes move
    #[arg(long)]
    free_rims: bool,
    /// Rounds of smoothing of a triangle mesh's normals, of which the flow takes its curvature
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=100))]
    normal_rounds: u32,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  17_smooth scan.ply --out smooth
  17_smooth part.off --steps 50 --keep-volume --out part
  17_smooth part.off --method bilateral --out filtered

Outputs: smooth.ply, smooth.glb, smooth.png (before and after), report.json with displacements and volumes. Quads are
taken as the control mesh of a Catmull–Clark surface and stay quads in smooth.obj.";

#[derive(Clone, Copy, Default, PartialEq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum Method {
    /// The generalized Giaquinta–Hildebrandt operator: flat parts and straight creases stay
    #[default]
    Ggho,
    /// Mean curvature flow
    MeanCurvature,
    /// The bilateral normal filter, for triangles with flat parts
    Bilateral,
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
    biogeom_examples::run("17_smooth", program)
}

impl Args {
    fn options(&self) -> FlowOptions {
        FlowOptions {
            operator: match self.method {
                Method::MeanCurvature => FlowOperator::Lbo,
                _ => FlowOperator::Ggho,
            },
            iterations: self.steps as usize,
            step: self.step,
            sharpen: self.sharpen,
            keep_volume: self.keep_volume,
            keep_rims: !self.free_rims,
            ..FlowOptions::default()
        }
    }
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    match args.method {
        Method::Bilateral => {
            let of_flows = [
                "steps",
                "step",
                "sharpen",
                "keep_volume",
                "free_rims",
                "normal_rounds",
            ];
            session.refuse(&of_flows, "is of the flows, not of --method bilateral")?;
        }
        Method::MeanCurvature => session.refuse(&["sharpen"], "is of --method ggho")?,
        Method::Ggho => {}
    }
    let read = session.stage("reading", || {
        io::mesh::read_up_to(&args.input, session.memory())
    })?;
    match read.mesh {
        AnyMesh::Quad(mesh) if args.method != Method::Bilateral => {
            session.refuse(
                &["normal_rounds"],
                "is for triangles, and the input has quads",
            )?;
            quads(args, session, &mesh)
        }
        mesh => triangles(args, session, &mesh.into_triangles()),
    }
}

fn triangles(args: &Args, session: &Session, mesh: &TriMesh) -> Result<(), Failure> {
    let done = session.stage("smoothing", || match args.method {
        Method::Bilateral => filter_normals(mesh, &BilateralOptions::default()),
        _ => {
            let on = session.on(session.device.operators());
            smooth(mesh, args.normal_rounds, &args.options(), on)
        }
    })?;
    write(session, mesh, &done.mesh, &done.report)
}

fn quads(args: &Args, session: &Session, mesh: &QuadMesh) -> Result<(), Failure> {
    let on = session.on(session.device.operators());
    let done = session.stage("smoothing", || smooth_quads(mesh, &args.options(), on))?;
    io::mesh::save(session.output("smooth.obj")?, &Fields::from(&done.mesh))?;
    let [before, after] = [mesh, &done.mesh].map(|m| m.clone().into_triangles());
    write(session, &before, &after, &done.report)
}

fn write(
    session: &Session,
    before: &TriMesh,
    after: &TriMesh,
    report: &FlowReport,
) -> Result<(), Failure> {
    session.note("flow", report)?;
    products::note_surface(session, after)?;
    session.files(3, || {
        for (name, mesh) in [("1: before", before), ("2: after", after)] {
            session.show(name, mesh, products::colorings(mesh, None));
        }
        let fields = Fields::from(after);
        io::mesh::save(session.output("smooth.ply")?, &fields)?;
        io::mesh::save(session.output("smooth.glb")?, &fields)?;
        session.picture("smooth", || {
            let view = View::principal(before.positions()).turned(0.25, 0.2);
            let mut pictures = Vec::new();
            for (name, mesh) in [("before", before), ("after", after)] {
                let mut layer = Layer::surface(mesh, Paint::Plain(products::GOLD));
                layer.edges = false;
                layer.normals = None;
                let image =
                    Scene::new(vec![layer], view).draw(session.rasterizer()?, [800, 640])?;
                pictures.push((name.to_owned(), image));
            }
            Ok(sheet(&pictures, 2))
        })
    })
}
