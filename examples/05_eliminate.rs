//! 05 — Fewer atoms with the same surface.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use biogeom_examples::args::{Common, HasCommon, ModelArgs, ReaderArgs, default_spacing};
use biogeom_examples::picture::{ColorMap, Scale, Scene, View, sheet};
use biogeom_examples::products::{self, grouped};
use biogeom_examples::{Failure, Session};
use clap::Parser;
use gauss_density::{
    Cutoff, DensityBackend, Elimination, Interior, Model, PointSampler, Refit, Sampled, Stop,
    eliminate, refit, sample_band,
};
use geom_core::structure::Selector;
use geom_core::{BrickGrid, ImplicitField, Run, Structure, TriMesh, io};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;

/// Leaves out atoms that the surface does not need, within a bound on the density
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    /// Structure: PDB, mmCIF or PQR, each also gzip-compressed
    #[serde(serialize_with = "biogeom_examples::args::as_text")]
    input: PathBuf,
    /// Largest share of the density near the surface that may be lost (worst_loss in report.json; surface_max compares at the
    /// points of the new surface, and may be a little more); 0 keeps every atom
    #[arg(long, value_name = "EPS", default_value_t = Elimination::default().epsilon)]
    epsilon: f64,
    /// Chains (or any other parts, like B:10-25) that keep all their atoms
    #[arg(long, value_name = "SELECTOR")]
    #[serde(serialize_with = "biogeom_examples::args::shown_if_any")]
    keep_chains: Option<Selector>,
    /// Move the remaining atoms so that their density comes closest to the original
    #[arg(long)]
    refit: bool,
    /// Let the body become hollow: buried atoms go first, as in the thesis
    #[arg(long)]
    hollow: bool,
    /// Stop at the first atom that would break the bound, as the thesis does, instead of trying on
    #[arg(long)]
    first_failure: bool,
    /// Distance of samples and size of the surfaces' cells, Å [default: 0.5, more from 1000 atoms on]
    #[arg(long, value_name = "H")]
    spacing: Option<f64>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    reader: ReaderArgs,
    #[command(flatten)]
    common: Common,
}

const EXAMPLES: &str = "\
Examples:
  05_eliminate 1ajj.pdb --out out
  05_eliminate 1su4.pdb --epsilon 0.01 --residue-power 0.25 --hollow --first-failure --out thesis
  05_eliminate 1hpx.pdb --keep-chains A --refit --out emphasized

Outputs: reduced.pqr (the remaining atoms, for any of these programs), after --refit also reduced.csv
(each atom with its decay, which PQR has no column for); original.ply/.glb and reduced.ply/.glb (the two
surfaces, coloured by what has changed of the density there) and error.png; report.json, where `table` is the row of
this input in Tables 3.1 and 3.4 of the thesis.";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.input.clone()]
    }
}

/// Where less than this share of the atoms goes, the program says what wider bounds would do.
const FEW_GO: f64 = 0.05;
/// Wider bounds.
const WIDER: [f64; 3] = [0.05, 0.1, 0.2];

fn main() -> ExitCode {
    biogeom_examples::run("05_eliminate", fewer)
}

fn fewer(args: &Args, session: &Session) -> Result<(), Failure> {
    let structure = args.reader.read(session, &args.input)?.structure;
    let mut original = Model::uniform(&structure, &args.model.levels())?;
    if let Some(keep) = &args.keep_chains {
        let atoms = original.selected(&structure, keep)?;
        original.protect(atoms)?;
    }
    let spacing = args
        .spacing
        .unwrap_or_else(|| default_spacing(structure.atoms().len()));
    session.note("spacing", spacing)?;
    let on = session.on(session.device.density());

    let options = Elimination {
        epsilon: args.epsilon,
        spacing,
        stop: if args.first_failure {
            Stop::FirstFailure
        } else {
            Stop::SkipFailing
        },
        interior: if args.hollow {
            Interior::Hollow
        } else {
            Interior::KeepSolid
        },
        max_memory: session.memory(),
        ..Default::default()
    };
    let eliminated = session.stage("elimination", || eliminate(&original, &options, on))?;
    session.note("elimination", &eliminated.report)?;
    let (all, left) = (original.atoms(), eliminated.model.atoms());
    let free = (all - eliminated.report.protected) as f64;
    if options.epsilon > 0.0 && ((all - left) as f64) < FEW_GO * free {
        let advice = || wider_bounds(&original, all - left, &options, on);
        let advice = session.stage("wider bounds", advice)?;
        session.warn(advice)?;
    }
    let mut error = eliminated.report.comparison.surface_max;
    let mut reduced = eliminated.model;
    if args.refit {
        let options = Refit {
            spacing,
            max_memory: session.memory(),
            ..Default::default()
        };
        let refitted = session.stage("refit", || refit(&reduced, &original, &options, on))?;
        session.note("refit", &refitted.report)?;
        error = refitted.report.comparison[1].surface_max;
        reduced = refitted.model;
    }

    let [(before, before_seconds), (after, after_seconds)] = [
        density(&original, spacing, session)?,
        density(&reduced, spacing, session)?,
    ];
    session.note("counts", json!({ "remaining_atoms": left }))?;
    let share = left as f64 / all as f64;
    let table = json!({
        "N_A": all,
        "T_G": before_seconds,
        "N_R": left,
        "N_R / N_A": share,
        "T_G of N_R": after_seconds,
        "e_G^M": eliminated.report.comparison.surface_max,
        "e_G^M after refit": args.refit.then_some(error),
        "protected": eliminated.report.protected,
    });
    session.note("table", table)?;
    let pairs = |s: &Sampled<BrickGrid>| json!({ "evaluated": s.report.pairs, "brute_force": s.report.brute_force_pairs });
    session.note(
        "pairs",
        json!({ "original": pairs(&before), "reduced": pairs(&after) }),
    )?;

    let surfaces = [
        surface(&original, &before.grid, session)?,
        surface(&reduced, &after.grid, session)?,
    ];
    let errors = session.stage("errors", || {
        let first = changes(&surfaces[0], [&original, &reduced])?;
        Ok::<_, Failure>([first, changes(&surfaces[1], [&original, &reduced])?])
    })?;
    for (name, errors) in ["original", "reduced"].into_iter().zip(&errors) {
        let most = errors.iter().copied().fold(0.0, f64::max);
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        session.note("errors", json!({ name: { "max": most, "mean": mean } }))?;
    }
    session.files(6 + u64::from(args.refit), || {
        io::pqr::save(
            session.output("reduced.pqr")?,
            &remaining(&structure, &eliminated.kept, &reduced),
        )?;
        if args.refit {
            save_parameters(session, &reduced)?;
        }
        // Few changes come near the bound, and what there is should be seen; around a bubble inside they are far above.
        let most = errors.iter().flatten().copied().fold(0.0, f64::max);
        let bound = args.epsilon.max(1e-3);
        let top = most.clamp(0.01 * bound, 1.5 * bound);
        let scale = Scale::new(ColorMap::Heat, [0.0, top], "|G − G original| / G");
        let view = View::principal(surfaces[0].positions()).turned(0.25, 0.2);
        let mut scenes = Vec::new();
        for ((name, atoms), (mesh, errors)) in [("original", all), ("reduced", left)]
            .into_iter()
            .zip(surfaces.iter().zip(&errors))
        {
            let layer = products::save_scalars(session, name, mesh, errors, &scale)?;
            let mut scene = Scene::new(vec![layer], view);
            scene.scale = Some(scale.clone());
            scenes.push((format!("{name}: {} atoms", grouped(atoms)), scene));
        }
        session.picture("error", || {
            let mut pictures = Vec::new();
            for (title, scene) in scenes {
                pictures.push((title, scene.draw(session.rasterizer()?, [940, 760])?));
            }
            Ok(sheet(&pictures, 2))
        })
    })
}

