//! 06 — Eigenfunctions of a surface's Laplace operator, and its shape-DNA.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::source::SourceArgs;
use biogeom_examples::input::surface;
use biogeom_examples::picture::{Curve, Layer, Paint, Scale, Scene, View, lines, sheet_of_modes};
use biogeom_examples::products::Coloring;
use biogeom_examples::{Failure, Session, products};
use clap::Parser;
use geom_core::algebra::eigen::{Options, eigenpairs};
use geom_core::io::{self, view::View as Fields};
use geom_core::surface::laplace;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;

/// The first eigenfunctions of a surface: of a mesh, or of a structure's or grid's surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// How many eigenpairs
    #[arg(long, short = 'k', value_name = "K", default_value_t = 12, value_parser = clap::value_parser!(u32).range(1..=300))]
    count: u32,
    /// Largest relative residual
    #[arg(long, value_name = "R", default_value_t = Options::default().tolerance)]
    tolerance: f64,
    /// Consistent instead of lumped mass
    #[arg(long)]
    consistent: bool,
    /// Keep all components of the surface, cavities too, each of which has a constant mode of its own;
    /// else the one of the largest area
    #[arg(long)]
    all_components: bool,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  06_modes spot.ply --count 20 --out out
  06_modes 1ajj.pdb --spacing 1 --out protein
  06_modes 1ajj.pdb --spacing 1 --all-components --out everything

Meshes are PLY, OFF, OBJ, STL, GLB, VTU or MSH. Outputs: modes.png (contact sheet), mode_01.glb … (coloured),
modes.vtu (all modes as point fields), spectrum.png, shape_dna.json (eigenvalues as they are, and made
free of scale by the area), report.json with `eigenvalues`.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("06_modes", modes)
}

fn modes(args: &Args, session: &Session) -> Result<(), Failure> {
    let whole = surface::read(&args.source, session)?;
    let mut components = whole.components();
    session.note("components", components.len())?;
    let mesh = if args.all_components || components.is_empty() {
        whole
    } else {
        components.swap_remove(0)
    };
    products::note_surface(session, &mesh)?;
    let vertices = mesh.positions().len();
    if args.count as usize > vertices {
        let count = args.count;
        return Err(format!(
            "--count {count}: a surface of {vertices} vertices has {vertices} eigenpairs"
        )
        .into());
    }
    let pairs = session.stage("eigenpairs", || {
        let stiffness = laplace::stiffness(&mesh)?;
        let mass = if args.consistent {
            laplace::consistent_mass(&mesh)?
        } else {
            laplace::lumped_mass(&mesh)
        };
        let options = Options {
            tolerance: args.tolerance,
            ..Options::default()
        };
        let on = session.on(session.device.spectral());
        Ok::<_, Failure>(eigenpairs(
            &stiffness,
            &mass,
            args.count as usize,
            &options,
            on,
        )?)
    })?;
    session.note("eigenvalues", &pairs.values)?;
    session.note("residuals", &pairs.residuals)?;
    session.note("clusters", &pairs.clusters)?;
    session.note("spectral", &pairs.report)?;

    session.files(4 + pairs.values.len() as u64, || {
        let area = mesh.area();
        let dna = json!({
            "eigenvalues": pairs.values,
            "area": area,
            "normalized": pairs.values.iter().map(|v| v * area).collect::<Vec<_>>(),
        });
        io::save(session.output("shape_dna.json")?, |w| {
            let text =
                serde_json::to_string_pretty(&dna).map_err(|e| io::ErrorKind::System(e.into()))?;
            Ok(writeln!(w, "{text}")?)
        })?;

        let paints: Vec<Paint> = pairs
            .vectors
            .iter()
            .map(|mode| Paint::Vertices(Scale::symmetric(mode, "").colors(mode)))
            .collect();
        let mut fields = Fields::from(&mesh);
        for (mode, number) in pairs.vectors.iter().zip(1..) {
            fields = fields.point_field(&format!("mode_{number:02}"), mode)?;
        }
        io::mesh::save(session.output("modes.vtu")?, &fields)?;
        paints.par_iter().enumerate().try_for_each(|(i, paint)| {
            let Paint::Vertices(colors) = paint else {
                unreachable!("made above")
            };
            let colored = Fields::from(&mesh).colored(products::rgba(colors))?;
            let path = session.output(format!("mode_{:02}.glb", i + 1))?;
            Ok::<_, Failure>(io::mesh::save(path, &colored)?)
        })?;
        let colorings = pairs.vectors.iter().zip(&pairs.values).zip(1..);
        let colorings = colorings.map(|((mode, value), number)| {
            let name = format!("mode {number}: λ = {}", products::brief(*value));
            (name, Coloring::of_values(mode, Scale::symmetric(mode, "")))
        });
        session.show("surface", &mesh, colorings.take(SHOWN).collect());
        session.picture("modes", || {
            let view = View::principal(mesh.positions()).turned(0.25, 0.2);
            let mut layer = Layer::surface(&mesh, Paint::Plain(products::GOLD));
            layer.edges = false;
            let shown = &paints[..paints.len().min(SHOWN)];
            let images = Scene::new(vec![layer], view).draw_each(
                session.rasterizer()?,
                [420, 330],
                shown,
            )?;
            let title =
                |(i, value): (usize, &f64)| format!("{}: λ = {}", i + 1, products::brief(*value));
            let titles = pairs.values.iter().enumerate().map(title);
            Ok(sheet_of_modes(&titles.zip(images).collect::<Vec<_>>(), 4))
        })?;
        let points = (1..)
            .zip(&pairs.values)
            .map(|(k, &v)| (f64::from(k), v))
            .collect();
        let curve = Curve {
            name: "",
            color: [52, 102, 178],
            points,
        };
        let title = format!(
            "Spectrum: {} vertices, area {area:.1} Å²",
            products::grouped(mesh.positions().len())
        );
        session.picture("spectrum", || {
            let axes = ["number", "eigenvalue / Å⁻²"];
            Ok(lines(&[curve], &title, axes, [1100, 680]))
        })
    })
}

/// Most modes on the contact sheet.
const SHOWN: usize = 16;
