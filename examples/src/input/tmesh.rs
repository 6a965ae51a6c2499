//! A T-mesh of any input: its surface, quads of that, levels, elements, and how they are drawn.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use crossfield::quads::quality::distances;
use crossfield::{Options, Size, quadrangulate};
use geom_core::io::{self, AnyMesh, view::Field};
use geom_core::mesh::Halfedges;
use geom_core::search::bvh::TriangleTree;
use geom_core::surface::repair;
use geom_core::{Point3, QuadMesh, Structure, TriMesh, VertexId};
use serde::Serialize;
use serde_json::json;
use tspline::levels::{self, Places};
use tspline::mesh::refined;
use tspline::quality::{JacobianSummary, scaled_jacobians};
use tspline::{CleanOptions, Improved, Method, QualityOptions, TMesh, TMeshOptions, improve};

use super::surface;
use crate::crosses::{self, Guide, Mode};
use crate::input::labels::Labels;
use crate::input::source::{Kind, SourceArgs};
use crate::picture::{ColorMap, Image, Layer, Paint, Scale, Scene, View};
use crate::{Failure, Session, products};

/// A surface and the T-mesh that is wanted of it.
#[derive(Clone, Debug, Args, Serialize)]
pub struct TMeshArgs {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    #[serde(flatten)]
    elements: ElementArgs,
}

/// What elements are wanted of a surface.
#[derive(Clone, Debug, Args, Serialize)]
pub struct ElementArgs {
    /// How many quads of the finest level the whole surface would have [default: a third of the triangles; a mesh of quads
    /// has its own, cut into four for each level]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    quads: Option<u32>,
    /// Where elements are larger: chain:A=2,B=0 (sides of 4 and 1; chains that are not named as the coarsest),
    /// domain:1=0,2=2, curvature, or the name of a point field of a mesh (finest where it is largest) [default:
    /// nowhere]
    #[arg(long, value_name = "LEVELS", value_parser = wanted)]
    levels: Option<Wanted>,
    /// By curvature or a field: the highest level
    #[arg(long, value_name = "LEVEL", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=6))]
    coarsest: u8,
    /// By curvature: along the side of an element the surface turns by so much at most, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0)]
    turn: f64,
    /// Keep edges whose triangles' normals differ by more than this as sides of quads, degrees; a spline surface is smooth
    /// across them
    #[arg(long, value_name = "DEGREES")]
    crease: Option<f64>,
    /// What the quads follow: none, curvature, modes:1,2, modes:auto, characteristic:1,2
    #[arg(long, value_name = "GUIDE", default_value = "none", value_parser = crosses::guide)]
    guide: Guide,
    /// How strictly
    #[arg(long, value_enum, default_value_t)]
    mode: Mode,
    /// Which distortion of the elements is lowered
    #[arg(long, value_enum, default_value_t)]
    method: MethodName,
    /// Leave the vertices where the quads have them
    #[arg(long)]
    raw: bool,
}

impl ElementArgs {
    /// Larger ones where the surface is flat, everything else as the programs do without being told.
    pub fn by_curvature() -> Self {
        Self {
            quads: None,
            levels: Some(Wanted::Curvature),
            coarsest: 2,
            turn: 30.0,
            crease: None,
            guide: Guide::default(),
            mode: Mode::default(),
            method: MethodName::default(),
            raw: false,
        }
    }
}

/// Names of [`Method`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MethodName {
    /// From right angles between sides of the proportions they have
    #[default]
    Corners,
    /// From triangles of squares
    Triangles,
}

/// More quads than this times those asked for are warned of.
const OVERSHOT: f64 = 1.1;

/// What a structure consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parts {
    /// Chains, by name.
    Chain,
    /// Models and copies of an assembly, counted from 1.
    Domain,
}

