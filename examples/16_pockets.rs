//! 16 — Pockets of a molecule: found, ranked and outlined on its surface.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon, ReaderArgs, default_spacing};
use biogeom_examples::picture::{Layer, Paint, Rgb, Scene, View, segment_color};
use biogeom_examples::products::Coloring;
use biogeom_examples::{Failure, Session, products, scripts};
use clap::Parser;
use gauss_density::{Levels, Model, PointSampler, sample_band};
use geom_core::io::{self, view::View as Fields};
use geom_core::structure::ResidueKind;
use geom_core::{Structure, TriMesh};
use secondfund_ops::PocketOptions;
use secondfund_ops::options::OutlineOptions;
use secondfund_ops::pockets::{Outline, Pocket, Pockets, find, outline};
use serde::Serialize;
use serde_json::json;

/// Pockets of a molecule, ranked by burial: where ligands may bind
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure (PDB, mmCIF, PQR), also gzip-compressed. Ligands, ions, waters and hydrogens never count
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// Most pockets
    #[arg(long, value_name = "N", default_value_t = PocketOptions::default().most as u16, value_parser = clap::value_parser!(u16).range(1..=1000))]
    most: u16,
    /// Atoms within this distance of a point count as its burial, Å
    #[arg(long, value_name = "R", default_value_t = PocketOptions::default().radius)]
    burial_radius: f64,
    /// The share of points that are not deep enough
    #[arg(long, value_name = "SHARE", default_value_t = PocketOptions::default().percentile)]
    percentile: f64,
    /// One threshold for all chains instead of one for each
    #[arg(long)]
    pooled: bool,
    /// Decay of an atom's kernel, 1/Å²: of the surface on which pockets are outlined. Smaller is smoother; below 0.3
    /// deep pockets close
    #[arg(long, value_name = "KAPPA", default_value_t = 0.5)]
    decay: f64,
    /// Distance of the lattice points of the surface, Å [default: 0.5, more from 1000 atoms on]
    #[arg(long, value_name = "H")]
    spacing: Option<f64>,
    #[command(flatten)]
    reader: ReaderArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  16_pockets 1hvr.pdb --out pockets
  16_pockets 1fki.cif --select A --out chain_a

Outputs: pockets.csv (rank, score, centre, volume, area, depth, mouth, residues), pockets.pdb (the points of the pockets:
chain P, residue = rank, for PyMOL and ChimeraX), pockets.glb and pockets.png (the surface, each pocket in its
colour), view.cxc and view.pml (ChimeraX and PyMOL open all of it around the structure), report.json with which atoms counted.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("16_pockets", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let structure = args.reader.read(session, &args.input)?.structure;
    let options = PocketOptions {
        most: args.most.into(),
        radius: args.burial_radius,
        percentile: args.percentile,
        per_chain: !args.pooled,
        ..PocketOptions::default()
    };
    let found = session.stage("pockets", || find(&structure, &options))?;
    let surface = surface(args, session, &structure)?;
    let outlining = OutlineOptions {
        radius: args.burial_radius,
        ..OutlineOptions::default()
    };
    let on = session.on(session.device.operators());
    let outlines = session.stage("outlines", || {
        outline(&surface, &structure, &found.pockets, &outlining, on)
    })?;
    note(session, &found)?;
    session.files(6, || {
        write_table(session, &structure, &found.pockets, &outlines)?;
        write_points(session, &found.pockets)?;
        scripts::save(session, &args.input, &["pockets"], &["pockets"])?;
        session.show_structure(&args.input);
        write_surface(session, &surface, &outlines)
    })
}

/// The surface of the polymers alone, the part of the largest area.
fn surface(args: &Args, session: &Session, structure: &Structure) -> Result<TriMesh, Failure> {
    let polymer = structure.of_kind(ResidueKind::Polymer);
    let levels = Levels {
        decay: args.decay,
        ..Levels::default()
    };
    let model = Model::uniform(&polymer, &levels)?;
    let options = gauss_density::Options {
        spacing: args
            .spacing
            .unwrap_or_else(|| default_spacing(polymer.atoms().len())),
        max_memory: session.memory(),
        ..Default::default()
    };
    let sampled = session.stage("density", || {
        sample_band(&model, &options, session.on(session.device.density()))
    })?;
    let field = PointSampler::new(&model, options.cutoff)?;
    let contour = dual_contour::Options {
        max_memory: session.memory(),
        ..Default::default()
    };
    let on = session.on(session.device.contour());
    let made = session.stage("surface", || {
        dual_contour::surface(&sampled.grid, Some(&field), &contour, on)
    })?;
    products::note_surface(session, &made.mesh)?;
    let parts = made.mesh.components();
    parts
        .into_iter()
        .next()
        .ok_or_else(|| "the surface has no triangles".into())
}

fn note(session: &Session, found: &Pockets) -> Result<(), Failure> {
    let pockets: Vec<_> = found
        .pockets
        .iter()
        .map(
            |p| json!({ "rank": p.rank, "score": p.score, "center": p.center, "volume": p.volume }),
        )
        .collect();
    let counts = json!({ "atoms": found.atoms, "pockets": pockets.len() });
    session.note("counts", counts)?;
    session.note(
        "pockets",
        json!({
            "atoms_counted": found.atoms,
            "which_atoms": "heavy atoms of polymers",
            "shell_points": found.shell_points,
            "candidates": found.candidates,
            "found": pockets,
        }),
    )
}

