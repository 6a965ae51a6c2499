//! A spline surface: its files and its picture.

use std::io::{BufWriter, Write};

use clap::ValueEnum;
use geom_core::io::{self, view::View as Fields};
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, TriMesh, Vector3};
use serde::Serialize;
use serde_json::json;
use tspline::files::{Exchange, bext, iga, step, vtu};
use tspline::surface::Jet;
use tspline::surface::adapt::{Adapted, adapt};
use tspline::surface::fit::FitOptions;
use tspline::surface::seams::Seams;
use tspline::surface::tessellate::{Tessellation, tessellate};
use tspline::{Basis, Error, Surface, TMesh, VertexKind};

use crate::input::tmesh::{Input, affordable, note_counts};
use crate::picture::{ColorMap, Image, Layer, Paint, Scale, Scene, View};
use crate::{Failure, Session, crosses, products};

/// Kinds of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Product {
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

/// Fits a surface to what a T-mesh was made of: with this basis, cutting elements until the tolerance is reached if there is
/// one, and with so many triangles along each side of a patch. Notes what it is.
pub fn fit(
    session: &Session,
    mesh: TMesh,
    input: &Input,
    (basis, tolerance, steps): (Basis, Option<f64>, u32),
    options: &FitOptions,
) -> Result<(Adapted, Tessellation), Failure> {
    // Samples of a patch, its place in the least squares, and their factor.
    const BYTES: f64 = 16384.0;
    affordable(mesh.elements().len(), BYTES, session)?;
    let on = session.on(session.device.spline());
    let allowed = tolerance.unwrap_or(f64::INFINITY);
    let adapted = session.stage("surface", || {
        let target = &input.surface;
        if basis != Basis::Suitable {
            return Ok(adapt(mesh, basis, target, allowed, options, on)?);
        }
        match adapt(mesh.clone(), basis, target, allowed, options, on) {
            Err(because @ (Error::NotSuitable { .. } | Error::Open { .. })) => {
                let warning = format!("the basis is hierarchical: {because}");
                session.warn(warning)?;
                Ok(adapt(
                    mesh,
                    Basis::Hierarchical,
                    target,
                    allowed,
                    options,
                    on,
                )?)
            }
            made => Ok::<_, Failure>(made?),
        }
    })?;
    session.note("basis", adapted.surface.basis())?;
    note(session, &adapted, tolerance.is_some())?;
    let triangles = session.stage("triangles", || tessellate(&adapted.surface, steps, on))?;
    Ok((adapted, triangles))
}

/// Notes counts and errors; if a tolerance was asked for, whether it is reached.
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

/// Writes a text.
pub fn write(
    session: &Session,
    name: &str,
    text: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), Failure> {
    let mut out = BufWriter::new(std::fs::File::create(session.output(name)?)?);
    text(&mut out)?;
    Ok(out.flush()?)
}

/// Writes a file of this kind.
pub fn save(
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
pub fn picture(
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
    scene.draw(session.rasterizer()?, products::SIZE)
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