/// The density near the surface, and how long it took.
fn density(
    model: &Model,
    spacing: f64,
    session: &Session,
) -> Result<(Sampled<BrickGrid>, f64), Failure> {
    let options = gauss_density::Options {
        spacing,
        max_memory: session.memory(),
        ..Default::default()
    };
    let start = Instant::now();
    let sampled = session.stage("density", || {
        sample_band(model, &options, session.on(session.device.density()))
    })?;
    Ok((sampled, start.elapsed().as_secs_f64()))
}

fn surface(model: &Model, grid: &BrickGrid, session: &Session) -> Result<TriMesh, Failure> {
    let field = PointSampler::new(model, Cutoff::default())?;
    let options = dual_contour::Options {
        max_memory: session.memory(),
        ..Default::default()
    };
    let made = session.stage("surface", || {
        dual_contour::surface(
            grid,
            Some(&field),
            &options,
            session.on(session.device.contour()),
        )
    })?;
    Ok(made.mesh)
}

/// What elimination has changed of the density `G` at each vertex, as a share: Eq. 3.10 with the original density there in
/// place of 1, which it is at points of the isosurface but not all over the triangles between.
fn changes(mesh: &TriMesh, [original, reduced]: [&Model; 2]) -> Result<Vec<f64>, Failure> {
    let cutoff = Cutoff(1e-6);
    let original = PointSampler::new(original, cutoff)?;
    let reduced = PointSampler::new(reduced, cutoff)?;
    let change = |x| {
        let g = reduced.value(x);
        (g - original.value(x)).abs() / g.max(f64::MIN_POSITIVE)
    };
    Ok(mesh.positions().par_iter().map(change).collect())
}

/// Where hardly an atom can go: what wider bounds would let go.
fn wider_bounds(
    model: &Model,
    gone: usize,
    options: &Elimination,
    on: Run<'_, dyn DensityBackend>,
) -> Result<String, Failure> {
    let all = model.atoms();
    let mut lets = Vec::new();
    for epsilon in WIDER.into_iter().filter(|e| *e > options.epsilon) {
        let options = Elimination {
            epsilon,
            ..*options
        };
        let left = eliminate(model, &options, on)?.model.atoms();
        lets.push(format!("{epsilon} lets {} go", grouped(all - left)));
    }
    let more = match lets.is_empty() {
        true => String::new(),
        false => format!("; {}", lets.join(", ")),
    };
    let (gone, all) = (grouped(gone), grouped(all));
    let epsilon = options.epsilon;
    Ok(format!(
        "{gone} of {all} atoms go at --epsilon {epsilon}, since nearly all shape the surface{more}"
    ))
}

/// The remaining atoms with the centres and radii of the model.
fn remaining(structure: &Structure, kept: &[u32], model: &Model) -> Structure {
    let mut left = structure.filter(|atom| kept.binary_search(&(atom as u32)).is_ok());
    for (i, atom) in left.atoms_mut().iter_mut().enumerate() {
        atom.position = model.centers()[i];
        atom.radius = model.radii()[i];
    }
    left
}

/// One line per atom: centre, radius, decay.
fn save_parameters(session: &Session, model: &Model) -> Result<(), Failure> {
    io::save(session.output("reduced.csv")?, |w| {
        writeln!(w, "x,y,z,radius,decay")?;
        let atoms = model
            .centers()
            .iter()
            .zip(model.radii())
            .zip(model.decays());
        for ((c, radius), decay) in atoms {
            writeln!(w, "{},{},{},{radius},{decay}", c.x, c.y, c.z)?;
        }
        Ok(())
    })?;
    Ok(())
}
