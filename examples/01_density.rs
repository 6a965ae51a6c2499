//! 01 — From atoms to a density map.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, DensityArgs, HasCommon, ReaderArgs};
use biogeom_examples::steps::density;
use biogeom_examples::{Failure, Session};
use clap::Parser;
use gauss_density::{Model, Options, sample, sample_band};
use geom_core::{LatticeValues, ScalarGrid};
use serde::Serialize;
use serde_json::{Value, json};

/// From atoms to a density map, with slices through it
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure: PDB, mmCIF or PQR, each also gzip-compressed
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// Write the map as OpenDX text, too: nine times as large as MRC
    #[arg(long)]
    dx: bool,
    /// Note the shares of Table 3.2 of the thesis, `k_a`: samples four bands more
    #[arg(long)]
    k_a: bool,
    #[command(flatten)]
    density: DensityArgs,
    #[command(flatten)]
    reader: ReaderArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  01_density 1ajj.pdb --out out
  01_density 1su4.pdb --spacing 1 --residue-power 0.05 --chain-power 0.5 --out blurred

Outputs: density.mrc (the map, for other programs), with --dx also density.dx, slices.png (through the
middle along x, y and z; the white line is the surface), report.json. With --k-a it has the share of
lattice points that a search near the surface analyses, for the thresholds of the thesis's Table 3.2:
`points` of cells that meet the band, and `stored` by this program's bricks.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("01_density", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let structure = args.reader.read(session, &args.input)?.structure;
    let model = Model::uniform(&structure, &args.density.model.levels())?;
    let options = args.density.options(&structure, session);
    let on = session.on(session.device.density());

    let sampled = session.stage("density", || sample(&model, &options, on))?;
    session.note("spacing", options.spacing)?;
    session.note("density", &sampled.report)?;
    let pairs = json!({ "evaluated": sampled.report.pairs, "brute_force": sampled.report.brute_force_pairs });
    session.note("pairs", pairs)?;

    let grid = &sampled.grid;
    if args.k_a {
        let shares = session.stage("narrow bands", || {
            let shares = BANDS.map(|band| narrow_band(&model, &options, session, grid, band));
            shares.into_iter().collect::<Result<Vec<Value>, Failure>>()
        })?;
        session.note("k_a", shares)?;
    }

    session.files(2 + u64::from(args.dx), || {
        density::save(session, grid, args.dx)
    })
}

/// The thresholds of Table 3.2.
const BANDS: [[f64; 2]; 4] = [[0.9, 1.1], [0.6, 1.4], [0.3, 1.7], [0.1, 2.0]];

/// What a search within a band analyses, as shares of the whole grid.
fn narrow_band(
    model: &Model,
    options: &Options,
    session: &Session,
    grid: &ScalarGrid,
    band: [f64; 2],
) -> Result<Value, Failure> {
    let options = Options {
        band,
        ..options.clone()
    };
    let stored = sample_band(model, &options, session.on(session.device.density()))?.report;
    Ok(json!({
        "lower": band[0],
        "upper": band[1],
        "points": share_near(grid, band),
        "stored": stored.stored_share,
        "pairs": stored.pairs,
    }))
}

/// The share of lattice points that are corners of cells whose range of values meets the band.
fn share_near(grid: &ScalarGrid, [low, high]: [f64; 2]) -> f64 {
    let lattice = grid.lattice();
    let (values, cells) = (grid.values(), lattice.cells());
    let mut near = vec![false; values.len()];
    for k in 0..cells[2] {
        for j in 0..cells[1] {
            for i in 0..cells[0] {
                let corners: [usize; 8] = std::array::from_fn(|c| {
                    lattice.index([i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)])
                });
                let (min, max) = corners
                    .iter()
                    .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &c| {
                        (a.min(values[c]), b.max(values[c]))
                    });
                if f64::from(min) < high && f64::from(max) > low {
                    corners.iter().for_each(|&c| near[c] = true);
                }
            }
        }
    }
    near.iter().filter(|&&n| n).count() as f64 / values.len().max(1) as f64
}
