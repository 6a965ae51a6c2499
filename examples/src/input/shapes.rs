//! Two shapes to be matched, morphed or compared: of structures, grids or closed meshes, as sets of lattice points.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use gauss_density::{Cutoff, Levels, Model, PointSampler, sample};
use geom_core::algebra::graph::Neighbours;
use geom_core::compute::parallel;
use geom_core::io::{self, structure};
use geom_core::mesh::Halfedges;
use geom_core::search::nearest::PointTree;
use geom_core::structure::Element;
use geom_core::{Aabb, ImplicitField, Point3, ScalarGrid, Structure, TriMesh};
use serde::Serialize;
use serde_json::json;
use spectral_corresp::correspond::{Embedding, expected_bytes};
use spectral_corresp::options::Components;
use spectral_corresp::{
    Correspondence, Directions, MatchOptions, Refine, ShapeOptions, Start, Truth, VoxelShape,
    correspond,
};

use crate::args::ReaderArgs;
use crate::input::source::{Kind, contour};
use crate::{Failure, Session};

/// Two shapes and how lattice points are made of them.
#[derive(Clone, Debug, Args, Serialize)]
pub struct ShapeArgs {
    /// The first shape: structure (PDB, mmCIF, PQR), grid (MRC, CCP4, DX) or closed mesh (PLY, OFF, OBJ, STL, VTU, MSH, GLB)
    #[serde(serialize_with = "crate::args::as_text")]
    pub first: PathBuf,
    /// The second shape, likewise
    #[serde(serialize_with = "crate::args::as_text")]
    pub second: PathBuf,
    /// Distance of lattice points of structures and meshes [default: that of a grid beside it; else 1.5 Å, of a mesh its largest extent over 96]
    #[arg(long, value_name = "H", help_heading = "Shapes")]
    pub spacing: Option<f64>,
    /// Structures: decay of an atom's kernel, 1/Å²; smaller is smoother
    #[arg(long, value_name = "KAPPA", visible_alias = "kappa", default_value_t = DECAY, help_heading = "Shapes")]
    pub decay: f64,
    /// Structures: power per residue
    #[arg(long, value_name = "P", default_value_t = Levels::default().residue_power, help_heading = "Shapes")]
    pub residue_power: f64,
    /// Structures: hydrogens count for the shape, too; without them it follows motions better
    #[arg(long, conflicts_with = "no_hydrogens", help_heading = "Shapes")]
    pub hydrogens: bool,
    /// Grids: the value on the surface; inside it is larger
    #[arg(long, value_name = "VALUE", help_heading = "Shapes")]
    pub isovalue: Option<f64>,
    /// Grids, instead: the isovalue that encloses this volume, Å³
    #[arg(
        long,
        value_name = "VOLUME",
        conflicts_with = "isovalue",
        help_heading = "Shapes"
    )]
    pub enclosed_volume: Option<f64>,
    /// Which lattice points are neighbours
    #[arg(long, value_enum, default_value_t, help_heading = "Shapes")]
    pub neighbours: NeighboursName,
    /// Keep all parts, not the largest only
    #[arg(long, help_heading = "Shapes")]
    pub all_components: bool,
    /// Fill cavities
    #[arg(long, help_heading = "Shapes")]
    pub fill_cavities: bool,
    /// How structures are read.
    #[command(flatten)]
    pub reader: ReaderArgs,
}

/// Shapes whose volumes differ by more than this share were not made alike, or are not alike.
const UNLIKE: f64 = 0.12;
/// Parts that are left out are worth a word from one point in so many on.
const SPECKS: usize = 100;
/// A shape of which more than this share is boundary has little inside.
const POROUS: f64 = 0.5;
/// Boundary points farther from their partners than this have none, Å.
const UNMATCHED: f64 = 4.0;
/// The smoothness of a structure's shape: side chains, which move, do not count.
const DECAY: f64 = 0.3;
/// The spacing of structures, Å, which is also what all lengths of the method are measured by.
const SPACING: f64 = 1.5;
/// Lattice points along the largest extent of a mesh.
const ALONG: f64 = 96.0;

/// Points across faces, edges and corners.
#[derive(Clone, Copy, Debug, Default, Serialize, ValueEnum)]
pub enum NeighboursName {
    /// Across faces
    #[value(name = "6")]
    Six,
    /// Across faces and edges
    #[value(name = "18")]
    Eighteen,
    /// Across faces, edges and corners
    #[default]
    #[value(name = "26")]
    TwentySix,
}

