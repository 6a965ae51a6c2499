//! 01 — From atoms to a density map.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, DensityArgs, HasCommon, ReaderArgs};
use biogeom_examples::picture::{ColorMap, Scale, sheet, slice};
use biogeom_examples::{Failure, Session};
use clap::Parser;
use gauss_density::{Model, Options, sample, sample_band};
use geom_core::{LatticeValues, ScalarGrid, io};
use serde::Serialize;
use serde_json::{Value, json};

/// From atoms to a density map, with slices through it
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure: PDB, mmCIF or PQR, each also gzip-compressed
    input: PathBuf,
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

Outputs: density.mrc and density.dx (the map, for other programs), slices.png (through the middle along
x, y and z; the white line is the surface), report.json. `k_a` there has the share of lattice points
that a search near the surface analyses, for the thresholds of the thesis's Table 3.2: `points` of cells
that meet the band, and `stored` by this program's bricks.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("01_density", density)
}

fn density(args: &Args, session: &Session) -> Result<(), Failure> {
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
    let shares = session.stage("narrow bands", || {
        // The thresholds of Table 3.2.
        let bands = [[0.9, 1.1], [0.6, 1.4], [0.3, 1.7], [0.1, 2.0]];
        let shares: Result<Vec<Value>, Failure> = bands
            .into_iter()
            .map(|band| {
                let stored = sample_band(
                    &model,
                    &Options {
                        band,
                        ..options.clone()
                    },
                    on,
                )?
                .report;
                Ok(json!({
                    "lower": band[0],
                    "upper": band[1],
                    "points": share_near(grid, band),
                    "stored": stored.stored_share,
                    "pairs": stored.pairs,
                }))
            })
            .collect();
        shares
    })?;
    session.note("k_a", shares)?;

    session.stage("files and pictures", || {
        io::grid::save(session.output("density.mrc")?, grid)?;
        io::grid::save(session.output("density.dx")?, grid)?;
        let scale = Scale::new(ColorMap::Viridis, [0.0, 2.0], "density G");
        let pictures: Vec<_> = [("along x", 0), ("along y", 1), ("along z", 2)]
            .map(|(title, axis)| {
                (
                    title.to_owned(),
                    slice(grid, grid.lattice(), axis, 0.5, 1.0, &scale, 620),
                )
            })
            .into();
        sheet(&pictures, 3).save(session.output("slices.png")?)?;
        Ok::<_, Failure>(())
    })
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
