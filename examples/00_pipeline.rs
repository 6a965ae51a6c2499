//! 00 — From atoms to an improved tetrahedral mesh: the main job.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon, MeshArgs, Region, VolumeArgs};
use biogeom_examples::batch::{Batch, BatchArgs};
use biogeom_examples::device::left_out;
use biogeom_examples::input::labels::LabelArgs;
use biogeom_examples::input::source::{Source, SourceArgs};
use biogeom_examples::{Failure, Session, products, steps};
use clap::builder::{EnumValueParser, TypedValueParser};
use clap::{Parser, ValueEnum};
use gauss_density::{Model, sample};
use geom_core::{Structure, TriMesh};
use serde::Serialize;

/// From atoms or a grid to a quality tetrahedral mesh, inside and outside of the molecule's surface
#[derive(Clone, Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    volume: VolumeArgs,
    /// What to make: tets (with their surface), surface (alone), density, modes, quads, tmesh, spline, segments, pockets, or
    /// all of them. Each of the last seven has a folder of its own and is done as its program does it by default. `cargo
    /// pipeline` has the first three
    #[arg(long, value_name = "STAGES", value_parser = EnumValueParser::<Stage>::new().try_map(Stage::in_build), value_delimiter = ',', hide_possible_values = true, default_value = "tets")]
    stages: Vec<Stage>,
    /// Watch every step that it lets no walls of gaps that are not meshed cross, instead of parting them at the end; takes
    /// up to three times as long, and is for surfaces of which the report still counts crossing pairs
    #[arg(long)]
    keep_apart: bool,
    #[command(flatten)]
    labels: LabelArgs,
    #[command(flatten)]
    #[serde(skip)]
    batch: BatchArgs,
    #[command(flatten)]
    common: Common,
}

/// What the pipeline makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Stage {
    /// A density map: as `01_density`
    Density,
    /// A surface of triangles: as `02_surface`, or the skin of the tetrahedra
    Surface,
    /// Tetrahedra, improved
    Tets,
    /// Eigenfunctions: as `06_modes`
    Modes,
    /// Quads: as `08_quads`
    Quads,
    /// A T-mesh, coarse where the surface is flat: as `10_tmesh --levels curvature`
    Tmesh,
    /// A spline surface on that: as `11_tspline --levels curvature`
    Spline,
    /// Segments: as `15_segment`
    Segments,
    /// Pockets: as `16_pockets`
    Pockets,
    /// All of them that the input allows
    All,
}

/// What is made of a surface.
const OF_SURFACES: [Stage; 5] = [
    Stage::Modes,
    Stage::Quads,
    Stage::Tmesh,
    Stage::Spline,
    Stage::Segments,
];

/// The options that only tetrahedra have.
const OF_VOLUMES: [&str; 9] = [
    "region",
    "outer",
    "slab",
    "cylinder",
    "ball",
    "cuboid",
    "membrane",
    "separate_exterior",
    "keep_apart",
];

/// The options of everything that is meshed.
const OF_MESHES: [&str; 11] = [
    "method",
    "cell",
    "tets",
    "tolerance",
    "error_norm",
    "zone",
    "finer",
    "max_cell",
    "placement",
    "at_box",
    "prune",
];

const EXAMPLES: &str = "\
Examples:
  00_pipeline 1ajj.pdb --out out
  00_pipeline 2buk.pdb --assembly 1 --out capsid
  00_pipeline 1ajj.pdb --method dual-contour --out thesis
  00_pipeline 1ajj.pdb --region exterior --outer box:2 --out solvent
  00_pipeline 1su4.pdb --region both --spacing 0.8 --residue-power 0.25 --out both
  00_pipeline 2nwl_opm.pdb --membrane --region both --outer box:1.5 --out membrane
  00_pipeline 1ajj.pdb --region both --spacing 0.5 --max-cell 2 --out study
  00_pipeline 1ajj.pdb --stages all --spacing 1 --out everything
  00_pipeline structures/ --shard 2/8 --no-pictures --out all

Materials get the region numbers 2, 3, … in the order cylinders, balls, boxes, slabs; where they overlap
the first one counts, and the molecule (1) before all.

Outputs: surface.ply, surface.glb (coloured by --color) and surface.png; of structures view.cxc and view.pml
(ChimeraX and PyMOL open the surface around the atoms); volume.vtu (regions and quality
per tetrahedron), volume.msh (named groups, for solvers) and volume.png (a cut); quality.png;
report.json with counts, quality before and after, seconds per stage and peak memory.";

