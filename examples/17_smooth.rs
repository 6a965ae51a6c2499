//! 17 — Smoothing that keeps creases.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::picture::{Layer, Paint, Scene, View, sheet};
use biogeom_examples::{Failure, Session, products};
use clap::{Parser, ValueEnum};
use geom_core::io::{self, mesh::AnyMesh, view::View as Fields};
use geom_core::{QuadMesh, TriMesh};
use secondfund_ops::flow::{FlowReport, filter_normals, filter_quad_normals};
use secondfund_ops::options::FlowOperator;
use secondfund_ops::{FilterOptions, FlowOptions, NormalFilter, smooth, smooth_quads};
use serde::Serialize;
use serde_json::json;

/// A smoother surface: by the flow of an operator, or by filtered normals
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
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
    /// Let faces come through others: faster, and for surfaces that do so anyway
    #[arg(long)]
    let_cross: bool,
    /// Rounds of smoothing of a triangle mesh's normals, of which the flow takes its curvature
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=100))]
    normal_rounds: u32,
    /// Difference of unit normals beyond which the bilateral filter counts a face little [default: 0.3]
    #[arg(long, value_name = "RANGE")]
    range: Option<f64>,
    /// How firmly the total-variation filter holds normals to those of the input, in 1 over mean edges: lower values
    /// flatten coarser noise, and details with it [default: 10]
    #[arg(long, value_name = "ALPHA")]
    fidelity: Option<f64>,
    /// How far a filter moves vertices along flat parts and edges, towards the middle of their faces, per round: the share
    /// of the way, 0 to 1 [default: 0.1]
    #[arg(long, value_name = "SHARE")]
    tangential: Option<f64>,
    /// No corner of a face is made narrower than this, degrees below 60 [default: 10]
    #[arg(long, value_name = "DEGREES")]
    least_angle: Option<f64>,
    #[command(flatten)]
    common: Common,
}

/// By so much of itself a volume that is kept may change.
const KEPT: f64 = 1e-3;

const EXAMPLES: &str = "\
Examples:
  17_smooth scan.ply --out smooth
  17_smooth part.off --steps 50 --keep-volume --out part
  17_smooth part.off --method total-variation --out filtered

Outputs: smooth.vtu (with the fields and groups of the input), smooth.ply, smooth.glb, smooth.png (before and after),
report.json with displacements and volumes. Quads stay quads in smooth.vtu and smooth.obj; the flows take them as the
control mesh of a Catmull–Clark surface, the filters as they stand. Noise on flat parts: total-variation; on round bodies:
mean-curvature. ggho moves the surface and keeps its edges; noise, too, but for little of it.";

#[derive(Clone, Copy, Default, PartialEq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum Method {
    /// The generalized Giaquinta–Hildebrandt operator: flat parts and straight creases stay
    #[default]
    Ggho,
    /// Mean curvature flow
    MeanCurvature,
    /// The bilateral filter of normals, for flat parts
    Bilateral,
    /// The total-variation filter of normals, for flat parts with sharp edges
    TotalVariation,
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
        let defaults = FlowOptions::default();
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
            keep_apart: !self.let_cross,
            least_angle: self.least_angle.unwrap_or(defaults.least_angle),
            ..defaults
        }
    }

    /// The filter of normals, if the method is one.
    fn filter(&self) -> Option<FilterOptions> {
        let mut filter = match self.method {
            Method::Bilateral => NormalFilter::BILATERAL,
            Method::TotalVariation => NormalFilter::TOTAL_VARIATION,
            Method::Ggho | Method::MeanCurvature => return None,
        };
        match &mut filter {
            NormalFilter::Bilateral { range, .. } => *range = self.range.unwrap_or(*range),
            NormalFilter::TotalVariation { fidelity, .. } => {
                *fidelity = self.fidelity.unwrap_or(*fidelity);
            }
        }
        let defaults = FilterOptions::default();
        Some(FilterOptions {
            filter,
            tangential: self.tangential.unwrap_or(defaults.tangential),
            least_angle: self.least_angle.unwrap_or(defaults.least_angle),
            keep_volume: self.keep_volume,
            keep_rims: !self.free_rims,
            keep_apart: !self.let_cross,
            ..defaults
        })
    }

    /// Refuses options of other methods.
    fn refuse_others(&self, session: &Session) -> Result<(), Failure> {
        if self.method != Method::Bilateral {
            session.refuse(&["range"], "is of --method bilateral")?;
        }
        if self.method != Method::TotalVariation {
            session.refuse(&["fidelity"], "is of --method total-variation")?;
        }
        if self.filter().is_some() {
            let of_flows = ["steps", "step", "sharpen", "normal_rounds"];
            session.refuse(&of_flows, "is of the flows, not of filters of normals")?;
        } else {
            session.refuse(
                &["tangential"],
                "is of filters of normals, not of the flows",
            )?;
        }
        if self.method == Method::MeanCurvature {
            session.refuse(&["sharpen"], "is of --method ggho")?;
        }
        Ok(())
    }
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    args.refuse_others(session)?;
    let read = session.stage("reading", || {
        io::mesh::read_up_to(&args.input, session.memory())
    })?;
    let said = match &read.mesh {
        AnyMesh::Tri(_) | AnyMesh::Quad(_) => Fields {
            point_fields: read.point_fields,
            cell_fields: read.cell_fields,
            colors: read.colors.map(Into::into),
            groups: read.groups,
            group_of: read.group_of.into(),
            ..Fields::default()
        },
        // They are of tetrahedra, of which the boundary is smoothed.
        _ => Fields::default(),
    };
    if !read.face_of.is_empty() {
        let warning = "the faces with more than three corners have been cut into triangles";
        session.warn(warning)?;
    }
    match read.mesh {
        AnyMesh::Quad(mesh) => {
            session.refuse(
                &["normal_rounds"],
                "is for triangles, and the input has quads",
            )?;
            quads(args, session, &mesh, &said)
        }
        mesh => triangles(args, session, &mesh.into_triangles(), &said),
    }
}

