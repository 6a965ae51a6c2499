//! 11 — A spline surface on a T-mesh, for CAD and for analysis.

use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::tmesh::{Input, TMeshArgs, affordable, note_counts};
use biogeom_examples::picture::{ColorMap, Image, Layer, Paint, Scale, Scene, View};
use biogeom_examples::{Failure, Session, crosses, products};
use clap::{Parser, ValueEnum};
use geom_core::io::{self, view::View as Fields};
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, TriMesh, Vector3};
use serde::Serialize;
use serde_json::json;
use tspline::files::{Exchange, bext, iga, market, npz, step, vtu};
use tspline::surface::Jet;
use tspline::surface::adapt::{Adapted, adapt};
use tspline::surface::fit::FitOptions;
use tspline::surface::seams::Seams;
use tspline::surface::tessellate::{Tessellation, tessellate};
use tspline::{Basis, Surface, VertexKind, analysis};

/// A spline surface: of a mesh, or of a structure's or grid's surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    mesh: TMeshArgs,
    /// Which functions carry the surface
    #[arg(long, value_enum, default_value_t)]
    basis: BasisName,
    /// Cut elements that are farther from the surface than this, Å, as long as they are not of the finest level
    #[arg(long, value_name = "DISTANCE")]
    tolerance: Option<f64>,
    /// How much bending counts beside distance
    #[arg(long, value_name = "SHARE", default_value_t = FitOptions::default().smoothing)]
    smoothing: f64,
    /// Rounds of nearest points and least squares
    #[arg(long, value_name = "N", default_value_t = FitOptions::default().rounds)]
    rounds: u32,
    /// Triangles along each side of a patch in the pictures and triangle meshes
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(2..=64))]
    steps: u32,
    /// Eigenvalues of the Laplace–Beltrami operator on the surface to compute; writes its matrices
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=200))]
    eigenvalues: Option<u32>,
    /// What to write
    #[arg(long, value_name = "FILES", value_enum, value_delimiter = ',', default_values_t = [Product::Vtu, Product::Step, Product::Glb])]
    files: Vec<Product>,
    #[command(flatten)]
    common: Common,
}

/// Names of [`Basis`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum BasisName {
    /// Truncated hierarchical functions
    #[default]
    Hierarchical,
    /// Rational T-splines by local knots (the thesis's)
    Rational,
}

/// Kinds of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Product {
    /// Bézier cells for ParaView, with the error of each element and the input's labels or scalar fields
    Vtu,
    /// B-spline faces for CAD; a millimetre stands for an Å
    Step,
    /// Triangles coloured by distance
    Glb,
    /// Triangles
    Obj,
    /// Bézier extraction for isogeometric solvers
    Bext,
    /// The same, as tIGAr reads it
    Iga,
    /// The same, without loss, for programs of your own
    Json,
}

const EXAMPLES: &str = "\
Examples:
  11_tspline spot.ply --quads 4000 --out out
  11_tspline 1ajj.pdb --spacing 1 --levels curvature --tolerance 0.1 --out protein
  11_tspline quads.obj --basis rational --files step,bext,json --eigenvalues 10 --out out

Outputs: surface.vtu, surface.step, surface.glb and others as --files says; surface.png (distance from the input, sides
of elements, T-junctions, extraordinary vertices),
stiffness and mass as .mtx (Matrix Market) and .npz (SciPy) with --eigenvalues; report.json with `counts`, `error` (`rms`, `hausdorff`, Å), `rounds`,
`independence` and `eigenvalues` (Å⁻²).";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.mesh.input()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("11_tspline", spline)
}

