//! Arguments that several programs have, under the names of the crates' option fields.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use clap::builder::{EnumValueParser, TypedValueParser};
use clap::{Args, ValueEnum};
use dual_contour::{Extent, Material, Outer, Resolution, Shape, Zone};
use gauss_density::{Cutoff, Levels};
use geom_core::io::structure::{self, Models, Radii, ReadOptions, ReadStructure};
use geom_core::structure::Selector;
use geom_core::{Aabb, Point3, Structure, Vector3};
use serde::{Serialize, Serializer};

use crate::device::left_out;
use crate::input::source::Source;
use crate::picture::Renderer;
use crate::{Failure, Session};

/// Where kernels run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum BackendName {
    /// The CPU
    Cpu,
    /// A GPU, through wgpu; an error where there is no adapter
    Wgpu,
    /// A GPU if there is one in hardware, else the CPU
    Auto,
}

/// Any of these but a GPU in a build without.
fn but_gpu_if_none<T>(gpu: T) -> impl TypedValueParser<Value = T>
where
    T: ValueEnum + PartialEq + Send + Sync + 'static,
{
    let in_build = move |asked| match cfg!(feature = "wgpu") || asked != gpu {
        true => Ok(asked),
        false => Err(left_out("GPU", "wgpu")),
    };
    EnumValueParser::<T>::new().try_map(in_build)
}

/// A path as it stands in a report: names of files need not be UTF-8, JSON must.
pub fn as_text<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&path.to_string_lossy())
}

/// The same of one that may be absent.
pub fn as_text_if_any<S: Serializer>(path: &Option<PathBuf>, to: S) -> Result<S::Ok, S::Error> {
    match path {
        Some(path) => as_text(path, to),
        None => to.serialize_none(),
    }
}

/// What every program asks.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "How to run")]
pub struct Common {
    /// Folder for all outputs, made if it is absent; a failed run leaves nothing there
    #[arg(long, short, value_name = "DIR")]
    #[serde(serialize_with = "as_text")]
    pub out: PathBuf,
    /// Where kernels run
    #[arg(long, value_parser = but_gpu_if_none(BackendName::Wgpu), default_value = "cpu")]
    pub backend: BackendName,
    /// Threads [default: one per core]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Most memory that a file may unpack to, and grids may take, e.g. 500M or 4G [default: half of what is free]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub max_memory: Option<u64>,
    /// What draws the pictures
    #[arg(long, value_parser = but_gpu_if_none(Renderer::Wgpu), default_value = "auto")]
    pub renderer: Renderer,
    /// No PNG pictures, and no page
    #[arg(long)]
    pub no_pictures: bool,
    /// No progress bars and no summary
    #[arg(long, short)]
    pub quiet: bool,
}

impl Common {
    /// The memory limit in bytes: the asked one, else half of what is free now.
    pub fn memory(&self) -> u64 {
        self.max_memory.unwrap_or_else(|| {
            let mut system = sysinfo::System::new();
            system.refresh_memory();
            // In a container its own limit counts.
            let free = system
                .cgroup_limits()
                .map_or(u64::MAX, |limits| limits.free_memory);
            (system.available_memory().min(free) / 2).max(64 << 20)
        })
    }
}

/// Programs whose arguments hold the common ones.
pub trait HasCommon {
    /// The common arguments.
    fn common(&self) -> &Common;
    /// The input files.
    fn inputs(&self) -> Vec<PathBuf>;
}

/// Bytes with an optional unit: `K`, `M`, `G`, `T`, powers of 1024, with or without `B` or `iB`.
pub fn bytes(text: &str) -> Result<u64, String> {
    let bad = || format!("{text:?} is not a number of bytes like 500M or 4G");
    let lower = text.trim().to_ascii_lowercase();
    let bare = lower
        .strip_suffix("ib")
        .or(lower.strip_suffix('b'))
        .unwrap_or(&lower);
    let (number, shift) = match bare.chars().last() {
        Some('k') => (&bare[..bare.len() - 1], 10),
        Some('m') => (&bare[..bare.len() - 1], 20),
        Some('g') => (&bare[..bare.len() - 1], 30),
        Some('t') => (&bare[..bare.len() - 1], 40),
        _ => (bare, 0),
    };
    let value: f64 = number.trim().parse().map_err(|_| bad())?;
    let total =
        value * f64::from(1u32 << (shift % 32)) * if shift >= 32 { 4_294_967_296.0 } else { 1.0 };
    if (1.0..1e18).contains(&total) {
        Ok(total as u64)
    } else {
        Err(bad())
    }
}

