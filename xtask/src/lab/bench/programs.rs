//! The programs by their default options, with their files and pictures, stage by stage.

use std::path::Path;

use serde_json::Value;

use super::baseline::Figures;
use crate::lab::text;
use crate::{Outcome, fixtures, root, target};

/// A program and its arguments; `@a` is a bundled file, or one of the larger data.
struct Case {
    program: &'static str,
    arguments: &'static str,
}

const fn case(program: &'static str, arguments: &'static str) -> Case {
    Case { program, arguments }
}

/// The whole chain on a small protein, then what people ask of each program.
const CASES: [Case; 20] = [
    case("00_pipeline", "@1AJJ.pdb"),
    case("01_density", "@1A8O.pdb"),
    case("02_surface", "@1A8O.pdb"),
    case("02_surface", "@pdb/1su4.pdb --spacing 0.5"),
    case("03_tets", "@1A8O.pdb"),
    case("03_tets", "@pdb/1su4.pdb"),
    case("04_improve", "@repro/groups.msh"),
    case("05_eliminate", "@1A8O.pdb"),
    case("06_modes", "@spot.ply"),
    case("07_field", "@spot.ply"),
    case("08_quads", "@spot.ply"),
    case("08_quads", "@1AJJ.pdb --spacing 1"),
    case("08_quads", "@meshes/dir_fertility.obj"),
    case("10_tmesh", "@spot.ply"),
    case("11_tspline", "@spot.ply"),
    case("12_correspond", "@1A8O.pdb @1A8O.cif"),
    case("15_segment", "@spot.ply"),
    case("16_pockets", "@1hvr.pdb"),
    case("16_pockets", "@pockets/1eve.pdb"),
    case("17_smooth", "@spot.ply"),
];

/// Builds the programs as their users do, runs each, and notes the shortest time of every stage.
pub(super) fn run(figures: &mut Figures, runs: u32) -> Outcome {
    let build = [
        "build",
        "--quiet",
        "--release",
        "--package",
        "biogeom-examples",
        "--examples",
    ];
    crate::call("cargo", &build, &[])?;
    println!("programs, files and pictures included; shortest of {runs}, s");
    for case in &CASES {
        let Some(arguments) = arguments(case) else {
            println!("  {} {}: not at hand", case.program, case.arguments);
            continue;
        };
        let mut shortest: Vec<(String, f64)> = Vec::new();
        for _ in 0..runs {
            let stages = stages(case.program, &arguments)?;
            if shortest.is_empty() {
                shortest = stages;
                continue;
            }
            for ((_, least), (_, seconds)) in shortest.iter_mut().zip(stages) {
                *least = least.min(seconds);
            }
        }
        let name = format!("{} {}", case.program, case.arguments.replace('@', ""));
        let told: Vec<String> = shortest
            .iter()
            .map(|(stage, seconds)| format!("{stage} {seconds:.2}"))
            .collect();
        println!("  {name}: {}", told.join(", "));
        for (stage, seconds) in shortest {
            figures.seconds(format!("{name} · {stage}"), seconds);
        }
    }
    Ok(())
}

/// With the places of the files; `None` if one is not at hand.
fn arguments(case: &Case) -> Option<Vec<String>> {
    let place = |word: &str| match word.strip_prefix('@') {
        None => Some(word.to_owned()),
        Some(file) => {
            let bundled = fixtures::folder().join(file);
            let found = bundled.exists().then_some(bundled);
            let found = found.or_else(|| fixtures::shared(file))?;
            Some(found.display().to_string())
        }
    };
    case.arguments.split(' ').map(place).collect()
}

/// Runs a program: the whole and each of its stages, s. Stages of one name count together.
fn stages(program: &str, arguments: &[String]) -> Result<Vec<(String, f64)>, String> {
    let out = root().join("target/bench-programs").join(program);
    let binary = target().join("release/examples").join(program);
    let mut all = arguments.to_vec();
    all.extend(["--quiet".into(), "--out".into(), out.display().to_string()]);
    crate::capture(&binary.display().to_string(), &all)?;
    let report = report(&out.join("report.json"))?;
    let whole = report["seconds"].as_f64().unwrap_or_default();
    let mut stages = vec![("whole".to_owned(), whole)];
    for stage in report["stages"].as_array().into_iter().flatten() {
        let name = stage["name"].as_str().unwrap_or_default();
        let seconds = stage["seconds"].as_f64().unwrap_or_default();
        match stages.iter_mut().find(|(other, _)| other == name) {
            Some((_, sum)) => *sum += seconds,
            None => stages.push((name.to_owned(), seconds)),
        }
    }
    Ok(stages)
}

fn report(path: &Path) -> Result<Value, String> {
    let file = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    serde_json::from_str(&file).map_err(text)
}
