//! The loop over all cases and the file of results.

use std::fs::{self, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use dual_contour::{Extent, Method};
use gauss_density::{Cutoff, Levels, Model, PointSampler, sample_band};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::{Cpu, Run, Structure};
use serde_json::{Value, json};

use super::{Arguments, Rows, case, check, files, name, table};
use crate::lab::text;
use crate::{Outcome, root};

fn method(name: &str) -> Method {
    match name {
        "stuffing" => Method::Stuffing,
        _ => Method::DualContour,
    }
}

fn extent(name: &str) -> Extent {
    match name {
        "interior" => Extent::Interior,
        "exterior" => Extent::Exterior,
        _ => Extent::Both,
    }
}

/// A structure at a spacing: all cases that share a density.
struct Batch {
    path: PathBuf,
    name: String,
    atoms: usize,
    spacing: f64,
}

impl Batch {
    /// Its cases: mesher, region and name.
    fn cases<'a>(&self, arguments: &'a Arguments) -> Vec<(&'a str, &'a str, String)> {
        let Self { name, spacing, .. } = self;
        let regions = |m| arguments.region.iter().map(move |r| (m, r));
        let pairs = arguments.method.iter().flat_map(regions);
        pairs
            .map(|(m, r)| (m.as_str(), r.as_str(), format!("{name} {spacing} {m} {r}")))
            .collect()
    }

    /// What every result of it says.
    fn row(&self, mut row: Value, (method, region, key): &(&str, &str, String)) -> Value {
        row["case"] = key.as_str().into();
        row["structure"] = self.name.as_str().into();
        row["atoms"] = self.atoms.into();
        row["spacing"] = self.spacing.into();
        row["method"] = (*method).into();
        row["region"] = (*region).into();
        row
    }
}

pub(super) fn run(arguments: &Arguments) -> Outcome {
    let batches = batches(arguments)?;
    let keys: Vec<String> = batches
        .iter()
        .flat_map(|b| b.cases(arguments))
        .map(|case| case.2)
        .collect();
    if let Some(twice) = (1..keys.len()).find(|&i| keys[..i].contains(&keys[i])) {
        return Err(format!("the case {} would run twice", keys[twice]));
    }
    let out = root().join(&arguments.out);
    let mut rows = earlier(&out)?;
    if arguments.in_process {
        for batch in &batches {
            sweep(batch, arguments, &out, &rows)?;
        }
        return Ok(());
    }
    println!("{} cases, results in {}", keys.len(), out.display());
    for batch in &batches {
        // Each turn of the loop adds a result at least.
        loop {
            let cases = batch.cases(arguments);
            if cases.iter().all(|c| rows.contains_key(&c.2)) {
                break;
            }
            let end = in_own_process(batch, arguments)?;
            rows = earlier(&out)?;
            let dead = cases.iter().find(|c| !rows.contains_key(&c.2));
            if let Some(case) = dead {
                let end = end.err().unwrap_or_else(|| "ended early".to_owned());
                let row = batch.row(json!({ "faults": [end], "misses": [] }), case);
                append(&out, &row, &table::line(&row))?;
                rows.insert(case.2.clone(), row);
            }
        }
    }
    if let Some(path) = &arguments.table {
        let page = table::page(&keys, &rows, arguments.tets);
        fs::write(root().join(path), page).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    table::summary(&keys, &rows)
}

/// All structures at the coarser spacing first: what stops early has seen each of them.
fn batches(arguments: &Arguments) -> Result<Vec<Batch>, String> {
    let mut all = Vec::new();
    for path in files(
        arguments,
        &["pdb", "pockets"],
        &["pdb", "ent", "cif", "pqr"],
    )? {
        let structure = structure(&path)?;
        let atoms = structure.atoms().len();
        let spacings = match arguments.spacing[..] {
            [] => spacings_for(atoms, arguments.tets as f64).to_vec(),
            ref given => given.to_vec(),
        };
        let name = name(&path);
        for (turn, spacing) in spacings.into_iter().enumerate() {
            let batch = Batch {
                path: path.clone(),
                name: name.clone(),
                atoms,
                spacing,
            };
            all.push((turn, batch));
        }
    }
    all.sort_by_key(|(turn, _)| *turn);
    Ok(all.into_iter().map(|(_, batch)| batch).collect())
}

pub(super) fn structure(path: &Path) -> Result<Structure, String> {
    let read = read(path, &ReadOptions::default()).map_err(text)?;
    Ok(read.structure)
}

/// Spacings, Å, that give a molecule about as many tetrahedra inside, and 2.5 times as many. The coarser
/// one is not so coarse that atoms are lost.
pub(super) fn spacings_for(atoms: usize, tets: f64) -> [f64; 2] {
    let h = (0.5 * (atoms as f64 / 1000.0 * 1e6 / tets).cbrt()).min(1.6);
    [h, h / 2.5f64.cbrt()].map(|h| (h * 100.0).round() / 100.0)
}

/// The results so far.
pub(super) fn earlier(path: &Path) -> Result<Rows, String> {
    let lines = match fs::read_to_string(path) {
        Ok(lines) => lines,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Rows::new()),
        Err(e) => return Err(format!("{}: {e}", path.display())),
    };
    let mut rows = Rows::new();
    for (i, line) in lines.lines().enumerate() {
        let row: Value = serde_json::from_str(line)
            .map_err(|e| format!("{}, line {}: {e}", path.display(), i + 1))?;
        let key = row["case"].as_str().unwrap_or_default().to_owned();
        rows.insert(key, row);
    }
    Ok(rows)
}