/// The density model (Eqs. 3.1–3.6 of the thesis).
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "Density")]
pub struct ModelArgs {
    /// Power per residue: below 1 blurs, above 1 sharpens
    #[arg(long, value_name = "P", default_value_t = Levels::default().residue_power)]
    pub residue_power: f64,
    /// Power per chain
    #[arg(long, value_name = "P", default_value_t = Levels::default().chain_power)]
    pub chain_power: f64,
    /// Power per domain: a model or a copy of an assembly
    #[arg(long, value_name = "P", default_value_t = Levels::default().domain_power)]
    pub domain_power: f64,
    /// Decay of an atom's kernel, 1/Å²: smaller is smoother
    #[arg(long, value_name = "KAPPA", default_value_t = Levels::default().decay)]
    pub decay: f64,
}

impl ModelArgs {
    /// As the crate takes it.
    pub fn levels(&self) -> Levels {
        Levels {
            residue_power: self.residue_power,
            chain_power: self.chain_power,
            domain_power: self.domain_power,
            decay: self.decay,
        }
    }
}

/// How a structure is sampled.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "Density")]
pub struct DensityArgs {
    /// Distance of lattice points, Å [default: 0.5, more from 1000 atoms on]
    #[arg(long, value_name = "H")]
    pub spacing: Option<f64>,
    /// What may be left out: this share of the density wherever it matters
    #[arg(long, value_name = "EPS", default_value_t = 1e-4)]
    pub cutoff: f64,
    /// Space around the outermost atom centres, Å [default: far enough that the surface closes]
    #[arg(long, value_name = "LENGTH")]
    pub margin: Option<f64>,
    /// The model.
    #[command(flatten)]
    pub model: ModelArgs,
}

impl DensityArgs {
    /// As the crate takes them.
    pub fn options(&self, structure: &Structure, session: &Session) -> gauss_density::Options {
        gauss_density::Options {
            spacing: self
                .spacing
                .unwrap_or_else(|| default_spacing(structure.atoms().len())),
            cutoff: Cutoff(self.cutoff),
            margin: self.margin,
            max_memory: session.memory(),
            ..Default::default()
        }
    }
}

/// What is kept of a structure file.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "Reading structures")]
pub struct ReaderArgs {
    /// Models: first, all (a domain each) or a number
    #[arg(long, value_name = "first|all|N", default_value_t)]
    #[serde(serialize_with = "shown")]
    pub models: Models,
    /// Build this assembly, by its name in the file
    #[arg(long, value_name = "ID")]
    pub assembly: Option<String>,
    /// Keep only these parts, e.g. A,B:10-25,name:HEM
    #[arg(long, value_name = "SELECTOR")]
    #[serde(serialize_with = "shown_if_any")]
    pub select: Option<Selector>,
    /// Leave out hydrogens
    #[arg(long)]
    pub no_hydrogens: bool,
    /// Keep water
    #[arg(long)]
    pub waters: bool,
    /// Leave out ions
    #[arg(long)]
    pub no_ions: bool,
    /// Leave out ligands: what is neither polymer, ion nor water
    #[arg(long)]
    pub no_ligands: bool,
    /// Where radii come from
    #[arg(long, value_enum, default_value_t)]
    pub radii: RadiiFrom,
    /// Raise smaller radii to this, Å
    #[arg(long, value_name = "LENGTH", default_value_t = 0.0)]
    pub min_radius: f64,
}

/// Where radii come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RadiiFrom {
    /// The file where it has radii (PQR), else the elements.
    #[default]
    File,
    /// Van der Waals radii of the elements.
    Elements,
    /// Heavy atoms together with their hydrogens, which are left out.
    United,
}

fn shown<S: serde::Serializer>(value: &impl std::fmt::Display, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(value)
}

/// A selector as it is written, for reports.
pub fn shown_if_any<S: serde::Serializer>(
    value: &Option<Selector>,
    to: S,
) -> Result<S::Ok, S::Error> {
    match value {
        Some(selector) => to.collect_str(selector),
        None => to.serialize_none(),
    }
}

