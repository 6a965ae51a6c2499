//! 20 — Tetrahedra of what does not fit into memory: tile after tile, or tiles side by side.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::AtomicU64;

use biogeom_examples::args::{Common, DensityArgs, HasCommon, Method, ReaderArgs, default_spacing};
use biogeom_examples::steps::tiles::{Outcome, Plan, merged_bytes};
use biogeom_examples::{Failure, Session, products};
use clap::{Parser, ValueEnum};
use dual_contour::{Extent, LARGEST};
use gauss_density::{Copies, Cutoff, Model};
use geom_core::Structure;
use geom_core::io::structure::{self, ReadOptions};
use geom_core::mesh::INTERIOR;
use geom_core::structure::Transform;
use geom_core::tiles::{Solo, Spill, Threads};
use serde::Serialize;
use serde_json::json;

/// From atoms to tetrahedra in tiles, for assemblies of which neither the atoms nor the mesh fit into memory; the mesh
/// is the same, to the last bit, for any number of tiles, unless it is improved
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure (PDB, mmCIF, PQR), also gzip-compressed
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    #[command(flatten)]
    density: DensityArgs,
    #[command(flatten)]
    reader: ReaderArgs,
    /// How many tiles
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    tiles: u32,
    /// How tiles are worked on
    #[arg(long, value_enum, default_value_t)]
    exchange: Form,
    /// Ranks side by side, with --exchange threads [default: one per tile, at most one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    ranks: Option<u16>,
    /// How to mesh
    #[arg(long, value_enum, default_value_t)]
    method: Method,
    /// Improve the tetrahedra, in two passes with the borders of tiles held, half a root cell (16 cells) apart, and then
    /// around what is still bad; what comes out depends on where the borders are
    #[arg(long)]
    improve: bool,
    /// Mesh the exterior too, to the end of the lattice
    #[arg(long)]
    both: bool,
    #[command(flatten)]
    common: Common,
}

/// How tiles are worked on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Form {
    /// One after another, the others on disk
    #[default]
    Solo,
    /// Some side by side, as ranks of one process
    Threads,
    /// Some side by side, as the processes that mpirun has started; --max-memory is that of each
    #[cfg(feature = "mpi")]
    Mpi,
}

const EXAMPLES: &str = "\
Examples:
  20_tiles 1ajj.pdb --tiles 4 --out out
  20_tiles 1m4x.pdb.gz --assembly 1 --spacing 5 --decay 0.1 --tiles 64 --max-memory 4G --out capsid
  20_tiles 3enl.pdb --tiles 7 --exchange threads --ranks 3 --both --out both
  20_tiles 1hvr.pdb --tiles 8 --method dual-contour --improve --out fewer

Assemblies are not copied: the atoms of a tile are made when it asks for them. Vertices lie where the values of the
lattice cross the surface. Outputs: volume.pvtu and parts/part_N.vtu (regions and boundaries by name, the nearest atom of
each vertex, global numbers, two layers of ghosts), the same as parts/volume_N.msh for Gmsh, from 1 on, of up to 32,767 tiles;
in one process volume.vtu, volume.msh, volume.png and surface.ply/.glb/.png, too, where the whole fits into --max-memory;
report.json with the digest of the mesh (before --improve) and what each rank has held, sent and put aside.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("20_tiles", tiles)
}

fn tiles(args: &Args, session: &Session) -> Result<(), Failure> {
    if session.device.is_gpu() {
        return Err("tiles need the bits of their neighbours: take --backend cpu".into());
    }
    if args.exchange != Form::Threads {
        session.refuse(&["ranks"], "is for --exchange threads")?;
    }
    let (structure, places) = read(args, session)?;
    let unit = Model::uniform(&structure, &args.density.model.levels())?;
    let copies = Copies::new(&unit, places.clone())?;
    let ranks = ranks(args);
    // What a rank may use at once.
    let memory = session.memory() / ranks as u64;
    let density = gauss_density::Options {
        spacing: args
            .density
            .spacing
            .unwrap_or_else(|| default_spacing(copies.atoms() as usize)),
        cutoff: Cutoff(args.density.cutoff),
        margin: args.density.margin,
        max_memory: memory,
        ..Default::default()
    };
    let contour = dual_contour::Options {
        method: args.method.into(),
        max_cell: LARGEST as f64 * density.spacing,
        region: if args.both {
            Extent::Both
        } else {
            Extent::Interior
        },
        max_memory: memory,
        ..Default::default()
    };
    let improve = args.improve.then(|| tet_quality::Options {
        spacing: Some(density.spacing),
        ..Default::default()
    });
    let folder = session.scratch()?;
    let spill = Spill::into(folder.path());
    let plan = session.stage("plan", || {
        Plan::new(
            &copies,
            (&structure, &places),
            density,
            contour,
            improve,
            args.tiles as usize,
            spill,
        )
    })?;
    #[cfg(feature = "mpi")]
    if args.exchange == Form::Mpi {
        return among_processes(&plan, session);
    }
    let made = session.stage("tiles", || run(&plan, ranks, session))?;
    note(&plan, &made, ranks, session)?;
    session.files(8, || save(&plan, &made, session))
}

