//! Quads of a surface.

use crossfield::quads::quality::{aspect_ratio, distances};
use crossfield::{Ladder, Options, Quadrangulation, Size, quadrangulate};
use geom_core::io::{self, view::View as Fields};
use geom_core::mesh::Halfedges;
use geom_core::{TriMesh, VertexId};
use serde::Serialize;
use serde_json::json;

use crate::picture::{ColorMap, Image, Layer, Paint, Scale, Scene, View};
use crate::{Failure, Session, crosses, products};

/// How many quads, and how they are made.
#[derive(clap::Args, Serialize)]
pub struct QuadArgs {
    /// How many quads [default: a third of the triangles]
    #[arg(long, value_name = "N", conflicts_with = "side", value_parser = clap::value_parser!(u32).range(1..))]
    quads: Option<u32>,
    /// Side of a quad, the longer one, Å, instead
    #[arg(long, value_name = "H")]
    side: Option<f64>,
    /// Keep edges whose triangles' normals differ by more than this, degrees
    #[arg(long, value_name = "DEGREES")]
    crease: Option<f64>,
    /// Bumps smaller than this many sides of a quad get no irregular vertices of their own
    #[arg(long, value_name = "SIDES", default_value_t = Options::default().smoothing)]
    smoothing: f64,
    /// Stop at the first failure instead of trying other fields and sizes
    #[arg(long)]
    no_fallback: bool,
    /// Leave the vertices where the map puts them
    #[arg(long)]
    raw: bool,
}

impl QuadArgs {
    /// These options, the others as they are by default.
    pub fn options(&self) -> Options {
        Options {
            size: match (self.quads, self.side) {
                (Some(n), _) => Size::Quads(n as usize),
                (None, Some(h)) => Size::Spacing(h),
                (None, None) => Size::Triangles,
            },
            crease: self.crease,
            smoothing: self.smoothing,
            ladder: if self.no_fallback {
                Ladder::Off
            } else {
                Ladder::Full
            },
            improve: !self.raw,
            ..Options::default()
        }
    }
}

/// Makes the quads, notes what they are, and writes them.
pub fn run(session: &Session, mesh: &TriMesh, options: &Options) -> Result<(), Failure> {
    let made = make(session, mesh, options)?;
    session.files(4, || save(session, &made, &[]))
}

/// Makes the quads and notes what they are.
pub fn make(
    session: &Session,
    mesh: &TriMesh,
    options: &Options,
) -> Result<Quadrangulation, Failure> {
    affordable(options, mesh, session)?;
    let options = &Options {
        max_memory: session.memory(),
        ..options.clone()
    };
    let on = session.on(session.device.crossfield());
    let made = session.stage("quads", || quadrangulate(mesh, options, on))?;
    note(session, mesh, &made)?;
    Ok(made)
}

/// Refuses more quads than there is memory for, before anything is made of them.
fn affordable(options: &Options, mesh: &TriMesh, session: &Session) -> Result<(), Failure> {
    let needed = options.bytes(mesh.area(), mesh.triangles().len());
    let allowed = session.memory();
    if needed > allowed as f64 {
        let gigabytes = |bytes: f64| bytes / 1e9;
        return Err(format!(
            "the quads need about {:.1} GB, more than the {:.1} GB of --max-memory",
            gigabytes(needed),
            gigabytes(allowed as f64)
        )
        .into());
    }
    Ok(())
}

fn note(session: &Session, mesh: &TriMesh, made: &Quadrangulation) -> Result<(), Failure> {
    let report = &made.report;
    crosses::warn(session, report)?;
    let counts = json!({
        "quads": made.mesh.quads().len(),
        "vertices": made.mesh.positions().len(),
        "irregular": report.valences.irregular(),
    });
    session.note("counts", counts)?;
    let fields = report.parts.iter().filter_map(|p| p.field.as_ref());
    session.note(
        "singularities",
        fields.clone().map(|f| f.singularities).sum::<usize>(),
    )?;
    session.note("energy", fields.map(|f| f.energy).sum::<f64>())?;
    session.note("scaled_jacobian", report.scaled_jacobian)?;
    session.note("aspect_ratio", report.aspect_ratio)?;
    session.note("hausdorff", distances(&made.mesh, mesh)?)?;
    session.note("rung", report.rung())?;
    session.note("valences", &report.valences)?;
    session.note("repaired", report.repaired)?;
    session.note("parts", &report.parts)
}

/// Writes the quads and their picture; into `quads.vtu` also more values per quad.
pub fn save(
    session: &Session,
    made: &Quadrangulation,
    more: &[(&str, &[f64])],
) -> Result<(), Failure> {
    let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<_>>();
    let jacobian = single(&made.jacobians);
    let quads = 0..made.mesh.quads().len();
    let aspect: Vec<f64> = quads.map(|q| aspect_ratio(&made.mesh.corners(q))).collect();
    let aspect = single(&aspect);
    let more: Vec<_> = more.iter().map(|(name, v)| (name, single(v))).collect();
    let mut fields = Fields::from(&made.mesh)
        .cell_field("scaled_jacobian", &jacobian)?
        .cell_field("aspect_ratio", &aspect)?;
    for (name, values) in &more {
        fields = fields.cell_field(name, values)?;
    }
    io::mesh::save(session.output("quads.vtu")?, &fields)?;
    io::mesh::save(session.output("quads.obj")?, &Fields::from(&made.mesh))?;
    io::mesh::save(session.output("quads.glb")?, &Fields::from(&made.mesh))?;

    session.picture("quads", || picture(session, made))
}

/// The quads with their sides and irregular vertices, coloured by the scaled Jacobian.
fn picture(session: &Session, made: &Quadrangulation) -> Result<Image, Failure> {
    let scale = Scale::new(ColorMap::Viridis, [0.0, 1.0], "scaled Jacobian");
    let halves = made.mesh.clone().into_triangles();
    let colors = made
        .jacobians
        .iter()
        .flat_map(|&j| [scale.color(j); 2])
        .collect();
    let mut body = Layer::surface(&halves, Paint::Faces(colors));
    body.edges = false;
    let edges = Halfedges::of_quads(&made.mesh)?;
    let irregular = (0..made.mesh.positions().len()).filter_map(|v| {
        let id = VertexId(v as u32);
        let count = edges.around(id).count();
        let inside = !edges.on_boundary(id);
        (inside && count != 4).then(|| (made.mesh.positions()[v], count < 4))
    });
    let radius = 0.006 * made.mesh.bounds().diagonal();
    let mut layers = vec![body, crosses::sides(&made.mesh)];
    layers.extend(crosses::balls(irregular, radius));
    let view = View::principal(made.mesh.positions()).turned(0.25, 0.2);
    let mut scene = Scene::new(layers, view);
    scene.scale = Some(scale);
    scene.caption = Some(format!(
        "{} quads, {} irregular vertices",
        products::grouped(made.mesh.quads().len()),
        products::grouped(made.report.valences.irregular())
    ));
    session.show_scene("quads", &scene);
    scene.draw(session.rasterizer()?, products::SIZE)
}
