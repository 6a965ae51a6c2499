//! 04 — Better elements for a mesh of anybody.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::products::Coloring;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use geom_core::io::{
    self,
    mesh::{AnyMesh, VolumeGroups},
};
use geom_core::surface::remesh::{self, Features, Sizing, remesh};
use geom_core::{TetMesh, TriMesh};
use serde::Serialize;
use tet_quality::{Goals, Options, SurfaceMotion, improve};

/// Improves the tetrahedra or the triangles of any mesh and shows the quality before and after
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Mesh: VTU, MSH, PLY, OFF, OBJ, STL or GLB
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    #[command(flatten)]
    tets: Tets,
    #[command(flatten)]
    triangles: Triangles,
    #[command(flatten)]
    common: Common,
}

/// What is asked of tetrahedra.
#[derive(clap::Args, Serialize)]
#[command(next_help_heading = "Meshes of tetrahedra")]
struct Tets {
    /// Smallest dihedral angle to reach, degrees
    #[arg(long, value_name = "DEGREES")]
    min_dihedral: Option<f64>,
    /// Largest dihedral angle to reach, degrees
    #[arg(long, value_name = "DEGREES")]
    max_dihedral: Option<f64>,
    /// Joe–Liu measure to reach
    #[arg(long, value_name = "Q")]
    joe_liu: Option<f64>,
    /// Longest over shortest edge to stay below; raises the Joe–Liu measure to reach where that needs it
    #[arg(long, value_name = "RATIO")]
    edge_ratio: Option<f64>,
    /// Let surface vertices slide along the surface of the input, off it by this share of its edges at
    /// most; edges and corners where it turns by 40° or more stay [default: what is not plane stays]
    #[arg(long, value_name = "SHARE")]
    deviation: Option<f64>,
    /// Watch every step that it lets no walls of gaps that are not meshed cross, instead of parting them at the end; takes
    /// up to three times as long, and is for surfaces of which the report still counts crossing pairs
    #[arg(long)]
    keep_apart: bool,
    /// Most passes
    #[arg(long, value_name = "N")]
    passes: Option<u32>,
}

/// What is asked of triangles.
#[derive(clap::Args, Serialize)]
#[command(next_help_heading = "Meshes of triangles")]
struct Triangles {
    /// Wanted length of edges, Å [default: the mean of the input's]
    #[arg(long, value_name = "LENGTH")]
    edge_length: Option<f64>,
    /// Longer edges where the surface is flat: distance allowed between triangles and surface, Å
    #[arg(long, value_name = "LENGTH", conflicts_with = "edge_length")]
    tolerance: Option<f64>,
    /// Keep edges where the surface turns by more than this, degrees [default: none]
    #[arg(long, value_name = "DEGREES")]
    keep_edges: Option<f64>,
}

const EXAMPLES: &str = "\
Examples:
  04_improve volume.vtu --out out
  04_improve gmsh.msh --min-dihedral 30 --passes 30 --out better
  04_improve volume.vtu --deviation 0.1 --out rounder
  04_improve surface.ply --edge-length 0.8 --out even

Tetrahedra: regions, their interfaces and the boundary stay; surface vertices slide only where that
changes no shape, since a mesh alone does not say what surface it stands for. Where that keeps
tetrahedra bad, as the report's `unmet` says, --deviation lets them go. Triangles: the surface is
remeshed with edges of even length, within the surface of the input.

Names and numbers of regions and of patches of the boundary stay; a patch's border is kept exactly at a
crease, and by the nearest edges within a plane.

Outputs: improved.vtu and improved.msh, or improved.ply and improved.glb; before.png and improved.png
(tetrahedra are cut and coloured by the smallest dihedral angle), quality.png (histograms before and
after), report.json.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("04_improve", better)
}

fn better(args: &Args, session: &Session) -> Result<(), Failure> {
    let file = session.stage("reading", || {
        io::mesh::read_up_to(&args.input, session.memory())
    })?;
    let groups = VolumeGroups::of(&file);
    match file.mesh {
        AnyMesh::Tet(mesh) => better_tets(args, mesh, &groups, session),
        AnyMesh::Tri(mesh) => better_triangles(args, mesh, session),
        _ => Err(format!("{}: neither tetrahedra nor triangles", args.input.display()).into()),
    }
}