fn write_table(
    session: &Session,
    structure: &Structure,
    pockets: &[Pocket],
    outlines: &[Outline],
) -> Result<(), Failure> {
    io::save(session.output("pockets.csv")?, |w| {
        writeln!(
            w,
            "rank,score,center_x,center_y,center_z,volume,area,depth,mouth,mean_curvature,residues"
        )?;
        for (p, o) in pockets.iter().zip(outlines) {
            let c = p.center;
            let residues: Vec<String> = p
                .residues
                .iter()
                .map(|&r| residue_name(structure, r))
                .collect();
            writeln!(
                w,
                "{},{:.1},{:.3},{:.3},{:.3},{:.1},{:.1},{:.2},{:.1},{:.4},{}",
                p.rank,
                p.score,
                c.x,
                c.y,
                c.z,
                p.volume,
                o.area,
                o.depth,
                o.mouth,
                o.mean_curvature,
                residues.join(" ")
            )?;
        }
        Ok(())
    })?;
    Ok(())
}

/// Chain, name and number, as `A:ASP25`.
fn residue_name(structure: &Structure, residue: u32) -> String {
    let r = structure.residues()[residue as usize];
    let chain = structure.chain_starts().partition_point(|&s| s <= residue) - 1;
    let chain = structure.chains()[chain].name;
    format!("{chain}:{}{}{}", r.name, r.number, r.insertion)
}

fn write_points(session: &Session, pockets: &[Pocket]) -> Result<(), Failure> {
    io::save(session.output("pockets.pdb")?, |w| {
        writeln!(
            w,
            "REMARK   Points of pockets: chain P, residue number = rank, B factor = rank"
        )?;
        let points = pockets
            .iter()
            .flat_map(|p| p.points.iter().map(move |x| (p.rank, x)));
        for (serial, (rank, x)) in points.enumerate() {
            writeln!(
                w,
                "HETATM{:5}  C   PKT P{:4}    {:8.3}{:8.3}{:8.3}  1.00{:6.2}           C",
                (serial + 1) % 100_000,
                rank % 10_000,
                x.x,
                x.y,
                x.z,
                rank as f64
            )?;
        }
        Ok(writeln!(w, "END")?)
    })?;
    Ok(())
}

/// Best pockets are coloured last, so that they win where outlines overlap.
fn write_surface(
    session: &Session,
    surface: &TriMesh,
    outlines: &[Outline],
) -> Result<(), Failure> {
    const PLAIN: Rgb = [226, 222, 214];
    let mut colors = vec![PLAIN; surface.triangles().len()];
    for outline in outlines.iter().take(SHOWN).rev() {
        for &t in &outline.triangles {
            colors[t as usize] = segment_color(outline.rank as u32);
        }
    }
    let mut of_vertices = vec![PLAIN; surface.positions().len()];
    for (corners, &color) in surface.triangles().iter().zip(&colors) {
        if color != PLAIN {
            corners
                .iter()
                .for_each(|&v| of_vertices[v as usize] = color);
        }
    }
    let fields = Fields::from(surface).colored(products::rgba(&of_vertices))?;
    let legend = outlines.iter().take(SHOWN);
    let legend = legend.map(|o| (segment_color(o.rank as u32), format!("pocket {}", o.rank)));
    let coloring = Coloring {
        colors: of_vertices.clone(),
        scale: None,
        legend: legend.collect(),
    };
    session.show("pockets", surface, vec![("pockets".to_owned(), coloring)]);
    io::mesh::save(session.output("pockets.glb")?, &fields)?;
    session.picture("pockets", || {
        let mut layer = Layer::surface(surface, Paint::Faces(colors));
        layer.edges = false;
        let mut scene = Scene::new(vec![layer], view_into(surface, outlines));
        scene.caption = Some(format!(
            "{} pockets; the first {SHOWN} are coloured",
            outlines.len()
        ));
        Ok(scene.draw(session.rasterizer()?, products::SIZE)?)
    })
}

/// Pockets with a colour.
const SHOWN: usize = 5;

/// From the side to which the first pocket opens.
fn view_into(surface: &TriMesh, outlines: &[Outline]) -> View {
    let mut view = View::principal(surface.positions());
    let first = outlines.iter().find(|o| !o.triangles.is_empty());
    let normal = first.map(|o| {
        let sum: geom_core::Vector3 = o
            .triangles
            .iter()
            .map(|&t| surface.doubled_area_normal(t as usize))
            .sum();
        sum
    });
    if let Some(toward) = normal.and_then(|n| n.try_normalize(0.0)) {
        let up = (view.up - toward * view.up.dot(&toward)).try_normalize(1e-6);
        view.up = up.unwrap_or_else(|| toward.cross(&view.right).normalize());
        view.right = view.up.cross(&toward);
        view.toward = toward;
    }
    view
}