impl Parts {
    const ALL: [(Self, &'static str); 2] = [(Self::Chain, "chain"), (Self::Domain, "domain")];

    fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

/// Where elements are larger.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Near these chains or domains (counted from 1), at these levels.
    Near(Parts, Vec<(String, u8)>),
    /// Where the surface is flat.
    Curvature,
    /// Where a field of the mesh is small.
    Field(String),
}

impl std::fmt::Display for Wanted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Near(parts, pairs) => {
                let pairs: Vec<String> = pairs.iter().map(|(n, l)| format!("{n}={l}")).collect();
                write!(f, "{}:{}", parts.name(), pairs.join(","))
            }
            Self::Curvature => write!(f, "curvature"),
            Self::Field(name) => write!(f, "{name}"),
        }
    }
}

impl Serialize for Wanted {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// `chain:A=2,B=0`, `domain:1=0,2=2`, `curvature`, or the name of a field.
pub fn wanted(text: &str) -> Result<Wanted, String> {
    let pairs = |list: &str| -> Result<Vec<(String, u8)>, String> {
        let one = |pair: &str| -> Option<(String, u8)> {
            let (name, level) = pair.split_once('=')?;
            let level = level.parse().ok().filter(|l| *l <= 6)?;
            Some((name.to_owned(), level))
        };
        let all: Option<Vec<_>> = list.split(',').map(one).collect();
        let all = all
            .ok_or_else(|| format!("`{list}` is no list of NAME=LEVEL with levels from 0 to 6"))?;
        let again = |&i: &usize| all[..i].iter().any(|earlier| earlier.0 == all[i].0);
        match (0..all.len()).find(again) {
            Some(i) => Err(format!("{} is in `{list}` more than once", all[i].0)),
            None => Ok(all),
        }
    };
    let near = text.split_once(':').and_then(|(name, list)| {
        let parts = Parts::ALL.into_iter().find(|p| p.1 == name)?;
        Some((parts.0, list))
    });
    match near {
        Some((parts, list)) => Ok(Wanted::Near(parts, pairs(list)?)),
        None if text == "curvature" => Ok(Wanted::Curvature),
        None if !text.is_empty() => Ok(Wanted::Field(text.to_owned())),
        None => {
            Err("it must be chain:A=2,B=0, domain:1=0,2=2, curvature or the name of a field".into())
        }
    }
}

/// What was read of the input.
pub struct Input {
    /// The surface; a manifold once a T-mesh is made of it.
    pub surface: TriMesh,
    /// What the surface was before repair, if it needed any: what fields and labels are of.
    given: Option<TriMesh>,
    /// If it is a mesh of quads.
    quads: Option<QuadMesh>,
    /// The fields of a mesh's points and cells, if these are those of the surface.
    fields: Vec<Field<'static>>,
    cell_fields: Vec<Field<'static>>,
    /// If it is a structure.
    structure: Option<Structure>,
}

impl Input {
    /// With a manifold in place of what is none. Quads are their own T-mesh, and have to be one already.
    fn into_manifold(mut self, session: &Session) -> Result<Self, Failure> {
        if self.quads.is_none() {
            let (surface, repaired) = repair::manifold(&self.surface)?;
            session.note("repaired", repaired)?;
            if repaired.is_some() {
                self.given = Some(std::mem::replace(&mut self.surface, surface));
            }
        }
        Ok(self)
    }

    fn given(&self) -> &TriMesh {
        self.given.as_ref().unwrap_or(&self.surface)
    }

    /// The surface of a structure, if it is one.
    pub fn of_surface(surface: TriMesh, structure: Option<Structure>) -> Self {
        Self {
            surface,
            given: None,
            quads: None,
            fields: Vec::new(),
            cell_fields: Vec::new(),
            structure,
        }
    }