impl ReaderArgs {
    /// As the reader takes them.
    pub fn options(&self) -> ReadOptions {
        ReadOptions {
            models: self.models,
            assembly: self.assembly.clone(),
            select: self.select.clone(),
            hydrogens: !self.no_hydrogens,
            waters: self.waters,
            ions: !self.no_ions,
            ligands: !self.no_ligands,
            radii: match self.radii {
                RadiiFrom::File => Radii::File,
                RadiiFrom::Elements => Radii::Elements,
                RadiiFrom::United => Radii::United,
            },
            min_radius: self.min_radius,
            ..Default::default()
        }
    }

    /// Reads a structure, as a stage of the session, and notes what was kept.
    pub fn read(&self, session: &Session, path: &Path) -> Result<ReadStructure, Failure> {
        let options = ReadOptions {
            max_bytes: session.memory(),
            ..self.options()
        };
        let read = session.stage("reading", || structure::read(path, &options))?;
        session.note("structure", &read.report)?;
        let s = &read.structure;
        let counts = serde_json::json!({
            "atoms": s.atoms().len(),
            "residues": s.residues().len(),
            "chains": s.chains().len(),
            "domains": s.domains().len(),
        });
        session.note("counts", counts)?;
        Ok(read)
    }
}

/// 0.5 Å for small proteins, more for larger ones, so that the tetrahedra inside stay about a million
/// from 1000 to 30,000 atoms; never more than 1.6 Å, where atoms begin to be lost.
pub fn default_spacing(atoms: usize) -> f64 {
    let fine = 0.5 * (atoms as f64 / 1000.0).cbrt().clamp(1.0, 3.2);
    (fine * 20.0).round() / 20.0
}

/// Atoms around which another tolerance holds.
#[derive(Clone, Debug, Serialize)]
pub struct Finer {
    /// Which.
    #[serde(serialize_with = "shown")]
    pub atoms: Selector,
    /// The tolerance, Å.
    pub tolerance: f64,
}

/// How a field is meshed.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "Meshing")]
pub struct MeshArgs {
    /// How to mesh [default: stuffing; dual-contour where --tolerance, --zone, --finer or --placement asks for it]
    #[arg(long, value_enum)]
    pub method: Option<Method>,
    /// Size of the finest cells, Å [default: the spacing of the lattice]
    #[arg(long, value_name = "LENGTH")]
    pub cell: Option<f64>,
    /// Instead: about this many tetrahedra
    #[arg(long, value_name = "N", conflicts_with = "cell")]
    pub tets: Option<u64>,
    /// Coarser cells where the surface is flat: error allowed, Å
    #[arg(long, value_name = "LENGTH", default_value_t = 0.0)]
    pub tolerance: f64,
    /// How the terms of that error are put together
    #[arg(long, value_enum, default_value_t)]
    pub error_norm: ErrorNorm,
    /// A ball in which another tolerance holds: centre, radius and tolerance; may be repeated
    #[arg(long, value_name = "X,Y,Z:R:LENGTH", value_parser = zone, allow_hyphen_values = true)]
    pub zone: Vec<Zone>,
    /// Atoms around which another tolerance holds, such as A,B:10-25=0.1; may be repeated
    #[arg(long, value_name = "SELECTOR=LENGTH", value_parser = finer)]
    pub finer: Vec<Finer>,
    /// Largest cells, Å [default: as large as the balance of the octree allows, so that cells inside stay coarse
    /// when --spacing is halved; studies of convergence halve both]
    #[arg(long, value_name = "LENGTH")]
    pub max_cell: Option<f64>,
    /// Where the vertices of dual contouring go within cells [default: newton]
    #[arg(long, value_enum)]
    pub placement: Option<Placement>,
    /// What to do where the surface meets the box of the lattice
    #[arg(long, value_enum, default_value_t)]
    pub at_box: AtBox,
    /// Drop pieces and cavities of fewer lattice points than this
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub prune: u32,
}

impl MeshArgs {
    /// An error where the largest cells are to be smaller than the finest: none could be made.
    fn refuse_small_cells(&self, source: &Source) -> Result<(), Failure> {
        let finest = match (self.cell, self.tets) {
            (None, Some(_)) => None,
            (cell, _) => {
                Some(cell.unwrap_or(geom_core::LatticeValues::lattice(&source.values).spacing))
            }
        };
        if let (Some(most), Some(finest)) = (self.max_cell, finest)
            && most < finest * (1.0 - 1e-9)
        {
            return Err(format!(
                "--max-cell {most} is below the finest cells, which are {finest} Å: --cell and --spacing make these smaller"
            )
            .into());
        }
        Ok(())
    }