/// How a correspondence is sought.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "Matching")]
pub struct MatchArgs {
    /// Where the search starts
    #[arg(long, value_enum, default_value_t)]
    pub start: StartName,
    /// How starts are made better
    #[arg(long, value_enum, default_value_t)]
    pub refine: RefineName,
    /// A point of the first shape and where it is in the second, Å; at least three
    #[arg(long, value_name = "X,Y,Z=X,Y,Z", value_parser = anchor, allow_hyphen_values = true, conflicts_with = "start")]
    pub anchor: Vec<(Point3, Point3)>,
    /// Structures: residues of the same chain, number and name belong together
    #[arg(long, conflicts_with_all = ["start", "anchor"])]
    pub same_residues: bool,
    /// Structures: chains of the same name belong together; at least three, whose centres are not on one line
    #[arg(long, conflicts_with_all = ["start", "anchor", "same_residues"])]
    pub same_chains: bool,
    /// Modes of each shape, and joint modes
    #[arg(long, value_name = "K", default_value_t = MatchOptions::default().modes)]
    pub modes: usize,
    /// Weight of links between the shapes, over that of an edge across a face
    #[arg(long, value_name = "C", default_value_t = MatchOptions::default().link)]
    pub link: f64,
    /// Solve from the first to the second shape only
    #[arg(long)]
    pub forward_only: bool,
    /// The length that counts as 1 Å [default: 1; of meshes the spacing over 1.5]
    #[arg(long, value_name = "LENGTH")]
    pub unit: Option<f64>,
    /// Seed of samples and rotations
    #[arg(long, default_value_t = MatchOptions::default().seed)]
    pub seed: u64,
}

/// Where the search starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum StartName {
    /// Everywhere; the best is taken
    #[default]
    Auto,
    /// Histograms of diameters and the first mode, as in the thesis
    Thesis,
    /// The first modes, with all signs
    Spectral,
    /// Rigid motions
    Rigid,
}

/// How starts are made better.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum RefineName {
    /// By an annealed two-way fit
    #[default]
    Annealed,
    /// By the two steps of the thesis
    Thesis,
    /// Not at all
    None,
}

/// `X,Y,Z=X,Y,Z`: a point of the one and where it lies on the other.
pub fn anchor(text: &str) -> Result<(Point3, Point3), String> {
    let point = |text: &str| -> Option<Point3> {
        let numbers = text.split(',').map(|n| n.trim().parse().ok());
        let [x, y, z] = numbers.collect::<Option<Vec<f64>>>()?[..] else {
            return None;
        };
        Some(Point3::new(x, y, z))
    };
    text.split_once('=')
        .and_then(|(a, b)| Some((point(a)?, point(b)?)))
        .ok_or_else(|| format!("{text:?} is not like 1,2,3=4,5,6"))
}

/// A shape, and what is drawn of it.
pub struct Body {
    /// The lattice points inside.
    pub shape: VoxelShape,
    /// Its surface.
    pub surface: TriMesh,
    /// The structure, if it comes from one.
    pub structure: Option<Structure>,
}

/// Two of them.
pub struct Pair {
    /// The first.
    pub first: Body,
    /// The second.
    pub second: Body,
    /// The length that counts as 1 Å unless another is asked for.
    pub unit: f64,
}

/// The options of structures; the rest of those of the reader stands in [`crate::input::source::OF_STRUCTURES`].
const OF_STRUCTURES: [&str; 3] = ["decay", "residue_power", "hydrogens"];

impl ShapeArgs {
    /// The input files.
    pub fn inputs(&self) -> Vec<PathBuf> {
        vec![self.first.clone(), self.second.clone()]
    }

