//! Where a field comes from: the atoms of a structure, or a grid of anybody (a cryo-EM map, a
//! potential).

use std::path::{Path, PathBuf};

use clap::Args;
use gauss_density::{Cutoff, DensityBackend, Model, PointSampler, sample_band};
use geom_core::io::structure::Membrane;
use geom_core::{
    BrickGrid, FieldAtMany, ImplicitField, Lattice, LatticeValues, Point3, ScalarGrid, Structure,
    TriMesh, Vector3, io,
};
use serde::Serialize;
use serde_json::json;

use crate::args::{DensityArgs, ReaderArgs};
use crate::{Failure, Session};

/// A structure or a grid, and how to make a field of it.
#[derive(Clone, Debug, Args, Serialize)]
pub struct SourceArgs {
    /// Structure (PDB, mmCIF, PQR) or grid (MRC, CCP4, OpenDX), each also gzip-compressed; for what begins with a surface (06 to 11)
    /// also a mesh (PLY, OFF, OBJ, STL, GLB, VTU, MSH)
    #[serde(serialize_with = "crate::args::as_text")]
    pub input: PathBuf,
    /// Grids: the value on the surface; inside it is larger
    #[arg(long, value_name = "VALUE", help_heading = "Grids")]
    pub isovalue: Option<f64>,
    /// Grids, instead: the isovalue whose surface by dual contouring encloses this volume, Å³ (by stuffing it encloses 1 to 4 %
    /// more in cells of 1 to 2 Å)
    #[arg(
        long,
        value_name = "VOLUME",
        conflicts_with = "isovalue",
        help_heading = "Grids"
    )]
    pub enclosed_volume: Option<f64>,
    /// The density of structures.
    #[command(flatten)]
    pub density: DensityArgs,
    /// How structures are read.
    #[command(flatten)]
    pub reader: ReaderArgs,
}

/// A field ready to be meshed.
pub struct Source {
    /// Its values and what lies between them.
    pub values: Values,
    /// The value on the surface.
    pub level: f64,
    /// The planes of a membrane, if the structure's file marks one.
    pub membrane: Option<Membrane>,
}

/// Values on a lattice and what they were sampled from.
pub enum Values {
    /// The density of atoms, near the surface only.
    Atoms(Box<Atoms>),
    /// A grid from a file.
    Grid(ScalarGrid),
}

/// Atoms and their density.
pub struct Atoms {
    structure: Structure,
    model: Model,
    cutoff: Cutoff,
    grid: BrickGrid,
}

impl LatticeValues for Values {
    fn lattice(&self) -> &Lattice {
        match self {
            Self::Atoms(atoms) => atoms.grid.lattice(),
            Self::Grid(grid) => grid.lattice(),
        }
    }
    fn at(&self, point: [usize; 3]) -> f32 {
        match self {
            Self::Atoms(atoms) => atoms.grid.at(point),
            Self::Grid(grid) => grid.at(point),
        }
    }
}

/// The options that only structures have.
pub const OF_STRUCTURES: [&str; 17] = [
    "color",
    "spacing",
    "cutoff",
    "margin",
    "residue_power",
    "chain_power",
    "domain_power",
    "decay",
    "models",
    "assembly",
    "select",
    "no_hydrogens",
    "waters",
    "no_ions",
    "no_ligands",
    "radii",
    "min_radius",
];

/// The extension of a file name, lower-case, before `.gz`.
pub fn extension(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.to_ascii_lowercase();
    let stem = name.strip_suffix(".gz").unwrap_or(&name);
    stem.rsplit_once('.')
        .map_or_else(String::new, |(_, e)| e.to_owned())
}

/// What kind of input a file is.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Atoms; also what has no known extension.
    Structure,
    /// A density map.
    Grid,
    /// A surface, or tetrahedra.
    Mesh,
}

impl Kind {
    /// By the extension of its name.
    pub fn of(path: &Path) -> Self {
        match extension(path).as_str() {
            "mrc" | "map" | "ccp4" | "dx" => Self::Grid,
            "ply" | "off" | "obj" | "stl" | "vtu" | "msh" | "glb" => Self::Mesh,
            _ => Self::Structure,
        }
    }
}

impl SourceArgs {
    /// Refuses the options that say nothing of a mesh.
    pub fn refuse_beside_mesh(session: &Session) -> Result<(), Failure> {
        session.refuse(&OF_STRUCTURES, "is for structures, and the input is a mesh")?;
        let of_grids = ["isovalue", "enclosed_volume"];
        session.refuse(&of_grids, "is for grids, and the input is a mesh")
    }

    /// Reads a grid, or a structure and samples it, as stages of the session.
    pub fn read(&self, session: &Session) -> Result<Source, Failure> {
        match Kind::of(&self.input) {
            Kind::Grid => self.read_grid(session),
            Kind::Structure => self.read_structure(session),
            Kind::Mesh => Err(format!(
                "{}: a mesh, and this begins with atoms or a grid; 04_improve, 06 to 15 and 17 take meshes",
                self.input.display()
            )
            .into()),
        }
    }

    fn read_structure(&self, session: &Session) -> Result<Source, Failure> {
        if self.isovalue.is_some() || self.enclosed_volume.is_some() {
            return Err("--isovalue and --enclosed-volume are for grids; the surface of a structure has the density 1".into());
        }
        let read = self.reader.read(session, &self.input)?;
        let structure = read.structure;
        let model = Model::uniform(&structure, &self.density.model.levels())?;
        let options = self.density.options(&structure, session);
        let sampled = session.stage("density", || {
            sample_band(&model, &options, session.on(session.device.density()))
        })?;
        session.note("density", &sampled.report)?;
        session.note("spacing", options.spacing)?;
        Ok(Source {
            values: Values::Atoms(Box::new(Atoms {
                structure,
                model,
                cutoff: options.cutoff,
                grid: sampled.grid,
            })),
            level: 1.0,
            membrane: read.report.membrane,
        })
    }