    /// As the crate takes them, for the surface of `source`; an error where options contradict each
    /// other.
    pub fn options(
        &self,
        source: &Source,
        session: &Session,
    ) -> Result<dual_contour::Options, Failure> {
        // Only dual contouring grades cells along the surface, so what asks for that chooses it.
        let uneven = self.tolerance > 0.0 || !self.zone.is_empty() || !self.finer.is_empty();
        let dual = uneven || self.placement.is_some();
        let method = self.method.unwrap_or(if dual {
            Method::DualContour
        } else {
            Method::Stuffing
        });
        if method == Method::Stuffing && self.placement.is_some() {
            return Err("--placement is of --method dual-contour".into());
        }
        if method == Method::Stuffing && uneven {
            return Err("--tolerance, --zone and --finer are of --method dual-contour".into());
        }
        if !uneven {
            session.refuse(&["error_norm"], "needs --tolerance, --zone or --finer")?;
        }
        let mut zones = self.zone.clone();
        for finer in &self.finer {
            let Some(structure) = source.structure() else {
                return Err("--finer names atoms, and a grid has none; use --zone".into());
            };
            zones.extend(zones_around(structure, finer)?);
        }
        self.refuse_small_cells(source)?;
        Ok(dual_contour::Options {
            level: source.level,
            method: method.into(),
            resolution: match (self.cell, self.tets) {
                (Some(cell), _) => Resolution::Spacing(cell),
                (None, Some(tets)) => Resolution::Tets(tets),
                (None, None) => Resolution::Lattice,
            },
            prune: self.prune,
            tolerance: self.tolerance,
            error_norm: match self.error_norm {
                ErrorNorm::Sum => dual_contour::ErrorNorm::Sum,
                ErrorNorm::Max => dual_contour::ErrorNorm::Max,
            },
            zones,
            max_cell: self.max_cell.unwrap_or(f64::INFINITY),
            placement: match self.placement.unwrap_or_default() {
                Placement::Mass => dual_contour::Placement::Mass,
                Placement::Newton => dual_contour::Placement::Newton,
                Placement::Qef => dual_contour::Placement::Qef,
            },
            at_box: match self.at_box {
                AtBox::Refuse => dual_contour::AtBox::Refuse,
                AtBox::Cap => dual_contour::AtBox::Cap,
                AtBox::Clip => dual_contour::AtBox::Clip,
            },
            max_memory: session.memory(),
            ..Default::default()
        })
    }
}

/// What is filled with tetrahedra.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "Regions")]
pub struct VolumeArgs {
    /// What to mesh
    #[arg(long, value_enum, default_value_t)]
    pub region: Region,
    /// Where the exterior ends: grid (the lattice's box), box:SCALE (that box scaled about its middle) or sphere:SCALE (its
    /// half diagonal scaled); grid and box are enlarged to whole blocks of the octree, of 8 finest cells or more, on their upper
    /// sides too
    #[arg(long, value_name = "grid|box:S|sphere:S", default_value = "grid", value_parser = outer)]
    pub outer: Outer,
    /// A material between two planes, e.g. a membrane z:-15:15; may be repeated
    #[arg(long, value_name = "AXIS:LOW:HIGH", value_parser = slab, allow_hyphen_values = true)]
    pub slab: Vec<Shape>,
    /// A material in a cylinder between two points; may be repeated
    #[arg(long, value_name = "X,Y,Z:X,Y,Z:R", value_parser = cylinder, allow_hyphen_values = true)]
    pub cylinder: Vec<Shape>,
    /// A material in a ball; may be repeated
    #[arg(long, value_name = "X,Y,Z:R", value_parser = ball, allow_hyphen_values = true)]
    pub ball: Vec<Shape>,
    /// A material in an axis-aligned box between two corners; may be repeated
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = cuboid, allow_hyphen_values = true)]
    pub cuboid: Vec<Shape>,
    /// Take the membrane's planes from the structure file (dummy atoms as in the OPM database)
    #[arg(long)]
    pub membrane: bool,
    /// Give each separate part of the exterior a region number of its own
    #[arg(long)]
    pub separate_exterior: bool,
}