impl Stage {
    /// Builds without chapters 4 to 7 go as far as tetrahedra.
    fn in_build(self) -> Result<Self, Failure> {
        match self {
            Self::Density | Self::Surface | Self::Tets => Ok(self),
            _ if cfg!(feature = "analysis") => Ok(self),
            _ => Err(left_out("stages after tets", "analysis")),
        }
    }
}

impl Args {
    fn wants(&self, stage: Stage) -> bool {
        self.stages.contains(&stage) || self.stages.contains(&Stage::All)
    }
}

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.source.input.clone()]
    }
}

impl Batch for Args {
    fn batch(&self) -> &BatchArgs {
        &self.batch
    }
    fn parts_mut(&mut self) -> (&mut PathBuf, &mut Common) {
        (&mut self.source.input, &mut self.common)
    }
}

fn main() -> ExitCode {
    biogeom_examples::run_each("00_pipeline", pipeline)
}

fn pipeline(args: &Args, session: &Session) -> Result<(), Failure> {
    let wants = |stage| args.wants(stage);
    if !wants(Stage::Tets) {
        session.refuse(&OF_VOLUMES, "is for --stages tets")?;
    }
    let of_surfaces = OF_SURFACES.into_iter().any(wants);
    if !wants(Stage::Tets) && !wants(Stage::Surface) {
        session.refuse(&["color"], "is for --stages surface and tets")?;
        if !of_surfaces {
            session.refuse(&OF_MESHES, "is for stages that mesh something")?;
        }
    }
    if matches!(args.volume.region, Region::Both) {
        session.refuse(&["keep_apart"], "is for --region interior and exterior")?;
    }
    let source = args.source.read(session)?;
    let structure = source.structure();
    if structure.is_none() {
        for (stage, name) in [(Stage::Density, "density"), (Stage::Pockets, "pockets")] {
            if args.stages.contains(&stage) {
                return Err(
                    format!("--stages {name} is for structures, and the input is a grid").into(),
                );
            }
        }
    }
    if let Some(structure) = structure.filter(|_| wants(Stage::Density)) {
        session.part("density", || density(args, session, structure))?;
    }

    // The surface on which the others work is the skin of the tetrahedra if there are some.
    let surface = if wants(Stage::Tets) {
        tetrahedra(args, session, &source)?
    } else if wants(Stage::Surface) || of_surfaces {
        surface(args, session, &source, wants(Stage::Surface))?
    } else {
        TriMesh::default()
    };
    if of_surfaces || structure.is_some() && wants(Stage::Pockets) {
        analysis::run(args, session, &surface, structure)?;
    }
    Ok(())
}

/// The density on a whole lattice: the other stages need it near the surface only.
fn density(args: &Args, session: &Session, structure: &Structure) -> Result<(), Failure> {
    let density = &args.source.density;
    let model = Model::uniform(structure, &density.model.levels())?;
    let options = density.options(structure, session);
    let on = session.on(session.device.density());
    let sampled = session.stage("density", || sample(&model, &options, on))?;
    session.note("spacing", options.spacing)?;
    session.note("density", &sampled.report)?;
    session.files(2, || steps::density::save(session, &sampled.grid, false))
}

/// The surface alone.
fn surface(
    args: &Args,
    session: &Session,
    source: &Source,
    save: bool,
) -> Result<TriMesh, Failure> {
    let field = source.field(session)?;
    let options = args.mesh.options(source, session)?;
    let on = session.on(session.device.contour());
    let made = session.stage("surface", || {
        dual_contour::surface(&source.values, Some(&field), &options, on)
    })?;
    session.note("contour", &made.report)?;
    products::note_surface(session, &made.mesh)?;
    if save {
        let around = args.labels.around(source, &args.source.input);
        session.files(5, || {
            products::save_surface(session, "surface", &made.mesh, around)
        })?;
    }
    Ok(made.mesh)
}