    /// Reads both, as stages of the session.
    pub fn read(&self, session: &Session) -> Result<Pair, Failure> {
        let kinds = [&self.first, &self.second].map(|p| Kind::of(p));
        if !kinds.contains(&Kind::Structure) {
            let because = "is for structures, and neither input is one";
            session.refuse(&OF_STRUCTURES, because)?;
            let of_reader = crate::input::source::OF_STRUCTURES;
            let of_reader = of_reader.into_iter().filter(|o| *o != "spacing");
            session.refuse(&of_reader.collect::<Vec<_>>(), because)?;
        }
        if !kinds.contains(&Kind::Grid) {
            let because = "is for grids, and neither input is one";
            session.refuse(&["isovalue", "enclosed_volume"], because)?;
        }
        let mut spacing = self.spacing;
        // A grid has its spacing, which the other shape takes: it is read first.
        let grid_is_second = kinds[1] == Kind::Grid && kinds[0] != Kind::Grid;
        if kinds.contains(&Kind::Grid) {
            session.refuse(&["spacing"], "is that of the grid")?;
        }
        let (first, second) = if grid_is_second {
            let second = self.body(session, "second", &self.second, &mut spacing)?;
            (
                self.body(session, "first", &self.first, &mut spacing)?,
                second,
            )
        } else {
            (
                self.body(session, "first", &self.first, &mut spacing)?,
                self.body(session, "second", &self.second, &mut spacing)?,
            )
        };
        let nodes = |body: &Body| [body.shape.nodes(), body.shape.boundary().len()];
        let ([a, on_a], [b, on_b]) = (nodes(&first), nodes(&second));
        session.note(
            "counts",
            json!({ "nodes": [a, b], "boundary_nodes": [on_a, on_b] }),
        )?;
        let unit = match kinds {
            [Kind::Mesh, Kind::Mesh] => first.shape.lattice().spacing / SPACING,
            _ => 1.0,
        };
        Ok(Pair {
            first,
            second,
            unit,
        })
    }

    /// Reads a shape; what decides the spacing of the first decides that of the second.
    pub fn body(
        &self,
        session: &Session,
        name: &'static str,
        path: &Path,
        spacing: &mut Option<f64>,
    ) -> Result<Body, Failure> {
        let options = ShapeOptions {
            neighbours: match self.neighbours {
                NeighboursName::Six => Neighbours::Six,
                NeighboursName::Eighteen => Neighbours::Eighteen,
                NeighboursName::TwentySix => Neighbours::TwentySix,
            },
            components: match self.all_components {
                true => Components::All,
                false => Components::Largest,
            },
            fill_cavities: self.fill_cavities,
            max_memory: session.memory(),
            ..ShapeOptions::default()
        };
        let body = match Kind::of(path) {
            Kind::Mesh => of_mesh(session, path, spacing, &options)?,
            Kind::Grid => {
                let (grid, level) = self.grid(session, path)?;
                *spacing = Some(grid.lattice_spacing());
                of_grid(session, &grid, level, &grid, &options)?
            }
            Kind::Structure => {
                let h = *spacing.get_or_insert(SPACING);
                self.structure(session, path, h, &options)?
            }
        };
        let shape = &body.shape;
        let left_out: usize = shape.report().left_out.iter().sum();
        if left_out > shape.nodes() / SPECKS {
            let (parts, path) = (shape.report().left_out.len(), path.display());
            session.warn(format!(
                "{path}: {parts} smaller parts are left out, {left_out} points beside {}; --all-components keeps them",
                shape.nodes()
            ))?;
        }
        session.note(
            name,
            json!({
                "lattice": shape.lattice(),
                "nodes": shape.nodes(),
                "boundary": shape.boundary().len(),
                "volume": shape.volume(),
                "shape": shape.report(),
                "atoms": body.structure.as_ref().map(|s| s.atoms().len()),
            }),
        )?;
        Ok(body)
    }

    fn model(&self, session: &Session, path: &Path) -> Result<(Structure, Model), Failure> {
        let asked = structure::ReadOptions {
            max_bytes: session.memory(),
            ..self.reader.options()
        };
        let read = session.stage("reading", || structure::read(path, &asked))?;
        let levels = Levels {
            decay: self.decay,
            residue_power: self.residue_power,
            ..Levels::default()
        };
        let model = Model::uniform(&self.seen(&read.structure), &levels)?;
        Ok((read.structure, model))
    }

    /// The atoms of which shapes are made.
    pub fn seen(&self, structure: &Structure) -> Structure {
        match self.hydrogens {
            true => structure.clone(),
            false => heavy(structure),
        }
    }

    /// The field of which a shape would be made, to ask which points lie inside.
    pub fn field(&self, session: &Session, path: &Path) -> Result<Field, Failure> {
        Ok(match Kind::of(path) {
            Kind::Structure => Field::Structure(self.model(session, path)?.1),
            Kind::Grid => {
                let (grid, level) = self.grid(session, path)?;
                Field::Grid(grid, level)
            }
            Kind::Mesh => {
                let path = path.display();
                return Err(format!("{path}: a structure or a grid is needed here").into());
            }
        })
    }