impl VolumeArgs {
    /// What these and the options of the surface ask for together.
    pub fn options(
        &self,
        mesh: &MeshArgs,
        source: &Source,
        session: &Session,
    ) -> Result<dual_contour::Options, Failure> {
        let mut shapes = [&self.cylinder[..], &self.ball, &self.cuboid, &self.slab].concat();
        if self.membrane {
            let planes = source
                .membrane
                .ok_or("the file has no dummy atoms that mark a membrane; give --slab")?;
            shapes.push(Shape::Slab {
                normal: Vector3::z(),
                low: planes.lower,
                high: planes.upper,
            });
        }
        if self.region == Region::Interior && !shapes.is_empty() {
            return Err(
                "--cylinder, --ball, --cuboid, --slab and --membrane lie outside of the molecule: take --region both or exterior"
                    .into(),
            );
        }
        Ok(dual_contour::Options {
            region: self.region.into(),
            outer: self.outer,
            separate_exterior: self.separate_exterior,
            materials: (2..)
                .zip(shapes)
                .map(|(region, shape)| Material { region, shape })
                .collect(),
            ..mesh.options(source, session)?
        })
    }
}

/// How the terms of the error are put together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorNorm {
    /// Their sum, as published.
    #[default]
    Sum,
    /// The largest.
    Max,
}

/// Where vertices go within cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Placement {
    /// The mean of the points where edges cross the surface, as in the thesis.
    Mass,
    /// From there onto the surface.
    #[default]
    Newton,
    /// The point nearest to the tangent planes: for creases.
    Qef,
}

/// What to do where the surface meets the box of the lattice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AtBox {
    /// Stop with an error.
    #[default]
    Refuse,
    /// Close the surface within a cell of the box.
    Cap,
    /// End the mesh at the planes of the box.
    Clip,
}

/// Which regions are meshed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Region {
    /// The molecule.
    #[default]
    Interior,
    /// All but the molecule.
    Exterior,
    /// Everything, conforming across the surface.
    Both,
}

impl From<Region> for Extent {
    fn from(region: Region) -> Self {
        match region {
            Region::Interior => Self::Interior,
            Region::Exterior => Self::Exterior,
            Region::Both => Self::Both,
        }
    }
}

/// Which mesher.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Dual contouring on an octree: fewer elements; may adapt along the surface
    DualContour,
    /// Isosurface stuffing on the same octree: better angles in a fraction of the time
    #[default]
    #[value(alias = "lattice")]
    Stuffing,
}

impl From<Method> for dual_contour::Method {
    fn from(method: Method) -> Self {
        match method {
            Method::DualContour => Self::DualContour,
            Method::Stuffing => Self::Stuffing,
        }
    }
}

/// `grid`, `box:SCALE` or `sphere:SCALE`.
pub fn outer(text: &str) -> Result<Outer, String> {
    let scale = |s: &str| {
        s.parse::<f64>()
            .map_err(|_| format!("{s:?} is not a number"))
    };
    match text.split_once(':') {
        None if text == "grid" => Ok(Outer::Grid),
        Some(("box", s)) => Ok(Outer::Box { scale: scale(s)? }),
        Some(("sphere", s)) => Ok(Outer::Sphere { scale: scale(s)? }),
        _ => Err(format!("{text:?} is none of grid, box:1.5, sphere:2")),
    }
}

/// `x:LOW:HIGH`, `y:LOW:HIGH` or `z:LOW:HIGH`: the space between two planes.
pub fn slab(text: &str) -> Result<Shape, String> {
    let bad = || format!("{text:?} is not like z:-15:15");
    let mut parts = text.split(':');
    let axis = match parts.next() {
        Some("x") => 0,
        Some("y") => 1,
        Some("z") => 2,
        _ => return Err(bad()),
    };
    let numbers: Vec<f64> = parts
        .map(|p| p.parse().map_err(|_| bad()))
        .collect::<Result<_, _>>()?;
    let [low, high] = numbers[..] else {
        return Err(bad());
    };
    if low.partial_cmp(&high) != Some(Ordering::Less) {
        return Err(format!("{text:?}: {low} is not below {high}"));
    }
    Ok(Shape::Slab {
        normal: Vector3::ith(axis, 1.0),
        low,
        high,
    })
}

