//! Modes of operators of the second fundamental form on the Bézier elements of a spline surface.

use geom_core::TriMesh;
use geom_core::compute::parallel;
use secondfund_ops::{
    BezierElement, BezierSurface, Element, Operator, Spectrum, SpectrumOptions, spectrum,
};
use serde_json::json;
use tspline::Surface;
use tspline::files::Exchange;
use tspline::surface::tessellate::Tessellation;

use super::segments::contact_sheet;
use crate::picture::{Image, View};
use crate::{Failure, Session};

/// The modes at the vertices of a surface's triangles.
pub struct Modes {
    values: Vec<f64>,
    at_vertices: Vec<Vec<f64>>,
}

/// The first modes of an operator on a surface, at the vertices of its triangles; notes the eigenvalues.
pub fn find(
    session: &Session,
    surface: &Surface,
    triangles: &Tessellation,
    (operator, count): (Operator, usize),
) -> Result<Modes, Failure> {
    let Exchange { nodes, elements } = Exchange::from(surface);
    let elements = elements.into_iter().map(|e| BezierElement {
        nodes: e.nodes,
        rows: e.rows,
    });
    let elements = BezierSurface::new(&nodes, elements.collect())?;
    let options = SpectrumOptions {
        operator,
        modes: count,
        ..SpectrumOptions::default()
    };
    let on = session.on(session.device.operators());
    let found = session.stage("modes", || {
        spectrum(&Element::Bezier(&elements), &options, on)
    })?;
    session.note(
        "modes",
        json!({ "values": found.values, "scale": found.scale, "skipped": found.skipped }),
    )?;
    Ok(Modes {
        at_vertices: at_vertices(&elements, triangles, &found),
        values: found.values,
    })
}

fn at_vertices(
    elements: &BezierSurface,
    triangles: &Tessellation,
    found: &Spectrum,
) -> Vec<Vec<f64>> {
    // Any triangle's place of a vertex: functions are continuous.
    let mut places = vec![None; triangles.mesh.positions().len()];
    let corners = triangles.mesh.triangles().iter().zip(&triangles.parameters);
    for ((corners, at), &patch) in corners.zip(&triangles.patches) {
        for (&v, &uv) in corners.iter().zip(at) {
            places[v as usize] = Some((patch as usize, uv));
        }
    }
    let value = |mode: &Vec<f64>, place: &Option<(usize, [f64; 2])>| {
        place.map_or(0.0, |(patch, uv)| elements.value(patch, uv, mode))
    };
    let of_mode = |mode: &Vec<f64>| places.iter().map(|place| value(mode, place)).collect();
    parallel::map_each(&found.modes, of_mode)
}

/// The contact sheet.
pub fn picture(session: &Session, mesh: &TriMesh, modes: &Modes) -> Result<Image, Failure> {
    let view = View::principal(mesh.positions()).turned(0.25, 0.2);
    contact_sheet(session, mesh, view, &modes.values, &modes.at_vertices)
}