/// Puts what was made into the report.
fn note(plan: &Plan<'_>, made: &Outcome, ranks: usize, session: &Session) -> Result<(), Failure> {
    if made.tetrahedra == 0 {
        return Err("no tile holds a cell inside: take a smaller spacing".into());
    }
    session.note("tiles", made)?;
    session.note("lattice", plan.lattice)?;
    session.note("msh_parts", plan.writes_msh())?;
    let atoms = plan.copies.atoms();
    let counts = json!({ "atoms": atoms, "tetrahedra": made.tetrahedra, "ranks": ranks });
    session.note("counts", counts)
}

/// As one of the ranks of `mpirun`. Rank 0 writes the report and the file that joins the parts; a rank that fails says why
/// and ends all. No file appears before all have finished, and none is left where one is ended.
#[cfg(feature = "mpi")]
fn among_processes(plan: &Plan<'_>, session: &Session) -> Result<(), Failure> {
    use std::io::Write;

    use biogeom_examples::steps::tiles::remains::Remains;
    use geom_core::tiles::{Exchange, mpi::Mpi};

    let mpi = Mpi::start().ok_or("MPI has been started before")?;
    let remains = Remains::of(&mpi, session)?;
    remains.watch()?;
    let work = || -> Result<(), Failure> {
        let done = AtomicU64::new(0);
        let made = session.stage("tiles", || plan.run(&mpi, session, &done))?;
        if mpi.rank() == 0 {
            note(plan, &made, mpi.ranks(), session)?;
            plan.join(&made, session)?;
        } else {
            session.follow();
        }
        mpi.scan(0)?;
        Ok(())
    };
    work().inspect_err(|failure| {
        let _ = writeln!(std::io::stderr(), "error: rank {}: {failure}", mpi.rank());
        remains.clear();
        mpi.abort();
    })
}

/// The atoms, as one unit and its places.
fn read(args: &Args, session: &Session) -> Result<(Structure, Vec<Transform>), Failure> {
    let options = ReadOptions {
        max_bytes: session.memory(),
        instances: true,
        ..args.reader.options()
    };
    let read = session.stage("reading", || structure::read(&args.input, &options))?;
    session.note("structure", &read.report)?;
    Ok((read.structure, read.places))
}

fn ranks(args: &Args) -> usize {
    match args.exchange {
        Form::Solo => 1,
        // Each has its own memory.
        #[cfg(feature = "mpi")]
        Form::Mpi => 1,
        Form::Threads => args.ranks.map_or_else(
            || rayon::current_num_threads().min(args.tiles as usize),
            usize::from,
        ),
    }
}

/// Alone, or on some ranks that share the threads.
fn run(plan: &Plan<'_>, ranks: usize, session: &Session) -> Result<Outcome, Failure> {
    let done = AtomicU64::new(0);
    if ranks == 1 {
        return plan.run(&Solo, session, &done);
    }
    let threads = (rayon::current_num_threads() / ranks).max(1);
    let outcomes = Threads::run(ranks, |rank| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        pool.install(|| plan.run(rank, session, &done))
    });
    // The reason of the first that failed by itself, not that the others stopped.
    let is_lost = |failure: &Failure| failure.is::<geom_core::tiles::Lost>();
    let (mut made, mut lost) = (None, None);
    for outcome in outcomes {
        match outcome {
            Ok(outcome) => made = Some(outcome),
            Err(failure) if is_lost(&failure) => lost = Some(failure),
            Err(failure) => return Err(failure),
        }
    }
    match (made, lost) {
        (_, Some(failure)) => Err(failure),
        (made, None) => made.ok_or_else(|| "there was no rank".into()),
    }
}

fn save(plan: &Plan<'_>, made: &Outcome, session: &Session) -> Result<(), Failure> {
    plan.join(made, session)?;
    let fits = merged_bytes(made) <= session.memory() && made.vertices < u64::from(u32::MAX) - 1;
    session.note("merged", fits)?;
    if !fits {
        return Ok(());
    }
    let mesh = plan.merged(made)?;
    products::note_volume(session, &mesh)?;
    let surface = mesh.region_surface(INTERIOR);
    products::note_surface(session, &surface)?;
    products::save_surface(session, "surface", &surface, None)?;
    products::save_volume(session, "volume", &mesh, plan.view(&mesh)?, None)
}