/// Tetrahedra and their skin.
fn tetrahedra(args: &Args, session: &Session, source: &Source) -> Result<TriMesh, Failure> {
    let field = source.field(session)?;
    let options = args.volume.options(&args.mesh, source, session)?;
    let volume = session.stage("tetrahedra", || {
        dual_contour::volume(
            &source.values,
            Some(&field),
            &options,
            session.on(session.device.contour()),
        )
    })?;
    session.note("contour", &volume.report)?;

    let quality = tet_quality::Options {
        level: source.level,
        spacing: Some(volume.report.spacing),
        keep_apart: args.keep_apart,
        ..Default::default()
    };
    let improved = session.stage("improvement", || {
        tet_quality::improve(
            volume.mesh,
            Some(&field),
            &quality,
            session.on(session.device.quality()),
        )
    })?;
    let (mesh, report) = (improved.mesh, improved.report);
    session.note("quality", &report)?;

    let surface = products::molecule_surface(&mesh);
    products::note_volume(session, &mesh)?;
    products::warn_of_missing(session, &mesh, &options.materials)?;
    products::note_surface(session, &surface)?;
    session.files(9, || {
        products::side_by_side(
            || {
                products::save_surface(
                    session,
                    "surface",
                    &surface,
                    args.labels.around(source, &args.source.input),
                )
            },
            || products::save_volume(session, "volume", &mesh, (&mesh).into(), source.structure()),
        )?;
        products::picture_of_quality(session, "quality", &report.before.all, &report.after.all)
    })?;
    Ok(surface)
}

/// What a build has in place of these that goes as far as tetrahedra.
#[cfg(not(feature = "analysis"))]
mod analysis {
    use super::{Args, Failure, Session, Structure, TriMesh};

    pub(super) fn run(
        _: &Args,
        _: &Session,
        _: &TriMesh,
        _: Option<&Structure>,
    ) -> Result<(), Failure> {
        Err(super::left_out("stages after tets", "analysis"))
    }
}

/// What follows from a surface, each with its program's defaults.
#[cfg(feature = "analysis")]
mod analysis {
    use biogeom_examples::input::tmesh::{ElementArgs, Input, Made};
    use biogeom_examples::steps::spline::{self, Product};
    use biogeom_examples::steps::{elements, modes, pockets, quads, segments};
    use tspline::Basis;
    use tspline::surface::fit::FitOptions;

    use super::{Args, Failure, Session, Stage, Structure, TriMesh};

    /// Modes on the contact sheet of the segments.
    const MODES: usize = 8;

    pub(super) fn run(
        args: &Args,
        session: &Session,
        surface: &TriMesh,
        structure: Option<&Structure>,
    ) -> Result<(), Failure> {
        if args.wants(Stage::Modes) {
            let asked = modes::Settings::default();
            session.part("modes", || modes::run(session, &largest(surface)?, &asked))?;
        }
        if args.wants(Stage::Quads) {
            let asked = crossfield::Options::default();
            session.part("quads", || quads::run(session, surface, &asked))?;
        }
        if args.wants(Stage::Tmesh) || args.wants(Stage::Spline) {
            let input = Input::of_surface(surface.clone(), structure.cloned());
            let made = session.part("tmesh", || {
                let made = ElementArgs::by_curvature().make(input, session)?;
                if args.wants(Stage::Tmesh) {
                    session.files(5, || elements::save(session, &made))?;
                }
                Ok(made)
            })?;
            if args.wants(Stage::Spline) {
                session.part("spline", || spline_of(session, made))?;
            }
        }
        if args.wants(Stage::Segments) {
            session.part("segments", || {
                let asked = segments::Settings::default();
                let done = segments::of_triangles(session, largest(surface)?, &[], &asked)?;
                segments::finish(session, &done, MODES)
            })?;
        }
        if let Some(structure) = structure.filter(|_| args.wants(Stage::Pockets)) {
            let (input, asked) = (&args.source.input, pockets::Settings::default());
            session.part("pockets", || {
                pockets::run(session, structure, input, &asked)
            })?;
        }
        Ok(())
    }

    /// The component of the largest area: cavities have modes of their own.
    fn largest(surface: &TriMesh) -> Result<TriMesh, Failure> {
        let first = surface.components().into_iter().next();
        first.ok_or_else(|| "the surface has no triangles".into())
    }

    /// A spline surface with the files that most read.
    fn spline_of(session: &Session, made: Made) -> Result<(), Failure> {
        let asked = (Basis::Hierarchical, None, 4);
        let input = &made.input;
        let (adapted, triangles) =
            spline::fit(session, made.mesh, input, asked, &FitOptions::default())?;
        let files = [Product::Vtu, Product::Step, Product::Glb];
        session.files(1 + files.len() as u64, || {
            for file in files {
                spline::save(session, file, &adapted, &triangles, input)?;
            }
            session.picture("surface", || {
                spline::picture(session, &adapted, &triangles, &input.surface)
            })
        })
    }
}