/// Adds a result and tells it in a line.
pub(super) fn append(path: &Path, row: &Value, told: &str) -> Outcome {
    println!("{told}");
    // In one piece, so that a kill leaves no half of a line.
    let line = format!("{row}\n");
    let file = OpenOptions::new().create(true).append(true).open(path);
    file.and_then(|mut file| file.write_all(line.as_bytes()))
        .map_err(|e| format!("{}: {e}", path.display()))
}

/// Runs what is open of a batch in a process of its own; the inner error says how that died.
fn in_own_process(batch: &Batch, arguments: &Arguments) -> Result<Outcome, String> {
    let program = std::env::current_exe().map_err(text)?;
    let mut command = Command::new(program);
    command
        .args(["sweep", "--in-process", "--spacing"])
        .arg(batch.spacing.to_string())
        .arg("--data")
        .arg(&batch.path)
        .arg("--out")
        .arg(&arguments.out)
        .args(["--method", &arguments.method.join(",")])
        .args(["--region", &arguments.region.join(",")])
        .args(["--python", &arguments.python])
        .stderr(Stdio::piped());
    if let Some(script) = &arguments.meshcheck {
        command.arg("--meshcheck").arg(script);
    }
    let mut child = command.spawn().map_err(text)?;
    let mut said = String::new();
    if let Some(mut stderr) = child.stderr.take() {
        stderr.read_to_string(&mut said).map_err(text)?;
    }
    let status = child.wait().map_err(text)?;
    eprint!("{said}");
    if status.success() {
        return Ok(Ok(()));
    }
    let said = said.trim().replace('\n', "; ");
    Ok(Err(format!("the process died of {status}: {said}")))
}

/// Runs what is open of a batch.
fn sweep(batch: &Batch, arguments: &Arguments, out: &Path, rows: &Rows) -> Outcome {
    let mut open = batch.cases(arguments);
    open.retain(|c| !rows.contains_key(&c.2));
    if open.is_empty() {
        return Ok(());
    }
    let start = Instant::now();
    let structure = structure(&batch.path)?;
    let model = Model::uniform(&structure, &Levels::default()).map_err(text)?;
    let options = gauss_density::Options {
        spacing: batch.spacing,
        ..Default::default()
    };
    let grid = sample_band(&model, &options, Run::on(&Cpu))
        .map_err(text)?
        .grid;
    let field = PointSampler::new(&model, Cutoff::default()).map_err(text)?;
    let density_s = start.elapsed().as_secs_f64();
    for name in &arguments.method {
        let mine = || open.iter().filter(|c| c.0 == name);
        if mine().next().is_none() {
            continue;
        }
        let expected = case::expected(&grid, &field, method(name));
        for case in mine() {
            let region = extent(case.1);
            let done = case::run(&grid, &field, method(name), region, expected.clone());
            let mut row = batch.row(done.row, case);
            row["density_s"] = density_s.into();
            if let (Some(script), Some((mesh, surface)), true) =
                (&arguments.meshcheck, &done.mesh, check::is_chosen(&case.2))
            {
                let faults = check::check(&arguments.python, script, mesh, surface, region, &row)?;
                row["checked"] = true.into();
                if let Some(all) = row["faults"].as_array_mut() {
                    all.extend(faults.into_iter().map(Value::from));
                }
            }
            append(out, &row, &table::line(&row))?;
        }
    }
    Ok(())
}