/// `X,Y,Z:X,Y,Z:RADIUS`: a cylinder between two points.
pub fn cylinder(text: &str) -> Result<Shape, String> {
    let bad = || format!("{text:?} is not like 0,0,-20:0,0,20:5");
    let parts: Vec<&str> = text.split(':').collect();
    let [start, end, radius] = parts[..] else {
        return Err(bad());
    };
    let (start, end) = (point(start).ok_or_else(bad)?, point(end).ok_or_else(bad)?);
    if start == end {
        return Err(format!("{text:?}: the cylinder has no length"));
    }
    Ok(Shape::Cylinder {
        start,
        end,
        radius: radius_of(text, radius).ok_or_else(bad)??,
    })
}

/// A radius at the end of a shape; `None` if it is no number, an error if no shape has it.
fn radius_of(text: &str, radius: &str) -> Option<Result<f64, String>> {
    let radius: f64 = radius.parse().ok()?;
    let fits = radius > 0.0 && radius.is_finite();
    Some(match fits {
        true => Ok(radius),
        false => Err(format!("{text:?}: the radius is not above 0")),
    })
}

/// `X,Y,Z:RADIUS`: a ball.
pub fn ball(text: &str) -> Result<Shape, String> {
    let bad = || format!("{text:?} is not like 0,0,0:12");
    let (center, radius) = text.split_once(':').ok_or_else(bad)?;
    Ok(Shape::Sphere {
        center: point(center).ok_or_else(bad)?,
        radius: radius_of(text, radius).ok_or_else(bad)??,
    })
}

/// `X,Y,Z:X,Y,Z`: an axis-aligned box between two corners.
pub fn cuboid(text: &str) -> Result<Shape, String> {
    let bad = || format!("{text:?} is not like -5,-5,-5:5,5,5");
    let (low, high) = text.split_once(':').ok_or_else(bad)?;
    let corners = [low, high].map(|c| point(c).ok_or_else(bad));
    let [low, high] = corners;
    let (low, high) = (low?, high?);
    if (0..3).any(|k| low[k] == high[k]) {
        return Err(format!("{text:?}: the corners span no box"));
    }
    Ok(Shape::Cuboid(Aabb::of_points(&[low, high])))
}

/// `X,Y,Z:RADIUS:TOLERANCE`: a ball in which another tolerance holds.
pub fn zone(text: &str) -> Result<Zone, String> {
    let bad = || format!("{text:?} is not like 0,0,0:8:0.1");
    let parts: Vec<&str> = text.split(':').collect();
    let [center, radius, tolerance] = parts[..] else {
        return Err(bad());
    };
    let radius: f64 = radius.parse().map_err(|_| bad())?;
    if radius.is_nan() || radius <= 0.0 {
        return Err(format!("the radius of {text:?} must be positive"));
    }
    Ok(Zone {
        center: point(center).ok_or_else(bad)?,
        radius,
        tolerance: tolerance.parse().map_err(|_| bad())?,
    })
}

/// `SELECTOR=TOLERANCE`: the atoms around which another tolerance holds.
pub fn finer(text: &str) -> Result<Finer, String> {
    let bad = || format!("{text:?} is not like A,B:10-25=0.1");
    let (selector, tolerance) = text.rsplit_once('=').ok_or_else(bad)?;
    Ok(Finer {
        atoms: Selector::parse(selector).map_err(|e| e.to_string())?,
        tolerance: tolerance.trim().parse().map_err(|_| bad())?,
    })
}

/// A ball about every atom selected, as wide as its surface at the usual powers lies outside it.
fn zones_around(structure: &Structure, finer: &Finer) -> Result<Vec<Zone>, Failure> {
    let margin = 1.5;
    let selected = structure.select(&finer.atoms)?;
    let atoms = selected.atom_ranges(structure).flatten();
    Ok(atoms
        .map(|a| Zone {
            center: structure.atoms()[a].position,
            radius: structure.atoms()[a].radius + margin,
            tolerance: finer.tolerance,
        })
        .collect())
}

fn point(text: &str) -> Option<Point3> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|p| p.trim().parse().ok())
        .collect::<Option<_>>()?;
    let [x, y, z] = numbers[..] else { return None };
    Some(Point3::new(x, y, z))
}