/// The mesh with what the input says of its vertices and faces, which smoothing neither makes nor takes away.
fn carried<'a>(mesh: Fields<'a>, said: &Fields<'a>) -> Fields<'a> {
    Fields {
        points: mesh.points,
        blocks: mesh.blocks,
        ..said.clone()
    }
}

fn triangles(
    args: &Args,
    session: &Session,
    mesh: &TriMesh,
    said: &Fields<'_>,
) -> Result<(), Failure> {
    let on = session.on(session.device.operators());
    let done = session.stage("smoothing", || match args.filter() {
        Some(filter) => filter_normals(mesh, &filter, on),
        None => smooth(mesh, args.normal_rounds, &args.options(), on),
    })?;
    let fields = carried(Fields::from(&done.mesh), said);
    let files = [("smooth.vtu", &fields), ("smooth.ply", &fields)];
    write(args, session, [mesh, &done.mesh], &done.report, &files)
}

fn quads(
    args: &Args,
    session: &Session,
    mesh: &QuadMesh,
    said: &Fields<'_>,
) -> Result<(), Failure> {
    let on = session.on(session.device.operators());
    let done = session.stage("smoothing", || match args.filter() {
        Some(filter) => filter_quad_normals(mesh, &filter, on),
        None => smooth_quads(mesh, &args.options(), on),
    })?;
    let fields = carried(Fields::from(&done.mesh), said);
    let [before, after] = [mesh, &done.mesh].map(|m| m.clone().into_triangles());
    let plain = Fields::from(&after);
    let files = [
        ("smooth.vtu", &fields),
        ("smooth.obj", &fields),
        ("smooth.ply", &plain),
    ];
    write(args, session, [&before, &after], &done.report, &files)?;
    // The surface of the report is that of the mesh as it stands.
    let of = match args.filter() {
        Some(_) => "mesh",
        None => "limit surface",
    };
    session.note("flow", json!({ "volume_of": of }))
}

fn write(
    args: &Args,
    session: &Session,
    [before, after]: [&TriMesh; 2],
    report: &FlowReport,
    files: &[(&str, &Fields<'_>)],
) -> Result<(), Failure> {
    session.note("flow", report)?;
    let [first, last] = report.volume;
    if args.keep_volume && (last - first).abs() > KEPT * first.abs() {
        let off = 100.0 * (last / first - 1.0);
        let warning = format!("the volume has changed by {off:.2} % although it was to be kept");
        session.warn(warning)?;
    }
    products::note_surface(session, after)?;
    session.files(3, || {
        for &(name, fields) in files {
            io::mesh::save(session.output(name)?, fields)?;
        }
        for (name, mesh) in [("1: before", before), ("2: after", after)] {
            session.show(name, mesh, products::colorings(mesh, None));
        }
        io::mesh::save(session.output("smooth.glb")?, &Fields::from(after))?;
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