    /// What the input says of the middle of each element: atom, residue and chain of structures, scalars of meshes, those of
    /// points linear between them.
    pub fn carried(&self, mesh: &TMesh) -> Result<Vec<(String, Vec<f64>)>, Failure> {
        let corners = mesh.elements().iter().map(|e| e.corners).collect();
        let elements = QuadMesh::new(mesh.positions().to_vec(), corners)?;
        if let Some(structure) = &self.structure {
            let labels = Labels::of(structure, &levels::centres(&elements))?;
            let centres = io::View {
                points: levels::centres(&elements).into(),
                ..io::View::default()
            };
            let fields = labels.fields(centres)?.point_fields;
            let named = fields.iter().map(|f| (f.name.clone(), f.values.to_f64()));
            return Ok(named.collect());
        }
        let places = Places::of(self.given(), &elements)?;
        let scalar = |f: &&Field<'_>| f.values.components == 1;
        let points = self.given().positions().len();
        let of_points = (self.fields.iter().filter(scalar)).filter(|f| f.values.len() == points);
        let mut all = Vec::new();
        for field in of_points {
            all.push((field.name.clone(), places.values(&field.values.to_f64())?));
        }
        // A quad is two triangles.
        let triangles = self.given().triangles().len();
        let cells = self.quads.as_ref().map_or(triangles, |q| q.quads().len());
        let nearest: Vec<u32> = (0..triangles as u32).collect();
        let nearest = places.labels(&nearest)?;
        let of_cells = (self.cell_fields.iter().filter(scalar)).filter(|f| f.values.len() == cells);
        for field in of_cells {
            let cell = |&t: &u32| t as usize * cells / triangles;
            let values = nearest.iter().map(|t| field.values.get(cell(t), 0));
            all.push((field.name.clone(), values.collect()));
        }
        Ok(all)
    }
}

/// A surface and its T-mesh.
pub struct Made {
    /// What it was made of.
    pub input: Input,
    /// The T-mesh.
    pub mesh: TMesh,
    /// Signed scaled Jacobian per element.
    pub jacobians: Vec<f64>,
}

impl TMeshArgs {
    /// The file that is read.
    pub fn input(&self) -> PathBuf {
        self.source.input.clone()
    }

    /// Are there to be elements of several levels?
    pub fn has_levels(&self) -> bool {
        self.elements.levels.is_some()
    }

    /// Reads the input and makes a T-mesh of it; notes counts and quality.
    pub fn make(&self, session: &Session) -> Result<Made, Failure> {
        self.elements.refuse(session)?;
        self.elements.make(self.read(session)?, session)
    }

    fn read(&self, session: &Session) -> Result<Input, Failure> {
        let path = &self.source.input;
        if Kind::of(path) != Kind::Mesh {
            let (surface, structure) = surface::with_structure(&self.source, session)?;
            return Ok(Input::of_surface(surface, structure));
        }
        SourceArgs::refuse_beside_mesh(session)?;
        let file = session.stage("reading", || io::mesh::read_up_to(path, session.memory()))?;
        let quads = match &file.mesh {
            AnyMesh::Quad(quads) => Some(quads.clone()),
            _ => None,
        };
        if quads.is_some() {
            session.refuse(
                &["guide"],
                "is for triangles, and the input has quads already",
            )?;
            session.refuse(
                &["quads"],
                "is for triangles, and the input has quads already",
            )?;
        }
        let (fields, cell_fields) = match &file.mesh {
            AnyMesh::Tet(_) => (Vec::new(), Vec::new()),
            _ => (file.point_fields, file.cell_fields),
        };
        Ok(Input {
            surface: file.mesh.into_triangles(),
            given: None,
            quads,
            fields,
            cell_fields,
            structure: None,
        })
    }
}

impl ElementArgs {
    /// Makes a T-mesh of a surface; notes counts and quality.
    pub fn make(&self, input: Input, session: &Session) -> Result<Made, Failure> {
        self.look_up(&input)?;
        products::note_surface(session, &input.surface)?;
        let input = input.into_manifold(session)?;
        let fine = self.fine_quads(&input, session)?;
        let allowed = session.stage("levels", || self.allowed(&input, &fine, session))?;
        let built = session.stage("T-mesh", || {
            TMesh::build(&fine, &allowed, &TMeshOptions::default())
        })?;
        let (mesh, jacobians) = if self.raw {
            let jacobians = scaled_jacobians(&built, &input.surface)?;
            session.note("scaled_jacobian", JacobianSummary::of(&jacobians))?;
            (built, jacobians)
        } else {
            let better = || self.improved(built, &input.surface, session);
            let improved = session.stage("quality", better)?;
            session.note("scaled_jacobian", improved.report.after)?;
            session.note("quality", &improved.report)?;
            (improved.mesh, improved.jacobians)
        };
        note(session, &mesh, &input.surface)?;
        Ok(Made {
            input,
            mesh,
            jacobians,
        })
    }

