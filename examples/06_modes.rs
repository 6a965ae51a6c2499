//! 06 — Eigenfunctions of a surface's Laplace operator, and its shape-DNA.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::picture::{Curve, Layer, Paint, Scale, Scene, View, lines, sheet};
use biogeom_examples::source::SourceArgs;
use biogeom_examples::{Failure, Session, products, surface};
use clap::Parser;
use geom_core::algebra::eigen::{Options, eigenpairs};
use geom_core::io::{self, view::View as Fields};
use geom_core::surface::laplace;
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

    session.stage("files and pictures", || {
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

        let view = View::principal(mesh.positions()).turned(0.25, 0.2);
        let mut pictures = Vec::new();
        let mut fields = Fields::from(&mesh);
        for (i, (value, mode)) in pairs.values.iter().zip(&pairs.vectors).enumerate() {
            let number = i + 1;
            let colors = Scale::symmetric(mode, "").colors(mode);
            let colored = Fields::from(&mesh).colored(products::rgba(&colors))?;
            io::mesh::save(session.output(format!("mode_{number:02}.glb"))?, &colored)?;
            fields = fields.point_field(&format!("mode_{number:02}"), mode)?;
            if pictures.len() < SHOWN {
                let mut layer = Layer::surface(&mesh, Paint::Vertices(colors));
                layer.edges = false;
                let image =
                    Scene::new(vec![layer], view).draw(session.rasterizer()?, [420, 330])?;
                pictures.push((format!("{number}: λ = {}", products::brief(*value)), image));
            }
        }
        io::mesh::save(session.output("modes.vtu")?, &fields)?;
        sheet(&pictures, 4).save(session.output("modes.png")?)?;
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
        lines(
            &[curve],
            &title,
            ["number", "eigenvalue / Å⁻²"],
            [1100, 680],
        )
        .save(session.output("spectrum.png")?)?;
        Ok::<_, Failure>(())
    })
}

/// Most modes on the contact sheet.
const SHOWN: usize = 16;