    fn structure(
        &self,
        session: &Session,
        path: &Path,
        spacing: f64,
        options: &ShapeOptions,
    ) -> Result<Body, Failure> {
        let (structure, model) = self.model(session, path)?;
        let sampling = gauss_density::Options {
            spacing,
            max_memory: session.memory(),
            ..Default::default()
        };
        let on = session.on(session.device.density());
        let grid = session
            .stage("density", || sample(&model, &sampling, on))?
            .grid;
        let field = PointSampler::new(&model, sampling.cutoff)?;
        let body = of_grid(session, &grid, 1.0, &field, options)?;
        Ok(Body {
            structure: Some(structure),
            ..body
        })
    }

    fn grid(&self, session: &Session, path: &Path) -> Result<(ScalarGrid, f64), Failure> {
        let file = session.stage("reading", || io::grid::read_up_to(path, session.memory()))?;
        let grid = file.into_grid().map_err(|e| e.in_file(path))?;
        let level = match (self.isovalue, self.enclosed_volume) {
            (Some(level), _) => level,
            (None, Some(volume)) => {
                grid.level_enclosing(volume).map(f64::from).ok_or_else(|| {
                    format!(
                        "--enclosed-volume {volume} Å³ does not lie between 0 and the whole grid"
                    )
                })?
            }
            (None, None) => {
                let (low, high) = grid.range().unwrap_or_default();
                return Err(format!("a grid needs --isovalue or --enclosed-volume; its values lie between {low} and {high}").into());
            }
        };
        Ok((grid, level))
    }
}

/// What a shape is made of.
pub enum Field {
    /// The density of atoms; inside it is at least 1.
    Structure(Model),
    /// A grid, and the value on the surface.
    Grid(ScalarGrid, f64),
}

impl Field {
    /// Where the body may be.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Structure(model) => model.center_bounds().inflated(8.0),
            Self::Grid(grid, _) => geom_core::LatticeValues::lattice(grid).bounds(),
        }
    }

    /// Which points lie inside.
    pub fn inside(&self, points: &[Point3]) -> Result<Vec<bool>, Failure> {
        let of = |field: &dyn ImplicitField, level: f64| {
            parallel::map_each(points, |p| field.value(p) >= level)
        };
        Ok(match self {
            Self::Structure(model) => of(&PointSampler::new(model, Cutoff::default())?, 1.0),
            Self::Grid(grid, level) => of(grid, *level),
        })
    }
}

/// The spacing of a grid.
trait Spacing {
    fn lattice_spacing(&self) -> f64;
}

impl Spacing for ScalarGrid {
    fn lattice_spacing(&self) -> f64 {
        geom_core::LatticeValues::lattice(self).spacing
    }
}

fn of_grid(
    session: &Session,
    grid: &ScalarGrid,
    level: f64,
    field: &dyn ImplicitField,
    options: &ShapeOptions,
) -> Result<Body, Failure> {
    let on = session.on(session.device.corresp());
    let shape = session.stage("shape", || VoxelShape::of_grid(grid, level, options, on))?;
    Ok(Body {
        surface: session.stage("surface", || contour(session, grid, level, Some(field)))?,
        shape,
        structure: None,
    })
}

fn of_mesh(
    session: &Session,
    path: &Path,
    spacing: &mut Option<f64>,
    options: &ShapeOptions,
) -> Result<Body, Failure> {
    let read = session.stage("reading", || io::mesh::read_up_to(path, session.memory()))?;
    let (surface, _) = read.mesh.into_triangles().without_unused();
    let extent = Aabb::of_points(surface.positions()).extent().amax();
    let h = *spacing.get_or_insert(extent / ALONG);
    let on = session.on(session.device.corresp());
    let shape = session.stage("shape", || VoxelShape::of_mesh(&surface, h, options, on))?;
    // Larger ones are refused: a row of lattice points crosses the surface an odd number of times.
    let holes = Halfedges::of(&surface).map_or(0, |edges| edges.boundary_loops().len());
    if holes > 0 {
        let path = path.display();
        session.warn(format!(
            "{path} has {holes} holes, which no row of lattice points has met: they count as closed"
        ))?;
    }
    Ok(Body {
        shape,
        surface,
        structure: None,
    })
}