fn better_tets(
    args: &Args,
    mesh: TetMesh,
    groups: &VolumeGroups,
    session: &Session,
) -> Result<(), Failure> {
    let t = &args.triangles;
    if t.edge_length.or(t.tolerance).or(t.keep_edges).is_some() {
        return Err(
            "--edge-length, --tolerance and --keep-edges are for meshes of triangles".into(),
        );
    }
    let (asked, goals) = (&args.tets, Goals::default());
    let options = Options {
        goals: Goals {
            min_dihedral: asked.min_dihedral.unwrap_or(goals.min_dihedral),
            max_dihedral: asked.max_dihedral.unwrap_or(goals.max_dihedral),
            // Short edges go by way of the Joe–Liu measure, which bounds the ratio.
            joe_liu: asked
                .joe_liu
                .unwrap_or(goals.joe_liu)
                .max(asked.edge_ratio.map_or(0.0, Goals::joe_liu_for_edge_ratio)),
            edge_ratio: asked.edge_ratio.unwrap_or(goals.edge_ratio),
        },
        passes: asked.passes.unwrap_or(Options::default().passes),
        deviation: asked.deviation.unwrap_or(Options::default().deviation),
        surface: if asked.deviation.is_some() {
            SurfaceMotion::AlongInput
        } else {
            SurfaceMotion::default()
        },
        keep_apart: asked.keep_apart,
        ..Options::default()
    };
    session.note("improvement", options)?;
    products::picture_of_volume(session, "before", &mesh, &groups.view(&mesh))?;
    let improved = session.stage("improvement", || {
        improve(mesh, None, &options, session.on(session.device.quality()))
    })?;
    let (mesh, report) = (improved.mesh, improved.report);
    session.note("quality", &report)?;
    products::note_volume(session, &mesh)?;
    session.files(4, || {
        products::save_volume(session, "improved", &mesh, groups.view(&mesh), None)?;
        products::picture_of_quality(session, "quality", &report.before.all, &report.after.all)
    })
}

fn better_triangles(args: &Args, mesh: TriMesh, session: &Session) -> Result<(), Failure> {
    let t = &args.tets;
    let angles = t
        .min_dihedral
        .or(t.max_dihedral)
        .or(t.joe_liu)
        .or(t.edge_ratio);
    if angles.or(t.deviation).is_some() || t.passes.is_some() || t.keep_apart {
        return Err(
            "--min-dihedral, --max-dihedral, --joe-liu, --edge-ratio, --deviation, --keep-apart and --passes are for meshes of tetrahedra".into(),
        );
    }
    let asked = &args.triangles;
    let even = Sizing::Uniform {
        edge_length: asked.edge_length,
    };
    let options = remesh::Options {
        sizing: asked.tolerance.map_or(even, |tolerance| Sizing::Curvature {
            tolerance,
            min_edge: 2.0 * tolerance,
            max_edge: 40.0 * tolerance,
            gradation: 0.3,
        }),
        features: asked.keep_edges.map_or(Features::None, Features::Angle),
        ..Default::default()
    };
    session.note("improvement", &options)?;
    products::picture_of_surface(session, "before", &mesh, &Coloring::plain(&mesh))?;
    let made = session.stage("remeshing", || {
        remesh(mesh, None, &options, session.on(session.device.quality()))
    })?;
    let report = made.report;
    session.note("quality", &report)?;
    products::note_surface(session, &made.mesh)?;
    session.files(4, || {
        products::save_surface(session, "improved", &made.mesh, None)?;
        let counts = [&report.before, &report.after]
            .map(|r| r.min_angle_histogram.iter().map(|&n| n as u64).collect());
        let title = format!(
            "{} triangles: smallest angle {:.1}° before, {:.1}° after",
            products::grouped(report.after.triangles),
            report.before.min_angle_deg,
            report.after.min_angle_deg
        );
        let label = "smallest angle per triangle / °";
        products::picture_of_change(session, "quality", &title, label, 60.0, &counts)
    })
}