    fn refuse(&self, session: &Session) -> Result<(), Failure> {
        crosses::refuse_mode_alone(&self.guide, session)?;
        if !matches!(self.levels, Some(Wanted::Curvature)) {
            session.refuse(&["turn"], "is for --levels curvature")?;
        }
        if !matches!(self.levels, Some(Wanted::Curvature | Wanted::Field(_))) {
            session.refuse(&["coarsest"], "is for levels by curvature or a field")?;
        }
        if self.raw {
            let because = "says how elements are made better, and --raw leaves them";
            session.refuse(&["method"], because)?;
        }
        if !(self.turn > 0.0 && self.turn <= 360.0) {
            return Err(format!("--turn {} must lie between 0 and 360 degrees", self.turn).into());
        }
        Ok(())
    }

    /// An error for levels of what is not in the input: quads take long to make.
    fn look_up(&self, input: &Input) -> Result<(), Failure> {
        match &self.levels {
            Some(Wanted::Near(parts, pairs)) => levels_of_chains(*parts, pairs, 0, input).map(drop),
            Some(Wanted::Field(name)) => named(name, input).map(drop),
            Some(Wanted::Curvature) | None => Ok(()),
        }
    }

    /// The highest level: how often the coarsest quads are cut.
    fn highest(&self) -> u8 {
        match &self.levels {
            None => 0,
            Some(Wanted::Near(_, pairs)) => pairs.iter().map(|p| p.1).max().unwrap_or(0),
            Some(Wanted::Curvature | Wanted::Field(_)) => self.coarsest,
        }
    }

    /// The quads of the finest level, in squares of the coarsest as far as possible.
    fn fine_quads(&self, input: &Input, session: &Session) -> Result<QuadMesh, Failure> {
        let nested = self.highest();
        if let Some(quads) = &input.quads {
            // A place on the surface for each.
            const BYTES: f64 = 1024.0;
            affordable(quads.quads().len() << (2 * nested), BYTES, session)?;
            let cut = || onto(&refined(quads, nested)?, &input.surface);
            return session.stage("refinement", cut);
        }
        // Ten triangles on the way to each quad, their matrices factored.
        const BYTES: f64 = 16384.0;
        let triangles = input.surface.triangles().len();
        let count = self.quads.map_or(triangles / 3, |n| n as usize).max(1);
        affordable(count, BYTES, session)?;
        let options = Options {
            size: Size::Quads(count),
            nested,
            guidance: self.guide.guidance(self.mode),
            crease: self.crease,
            max_memory: session.memory(),
            ..Options::default()
        };
        options.check()?;
        let on = session.on(session.device.crossfield());
        let made = session.stage("quads", || quadrangulate(&input.surface, &options, on))?;
        session.note("rung", made.report.rung())?;
        crosses::warn(session, &made.report)?;
        let quads = made.mesh.quads().len();
        if self.quads.is_some() && quads as f64 > OVERSHOT * count as f64 {
            let squares = 1 << (2 * nested);
            session.warn(format!(
                "{quads} fine quads where {count} were asked for: the surface takes no fewer squares of {squares}"
            ))?;
        }
        Ok(made.mesh)
    }

    /// The level that each fine quad allows.
    fn allowed(
        &self,
        input: &Input,
        fine: &QuadMesh,
        session: &Session,
    ) -> Result<Vec<u8>, Failure> {
        let Some(wanted) = &self.levels else {
            return Ok(vec![0; fine.quads().len()]);
        };
        let highest = self.highest();
        let wished = match wanted {
            Wanted::Near(parts, pairs) => near(*parts, pairs, highest, input, fine)?,
            Wanted::Curvature => {
                let places = Places::of(&input.surface, fine)?;
                levels::by_curvature(fine, &places, self.turn.to_radians(), highest)?
            }
            Wanted::Field(name) => {
                let field = named(name, input)?;
                let places = Places::of(input.given(), fine)?;
                let values = places.values(&field.values.to_f64())?;
                let none = values.iter().filter(|v| !v.is_finite()).count();
                if none > 0 {
                    session.warn(format!(
                        "{none} quads have no finite value of `{name}`: they stay as fine as there are"
                    ))?;
                }
                levels::by_field(&values, highest)
            }
        };
        Ok(levels::cleaned(fine, &wished, &CleanOptions::default())?)
    }