    fn read_grid(&self, session: &Session) -> Result<Source, Failure> {
        session.refuse(&OF_STRUCTURES, "is for structures, and the input is a grid")?;
        let file = session.stage("reading", || {
            io::grid::read_up_to(&self.input, session.memory())
        })?;
        let (bytes, most) = (4 * file.values().len() as u64, session.memory());
        if bytes > most {
            let path = self.input.display();
            return Err(format!("{path}: {bytes} bytes of values; --max-memory is {most}").into());
        }
        let grid = file.into_grid().map_err(|e| e.in_file(&self.input))?;
        let level = match (self.isovalue, self.enclosed_volume) {
            (Some(level), _) => level,
            (None, Some(volume)) => enclosing(&grid, volume, session)?,
            (None, None) => {
                let (low, high) = grid.range().unwrap_or_default();
                return Err(format!("a grid needs --isovalue or --enclosed-volume; its values lie between {low} and {high}").into());
            }
        };
        let lattice = grid.lattice();
        let noted = json!({ "lattice": lattice, "range": grid.range(), "isovalue": level });
        session.note("grid", noted)?;
        session.note("spacing", lattice.spacing)?;
        let counts = json!({ "grid_points": grid.values().len() });
        session.note("counts", counts)?;
        Ok(Source {
            values: Values::Grid(grid),
            level,
            membrane: None,
        })
    }
}

impl Source {
    /// The structure, if the field comes from one.
    pub fn structure(&self) -> Option<&Structure> {
        match &self.values {
            Values::Atoms(atoms) => Some(&atoms.structure),
            Values::Grid(_) => None,
        }
    }

    /// The field between the lattice points: analytic from atoms, trilinear from a grid.
    pub fn field(&self, session: &Session) -> Result<Field<'_>, Failure> {
        match &self.values {
            Values::Atoms(atoms) => {
                Field::of_atoms(&atoms.model, atoms.cutoff, session.device.density())
            }
            Values::Grid(grid) => Ok(Field::Grid(grid)),
        }
    }
}

/// A field between the points of its lattice.
pub enum Field<'a> {
    /// Of atoms.
    Atoms(Box<PointSampler<'a>>),
    /// Of a grid.
    Grid(&'a ScalarGrid),
}

impl<'a> Field<'a> {
    /// The density between the points of its lattice, analytic.
    pub fn of_atoms<B: DensityBackend + ?Sized>(
        model: &'a Model,
        cutoff: Cutoff,
        backend: &B,
    ) -> Result<Self, Failure> {
        let sampler = PointSampler::new(model, cutoff)?.on(backend)?;
        Ok(Self::Atoms(Box::new(sampler)))
    }
}

impl ImplicitField for Field<'_> {
    fn value(&self, x: &Point3) -> f64 {
        match self {
            Self::Atoms(field) => field.value(x),
            Self::Grid(field) => field.value(x),
        }
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        match self {
            Self::Atoms(field) => field.value_gradient(x),
            Self::Grid(field) => field.value_gradient(x),
        }
    }
    fn at_many(&self) -> Option<&dyn FieldAtMany> {
        match self {
            Self::Atoms(field) => field.at_many(),
            Self::Grid(_) => None,
        }
    }
}

/// The isovalue whose surface encloses a volume, Å³: that of as many lattice points, corrected by what its surface turns out to
/// enclose. Values that fall off ever more slowly, as those of atoms do, have it further out than their points say.
fn enclosing(grid: &ScalarGrid, volume: f64, session: &Session) -> Result<f64, Failure> {
    const ROUNDS: usize = 4;
    const CLOSE: f64 = 2e-3;
    let of_points = |asked: f64| grid.level_enclosing(asked).map(f64::from);
    let mut level = of_points(volume).ok_or_else(|| {
        let all = grid.values().len() as f64 * grid.lattice().spacing.powi(3);
        format!(
            "--enclosed-volume {volume} Å³ does not lie between 0 and the whole grid of {all:.0} Å³"
        )
    })?;
    let enclosed = |level: f64| contour(session, grid, level, None).map(|mesh| mesh.volume());
    session.stage("isovalue", || {
        let mut asked = volume;
        for _ in 0..ROUNDS {
            // Of so few points that there is no surface, the number of points has to do.
            let Ok(found) = enclosed(level) else { break };
            if found.is_nan() || found <= 0.0 || (found / volume - 1.0).abs() < CLOSE {
                break;
            }
            asked *= volume / found;
            match of_points(asked) {
                Some(next) => level = next,
                None => break,
            }
        }
        Ok::<_, Failure>(level)
    })
}

/// The surface of a grid at a level; closed where the body reaches the box.
pub fn contour(
    session: &Session,
    grid: &ScalarGrid,
    level: f64,
    field: Option<&dyn ImplicitField>,
) -> Result<TriMesh, Failure> {
    let options = dual_contour::Options {
        level,
        at_box: dual_contour::AtBox::Cap,
        max_memory: session.memory(),
        ..Default::default()
    };
    let on = session.on(session.device.contour());
    Ok(dual_contour::surface(grid, field, &options, on)?.mesh)
}