impl Body {
    /// Values of boundary nodes at the vertices of a surface near them: of the four nearest, the nearer the more.
    pub fn on_surface(&self, values: &[f64], surface: &TriMesh) -> Result<Vec<f64>, Failure> {
        let tree = PointTree::of_positions(self.shape.boundary_points())?;
        let floor = 1e-3 * self.shape.lattice().spacing.powi(2);
        let at = |p: &Point3| {
            let near = tree.nearest(&[p.x, p.y, p.z], 4);
            let weigh = |d: f64| 1.0 / (d * d + floor);
            let sum = near.iter().fold((0.0, 0.0), |(sum, total), n| {
                let w = weigh(n.distance);
                (sum + w * values[n.index as usize], total + w)
            });
            sum.0 / sum.1
        };
        Ok(surface.positions().iter().map(at).collect())
    }
}

impl Body {
    /// Where points near the shape go if its nodes go to `images`.
    pub fn follow(&self, points: &[Point3], images: &[Point3]) -> Result<Vec<Point3>, Failure> {
        let nodes: Vec<Point3> = (0..self.shape.nodes())
            .map(|i| self.shape.position(i))
            .collect();
        Ok(Embedding::new(&nodes, images, &[])?.of(points))
    }
}

impl Pair {
    /// Where the atoms of the first structure are in the second, if both have as many.
    pub fn truth(&self) -> Result<Truth, Failure> {
        let (Some(a), Some(b)) = (&self.first.structure, &self.second.structure) else {
            return Err("only structures know where their atoms went".into());
        };
        Ok(truth(a, b)?)
    }

    /// The share of boundary points of the first shape whose partners belong to the same residue, of structures with the same
    /// atoms.
    pub fn residue_accuracy(&self, found: &Correspondence) -> Result<f64, Failure> {
        let truth = self.truth()?;
        let mut residues = Vec::new();
        if let Some(atoms) = self.first.structure.as_ref().map(heavy) {
            let all = (0u32..).zip(0..atoms.residues().len());
            let each = all.flat_map(|(r, at)| atoms.residue_atoms(at).map(move |_| r));
            residues.extend(each);
        }
        let (a, b) = (&self.first.shape, &self.second.shape);
        Ok(truth.residue_accuracy(&residues, a, b, &found.forward)?)
    }
}

/// All atoms but hydrogens.
fn heavy(structure: &Structure) -> Structure {
    structure.filter(|atom| structure.atoms()[atom].element != Element::HYDROGEN)
}

/// Where the atoms of a structure, but for hydrogens, are in another, which must have the same in the same order.
pub fn truth(a: &Structure, b: &Structure) -> Result<Truth, spectral_corresp::Error> {
    let (a, b) = (&heavy(a), &heavy(b));
    let points = |s: &Structure| -> Vec<Point3> { s.atoms().iter().map(|a| a.position).collect() };
    let radii: Vec<f64> = a.atoms().iter().map(|a| a.radius).collect();
    Truth::new(&points(a), &radii, &points(b))
}

/// Centres of the chains of the same name.
fn chains(a: &Structure, b: &Structure) -> Vec<(Point3, Point3)> {
    let named = |s: &Structure| {
        let mut sums = std::collections::BTreeMap::new();
        for c in 0..s.chains().len() {
            let of_chain = s.chain_residues(c).flat_map(|r| s.residue_atoms(r));
            // A chain may come in pieces: waters and ligands after the last one.
            let sum = sums
                .entry(s.chains()[c].name.as_str().to_owned())
                .or_insert((geom_core::Vector3::zeros(), 0.0));
            for atom in of_chain {
                sum.0 += s.atoms()[atom].position.coords;
                sum.1 += 1.0;
            }
        }
        sums
    };
    let (here, there) = (named(a), named(b));
    let center = |(sum, count): &(geom_core::Vector3, f64)| Point3::from(sum / count.max(1.0));
    here.iter()
        .filter_map(|(name, sum)| Some((center(sum), center(there.get(name)?))))
        .collect()
}

/// Centres of residues of the same chain, number and name.
fn residues(a: &Structure, b: &Structure) -> Vec<(Point3, Point3)> {
    let named = |s: &Structure| {
        let chains = 0..s.chains().len();
        let all = chains.flat_map(|c| s.chain_residues(c).map(move |r| (c, r)));
        all.map(|(c, r)| {
            let residue = &s.residues()[r];
            let atoms = &s.atoms()[s.residue_atoms(r)];
            let sum = atoms
                .iter()
                .fold(geom_core::Vector3::zeros(), |m, a| m + a.position.coords);
            let center = Point3::from(sum / atoms.len().max(1) as f64);
            let name = |n: &geom_core::structure::Name| n.as_str().to_owned();
            let chain = name(&s.chains()[c].name);
            (
                (
                    chain,
                    residue.number,
                    name(&residue.insertion),
                    name(&residue.name),
                ),
                center,
            )
        })
        .collect::<Vec<_>>()
    };
    let there: std::collections::BTreeMap<_, _> = named(b).into_iter().rev().collect();
    let paired = named(a).into_iter();
    paired
        .filter_map(|(key, p)| there.get(&key).map(|q| (p, *q)))
        .collect()
}

