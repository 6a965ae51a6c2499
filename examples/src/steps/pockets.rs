//! Pockets of a molecule: found, ranked and outlined.

use std::path::Path;

use gauss_density::{Levels, Model, PointSampler, sample_band};
use geom_core::io::{self, view::View as Fields};
use geom_core::structure::ResidueKind;
use geom_core::{Structure, TriMesh};
use secondfund_ops::PocketOptions;
use secondfund_ops::options::OutlineOptions;
use secondfund_ops::pockets::{Outline, Pocket, Pockets, find, outline};
use serde_json::json;

use crate::args::default_spacing;
use crate::picture::{Layer, Paint, Rgb, Scene, View, segment_color};
use crate::products::{self, Coloring};
use crate::{Failure, Session, scripts};

/// What is asked of the pockets.
pub struct Settings {
    /// Which points count, and how many pockets.
    pub pockets: PocketOptions,
    /// Decay of an atom's kernel, 1/Å²: of the surface on which they are outlined.
    pub decay: f64,
    /// Distance of the lattice points of that surface, Å; `None`: by the number of atoms.
    pub spacing: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            pockets: PocketOptions::default(),
            decay: 0.5,
            spacing: None,
        }
    }
}

/// Finds the pockets of a structure, outlines and writes them.
pub fn run(
    session: &Session,
    structure: &Structure,
    input: &Path,
    settings: &Settings,
) -> Result<(), Failure> {
    let found = session.stage("pockets", || find(structure, &settings.pockets))?;
    let surface = surface(session, structure, settings)?;
    let outlining = OutlineOptions {
        radius: settings.pockets.radius,
        ..OutlineOptions::default()
    };
    let on = session.on(session.device.operators());
    let outlines = session.stage("outlines", || {
        outline(&surface, structure, &found.pockets, &outlining, on)
    })?;
    note(session, &found)?;
    session.files(6, || {
        write_table(session, structure, &found.pockets, &outlines)?;
        write_points(session, &found.pockets)?;
        scripts::save(session, input, &["pockets"], &["pockets"])?;
        session.show_structure(input);
        write_surface(session, &surface, &outlines)
    })
}

/// The surface of the polymers alone, the part of the largest area.
fn surface(
    session: &Session,
    structure: &Structure,
    settings: &Settings,
) -> Result<TriMesh, Failure> {
    let polymer = structure.of_kind(ResidueKind::Polymer);
    let levels = Levels {
        decay: settings.decay,
        ..Levels::default()
    };
    let model = Model::uniform(&polymer, &levels)?;
    let options = gauss_density::Options {
        spacing: settings
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