fn spline(args: &Args, session: &Session) -> Result<(), Failure> {
    let options = FitOptions {
        rounds: args.rounds,
        smoothing: args.smoothing,
        ..FitOptions::default()
    };
    options.check()?;
    if args.tolerance.is_some_and(|t| t.is_nan() || t <= 0.0) {
        return Err("--tolerance must be positive, Å".into());
    }
    let made = args.mesh.make(session)?;
    if made.mesh.elements().iter().all(|e| e.level == 0) {
        let because = "cuts elements of higher levels, and there are none; see --levels";
        session.refuse(&["tolerance"], because)?;
    }
    // Samples of a patch, its place in the least squares, and their factor.
    const BYTES: f64 = 16384.0;
    affordable(made.mesh.elements().len(), BYTES, session)?;
    let basis = match args.basis {
        BasisName::Hierarchical => Basis::Hierarchical,
        BasisName::Rational => Basis::Rational,
    };
    let on = session.on(session.device.spline());
    let target = &made.input.surface;
    let tolerance = args.tolerance.unwrap_or(f64::INFINITY);
    let adapted = session.stage("surface", || {
        adapt(made.mesh, basis, target, tolerance, &options, on)
    })?;
    note(session, &adapted, args.tolerance.is_some())?;
    let surface = &adapted.surface;
    let triangles = session.stage("triangles", || tessellate(surface, args.steps, on))?;
    let matrices = match args.eigenvalues {
        None => None,
        Some(count) => Some(spectrum(session, surface, count as usize)?),
    };
    let count = args.files.len() as u64 + 1 + 4 * u64::from(matrices.is_some());
    session.files(count, || {
        for &file in &args.files {
            save(session, file, &adapted, &triangles, &made.input)?;
        }
        if let Some(matrices) = &matrices {
            for (name, matrix) in [("stiffness", &matrices.stiffness), ("mass", &matrices.mass)] {
                write(session, &format!("{name}.mtx"), |out| {
                    market::write_symmetric(out, matrix)
                })?;
                write(session, &format!("{name}.npz"), |out| {
                    npz::write(out, matrix)
                })?;
            }
        }
        session.picture("surface", || picture(session, &adapted, &triangles, target))
    })
}

fn note(session: &Session, adapted: &Adapted, asked: bool) -> Result<(), Failure> {
    let surface = &adapted.surface;
    note_counts(session, surface.mesh())?;
    let counts = json!({
        "functions": surface.controls().len(),
        "patches": surface.patches().len(),
    });
    session.note("counts", counts)?;
    session.note("error", adapted.errors)?;
    session.note("fit", &adapted.fit)?;
    if asked {
        session.note("rounds", &adapted.rounds)?;
        session.note("reached", adapted.reached)?;
    }
    Ok(())
}

fn spectrum(
    session: &Session,
    surface: &Surface,
    count: usize,
) -> Result<analysis::Matrices, Failure> {
    let matrices = session.stage("matrices", || analysis::matrices(surface))?;
    let spectral = session.on(session.device.spectral());
    let pairs = session.stage("eigenvalues", || {
        analysis::eigenpairs(&matrices, count, spectral)
    })?;
    session.note("eigenvalues", &pairs.values)?;
    session.note("independence", analysis::independence(&matrices, spectral)?)?;
    Ok(matrices)
}

/// Writes a text.
fn write(
    session: &Session,
    name: &str,
    text: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), Failure> {
    let mut out = BufWriter::new(std::fs::File::create(session.output(name)?)?);
    text(&mut out)?;
    Ok(out.flush()?)
}

fn save(
    session: &Session,
    file: Product,
    adapted: &Adapted,
    triangles: &Tessellation,
    input: &Input,
) -> Result<(), Failure> {
    let surface = &adapted.surface;
    match file {
        Product::Vtu => {
            let carried = input.carried(surface.mesh())?;
            let mut fields = vec![("distance", &adapted.of_elements[..])];
            fields.extend(
                carried
                    .iter()
                    .map(|(name, values)| (&name[..], &values[..])),
            );
            write(session, "surface.vtu", |out| {
                vtu::write(out, surface, &fields)
            })
        }
        Product::Step => write(session, "surface.step", |out| {
            step::write(out, surface, "surface")
        }),
        Product::Bext => write(session, "surface.bext", |out| {
            bext::write(out, &Exchange::from(surface))
        }),
        Product::Iga => write(session, "surface.iga", |out| {
            iga::write(out, &Exchange::from(surface))
        }),
        Product::Json => write(session, "surface.json", |out| {
            let all = json!({ "format": "tspline-bext/1", "degree": 3, "basis": surface.basis(),
                "surface": Exchange::from(surface), "patches": surface.extraction().patches() });
            serde_json::to_writer(out, &all).map_err(Into::into)
        }),
        Product::Obj => {
            let view = Fields::from(&triangles.mesh);
            Ok(io::mesh::save(session.output("surface.obj")?, &view)?)
        }
        Product::Glb => {
            let (values, scale) = distances(triangles, &input.surface)?;
            let colors = products::rgba(&scale.colors(&values));
            let view = Fields::from(&triangles.mesh).colored(colors)?;
            Ok(io::mesh::save(session.output("surface.glb")?, &view)?)
        }
    }
}

