//! Eigenfunctions of a surface's Laplace operator.

use geom_core::TriMesh;
use geom_core::algebra::eigen::{EigenPairs, Options, eigenpairs};
use geom_core::compute::parallel;
use geom_core::io::{self, view::View as Fields};
use geom_core::surface::laplace;
use serde_json::json;

use crate::picture::{Curve, Image, Layer, Paint, Rgb, Scale, Scene, View, lines, sheet_of_modes};
use crate::products::{self, Coloring};
use crate::{Failure, Session};

/// What is asked of the modes.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How many eigenpairs.
    pub count: u32,
    /// Largest relative residual.
    pub tolerance: f64,
    /// Consistent instead of lumped mass.
    pub consistent: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            count: 12,
            tolerance: Options::default().tolerance,
            consistent: false,
        }
    }
}

/// Computes the first modes of a surface, notes the spectrum, and writes both.
pub fn run(session: &Session, mesh: &TriMesh, settings: &Settings) -> Result<(), Failure> {
    products::note_surface(session, mesh)?;
    let (vertices, count) = (mesh.positions().len(), settings.count);
    if count as usize > vertices {
        let message =
            format!("--count {count}: a surface of {vertices} vertices has {vertices} eigenpairs");
        return Err(message.into());
    }
    let pairs = session.stage("eigenpairs", || pairs_of(session, mesh, settings))?;
    session.note("eigenvalues", &pairs.values)?;
    session.note("residuals", &pairs.residuals)?;
    session.note("clusters", &pairs.clusters)?;
    session.note("spectral", &pairs.report)?;
    if !pairs.report.converged {
        let worst = pairs.residuals.iter().copied().fold(0.0, f64::max);
        session.warn(format!(
            "the eigenpairs have not reached --tolerance: the largest residual is {worst:.1e}"
        ))?;
    }
    session.files(4 + pairs.values.len() as u64, || {
        shape_dna(session, mesh, &pairs)?;
        // Coloured once, for files and for pictures.
        let colors = pairs.vectors.iter();
        let colors = colors.map(|mode| Scale::symmetric(mode, "").colors(mode));
        let colors: Vec<Vec<Rgb>> = colors.collect();
        fields(session, mesh, &pairs, &colors)?;
        let colorings = pairs.vectors.iter().zip(&pairs.values).zip(1..);
        let colorings = colorings.map(|((mode, value), number)| {
            let name = format!("mode {number}: λ = {}", products::brief(*value));
            (name, Coloring::of_values(mode, Scale::symmetric(mode, "")))
        });
        session.show("surface", mesh, colorings.take(SHOWN).collect());
        session.picture("modes", || sheet(session, mesh, &pairs, colors))?;
        session.picture("spectrum", || Ok(spectrum(mesh, &pairs)))
    })
}

fn pairs_of(session: &Session, mesh: &TriMesh, settings: &Settings) -> Result<EigenPairs, Failure> {
    let stiffness = laplace::stiffness(mesh)?;
    let mass = if settings.consistent {
        laplace::consistent_mass(mesh)?
    } else {
        laplace::lumped_mass(mesh)
    };
    let options = Options {
        tolerance: settings.tolerance,
        ..Options::default()
    };
    let on = session.on(session.device.spectral());
    let count = settings.count as usize;
    Ok(eigenpairs(&stiffness, &mass, count, &options, on)?)
}

/// The eigenvalues as they are, and made free of scale by the area.
fn shape_dna(session: &Session, mesh: &TriMesh, pairs: &EigenPairs) -> Result<(), Failure> {
    let area = mesh.area();
    let dna = json!({
        "eigenvalues": pairs.values,
        "area": area,
        "normalized": pairs.values.iter().map(|v| v * area).collect::<Vec<_>>(),
    });
    Ok(io::save(session.output("shape_dna.json")?, |w| {
        let text =
            serde_json::to_string_pretty(&dna).map_err(|e| io::ErrorKind::System(e.into()))?;
        Ok(writeln!(w, "{text}")?)
    })?)
}

/// All modes as fields of one file, and each as a coloured surface.
fn fields(
    session: &Session,
    mesh: &TriMesh,
    pairs: &EigenPairs,
    colors: &[Vec<Rgb>],
) -> Result<(), Failure> {
    let mut fields = Fields::from(mesh);
    for (mode, number) in pairs.vectors.iter().zip(1..) {
        fields = fields.point_field(&format!("mode_{number:02}"), mode)?;
    }
    io::mesh::save(session.output("modes.vtu")?, &fields)?;
    let saved = parallel::map(colors.len(), |i| {
        let colored = Fields::from(mesh).colored(products::rgba(&colors[i]))?;
        let path = session.output(format!("mode_{:02}.glb", i + 1))?;
        Ok(io::mesh::save(path, &colored)?)
    });
    saved.into_iter().collect()
}

/// The first modes side by side.
fn sheet(
    session: &Session,
    mesh: &TriMesh,
    pairs: &EigenPairs,
    colors: Vec<Vec<Rgb>>,
) -> Result<Image, Failure> {
    let view = View::principal(mesh.positions()).turned(0.25, 0.2);
    let mut layer = Layer::surface(mesh, Paint::Plain(products::GOLD));
    layer.edges = false;
    let shown: Vec<Paint> = colors
        .into_iter()
        .take(SHOWN)
        .map(Paint::Vertices)
        .collect();
    let images =
        Scene::new(vec![layer], view).draw_each(session.rasterizer()?, [420, 330], &shown)?;
    let title = |(i, value): (usize, &f64)| format!("{}: λ = {}", i + 1, products::brief(*value));
    let titles = pairs.values.iter().enumerate().map(title);
    Ok(sheet_of_modes(&titles.zip(images).collect::<Vec<_>>(), 4))
}

/// The eigenvalues by their numbers.
fn spectrum(mesh: &TriMesh, pairs: &EigenPairs) -> Image {
    let points = (1..).zip(&pairs.values).map(|(k, &v)| (f64::from(k), v));
    let curve = Curve {
        name: "",
        color: [52, 102, 178],
        points: points.collect(),
    };
    let vertices = products::grouped(mesh.positions().len());
    let title = format!("Spectrum: {vertices} vertices, area {:.1} Å²", mesh.area());
    let axes = ["number", "eigenvalue / Å⁻²"];
    lines(&[curve], &title, axes, [1100, 680])
}

/// Most modes on the contact sheet.
const SHOWN: usize = 16;
