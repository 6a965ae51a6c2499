//! 15 — Segments of a surface from the eigenfunctions of operators.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::steps::segments::{self, Cut};
use biogeom_examples::{Failure, Session};
use clap::{Parser, ValueEnum};
use geom_core::TriMesh;
use geom_core::io::{self, mesh::AnyMesh};
use geom_core::mesh::Halfedges;
use secondfund_ops::{
    Groups, Operator, PartOptions, SegmentOptions, SpectrumOptions, Surface, Weight,
};
use serde::Serialize;
use serde_json::json;

/// Segments of a surface: patches on which the modes of operators change little
#[derive(Parser, Serialize)]
#[command(version, after_help = EXAMPLES)]
struct Args {
    /// Mesh of triangles or quads (PLY, OFF, OBJ, STL, GLB, VTU, MSH)
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// How many groups; about how many parts: fewer where neighbours blur into each other, more where groups fall apart [default: sought]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=200))]
    groups: Option<u16>,
    /// The operator whose modes are used
    #[arg(long, value_enum, default_value_t)]
    operator: OperatorName,
    /// The weight of the operator
    #[arg(long, value_enum, default_value_t)]
    weight: WeightName,
    /// Curvatures below this count as flat, in units of the largest extent
    #[arg(long, value_name = "EPSILON", default_value_t = SpectrumOptions::default().regularization)]
    regularization: f64,
    /// Rounds of smoothing of a triangle mesh's normals
    #[arg(long, value_name = "N", default_value_t = segments::Settings::default().normal_rounds, value_parser = clap::value_parser!(u32).range(0..=100))]
    normal_rounds: u32,
    /// Even out what is smaller than this share of the body's thickness, for the normals of a triangle mesh alone
    /// [default: 0.05 with --operator parts, else 0]
    #[arg(long, value_name = "SHARE")]
    detail: Option<f64>,
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

/// As many as each operator of the parts has.
const MODES_OF_PARTS: u16 = 15;

/// What is said of a closed surface of negative volume.
const INSIDE_OUT: &str = "the surface is inside out; it has been turned";

const EXAMPLES: &str = "\
Examples:
  15_segment spot.ply --out parts
  15_segment bust.off --groups 7 --out bust
  15_segment gear.ply --operator slo --weight one --out faces

Quads are taken as the control mesh of a Catmull–Clark limit surface. Outputs: segments.seg (one number per face of
the input), segments.glb and segments.png (coloured), modes.png, report.json with the eigenvalues and the
segments' areas.";

#[derive(Clone, Copy, Default, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum OperatorName {
    /// What the concave operator with weights 1 and e^K and the secondary Laplace operator with e^K agree on
    #[default]
    Parts,
    /// Secondary Laplace operator of the concave directions: sees concave creases
    Concave,
    /// Secondary Laplace operator: sees curvature
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
    fn weight(&self) -> Weight {
        match self.weight {
            WeightName::One => Weight::One,
            WeightName::ExpK => Weight::ExpK,
            WeightName::ExpMinusH => Weight::ExpMinusH,
            WeightName::ExpH => Weight::ExpH,
        }
    }

    fn cut(&self) -> Cut {
        let operator = match self.operator {
            OperatorName::Parts => return Cut::Parts(self.part_options()),
            OperatorName::Concave => Operator::Concave(self.weight()),
            OperatorName::Slo => Operator::Slo(self.weight()),
            OperatorName::Lbo => Operator::Lbo,
        };
        let segments = self.segment_options();
        let spectrum = SpectrumOptions {
            operator,
            modes: segments.modes_needed().max(self.modes.into()),
            regularization: self.regularization,
            ..SpectrumOptions::default()
        };
        Cut::Modes(Box::new((spectrum, segments)))
    }

    fn detail(&self) -> f64 {
        let usual = match self.operator {
            OperatorName::Parts => segments::Settings::default().detail,
            _ => 0.0,
        };
        self.detail.unwrap_or(usual)
    }

    fn part_options(&self) -> PartOptions {
        PartOptions {
            groups: self.groups.map(usize::from),
            regularization: self.regularization,
            smooth: !self.raw_borders,
            seed: self.seed,
            ..PartOptions::default()
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

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    match args.operator {
        OperatorName::Lbo => {
            let because = "is of --operator slo and --operator concave";
            session.refuse(&["weight", "regularization"], because)?;
            session.refuse(
                &["normal_rounds", "detail"],
                "changes nothing of --operator lbo",
            )?;
        }
        OperatorName::Parts => {
            session.refuse(&["weight"], "is of --operator slo and --operator concave")?;
            if args.modes > MODES_OF_PARTS {
                session.refuse(&["modes"], "is at most 15 of --operator parts")?;
            }
        }
        OperatorName::Concave | OperatorName::Slo => {}
    }
    let asked = segments::Settings {
        cut: args.cut(),
        normal_rounds: args.normal_rounds,
        detail: args.detail(),
    };
    let read = session.stage("reading", || {
        io::mesh::read_up_to(&args.input, session.memory())
    })?;
    let done = match read.mesh {
        AnyMesh::Quad(mesh) => {
            session.refuse(
                &["normal_rounds", "detail"],
                "is for triangles, and the input has quads",
            )?;
            let surface = session.stage("limit surface", || Surface::new(mesh))?;
            if surface.flipped() {
                session.warn(INSIDE_OUT)?;
            }
            session.note(
                "surface",
                json!({ "element": "catmull-clark", "refined": surface.refined() }),
            )?;
            segments::of_quads(session, &surface, &asked)?
        }
        mesh => {
            session.note("surface", json!({ "element": "triangles" }))?;
            // Vertices of no face would count in its extent. Triangles keep their order.
            let (mesh, _) = mesh.into_triangles().without_unused();
            let (vertices, file) = (mesh.positions().len(), args.input.display());
            if matches!(args.operator, OperatorName::Parts)
                && vertices <= usize::from(MODES_OF_PARTS) + 1
            {
                return Err(format!(
                    "{file}: --operator parts takes {MODES_OF_PARTS} modes, for which {vertices} vertices are too few: a finer mesh, or --operator slo with few --groups and --modes"
                )
                .into());
            }
            let mesh = outward(session, mesh)?;
            segments::of_triangles(session, mesh, &read.face_of, &asked)?
        }
    };
    segments::finish(session, &done, args.modes.into())
}

/// The surface with its faces outward if it is closed: else what is concave would count as convex.
fn outward(session: &Session, mesh: TriMesh) -> Result<TriMesh, Failure> {
    let closed = |edges: Halfedges<3>| edges.boundary_loops().is_empty();
    if mesh.volume() >= 0.0 || !Halfedges::of(&mesh).is_ok_and(closed) {
        return Ok(mesh);
    }
    session.warn(INSIDE_OUT)?;
    let (positions, triangles) = mesh.into_parts();
    let turned = triangles.into_iter().map(|[a, b, c]| [a, c, b]);
    Ok(TriMesh::new(positions, turned.collect())?)
}