    fn improved(
        &self,
        mesh: TMesh,
        surface: &TriMesh,
        session: &Session,
    ) -> Result<Improved, Failure> {
        let options = QualityOptions {
            method: match self.method {
                MethodName::Corners => Method::Corners,
                MethodName::Triangles => Method::Triangles,
            },
            crease: self.crease,
            ..QualityOptions::default()
        };
        Ok(improve(
            mesh,
            surface,
            &options,
            session.on(session.device.spline()),
        )?)
    }
}

/// The point field of this name.
fn named<'a>(name: &str, input: &'a Input) -> Result<&'a Field<'static>, Failure> {
    let found = input.fields.iter().find(|f| f.name == name);
    Ok(found.ok_or_else(|| {
        let names: Vec<&str> = input.fields.iter().map(|f| f.name.as_str()).collect();
        let known = match names.is_empty() {
            true => "none".to_owned(),
            false => names.join(", "),
        };
        format!("there is no point field `{name}` in the input; it has {known}")
    })?)
}

/// The level of the chain or domain nearest to each quad: as given, or else the highest.
fn near(
    parts: Parts,
    pairs: &[(String, u8)],
    highest: u8,
    input: &Input,
    fine: &QuadMesh,
) -> Result<Vec<u8>, Failure> {
    let levels = levels_of_chains(parts, pairs, highest, input)?;
    let labels = Labels::of(structure(parts, input)?, &levels::centres(fine))?;
    Ok(labels
        .chains()
        .iter()
        .map(|&c| levels[c as usize])
        .collect())
}

fn structure(parts: Parts, input: &Input) -> Result<&Structure, Failure> {
    let what = parts.name();
    let none = || format!("--levels {what}:… is for structures, and the input is none");
    Ok(input.structure.as_ref().ok_or_else(none)?)
}

/// The level of each chain: as given for it or its domain, or else the highest.
fn levels_of_chains(
    parts: Parts,
    pairs: &[(String, u8)],
    highest: u8,
    input: &Input,
) -> Result<Vec<u8>, Failure> {
    let what = parts.name();
    let structure = structure(parts, input)?;
    let chains = structure.chains();
    let mut names: Vec<String> = chains.iter().map(|c| c.name.to_string()).collect();
    if parts == Parts::Domain {
        for domain in 0..structure.domains().len() {
            names[structure.domain_chains(domain)].fill((domain + 1).to_string());
        }
    }
    if let Some((name, _)) = pairs.iter().find(|(n, _)| !names.contains(n)) {
        names.dedup();
        return Err(format!("there is no {what} {name}; there are {}", names.join(", ")).into());
    }
    let level = |name: &String| {
        pairs
            .iter()
            .find(|(n, _)| n == name)
            .map_or(highest, |p| p.1)
    };
    Ok(names.iter().map(level).collect())
}

/// Refuses more quads than there is memory for.
/// An error if so many quads need more than `--max-memory`.
pub fn affordable(quads: usize, bytes: f64, session: &Session) -> Result<(), Failure> {
    let (needed, allowed) = (quads as f64 * bytes, session.memory() as f64);
    if needed > allowed {
        let [needed, allowed] = [needed, allowed].map(|bytes| bytes / 1e9);
        return Err(format!(
            "{quads} fine quads need about {needed:.1} GB, more than the {allowed:.1} GB of --max-memory; fewer --quads help"
        )
        .into());
    }
    Ok(())
}

