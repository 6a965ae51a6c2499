//! 16 — Pockets of a molecule: found, ranked and outlined on its surface.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon, ReaderArgs};
use biogeom_examples::batch::{Batch, BatchArgs};
use biogeom_examples::steps::pockets;
use biogeom_examples::{Failure, Session};
use clap::Parser;
use secondfund_ops::PocketOptions;
use serde::Serialize;

/// Pockets of a molecule, ranked by burial: where ligands may bind
#[derive(Clone, Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure (PDB, mmCIF, PQR), also gzip-compressed. Ligands, ions, waters and hydrogens never count
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
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
    /// deep pockets close
    #[arg(long, value_name = "KAPPA", default_value_t = pockets::Settings::default().decay)]
    decay: f64,
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
  16_pockets structures/ --no-pictures --out all

Outputs: pockets.csv (rank, score, centre, volume, area, depth, mouth, residues), pockets.pdb (the points of the pockets:
chain P, residue = rank, for PyMOL and ChimeraX), pockets.glb and pockets.png (the surface, each pocket in its
colour), view.cxc and view.pml (ChimeraX and PyMOL open all of it around the structure), report.json with which atoms counted.";

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
    let structure = args.reader.read(session, &args.input)?.structure;
    let options = PocketOptions {
        most: args.most.into(),
        radius: args.burial_radius,
        percentile: args.percentile,
        per_chain: !args.pooled,
        ..PocketOptions::default()
    };
    let settings = pockets::Settings {
        pockets: options,
        decay: args.decay,
        spacing: args.spacing,
    };
    pockets::run(session, &structure, &args.input, &settings)
}
