//! Atoms, their alternate locations and assemblies, beside gemmi and biotite: every PDB and mmCIF file of the fixtures and,
//! where they are at hand, of the larger data.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use geom_core::Structure;
use geom_core::io::structure::{AltLocs, ReadOptions, ReadReport, read};
use serde_json::Value;

use super::{Lab, integer, number, text};
use crate::{Outcome, fixtures};

/// Biotite keeps f32, Å.
const SINGLE: f64 = 1e-4;

/// What of a file is read: all locations of its atoms, one of each, or an assembly.
enum Part {
    Locations(AltLocs),
    Assembly(String),
}

/// A part of a file as we have read it.
struct Reading {
    label: String,
    report: ReadReport,
    chains: usize,
}

/// Prints rows per file and reader. A file that one of them refuses is said, and counts as no comparison; one that both
/// refuse fails.
pub(super) fn structures(lab: &mut Lab) -> Outcome {
    let (mut readings, mut tasks) = (Vec::new(), Vec::new());
    for file in files()? {
        let entry = read(&file, &everything(AltLocs::All)).map_err(text)?;
        let mut parts = vec![
            Part::Locations(AltLocs::All),
            Part::Locations(AltLocs::Best),
        ];
        parts.extend(entry.report.assemblies.into_iter().map(Part::Assembly));
        for part in &parts {
            let (reading, task) = prepare(lab, &file, part, readings.len())?;
            readings.push(reading);
            tasks.extend(task);
        }
    }
    let answers = lab.ask("structures.py", &tasks)?;
    let answers = answers.as_array().map(Vec::as_slice).unwrap_or_default();
    if answers.len() != readings.len() {
        return Err("structures.py has not answered all".to_owned());
    }
    for (reading, answer) in readings.iter().zip(answers) {
        compare(lab, reading, answer)?;
    }
    Ok(())
}

/// The files that their formats' names end in, those of the larger data without the twins of fixtures.
fn files() -> Result<Vec<PathBuf>, String> {
    let bundled = listed(&fixtures::folder())?;
    let name = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().to_lowercase()
    };
    let known: Vec<String> = bundled.iter().map(name).collect();
    let mut files = bundled;
    match fixtures::shared("pdb") {
        None => println!("NOT AT HAND, not compared: the larger data's structures"),
        Some(folder) => {
            let more = listed(&folder)?.into_iter();
            files.extend(more.filter(|path| !known.contains(&name(path))));
        }
    }
    Ok(files)
}

fn listed(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(folder).map_err(text)?;
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    files.retain(|path| {
        let name = path.to_string_lossy();
        let stem = name.strip_suffix(".gz").unwrap_or(&name);
        stem.ends_with(".pdb") || stem.ends_with(".cif")
    });
    files.sort();
    Ok(files)
}

fn everything(altlocs: AltLocs) -> ReadOptions {
    ReadOptions {
        altlocs,
        waters: true,
        ..Default::default()
    }
}

/// Reads a part, writes its atoms for the others, and says what they shall do.
fn prepare(
    lab: &Lab,
    file: &Path,
    part: &Part,
    number: usize,
) -> Result<(Reading, [String; 4]), String> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let mut options = everything(AltLocs::All);
    let (label, kind, asked) = match part {
        Part::Locations(AltLocs::All) => (name.into_owned(), "locations", "all"),
        Part::Locations(altlocs) => {
            options.altlocs = *altlocs;
            (format!("{name} one location"), "locations", "one")
        }
        Part::Assembly(assembly) => {
            options.assembly = Some(assembly.clone());
            let label = format!("{name} assembly {assembly}");
            (label, "assembly", assembly.as_str())
        }
    };
    let ours = read(file, &options).map_err(text)?;
    let table = lab.file(&format!("atoms_{number}.tsv"));
    std::fs::write(&table, rows(&ours.structure)).map_err(text)?;
    let reading = Reading {
        label,
        chains: chains(&ours.structure),
        report: ours.report,
    };
    let [file, table] = [file, &table].map(|path| path.display().to_string());
    Ok((reading, [file, kind.to_owned(), asked.to_owned(), table]))
}

/// The rows of a part, per reader.
fn compare(lab: &mut Lab, ours: &Reading, answer: &Value) -> Outcome {
    let mut readers = 0;
    for reader in ["gemmi", "biotite"] {
        let theirs = &answer[reader];
        let what = |measure: &str| format!("{}, {reader}: {measure}", ours.label);
        if let Some(why) = theirs["refused"].as_str() {
            println!("{}: REFUSED, not compared: {why}", what("all"));
            continue;
        }
        readers += 1;
        let counts = [
            ("atoms", ours.report.atoms),
            ("chains", ours.chains),
            ("models", ours.report.models),
            ("assemblies", ours.report.assemblies.len()),
            ("copies", ours.report.copies),
            ("dummies", ours.report.membrane.map_or(0, |m| m.dummies)),
        ];
        for (measure, count) in counts {
            // A reader that does not know a measure prints none.
            if theirs[measure].is_number() {
                lab.same(&what(measure), count as i64, integer(theirs, measure)?);
            }
        }
        if theirs["elements"].is_string() {
            println!("{}: not read, not compared", what("elements"));
        }
        if theirs["apart"].is_number() {
            farthest(lab, &what("farthest atom, Å"), theirs, reader)?;
        }
    }
    let label = format!("{}: readers", ours.label);
    lab.row(&label, "1", &readers.to_string(), "1 or more", readers > 0);
    Ok(())
}

/// How far the farthest of our atoms is from theirs of the same chain, residue, name and element, or the other way round.
fn farthest(lab: &mut Lab, what: &str, theirs: &Value, reader: &str) -> Outcome {
    let apart = number(theirs, "apart")?;
    let bound = if reader == "biotite" { SINGLE } else { 1e-9 };
    lab.row(
        what,
        "0",
        &format!("{apart:.1e}"),
        &format!("{bound:.0e}"),
        apart <= bound,
    );
    if apart > bound {
        println!("  for example {}", theirs["example"]);
    }
    Ok(())
}

/// Number of different names of chains.
fn chains(structure: &Structure) -> usize {
    let mut names: Vec<&str> = structure.chains().iter().map(|c| c.name.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    names.len()
}

/// An atom per line: chain, residue's number, insertion code and name, atom's name, element; x, y, z.
fn rows(structure: &Structure) -> String {
    let mut out = String::new();
    for (c, chain) in structure.chains().iter().enumerate() {
        for r in structure.chain_residues(c) {
            let residue = &structure.residues()[r];
            for atom in &structure.atoms()[structure.residue_atoms(r)] {
                let p = atom.position;
                writeln!(
                    out,
                    "{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}",
                    chain.name,
                    residue.number,
                    residue.insertion,
                    residue.name,
                    atom.name,
                    atom.element.symbol().to_uppercase(),
                    p.x,
                    p.y,
                    p.z
                )
                .expect("a string takes all");
            }
        }
    }
    out
}