/// The vertices of a mesh at the nearest points of a surface, but for those of its boundary.
fn onto(mesh: &QuadMesh, surface: &TriMesh) -> Result<QuadMesh, Failure> {
    let edges = Halfedges::of_quads(mesh)?;
    let closest = TriangleTree::new(surface)?.closest_to_all(mesh.positions())?;
    let positions = closest
        .iter()
        .zip(mesh.positions())
        .enumerate()
        .map(|(v, (c, p))| {
            let on_rim = edges.on_boundary(VertexId(v as u32));
            if on_rim { *p } else { c.point }
        });
    Ok(QuadMesh::new(positions.collect(), mesh.quads().to_vec())?)
}

/// Notes how many of what a T-mesh has.
pub fn note_counts(session: &Session, mesh: &TMesh) -> Result<(), Failure> {
    let audit = mesh.audit();
    let counts = json!({
        "elements": audit.elements,
        "vertices": audit.vertices,
        "t_junctions": audit.t_junctions,
        "extraordinary": audit.extraordinary,
        "levels": audit.levels,
    });
    session.note("counts", counts)
}

fn note(session: &Session, mesh: &TMesh, surface: &TriMesh) -> Result<(), Failure> {
    let audit = mesh.audit();
    note_counts(session, mesh)?;
    session.note("counts", json!({ "fine_quads": mesh.fine().quads().len() }))?;
    session.note("hausdorff", distances(mesh.fine(), surface)?)?;
    session.note("valid", audit.is_valid())?;
    session.note("audit", audit)
}

/// The sides of elements, extraordinary vertices, and a colour per level.
pub fn picture(made: &TMesh, session: &Session) -> Result<Image, Failure> {
    let scale = scale(made);
    let halves = made.fine().clone().into_triangles();
    let level = |q: usize| f64::from(made.elements()[made.element_of(q) as usize].level);
    let quads = 0..made.fine().quads().len();
    let colors = quads.flat_map(|q| [scale.color(level(q)); 2]);
    let mut body = Layer::surface(&halves, Paint::Faces(colors.collect()));
    body.edges = false;
    let irregular = (0..made.positions().len()).filter_map(|v| match made.kind(v) {
        tspline::VertexKind::Extraordinary(n) => Some((made.positions()[v], n < 4)),
        _ => None,
    });
    let mut layers = vec![body, sides(made)];
    layers.extend(crosses::balls(
        irregular,
        0.006 * made.fine().bounds().diagonal(),
    ));
    let view = View::principal(made.positions()).turned(0.25, 0.2);
    let mut scene = Scene::new(layers, view);
    let audit = made.audit();
    if audit.levels.len() > 1 {
        scene.scale = Some(scale);
    }
    scene.caption = Some(format!(
        "{} elements, {} T-junctions, {} extraordinary vertices",
        products::grouped(audit.elements),
        products::grouped(audit.t_junctions),
        audit.extraordinary
    ));
    session.show_scene("tmesh", &scene);
    scene.draw(session.rasterizer()?, products::SIZE)
}

/// Levels as colours.
pub fn scale(made: &TMesh) -> Scale {
    let most = made.elements().iter().map(|e| e.level).max().unwrap_or(0);
    Scale::new(ColorMap::Viridis, [-0.5, f64::from(most) + 0.5], "level")
}

/// The sides of all elements, along the fine mesh.
pub fn sides(made: &TMesh) -> Layer {
    let fine = made.fine();
    let (edges, normals) = (made.fine_edges(), fine.vertex_normals());
    let width = 0.04 * (fine.area() / made.elements().len().max(1) as f64).sqrt();
    let segments = edges.edges().filter_map(|h| {
        let own = made.element_of(edges.face(h).0 as usize);
        let other = edges
            .twin(h)
            .map(|t| made.element_of(edges.face(t).0 as usize));
        if other == Some(own) {
            return None;
        }
        let [a, b] = [edges.from(h), edges.to(h)].map(|v| v.0 as usize);
        let ends: [Point3; 2] = [fine.positions()[a], fine.positions()[b]];
        Some((ends, normals[a] + normals[b]))
    });
    crosses::strips(segments, width)
}
