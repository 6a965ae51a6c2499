//! `cargo xtask thesis 4`, of which `4.8` to `4.11` are parts: cross fields and quads that follow eigenfunctions. Chapter 4 has
//! figures, and of numbers the singularities of its thin filament alone: 144 with two modes, 178 with principal curvatures.
//! What is printed here stands beside those figures; its models are at hand, but for the filament and 4KYT.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::time::Instant;

use crossfield::anisotropy::{Adaptation, Anisotropy, Function};
use crossfield::field::Frames;
use crossfield::guidance::{Modes, Normalization, guides};
use crossfield::{CrossField, FieldOptions, Guidance, Options, Size, cross_field, quadrangulate};
use geom_core::io::mesh;
use geom_core::io::structure::{ReadOptions, read};
use geom_core::{Cpu, Point3, Run, Structure, TriMesh};

use super::text;
use crate::lab::density_surface;
use crate::{Outcome, fixtures};

/// Decay of the Gaussians, for surfaces as smooth as the thesis's.
const SMOOTH: f64 = 0.1;
/// Quads of the models of the figures.
const QUADS: usize = 2000;

pub(crate) fn run() -> Outcome {
    ways_to_guide()?;
    weights()?;
    anisotropy()?;
    filament()
}

/// Figs. 4.2–4.8: isocontours and characteristic values, of few modes and more.
pub(crate) fn ways_to_guide() -> Outcome {
    println!("\nFigs. 4.2–4.8: bands of isocontours and of characteristic values, hard");
    heading("surface, guidance");
    for name in ["cgal_hand.off", "dir_eight.off"] {
        let Some(surface) = model(name)? else {
            continue;
        };
        for last in [2, 6] {
            let modes = || Modes::Numbers((1..=last).collect());
            row(
                &format!("{name}, isocontours of modes 1–{last}"),
                &surface,
                vec![isocontours(modes(), f64::INFINITY)],
            )?;
            let characteristic = Guidance::Characteristic {
                modes: modes(),
                normalization: Normalization::Normalized,
                weight: f64::INFINITY,
            };
            row(
                &format!("{name}, characteristic values of modes 1–{last}"),
                &surface,
                vec![characteristic],
            )?;
        }
        row(
            &format!("{name}, isocontours of Modes::Auto"),
            &surface,
            vec![isocontours(Modes::Auto, f64::INFINITY)],
        )?;
        row(&format!("{name}, no guidance"), &surface, Vec::new())?;
    }
    Ok(())
}

/// Fig. 4.9: what λ̄ trades.
pub(crate) fn weights() -> Outcome {
    println!("\nFig. 4.9: isocontours of the Hand's modes 1–6 by their weight λ̄");
    heading("λ̄");
    let Some(surface) = model("cgal_hand.off")? else {
        return Ok(());
    };
    for weight in [0.05, 0.5, 5.0, f64::INFINITY] {
        let modes = Modes::Numbers((1..=6).collect());
        row(
            &format!("{weight}"),
            &surface,
            vec![isocontours(modes, weight)],
        )?;
    }
    Ok(())
}