impl MatchArgs {
    /// The length that counts as 1 Å.
    pub fn unit(&self, pair: &Pair) -> f64 {
        self.unit.unwrap_or(pair.unit)
    }

    /// As the crate takes them.
    pub fn options(&self, pair: &Pair) -> Result<MatchOptions, Failure> {
        let start = match self.start {
            _ if self.same_residues || self.same_chains => {
                let (Some(a), Some(b)) = (&pair.first.structure, &pair.second.structure) else {
                    return Err("--same-residues and --same-chains are for two structures".into());
                };
                let named = if self.same_chains { chains } else { residues };
                Start::Anchors(named(a, b))
            }
            _ if !self.anchor.is_empty() => Start::Anchors(self.anchor.clone()),
            StartName::Auto => Start::Auto,
            StartName::Thesis => Start::Thesis,
            StartName::Spectral => Start::Spectral,
            StartName::Rigid => Start::Rigid,
        };
        Ok(MatchOptions {
            start,
            refine: match self.refine {
                RefineName::Annealed => Refine::Annealed,
                RefineName::None => Refine::None,
                RefineName::Thesis => Refine::Thesis {
                    tolerance: 0.01,
                    most: 150,
                },
            },
            modes: self.modes,
            link: self.link,
            directions: match self.forward_only {
                true => Directions::Forward,
                false => Directions::Both,
            },
            unit: self.unit(pair),
            seed: self.seed,
            ..MatchOptions::default()
        })
    }

    /// What may spoil a match, or what is odd about it.
    fn warnings(&self, pair: &Pair, found: &Correspondence) -> Vec<String> {
        let (a, b) = (&pair.first.shape, &pair.second.shape);
        let mut warnings = Vec::new();
        let ratio = a.volume() / b.volume();
        if !(1.0 - UNLIKE..=1.0 / (1.0 - UNLIKE)).contains(&ratio) {
            let percent = 100.0 * (1.0 - ratio.min(1.0 / ratio));
            warnings.push(format!(
                "the volumes of the shapes differ by {percent:.0} %: shapes made alike (of one decay, one resolution) match \
                 better, and only for those is the verdict calibrated"
            ));
        }
        for (name, shape) in [("first", a), ("second", b)] {
            let share = shape.report().boundary_share;
            if share > POROUS {
                warnings.push(format!(
                    "{:.0} % of the points of the {name} shape lie on its boundary: a smaller --spacing or --decay shows \
                     more of its inside",
                    100.0 * share
                ));
            }
        }
        if found.mirrored {
            let says = "the mirror image of the first shape fits the second one better than the shape itself";
            warnings.push(says.to_owned());
        }
        warnings
    }

    /// Seeks the correspondence, as a stage of the session, and notes it.
    pub fn find(&self, pair: &Pair, session: &Session) -> Result<Correspondence, Failure> {
        let options = MatchOptions {
            max_memory: session.memory(),
            ..self.options(pair)?
        };
        let bytes = expected_bytes(&pair.first.shape, &pair.second.shape);
        session.note("expected_bytes", bytes)?;
        let on = session.on(session.device.corresp());
        let found = session.stage("correspondence", || {
            correspond(&pair.first.shape, &pair.second.shape, &options, on)
        })?;
        let unmatched = found.unmatched(UNMATCHED * options.unit);
        let unmatched = unmatched.iter().filter(|u| **u).count() as f64 / unmatched.len() as f64;
        session.note(
            "correspondence",
            json!({
                "warnings": self.warnings(pair, &found),
                "mirrored": found.mirrored,
                "unmatched": unmatched,
                "verdict": found.verdict,
                "score": found.score,
                "coverage": found.coverage,
                "turned": found.turned,
                "candidates": found.candidates,
                "joint_eigenvalues": found.modes.values,
                "joint_correlations": found.modes.correlations,
                "joint_dropped": found.modes.dropped,
            }),
        )?;
        Ok(found)
    }
}