/// How far the vertices are from the target, and their colours.
fn distances(triangles: &Tessellation, target: &TriMesh) -> Result<(Vec<f64>, Scale), Failure> {
    let tree = TriangleTree::new(target)?;
    let nearest = tree.closest_to_all(triangles.mesh.positions())?;
    let values: Vec<f64> = nearest.iter().map(|c| c.distance).collect();
    let mut sorted = values.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let most = sorted[sorted.len() * 99 / 100].max(1e-12);
    Ok((
        values,
        Scale::new(ColorMap::Viridis, [0.0, most], "distance, Å"),
    ))
}

/// The surface coloured by distance, with sides of elements, T-junctions and extraordinary vertices.
fn picture(
    session: &Session,
    adapted: &Adapted,
    triangles: &Tessellation,
    target: &TriMesh,
) -> Result<Image, Failure> {
    let surface = &adapted.surface;
    let (values, scale) = distances(triangles, target)?;
    let mut body = Layer::surface(&triangles.mesh, Paint::Vertices(scale.colors(&values)));
    (body.normals, body.edges) = (Some(triangles.normals.clone()), false);
    let mesh = surface.mesh();
    let seams = Seams::of(surface);
    let radius = 0.15 * (triangles.mesh.area() / mesh.elements().len().max(1) as f64).sqrt();
    let positions = seams.positions(surface);
    let marks = |wanted: &dyn Fn(VertexKind) -> Option<bool>| -> Vec<(Point3, bool)> {
        let of = seams.corners.iter().zip(&positions);
        of.filter_map(|(&fine, &at)| {
            Some((at, wanted(mesh.kind(mesh.vertex_of_fine(fine)? as usize))?))
        })
        .collect()
    };
    let irregular = marks(&|kind| match kind {
        VertexKind::Extraordinary(n) => Some(n < 4),
        _ => None,
    });
    let junctions = marks(&|kind| (kind == VertexKind::TJunction).then_some(true));
    let mut layers = vec![body, borders(surface, &seams, 0.3 * radius)];
    layers.extend(crosses::balls(irregular.into_iter(), radius));
    let [mut small, mut dots] = crosses::balls(junctions.into_iter(), 0.6 * radius);
    (small.paint, dots.paint) = (Paint::Plain([255; 3]), Paint::Plain([255; 3]));
    layers.extend([small, dots]);
    let view = View::principal(triangles.mesh.positions()).turned(0.25, 0.2);
    let mut scene = Scene::new(layers, view);
    scene.scale = Some(scale);
    scene.caption = Some(format!(
        "{} patches, {} functions, {} T-junctions · rms {} Å, Hausdorff {} Å",
        products::grouped(surface.patches().len()),
        products::grouped(surface.controls().len()),
        products::grouped(mesh.audit().t_junctions),
        products::brief(adapted.errors.rms),
        products::brief(adapted.errors.hausdorff)
    ));
    session.show_scene("surface", &scene);
    Ok(scene.draw(session.rasterizer()?, products::SIZE)?)
}

/// The curves where patches meet.
fn borders(surface: &Surface, seams: &Seams, width: f64) -> Layer {
    const PIECES: usize = 6;
    let strips = seams.segments.iter().flat_map(|segment| {
        let points = &surface.patches()[segment.owner.patch as usize];
        let at = |i: usize| {
            let jet = Jet::of(points, segment.owner.at(i as f64 / PIECES as f64));
            (jet.point, jet.normal().unwrap_or_else(Vector3::z))
        };
        (0..PIECES).map(move |i| {
            let ((p, n), (q, m)) = (at(i), at(i + 1));
            ([p, q], n + m)
        })
    });
    crosses::strips(strips, width)
}