/// Figs. 4.10 and 4.12: quads that are narrow along a gradient.
pub(crate) fn anisotropy() -> Outcome {
    println!("\nFigs. 4.10 and 4.12: quads five times as long as wide where a mode is steep");
    println!(
        "| surface, mode | spacing | crosses adapted | rung | milder | quads | irregular | off the gradient, 95 %, ° | \
         sides, 95 % | J least / mean | s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let bunny = model("dir_bunny.off")?.map(|mesh| ("Bunny, 1", 1, mesh));
    let protein =
        protein("pdb/1su4.pdb", 2.5)?.map(|mesh| ("1SU4, 3 (the pump that 4KYT is)", 3, mesh));
    for (name, mode, surface) in bunny.into_iter().chain(protein) {
        // Eq. 4.13 jumps at half the steepest gradient, ours is a ramp.
        for (law, ramp) in [("jump", [0.5, 0.5]), ("ramp", [0.3, 0.9])] {
            for adaptation in [None, Some(Adaptation::default())] {
                let adapts = if adaptation.is_some() { "yes" } else { "no" };
                let anisotropy = Anisotropy {
                    ramp,
                    adaptation,
                    ..Anisotropy::of(Function::Mode(mode))
                };
                let options = Options {
                    size: Size::Quads(QUADS),
                    anisotropy: Some(anisotropy),
                    ..Options::default()
                };
                let clock = Instant::now();
                let made = quadrangulate(&surface, &options, Run::on(&Cpu)).map_err(text)?;
                let (report, part) = (&made.report, &made.report.parts[0]);
                let off = part.misalignment.as_ref().map(|m| m.percentile_95);
                println!(
                    "| {name} | {law} | {adapts} | {:?}{} | {} | {} | {} | {} | {:.1} | {:.2} / {:.3} | {:.1} |",
                    part.rung,
                    if part.squares { ", squares" } else { "" },
                    part.milder,
                    made.mesh.quads().len(),
                    report.valences.irregular(),
                    off.map_or_else(|| "–".to_owned(), |off| format!("{off:.1}")),
                    report.aspect_ratio.percentile_95,
                    report.scaled_jacobian.min,
                    report.scaled_jacobian.mean,
                    clock.elapsed().as_secs_f64(),
                );
            }
        }
    }
    Ok(())
}

/// Fig. 4.11: few modes, more, and principal curvatures on a long body full of bumps.
pub(crate) fn filament() -> Outcome {
    println!(
        "\nFig. 4.11, the thin filament: 144 singularities with modes 1–2, 178 with curvatures. It is not at hand; two that \
         are long and full of bumps stand in"
    );
    heading("surface, guidance");
    let beads = density_surface(&beads(), 0.005, 4.0)?;
    let virus = fixtures::shared("large/2tmv.pdb").map(|path| {
        let options = ReadOptions {
            assembly: Some("1".into()),
            ..ReadOptions::default()
        };
        density_surface(&read(&path, &options).map_err(text)?.structure, SMOOTH, 5.0)
    });
    let mut bodies = vec![("double helix of beads", beads)];
    match virus {
        Some(surface) => bodies.push(("2TMV × 49", surface?)),
        None => println!("| large/2tmv.pdb | not at hand |"),
    }
    for (name, surface) in &bodies {
        for last in [2, 14, 39] {
            let modes = Modes::Numbers((1..=last).collect());
            let name = format!("{name}, modes 1–{last}");
            row(&name, surface, vec![isocontours(modes, f64::INFINITY)])?;
        }
        let curvature = Guidance::Curvature {
            threshold: 0.8,
            weight: f64::INFINITY,
        };
        row(&format!("{name}, curvatures"), surface, vec![curvature])?;
        row(&format!("{name}, no guidance"), surface, Vec::new())?;
    }
    Ok(())
}

fn heading(first: &str) {
    println!(
        "| {first} | guided | conflicts | singularities as the thesis has them | energy, rad² | off the guides, mean ° | of our \
         default field | irregular of {QUADS} quads | J least / mean | rung | s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
}

/// A surface with a guidance: the thesis's field, which minimizes Eq. 4.9, and quads of the default one.
fn row(name: &str, surface: &TriMesh, guidance: Vec<Guidance>) -> Outcome {
    let clock = Instant::now();
    let options = Options {
        size: Size::Quads(QUADS),
        guidance,
        ..Options::default()
    };
    let plain = FieldOptions {
        singularity_penalty: 0.0,
        ..FieldOptions::default()
    };
    let frames = Frames::of(surface, plain.weights).map_err(text)?;
    let wishes = guides(surface, &frames, &options.guidance).map_err(text)?;
    let field = cross_field(surface, &wishes, &plain, Run::on(&Cpu)).map_err(text)?;
    let made = quadrangulate(surface, &options, Run::on(&Cpu)).map_err(text)?;
    let own = made.report.parts.iter().filter_map(|p| p.field.as_ref());
    println!(
        "| {name} | {} | {} | {} | {:.0} | {:.1} | {} | {} of {} | {:.2} / {:.3} | {:?} | {:.1} |",
        field.report.guided,
        field.report.conflicts,
        field.report.singularities,
        field.report.energy,
        off_the_guides(&frames, &wishes, &field),
        own.map(|f| f.singularities).sum::<usize>(),
        made.report.valences.irregular(),
        made.mesh.quads().len(),
        made.report.scaled_jacobian.min,
        made.report.scaled_jacobian.mean,
        made.report.rung(),
        clock.elapsed().as_secs_f64(),
    );
    Ok(())
}

/// The mean angle between the guides and the arms next to them, degrees; 0 without guides.
fn off_the_guides(frames: &Frames, guides: &[crossfield::field::Guide], field: &CrossField) -> f64 {
    let off = |guide: &crossfield::field::Guide| {
        let turn = guide.angle(frames) - field.theta[guide.face as usize];
        (turn - FRAC_PI_2 * (turn / FRAC_PI_2).round()).abs()
    };
    let sum = guides.iter().map(off).fold(0.0, |sum, off| sum + off);
    (sum / guides.len().max(1) as f64).to_degrees()
}

fn isocontours(modes: Modes, weight: f64) -> Guidance {
    Guidance::Isocontours {
        modes,
        inset: 0.125,
        weight,
    }
}

/// A mesh of the larger data set, or `None` with a line that says that it is absent.
fn model(name: &str) -> Result<Option<TriMesh>, String> {
    let Some(path) = fixtures::shared(&format!("meshes/{name}")) else {
        println!("| {name} | not at hand |");
        return Ok(None);
    };
    Ok(Some(mesh::read(&path).map_err(text)?.mesh.into_triangles()))
}

/// The density's surface of a structure of the larger data set, or `None` with a line that says that it is absent.
fn protein(file: &str, spacing: f64) -> Result<Option<TriMesh>, String> {
    let Some(path) = fixtures::shared(file) else {
        println!("| {file} | not at hand |");
        return Ok(None);
    };
    let structure = read(&path, &ReadOptions::default())
        .map_err(text)?
        .structure;
    Ok(Some(density_surface(&structure, SMOOTH, spacing)?))
}

/// Two strands of beads wound around each other, as the actins of a filament are: 13 pairs a turn, 27 Å along the axis each.
fn beads() -> Structure {
    const PAIRS: u32 = 30;
    let bead = |n: u32| {
        let (pair, strand) = (n / 2, n % 2);
        let angle = TAU * (f64::from(pair) / 26.0 + f64::from(strand) / 2.0);
        let along = 27.0 * f64::from(pair) + 13.5 * f64::from(strand);
        let position = Point3::new(24.0 * angle.cos(), 24.0 * angle.sin(), along);
        (position, 26.0)
    };
    Structure::of_spheres((0..2 * PAIRS).map(bead))
}
