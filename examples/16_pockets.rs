//! 16 — Pockets of a molecule: found, ranked and outlined on its surface.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::shown_if_any;
use biogeom_examples::args::{Common, HasCommon, ReaderArgs};
use biogeom_examples::batch::{Batch, BatchArgs};
use biogeom_examples::steps::pockets::{self, Method};
use biogeom_examples::{Failure, Session};
use clap::{Parser, ValueEnum};
use geom_core::structure::Selector;
use secondfund_ops::PocketOptions;
use secondfund_ops::options::{OutlineSource, PatchOptions};
use serde::Serialize;

/// Pockets of a molecule, ranked by burial: where ligands may bind
#[derive(Clone, Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure (PDB, mmCIF, PQR), also gzip-compressed. Ligands, ions, waters and hydrogens never count
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// How pockets are found
    #[arg(long, value_enum, default_value_t)]
    method: MethodName,
    /// Groups of the thesis's first cut
    #[arg(long, value_name = "N", default_value_t = PatchOptions::default().groups as u16, value_parser = clap::value_parser!(u16).range(2..=200))]
    groups: u16,
    /// A known ligand, e.g. name:XK2 or a chain. It is left out, and pockets get its distance and density
    #[arg(long, value_name = "SELECTOR")]
    #[serde(serialize_with = "shown_if_any")]
    ligand: Option<Selector>,
    /// A map of a potential (OpenDX, MRC): its values in each pocket, in the map's unit
    #[arg(long, value_name = "FILE")]
    #[serde(serialize_with = "biogeom_examples::args::as_text_if_any")]
    potential: Option<PathBuf>,
    /// What tells which part of the surface is a pocket
    #[arg(long, value_enum, default_value_t)]
    outline: OutlineName,
    /// Most pockets
    #[arg(long, value_name = "N", default_value_t = PocketOptions::default().most as u16, value_parser = clap::value_parser!(u16).range(1..=1000))]
    most: u16,
    /// Atoms within this distance of a point count as its burial, Å
    #[arg(long, value_name = "R", default_value_t = PocketOptions::default().radius)]
    burial_radius: f64,
    /// The share of points that are not deep enough
    #[arg(long, value_name = "SHARE", default_value_t = PocketOptions::default().percentile)]
    percentile: f64,
    /// One threshold for all chains instead of one for each
    #[arg(long)]
    pooled: bool,
    /// Decay of an atom's kernel, 1/Å²: of the surface on which pockets are outlined. Smaller is smoother; below 0.3
    /// deep pockets close [default: 0.5, of --method thesis 0.15]
    #[arg(long, value_name = "KAPPA")]
    decay: Option<f64>,
    /// Distance of the lattice points of the surface, Å [default: 0.5, more from 1000 atoms on]
    #[arg(long, value_name = "H")]
    spacing: Option<f64>,
    #[command(flatten)]
    reader: ReaderArgs,
    #[command(flatten)]
    #[serde(skip)]
    batch: BatchArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  16_pockets 1hvr.pdb --out pockets
  16_pockets 1fki.cif --select A --out chain_a
  16_pockets 1hvr.pdb --ligand name:XK2 --potential 1hvr.dx --out scored
  16_pockets structures/ --no-pictures --out all

Outputs: pockets.csv (rank, score, centre, volume, area, depth, mouth, mean curvature, residues; with --ligand its distance from the
centre and its mean density, with --potential mean, lowest, highest and that of the surface), pockets.pdb (the points of the pockets:
chain P, residue = rank, for PyMOL and ChimeraX), pockets.glb and pockets.png (the surface, each pocket in its
colour), view.cxc and view.pml (ChimeraX and PyMOL open all of it around the structure), report.json with which atoms counted.";

#[derive(Clone, Copy, Default, PartialEq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum MethodName {
    /// Where many atoms lie around points outside: the one that finds ligands
    #[default]
    Burial,
    /// Patches of negative mean curvature, as the thesis has it; most proteins have none
    Thesis,
}

#[derive(Clone, Copy, Default, PartialEq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum OutlineName {
    /// Points that a probe of 1.4 Å reaches and one of 3 Å does not cover
    #[default]
    Probes,
    /// Patches of the secondary Laplace operator with e^−H
    Patches,
}

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

impl Batch for Args {
    fn batch(&self) -> &BatchArgs {
        &self.batch
    }
    fn parts_mut(&mut self) -> (&mut PathBuf, &mut Common) {
        (&mut self.input, &mut self.common)
    }
}

fn main() -> ExitCode {
    biogeom_examples::run_each("16_pockets", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let method = match args.method {
        MethodName::Burial => {
            session.refuse(&["groups"], "is of --method thesis")?;
            Method::Burial(
                PocketOptions {
                    most: args.most.into(),
                    radius: args.burial_radius,
                    percentile: args.percentile,
                    per_chain: !args.pooled,
                    ..PocketOptions::default()
                },
                match args.outline {
                    OutlineName::Probes => OutlineSource::default(),
                    OutlineName::Patches => OutlineSource::Patches,
                },
            )
        }
        MethodName::Thesis => {
            let of_burial = ["burial_radius", "percentile", "pooled", "outline"];
            session.refuse(&of_burial, "is of --method burial")?;
            Method::Thesis(PatchOptions {
                most: args.most.into(),
                groups: args.groups.into(),
                ..PatchOptions::default()
            })
        }
    };
    let settings = pockets::Settings {
        method,
        decay: args.decay,
        spacing: args.spacing,
        ligand: args.ligand.clone(),
        potential: args.potential.clone(),
    };
    let structure = args.reader.read(session, &args.input)?.structure;
    pockets::run(session, &structure, &args.input, &settings)
}
