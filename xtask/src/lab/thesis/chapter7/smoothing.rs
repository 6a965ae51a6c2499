//! Flows and filters of normals on shaken bodies: how much of the noise of normals is left, and how far creases move.

use geom_core::mesh::shapes;
use geom_core::{Cpu, Run, TriMesh};
use secondfund_ops::flow::{Smoothed, filter_normals, filter_quad_normals};
use secondfund_ops::options::FlowOperator;
use secondfund_ops::testing::{box_errors, rounded_box, shaken, shaken_quads};
use secondfund_ops::{FilterOptions, FlowOptions, NormalFilter, smooth, smooth_quads};

use super::text;
use crate::Outcome;

#[derive(Clone, Copy)]
enum Method {
    /// Steps, and the share of the sharpening part.
    Flow(FlowOperator, usize, f64),
    Filter(NormalFilter),
}

/// Ten steps of the flows, which remove noise, and fifty, which round or sharpen.
const METHODS: [(&str, Method); 8] = [
    ("GGHO, 10 steps", Method::Flow(FlowOperator::Ggho, 10, 0.5)),
    ("GGHO, 50 steps", Method::Flow(FlowOperator::Ggho, 50, 0.5)),
    (
        "GGHO, no sharpening, 10",
        Method::Flow(FlowOperator::Ggho, 10, 0.0),
    ),
    (
        "GGHO, no sharpening, 50",
        Method::Flow(FlowOperator::Ggho, 50, 0.0),
    ),
    (
        "mean curvature, 10",
        Method::Flow(FlowOperator::Lbo, 10, 0.0),
    ),
    (
        "mean curvature, 50",
        Method::Flow(FlowOperator::Lbo, 50, 0.0),
    ),
    ("bilateral", Method::Filter(NormalFilter::BILATERAL)),
    (
        "total variation",
        Method::Filter(NormalFilter::TOTAL_VARIATION),
    ),
];
const HALF: [f64; 3] = [1.0, 0.8, 0.6];

fn flow(operator: FlowOperator, iterations: usize, sharpen: f64) -> FlowOptions {
    FlowOptions {
        operator,
        iterations,
        sharpen,
        ..FlowOptions::default()
    }
}

fn filtering(filter: NormalFilter) -> FilterOptions {
    FilterOptions {
        filter,
        ..FilterOptions::default()
    }
}

impl Method {
    fn triangles(self, mesh: &TriMesh) -> Result<TriMesh, String> {
        let done: Result<Smoothed<TriMesh>, _> = match self {
            Self::Flow(operator, n, s) => smooth(mesh, 1, &flow(operator, n, s), Run::on(&Cpu)),
            Self::Filter(filter) => filter_normals(mesh, &filtering(filter), Run::on(&Cpu)),
        };
        Ok(done.map_err(text)?.mesh)
    }

    /// The quads cut along their first diagonals.
    fn quads(self, mesh: &geom_core::QuadMesh) -> Result<TriMesh, String> {
        let done = match self {
            Self::Flow(operator, n, s) => smooth_quads(mesh, &flow(operator, n, s), Run::on(&Cpu)),
            Self::Filter(filter) => filter_quad_normals(mesh, &filtering(filter), Run::on(&Cpu)),
        };
        Ok(done.map_err(text)?.mesh.into_triangles())
    }
}

/// Root mean square of the angles between the normals of two meshes of the same triangles, degrees.
fn turned(clean: &TriMesh, now: &TriMesh) -> f64 {
    let count = clean.triangles().len();
    let angle = |t: usize| {
        clean
            .doubled_area_normal(t)
            .angle(&now.doubled_area_normal(t))
    };
    let squares: f64 = (0..count).map(|t| angle(t).powi(2)).sum();
    (squares / count as f64).sqrt().to_degrees()
}

/// A body, its noise, and what each method leaves of it.
struct Body {
    name: &'static str,
    measure: fn(&TriMesh, &TriMesh) -> String,
    clean: TriMesh,
    noisy: TriMesh,
    after: Vec<TriMesh>,
}

fn boxes(
    name: &'static str,
    radius: f64,
    measure: fn(&TriMesh, &TriMesh) -> String,
) -> Result<[Body; 2], String> {
    let quads = rounded_box(HALF, radius, 20);
    let clean = quads.clone().into_triangles();
    let noisy = shaken(&clean, NOISE, 9);
    let shaken = shaken_quads(&quads, NOISE, 9);
    let each = |f: &dyn Fn(Method) -> Result<TriMesh, String>| {
        METHODS
            .iter()
            .map(|m| f(m.1))
            .collect::<Result<Vec<_>, _>>()
    };
    let triangles = each(&|m| m.triangles(&noisy))?;
    let of_quads = each(&|m| m.quads(&shaken))?;
    let body = |after, noisy| Body {
        name,
        measure,
        clean: clean.clone(),
        noisy,
        after,
    };
    Ok([
        body(triangles, noisy),
        body(of_quads, shaken.into_triangles()),
    ])
}

/// Largest displacement along each axis: a twentieth of an edge of the boxes.
const NOISE: f64 = 0.004;

/// Prints the table.
pub(super) fn run() -> Outcome {
    println!(
        "Smoothing: noise of flat normals in degrees, and distance of creases in mean edges; of the torus, of all normals"
    );
    let sharp = |clean: &TriMesh, now: &TriMesh| cells(clean, now, 0.05);
    let round = |clean: &TriMesh, now: &TriMesh| cells(clean, now, 0.08);
    let [sharp, sharp_quads] = boxes("sharp box", 1e-3, sharp)?;
    let [round, round_quads] = boxes("rounded box", 0.08, round)?;
    let clean = shapes::torus(1.0, 0.4, 64, 32);
    let noisy = shaken(&clean, NOISE, 9);
    let after = METHODS.iter().map(|m| m.1.triangles(&noisy));
    let torus = Body {
        name: "torus",
        measure: |clean, now| format!("{:>13.2}", turned(clean, now)),
        after: after.collect::<Result<_, _>>()?,
        clean,
        noisy,
    };
    let bodies = [sharp, sharp_quads, round, round_quads, torus];
    let kinds = ["triangles", "quads", "triangles", "quads", "triangles"];
    let heads: Vec<String> = bodies.iter().map(|b| format!("{:>13}", b.name)).collect();
    println!("{:24} {}", "", heads.join(" "));
    println!("{:24} {}", "", kinds.map(|k| format!("{k:>13}")).join(" "));
    let row = |mesh: &dyn Fn(&Body) -> String| -> String {
        bodies.iter().map(mesh).collect::<Vec<_>>().join(" ")
    };
    println!(
        "{:24} {}",
        "shaken",
        row(&|b| (b.measure)(&b.clean, &b.noisy))
    );
    for (i, (name, _)) in METHODS.iter().enumerate() {
        println!("{name:24} {}", row(&|b| (b.measure)(&b.clean, &b.after[i])));
    }
    Ok(())
}

fn cells(clean: &TriMesh, now: &TriMesh, radius: f64) -> String {
    let errors = box_errors(clean, now, HALF, radius);
    format!("{:6.2} {:6.3}", errors.flat, errors.crease)
}
